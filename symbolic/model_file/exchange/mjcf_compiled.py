"""MJCF compiled by the package `mujoco`, without what is only drawn and without files of meshes.

Source: the XML reference at mujoco.readthedocs.io.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symbolic.model_file.checks import LARGEST, ModelError, printable, quote
from symbolic.model_file.exchange.unfolding import OTHER_FILES, check_unfolded
from symbolic.model_file.exchange.xml_file import XmlNode
from symbolic.model_file.frames import Vector

UNSEEN = ("keys", "sensors", "pairs", "excludes", "skins", "flexes", "equalities", "tendons")
"""Parts of a description that say nothing of a single arm, but may refer to shapes that are not read."""
NUMBERS = (
    *("body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia", "site_pos", "site_quat"),
    *("jnt_pos", "jnt_axis", "jnt_stiffness", "qpos0", "qpos_spring", "dof_damping", "dof_frictionloss"),
    *("dof_armature", "actuator_gear", "actuator_armature", "actuator_damping"),
)
"""What is taken of the compiled model, where this MuJoCo knows it; MuJoCo lets some of it be no number."""
SUFFIX = ".xml"
"""By which MuJoCo knows a description."""
RESERVED = ("memory", "njmax", "nconmax", "nstack")
RESERVED_BY_USERS = ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor")
"""Room that a description asks for, and numbers of users beside its parts: MuJoCo knows itself what an arm needs."""


@dataclass(frozen=True)
class CompiledMjcf:
    """model: MuJoCo's; unknown: names of bodies whose inertia the file does not state, in which the model has some;
    gravity in m/s²; notes: what of the file is not part of an arm, a line each."""

    model: Any
    name: str
    unknown: frozenset[str]
    gravity: Vector
    notes: tuple[str, ...]


def compiled(path: Path, root: XmlNode) -> CompiledMjcf:
    """The file as MuJoCo understands it.

    root   of the file, by which it is judged before MuJoCo unfolds it
    Raises ModelError: `mujoco` is not installed or too old, refuses the file, or finds what is no number.
    """
    file = printable(str(path))
    mujoco = _package(file)
    check_unfolded(root, path)
    try:
        with _heard(mujoco) as warned:
            spec = _spec(mujoco, path, root)
            _check_numbers(root, warned)
            notes = list(_no_part_of_an_arm(spec))
            _without_room(spec)
            unknown = _without_shapes(mujoco, spec)
            model = spec.compile()
    except ModelError:
        raise
    except (ValueError, OSError, RuntimeError, MemoryError) as error:
        raise ModelError(f"{file}: MuJoCo says: {printable(' '.join(str(error).split()))}") from None
    x, y, z = (float(g) for g in model.opt.gravity)
    known = ((name, getattr(model, name).flat) for name in NUMBERS if hasattr(model, name))
    for what, values in (("gravity", (x, y, z)), *known):
        for value in values:
            if not abs(value) <= LARGEST:
                raise ModelError(f"{file}: MuJoCo's {what} is {value:g}; expected magnitudes up to {LARGEST:g}")
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        notes.append("gravity is switched off by a flag of the file: taken as 0")
        x, y, z = 0.0, 0.0, 0.0
    said = (f"MuJoCo warns: {printable(' '.join(text.split()))}" for text in warned)
    return CompiledMjcf(model, spec.modelname, frozenset(unknown), (x, y, z), (*said, *notes))


def _package(file: str) -> Any:
    """mujoco. Raises ModelError where it is not installed, or too old."""
    try:
        mujoco = importlib.import_module("mujoco")
    except ImportError:
        raise ModelError(
            f"{file}: MJCF is read by the package mujoco, which is not installed: pip install mujoco (the extra `mjcf`)"
        ) from None
    if not hasattr(getattr(mujoco, "MjSpec", None), "delete"):
        raise ModelError(
            f"{file}: MJCF needs a newer mujoco than {printable(str(mujoco.__version__))}: pip install --upgrade "
            "mujoco (the extra `mjcf`)"
        )
    return mujoco


def _spec(mujoco: Any, path: Path, root: XmlNode) -> Any:
    """What MuJoCo makes of a file; it goes by the name, and finds others by the place of a file alone."""
    if path.suffix.lower() == SUFFIX:
        return mujoco.MjSpec.from_file(str(path))
    others = next((node for node in root.everything() if node.tag in OTHER_FILES), None)
    if others is not None:
        others.fail(f"<{others.tag}> of another file is read of a file that ends in {SUFFIX} alone; rename this one")
    return mujoco.MjSpec.from_string(path.read_bytes().decode())


def _check_numbers(root: XmlNode, warned: list[str]) -> None:
    """MuJoCo warns of a NaN, and takes it for a number that was left out. Raises ModelError, at its line."""
    if not any("nan" in text.lower() for text in warned):
        return
    for node in (root, *root.everything()):
        for key, value in node.attributes.items():
            if key != "name" and any(word.lstrip("+-").startswith("nan") for word in value.lower().split()):
                node.fail(f"<{node.tag}> {key} is {quote(value)}; expected numbers that are finite")
    root.fail("a file that it includes has a NaN; expected numbers that are finite")


@contextmanager
def _heard(mujoco: Any) -> Iterator[list[str]]:
    """What MuJoCo warns of meanwhile, which it would write to the screen and to a file in the user's folder."""
    texts: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(texts.append)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield texts
    finally:
        mujoco.set_mju_user_warning(before)


