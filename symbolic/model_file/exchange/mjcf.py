"""MJCF read with the package `mujoco`, which knows its defaults, includes and inertias from shapes.

Shapes that are only drawn, and mesh files, are left out. The size that includes and repetitions expand to is checked
before MuJoCo expands them. Source: the XML reference at mujoco.readthedocs.io.
"""

from __future__ import annotations

import importlib
import math
import warnings
from collections.abc import Iterable, Iterator, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symbolic.model_file.arm import Frame
from symbolic.model_file.checks import LARGEST, ModelError, printable, quote
from symbolic.model_file.exchange import xml_file
from symbolic.model_file.exchange.tree import Tree, TreeJoint, TreeLink, shortened
from symbolic.model_file.exchange.xml_file import XmlNode
from symbolic.model_file.frames import (
    NO_BODY,
    Rotation,
    StatedBody,
    Vector,
    about,
    added,
    angles,
    composed,
    packed,
    product,
    scaled,
    transposed,
)

MAX_UNFOLDED = 10_000
"""Elements including repetitions; MuJoCo compiles these in a second, with a time that grows quadratically. The largest
published robot models have a few thousand."""
MAX_NUMBERS = 100_000_000
"""Maximum size of height fields and textures, which are not read."""
REPEATED = ("replicate", "composite", "flexcomp")
"""Elements whose content is repeated `count` times, in up to three directions."""
GRIDS = {"hfield": ("nrow", "ncol"), "texture": ("width", "height")}
"""Elements with grids, and the attributes of their size."""
INCLUDED, ATTACHED = "include", "attach"
OTHER_FILES = (INCLUDED, "model")
"""Elements whose `file` is another MJCF file."""


@dataclass
class _Unfolding:
    """Counts the elements of a file and of the files that it includes; at most MAX_UNFOLDED are allowed.

    seen       files that were read
    largest    elements of the largest model that may be attached
    attached   number of attachments, each counted with the largest model
    """

    folder: Path
    seen: set[Path]
    count: int = 0
    largest: int = 0
    attached: float = 0.0

    def add(self, root: XmlNode) -> None:
        """Count a file's elements and those of its other files."""
        todo = [(root, 1.0)]
        while todo:
            node, times = todo.pop()
            if node.tag in REPEATED:
                times *= math.prod(_counts(node, "count"))
            if math.prod(max(_counts(node, key)) for key in GRIDS.get(node.tag, ())) > MAX_NUMBERS:
                node.fail(f"<{node.tag}> has more numbers than a robot needs; make it smaller, or leave it out")
            self.count += round(min(times, 1.0 + MAX_UNFOLDED))
            if node.tag == ATTACHED:
                self.attached += min(times, 1.0 + MAX_UNFOLDED)
            if node.tag in OTHER_FILES and node.attributes.get("file"):
                self._other(node.tag, self.folder / node.attributes["file"])
            if self.count + self.attached * self.largest > MAX_UNFOLDED:
                node.fail(f"unfolds into more than {MAX_UNFOLDED:,} elements; expected the description of a robot")
            todo += [(child, times) for child in node.children]

    def _other(self, tag: str, path: Path) -> None:
        """Count a named file; MuJoCo itself reports missing and repeated files."""
        if not path.is_file() or path.resolve() in self.seen:
            return
        self.seen.add(path.resolve())
        root = xml_file.read(path)
        if tag == INCLUDED:
            self.add(root)
            return
        model = _Unfolding(self.folder, self.seen)
        model.add(root)
        size = model.count + round(model.attached * model.largest)
        self.count, self.largest = self.count + size, max(self.largest, size)


def _counts(node: XmlNode, key: str) -> list[float]:
    """The numbers of an attribute above 1; MuJoCo itself reports invalid ones."""
    found = [1.0]
    for word in node.attributes.get(key, "").split():
        try:
            found.append(max(1.0, float(word)))
        except ValueError:
            continue
    return found


UNSEEN = ("keys", "sensors", "pairs", "excludes", "skins", "flexes", "equalities", "tendons")
"""Parts that do not concern a single arm but may refer to shapes that are not read."""
NUMBERS = (
    *("body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia", "site_pos", "site_quat"),
    *("jnt_pos", "jnt_axis", "jnt_stiffness", "qpos0", "qpos_spring", "dof_damping", "dof_frictionloss"),
    *("dof_armature", "actuator_gear", "actuator_armature", "actuator_damping"),
)
"""The arrays that are read, if this MuJoCo version has them; MuJoCo allows NaN in some."""
SUFFIX = ".xml"
"""The file suffix by which MuJoCo recognises MJCF."""
RESERVED = ("memory", "njmax", "nconmax", "nstack")
RESERVED_BY_USERS = ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor")
"""Memory sizes and user data that a file may request; MuJoCo determines by itself what an arm needs."""


