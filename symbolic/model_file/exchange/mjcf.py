"""MJCF read through the package `mujoco`, which alone knows its defaults, includes and inertias from shapes.

Source: the XML reference at mujoco.readthedocs.io.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from symbolic.model_file.arm import Frame
from symbolic.model_file.checks import LARGEST, ModelError, printable
from symbolic.model_file.exchange.bodies import NOTHING, StatedBody, packed
from symbolic.model_file.exchange.tree import Tree, TreeJoint, TreeLink
from symbolic.model_file.frames import Rotation, Vector, about, angles, composed, product, scaled, transposed

KINDS = ("free", "ball", "prismatic", "revolute")
"""By MuJoCo's number."""
UNSEEN = ("keys", "sensors", "pairs", "excludes", "skins", "flexes", "equalities", "tendons")
"""Parts of a description that say nothing of a single arm, but may refer to shapes that are not read."""


def tree(path: Path) -> Tree:
    """The bodies and joints that an MJCF file describes; its sites are links without a body.

    Raises ModelError: `mujoco` is not installed or too old, or refuses the file.
    """
    try:
        mujoco = importlib.import_module("mujoco")
    except ImportError:
        raise ModelError(
            f"{printable(str(path))}: MJCF is read by the package mujoco, which is not installed: pip install mujoco "
            "(the extra `mjcf`)"
        ) from None
    if not hasattr(getattr(mujoco, "MjSpec", None), "delete"):
        raise ModelError(
            f"{printable(str(path))}: MJCF needs a newer mujoco than {printable(str(mujoco.__version__))}: pip install "
            "--upgrade mujoco (the extra `mjcf`)"
        )
    try:
        with _heard(mujoco) as warned:
            spec = mujoco.MjSpec.from_file(str(path))
            related = len(spec.equalities) + len(spec.tendons)
            afloat = sum(body.gravcomp != 0 for body in spec.bodies)
            unknown = _without_shapes(mujoco, spec)
            model = spec.compile()
    except (ValueError, OSError) as error:
        raise ModelError(f"{printable(str(path))}: MuJoCo says: {printable(' '.join(str(error).split()))}") from None
    found = _Bodies(model, unknown)
    links, joints = found.tree()
    x, y, z = (float(g) for g in model.opt.gravity)
    notes = [f"MuJoCo warns: {printable(' '.join(text.split()))}" for text in warned]
    if related:
        notes.append("equality constraints and tendons are not part of an arm: left out")
    if afloat:
        notes.append("gravcomp, which takes bodies' weight away, is not part of an arm: left out")
    return Tree(printable(str(path)), "MJCF", spec.modelname, links, joints, (x, y, z), tuple(notes))


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


def _without_shapes(mujoco: Any, spec: Any) -> set[str]:
    """Take out what is only drawn, and what needs a file of a mesh: the names of bodies whose inertia that leaves
    unknown, which get some to be compiled."""
    for kind in UNSEEN:
        for item in list(getattr(spec, kind, ())):
            spec.delete(item)
    for actuator in list(spec.actuators):
        if actuator.trntype not in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            spec.delete(actuator)
    unknown = set()
    for k, body in enumerate(spec.bodies):
        if not body.name:
            body.name = f"body{k}"
        stored = [geom for geom in body.geoms if geom.meshname or geom.hfieldname]
        if k > 0 and not body.explicitinertial and any(_weighs(spec, geom) for geom in stored):
            unknown.add(body.name)
            body.explicitinertial, body.mass, body.inertia = True, 1.0, [1.0, 1.0, 1.0]
        for geom in list(body.geoms) if body.explicitinertial or k == 0 else stored:
            spec.delete(geom)
        for drawn in [*body.geoms, *body.sites]:
            drawn.material = ""
    for asset in [*spec.meshes, *spec.hfields, *spec.materials, *spec.textures]:
        spec.delete(asset)
    return unknown


def _weighs(spec: Any, geom: Any) -> bool:
    """Whether a body without a stated inertia has some from this shape."""
    first, last = spec.compiler.inertiagrouprange
    return bool(geom.mass != 0 and geom.density != 0 and first <= geom.group <= last)