def _no_part_of_an_arm(spec: Any) -> Iterator[str]:
    """What has torques in MuJoCo and none in an arm's equations."""
    if len(spec.equalities) + len(spec.tendons):
        yield "equality constraints and tendons are not part of an arm: left out"
    if any(body.gravcomp != 0 for body in spec.bodies):
        yield "gravcomp, which takes bodies' weight away, is not part of an arm: left out"
    if spec.option.density or spec.option.viscosity:
        yield "the drag of air or water (density, viscosity) is not part of an arm: left out"


def _without_room(spec: Any) -> None:
    """Take away what fills memory by a single number and says nothing of an arm."""
    spec.nuserdata = spec.nkey = 0
    for name in (*RESERVED, *(f"nuser_{part}" for part in RESERVED_BY_USERS)):
        setattr(spec, name, -1)
    for actuator in spec.actuators:
        actuator.actdim = -1


def _without_shapes(mujoco: Any, spec: Any) -> set[str]:
    """Take away what is only drawn, and what needs a file of a mesh: the names of bodies whose inertia that leaves
    unknown, which get some to be compiled."""
    for kind in UNSEEN:
        for item in list(getattr(spec, kind, ())):
            spec.delete(item)
    for actuator in list(spec.actuators):
        if actuator.trntype not in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            spec.delete(actuator)
    bodies, unknown = list(spec.bodies), set()
    for k, body in enumerate(bodies):
        if not body.name:
            body.name = f"body{k}"
        geoms = list(body.geoms)
        stored = [geom for geom in geoms if geom.meshname or geom.hfieldname]
        if k > 0 and any(_weighs(mujoco, spec, body, geom) for geom in stored):
            unknown.add(body.name)
            body.explicitinertial, body.mass, body.inertia = True, 1.0, [1.0, 1.0, 1.0]
        for geom in stored:
            # To take it out of the list takes a time that grows with the square of the list.
            geom.type, geom.size, geom.mass = mujoco.mjtGeom.mjGEOM_SPHERE, [1.0, 1.0, 1.0], float(body.name in unknown)
            geom.meshname = geom.hfieldname = ""
        for drawn in [*geoms, *body.sites]:
            drawn.material = ""
    for asset in [*spec.meshes, *spec.hfields, *spec.materials, *spec.textures]:
        spec.delete(asset)
    if unknown and spec.compiler.settotalmass > 0:
        # The masses that are stated are scaled to a sum in which those of meshes are.
        unknown = {body.name for body in bodies}
    return unknown


def _weighs(mujoco: Any, spec: Any, body: Any, geom: Any) -> bool:
    """Whether a body has inertia from this shape."""
    source, rules = spec.compiler.inertiafromgeom, mujoco.mjtInertiaFromGeom
    if source == rules.mjINERTIAFROMGEOM_FALSE or (source == rules.mjINERTIAFROMGEOM_AUTO and body.explicitinertial):
        return False
    first, last = spec.compiler.inertiagrouprange
    return bool(geom.mass != 0 and geom.density != 0 and first <= geom.group <= last)