def compiled(path: Path, root: XmlNode) -> tuple[Any, Any, set[str], list[str]]:
    """The file compiled by MuJoCo: its specification, the model, the bodies whose inertia the file does not state
    (MuJoCo's is a dummy), and notes on parts of the file that are not part of an arm.

    root   the file's XML, which is checked before MuJoCo expands it
    Raises ModelError: `mujoco` is not installed or too old, or MuJoCo refuses the file.
    """
    file = printable(str(path))
    mujoco = _package(file)
    _Unfolding(path.parent, {path.resolve()}).add(root)
    try:
        with _heard(mujoco) as warned:
            # MuJoCo recognises the format by the suffix, and finds other files by the path.
            others = next((node for node in root.everything() if node.tag in OTHER_FILES), None)
            if path.suffix.lower() == SUFFIX:
                spec = mujoco.MjSpec.from_file(str(path))
            elif others is None:
                spec = mujoco.MjSpec.from_string(path.read_bytes().decode())
            else:
                others.fail(f"<{others.tag}> of another file needs a file name that ends in {SUFFIX}; rename this one")
            _check_numbers(root, warned)
            notes = _not_of_an_arm(spec)
            # Requested memory and user data.
            spec.nuserdata = spec.nkey = 0
            for name in (*RESERVED, *(f"nuser_{part}" for part in RESERVED_BY_USERS)):
                setattr(spec, name, -1)
            for actuator in spec.actuators:
                actuator.actdim = -1
            unknown = _without_shapes(mujoco, spec)
            model = spec.compile()
    except ModelError:
        raise
    except (ValueError, OSError, RuntimeError, MemoryError) as error:
        raise ModelError(f"{file}: MuJoCo says: {printable(' '.join(str(error).split()))}") from None
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        notes.append("gravity is disabled by a flag of the file: set to 0")
        model.opt.gravity[:] = 0.0
    return spec, model, unknown, [*(f"MuJoCo warns: {printable(' '.join(text.split()))}" for text in warned), *notes]


def _package(file: str) -> Any:
    """The package. Raises ModelError if it is not installed or too old."""
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


def _check_numbers(root: XmlNode, warned: list[str]) -> None:
    """MuJoCo only warns of NaN and treats it as a missing number. Raises ModelError with the line."""
    if not any("nan" in text.lower() for text in warned):
        return
    for node in (root, *root.everything()):
        for key, value in node.attributes.items():
            if key != "name" and any(word.lstrip("+-").startswith("nan") for word in value.lower().split()):
                node.fail(f"<{node.tag}> {key} is {quote(value)}; expected numbers that are finite")
    root.fail("a file that it includes has a NaN; expected numbers that are finite")


@contextmanager
def _heard(mujoco: Any) -> Iterator[list[str]]:
    """Collects MuJoCo's warnings, which it would otherwise print and write to a file in the working directory."""
    texts: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(texts.append)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield texts
    finally:
        mujoco.set_mju_user_warning(before)


def _not_of_an_arm(spec: Any) -> list[str]:
    """Notes on forces that MuJoCo has and an arm's equations do not."""
    found = {
        "equality constraints and tendons are": len(spec.equalities) + len(spec.tendons),
        "gravcomp (gravity compensation of bodies) is": any(body.gravcomp != 0 for body in spec.bodies),
        "the drag of air or water (density, viscosity) is": spec.option.density or spec.option.viscosity,
    }
    return [f"{what} not part of an arm: left out" for what, there in found.items() if there]


def _without_shapes(mujoco: Any, spec: Any) -> set[str]:
    """Remove visual parts and everything that needs a mesh file. Returns the bodies whose inertia is then unknown; they
    get a dummy inertia so that MuJoCo compiles them."""
    for kind in UNSEEN:
        for item in list(getattr(spec, kind, ())):
            spec.delete(item)
    for actuator in list(spec.actuators):
        if actuator.trntype not in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            spec.delete(actuator)
    bodies, unknown = list(spec.bodies), set()
    rule, rules = spec.compiler.inertiafromgeom, mujoco.mjtInertiaFromGeom
    first, last = spec.compiler.inertiagrouprange
    for k, body in enumerate(bodies):
        if not body.name:
            body.name = f"body{k}"
        geoms = list(body.geoms)
        stored = [geom for geom in geoms if geom.meshname or geom.hfieldname]
        stated = rule == rules.mjINERTIAFROMGEOM_FALSE or (
            rule == rules.mjINERTIAFROMGEOM_AUTO and body.explicitinertial
        )
        heavy = [geom for geom in stored if geom.mass != 0 and geom.density != 0 and first <= geom.group <= last]
        if k > 0 and heavy and not stated:
            unknown.add(body.name)
            body.explicitinertial, body.mass, body.inertia = True, 1.0, [1.0, 1.0, 1.0]
        for geom in stored:
            # Deleting each from the list would take quadratic time.
            geom.type, geom.size, geom.mass = mujoco.mjtGeom.mjGEOM_SPHERE, [1.0, 1.0, 1.0], float(body.name in unknown)
            geom.meshname = geom.hfieldname = ""
        for drawn in [*geoms, *body.sites]:
            drawn.material = ""
    for asset in [*spec.meshes, *spec.hfields, *spec.materials, *spec.textures]:
        spec.delete(asset)
    if unknown and spec.compiler.settotalmass > 0:
        # Stated masses are scaled to a total that includes the meshes'.
        unknown = {body.name for body in bodies}
    return unknown