class _Bodies:
    """MuJoCo's arrays as links and joints; a body with several joints gets a frame for each."""

    def __init__(self, model: Any, unknown: set[str]) -> None:
        self.model, self.unknown = model, unknown
        self.frames: dict[int, tuple[str, Frame]] = {0: (model.body(0).name, Frame())}
        """Of every body, the link that it is, and where its own frame stands in the link's."""

    def tree(self) -> tuple[dict[str, TreeLink], dict[str, TreeJoint]]:
        links = {self.frames[0][0]: TreeLink(self.frames[0][0], None, True)}
        joints: dict[str, TreeJoint] = {}
        for body in range(1, self.model.nbody):
            for joint in self.joints(body):
                joints[joint.name] = joint
                links[joint.child] = TreeLink(joint.child, NOTHING, False)
            name, frame = self.frames[body]
            links[name] = TreeLink(name, self.body(body, frame.xyz), True)
        for k in range(self.model.nsite):
            site = self.model.site(k).name
            if site and site not in links:
                parent, frame = self.frames[int(self.model.site_bodyid[k])]
                at = composed(frame, _frame(self.model.site_pos[k], self.model.site_quat[k]))
                links[site] = TreeLink(site, None, False)
                joints[f"site {site}"] = TreeJoint(f"site {site}", "fixed", parent, site, at)
        return links, joints

    def joints(self, body: int) -> Iterator[TreeJoint]:
        """From the parent's link to the body's, one by one."""
        model = self.model
        name, first, count = model.body(body).name, int(model.body_jntadr[body]), int(model.body_jntnum[body])
        parent, before = self.frames[int(model.body_parentid[body])]
        origin = composed(before, _frame(model.body_pos[body], model.body_quat[body]))
        if count == 0:
            self.frames[body] = (name, Frame())
            yield TreeJoint(f"weld {name}", "fixed", parent, name, origin)
        at: Vector = (0.0, 0.0, 0.0)
        for k in range(first, first + count):
            child = name if k == first + count - 1 else f"{name} before joint {k + 1 - first}"
            place = _vector(model.jnt_pos[k])
            origin = composed(origin, Frame(_less(place, at)))
            yield self.joint(k, parent, child, origin)
            parent, origin, at = child, Frame(), place
        if count:
            self.frames[body] = (name, Frame(scaled(-1.0, at)))

    def joint(self, k: int, parent: str, child: str, origin: Frame) -> TreeJoint:
        model, dof = self.model, int(self.model.jnt_dofadr[k])
        kind, axis = KINDS[int(model.jnt_type[k])], _vector(model.jnt_axis[k])
        name = model.joint(k).name or f"joint{k + 1}"
        if kind in ("free", "ball"):
            return TreeJoint(name, kind, parent, child, origin)
        at = int(model.jnt_qposadr[k])
        zero = -float(model.qpos0[at])
        shift = Frame(scaled(zero, axis)) if kind == "prismatic" else Frame(rpy=angles(about(axis, zero)))
        low, high = (float(end) for end in model.jnt_range[k])
        stated = {
            "damping": float(model.dof_damping[dof]),
            "friction": float(model.dof_frictionloss[dof]),
            "stiffness": float(model.jnt_stiffness[k]),
            "rest": float(model.qpos_spring[at]),
        }
        gear, torque = self.drive(k)
        return TreeJoint(
            name,
            kind,
            parent,
            child,
            composed(origin, shift) if zero else origin,
            axis,
            (low, high) if model.jnt_limited[k] and low < high and max(-low, high) < LARGEST else None,
            None,
            torque,
            {word: value for word, value in stated.items() if value},
            float(model.dof_armature[dof]) or None,
            gear,
        )

    def drive(self, k: int) -> tuple[float | None, float | None]:
        """Gear ratio and largest torque of the joint's actuator, where it has one."""
        model = self.model
        limits = [model.jnt_actfrcrange[k]] if model.jnt_actfrclimited[k] else []
        gear = None
        for a in range(model.nu):
            if int(model.actuator_trnid[a][0]) == k:
                gear = abs(float(model.actuator_gear[a][0])) or None
                if model.actuator_forcelimited[a] and gear:
                    limits.append([gear * force for force in model.actuator_forcerange[a]])
        largest = [min(-float(low), float(high)) for low, high in limits]
        return gear, min((value for value in largest if 0 < value < LARGEST), default=None)

    def body(self, k: int, shift: Vector) -> StatedBody | None:
        """Of a body in its link's frame, which stands off its own by a shift."""
        model = self.model
        if model.body(k).name in self.unknown:
            return None
        R = _rotation(model.body_iquat[k])
        principal = [float(moment) for moment in model.body_inertia[k]]
        diagonal: Rotation = ((principal[0], 0.0, 0.0), (0.0, principal[1], 0.0), (0.0, 0.0, principal[2]))
        com = _less(_vector(model.body_ipos[k]), scaled(-1.0, shift))
        return StatedBody(float(model.body_mass[k]), com, packed(product(product(R, diagonal), transposed(R))))


def _vector(values: Sequence[Any]) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _less(left: Vector, right: Vector) -> Vector:
    x, y, z = (a - b for a, b in zip(left, right, strict=True))
    return x, y, z


def _frame(position: Sequence[Any], quaternion: Sequence[Any]) -> Frame:
    return Frame(_vector(position), angles(_rotation(quaternion)))


def _rotation(quaternion: Sequence[Any]) -> Rotation:
    """Of w, x, y, z."""
    w, x, y, z = (float(value) for value in quaternion)
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