KINDS = ("free", "ball", "prismatic", "revolute")
"""Joint kinds by MuJoCo's number."""
PLAIN = (0, 0)
"""Gain and bias types of an actuator whose control is its force, such as a motor."""


def mjcf_tree(path: Path, root: XmlNode) -> Tree:
    """The bodies and joints of an MJCF file; sites become links without a body.

    root   the file's XML
    Raises ModelError, see `compiled`.
    """
    spec, model, unknown, notes = compiled(path, root)
    x, y, z = _vector(model.opt.gravity)
    read = ((name, getattr(model, name).flat) for name in NUMBERS if hasattr(model, name))
    for what, values in (("gravity", (x, y, z)), *read):
        for value in values:
            if not abs(value) <= LARGEST:
                raise ModelError(f"{root.file}: MuJoCo's {what} is {value:g}; expected magnitudes up to {LARGEST:g}")
    # Newer MuJoCo versions have nonlinear damping and springs.
    for what, name in (("damping", "dof_dampingpoly"), ("stiffness", "jnt_stiffnesspoly")):
        if hasattr(model, name) and getattr(model, name).any():
            notes.append(f"{what} is a polynomial: its linear coefficient is used, the others are left out")
    links, joints = _Bodies(model, unknown).tree()
    return Tree(root.file, "MJCF", spec.modelname, links=links, joints=joints, gravity=(x, y, z), notes=tuple(notes))


class _Bodies:
    """Converts MuJoCo's arrays into links and joints; a body with several joints gets a link for each."""

    def __init__(self, model: Any, unknown: Set[str]) -> None:
        self.model, self.unknown = model, unknown
        self.frames: dict[int, tuple[str, Frame]] = {0: (model.body(0).name, Frame())}
        """For every body, its link and the pose of its frame in the link's frame."""

    def tree(self) -> tuple[dict[str, TreeLink], dict[str, TreeJoint]]:
        links = {self.frames[0][0]: TreeLink(self.frames[0][0], None, True)}
        joints: dict[str, TreeJoint] = {}
        for body in range(1, self.model.nbody):
            for joint in self.joints(body):
                joints[joint.name] = joint
                links[joint.child] = TreeLink(joint.child, NO_BODY, False)
            name, frame = self.frames[body]
            links[name] = TreeLink(name, self.body(body, frame.xyz), True)
        for k in range(self.model.nsite):
            site = self.model.site(k).name
            if site and site not in links:
                parent, frame = self.frames[int(self.model.site_bodyid[k])]
                at = composed(frame, _frame(self.model.site_pos[k], self.model.site_quat[k]))
                links[site] = TreeLink(site, None, False)
                joints[f"site {site}"] = TreeJoint(f"site {site}", "fixed", parent, child=site, origin=at)
        return links, joints

    def joints(self, body: int) -> Iterator[TreeJoint]:
        """The joints from the parent's link to the body's, in order."""
        model = self.model
        name, first, count = model.body(body).name, int(model.body_jntadr[body]), int(model.body_jntnum[body])
        parent, before = self.frames[int(model.body_parentid[body])]
        origin = composed(before, _frame(model.body_pos[body], model.body_quat[body]))
        if count == 0:
            self.frames[body] = (name, Frame())
            yield TreeJoint(f"weld {name}", "fixed", parent, child=name, origin=origin)
        at: Vector = (0.0, 0.0, 0.0)
        for k in range(first, first + count):
            child = name if k == first + count - 1 else f"{name} before joint {k + 1 - first}"
            place = _vector(model.jnt_pos[k])
            origin = composed(origin, Frame(added(place, scaled(-1.0, at))))
            yield self.joint(k, parent, child, origin)
            parent, origin, at = child, Frame(), place
        if count:
            self.frames[body] = (name, Frame(scaled(-1.0, at)))

    def joint(self, k: int, parent: str, child: str, origin: Frame) -> TreeJoint:
        model, dof = self.model, int(self.model.jnt_dofadr[k])
        kind, axis = KINDS[int(model.jnt_type[k])], _vector(model.jnt_axis[k])
        name = model.joint(k).name or f"joint{k + 1}"
        if kind in ("free", "ball"):
            return TreeJoint(name, kind, parent, child=child, origin=origin)
        at = int(model.jnt_qposadr[k])
        zero = -float(model.qpos0[at])
        shift = Frame(scaled(zero, axis)) if kind == "prismatic" else Frame(rpy=angles(about(axis, zero)))
        low, high = (float(end) for end in model.jnt_range[k])
        gears, torque, rotor, damping = _drive(model, k)
        stated = {
            "damping": float(model.dof_damping[dof]) + damping,
            "friction": float(model.dof_frictionloss[dof]),
            "stiffness": float(model.jnt_stiffness[k]),
            "rest": float(model.qpos_spring[at]),
        }
        return TreeJoint(
            name,
            kind,
            parent,
            child=child,
            origin=composed(origin, shift) if zero else origin,
            axis=axis,
            position=(low, high) if model.jnt_limited[k] and low < high and max(-low, high) < LARGEST else None,
            torque=torque,
            dynamics={word: value for word, value in stated.items() if value},
            rotor=float(model.dof_armature[dof]) + rotor or None,
            gears=gears,
        )

    def body(self, k: int, shift: Vector) -> StatedBody | None:
        """The body in its link's frame, which is shifted from the body's own frame."""
        model = self.model
        if model.body(k).name in self.unknown:
            return None
        R = _rotation(model.body_iquat[k])
        principal = [float(moment) for moment in model.body_inertia[k]]
        diagonal: Rotation = ((principal[0], 0.0, 0.0), (0.0, principal[1], 0.0), (0.0, 0.0, principal[2]))
        com = added(_vector(model.body_ipos[k]), shift)
        return StatedBody(float(model.body_mass[k]), com, packed(product(product(R, diagonal), transposed(R))))


def _drive(model: Any, k: int) -> tuple[tuple[tuple[str, float], ...], float | None, float, float]:
    """The actuators of a joint, at its output: gears with their sources; maximum torque or None; inertia and damping of
    the motors (newer MuJoCo versions)."""
    at_joint = [a for a, at in enumerate(model.actuator_trnid) if int(at[0]) == k and not _is_passive(model, a)]
    gears = {a: ratio for a in at_joint if (ratio := abs(float(model.actuator_gear[a][0])))}
    # Forces, inertias and damping of several actuators at one joint add up.
    forces = []
    for a, ratio in gears.items():
        ranges = [model.actuator_forcerange[a]] if model.actuator_forcelimited[a] else []
        if model.actuator_ctrllimited[a] and (model.actuator_gaintype[a], model.actuator_biastype[a]) == PLAIN:
            ranges.append(abs(float(model.actuator_gainprm[a][0])) * model.actuator_ctrlrange[a])
        forces.append(ratio * min(_largest(ranges), default=math.inf))
    own = _largest([model.jnt_actfrcrange[k]] if model.jnt_actfrclimited[k] else [])
    torque = min([*own, *([sum(forces)] if forces else [])], default=math.inf)
    rotor, damping = (
        sum(ratio**2 * float(getattr(model, what)[a]) for a, ratio in gears.items() if hasattr(model, what))
        for what in ("actuator_armature", "actuator_damping")
    )
    by = tuple((f"actuator {shortened(model.actuator(a).name) or a + 1}", ratio) for a, ratio in gears.items())
    return by, torque if torque < LARGEST else None, rotor, damping


def _is_passive(model: Any, a: int) -> bool:
    controls = getattr(model, "actuator_ctrlnum", None)
    return not any(model.actuator_gainprm[a]) or (controls is not None and not controls[a])


def _largest(ranges: Iterable[Sequence[Any]]) -> list[float]:
    """The magnitude that each range allows in both directions, if any."""
    both = (min(-float(low), float(high)) for low, high in ranges)
    return [value for value in both if 0 < value < LARGEST]


def _vector(values: Sequence[Any]) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _frame(position: Sequence[Any], quaternion: Sequence[Any]) -> Frame:
    return Frame(_vector(position), angles(_rotation(quaternion)))


def _rotation(quaternion: Sequence[Any]) -> Rotation:
    """The rotation of a quaternion w, x, y, z."""
    w, x, y, z = (float(value) for value in quaternion)
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
