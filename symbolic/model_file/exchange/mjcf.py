"""MJCF read through the package `mujoco`, which alone knows its defaults, includes and inertias from shapes.

Source: the XML reference at mujoco.readthedocs.io.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symbolic.model_file.arm import Frame
from symbolic.model_file.checks import LARGEST, printable
from symbolic.model_file.exchange.bodies import NOTHING, StatedBody, packed
from symbolic.model_file.exchange.chain import shortened
from symbolic.model_file.exchange.mjcf_compiled import compiled
from symbolic.model_file.exchange.tree import Tree, TreeJoint, TreeLink
from symbolic.model_file.exchange.xml_file import XmlNode
from symbolic.model_file.frames import Rotation, Vector, about, angles, composed, product, scaled, transposed

KINDS = ("free", "ball", "prismatic", "revolute")
"""By MuJoCo's number."""
PLAIN = (0, 0)
"""Of an actuator's gain and bias: its control is its force, as a motor's is."""


def mjcf_tree(path: Path, root: XmlNode) -> Tree:
    """The bodies and joints that an MJCF file describes; its sites are links without a body.

    root   of the file, as XML
    Raises ModelError: what CompiledMjcf cannot be made of.
    """
    made = compiled(path, root)
    found = _Bodies(made.model, made.unknown)
    links, joints = found.tree()
    notes = [*made.notes, *_bent(made.model)]
    return Tree(printable(str(path)), "MJCF", made.name, links, joints, made.gravity, tuple(notes))


def _bent(model: Any) -> Iterator[str]:
    """What of damping and springs is no straight line, of a MuJoCo that knows such."""
    for what, name in (("damping", "dof_dampingpoly"), ("stiffness", "jnt_stiffnesspoly")):
        if hasattr(model, name) and getattr(model, name).any():
            yield f"{what} of more than one number: what grows with the first power is taken, the rest is left out"


class _Bodies:
    """MuJoCo's arrays as links and joints; a body with several joints gets a frame for each."""

    def __init__(self, model: Any, unknown: Set[str]) -> None:
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
        drive = _drive(model, k)
        stated = {
            "damping": float(model.dof_damping[dof]) + drive.damping,
            "friction": float(model.dof_frictionloss[dof]),
            "stiffness": float(model.jnt_stiffness[k]),
            "rest": float(model.qpos_spring[at]),
        }
        return TreeJoint(
            name,
            kind,
            parent,
            child,
            composed(origin, shift) if zero else origin,
            axis,
            (low, high) if model.jnt_limited[k] and low < high and max(-low, high) < LARGEST else None,
            None,
            drive.torque,
            {word: value for word, value in stated.items() if value},
            float(model.dof_armature[dof]) + drive.rotor or None,
            drive.gears,
        )

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


@dataclass(frozen=True)
class _Drive:
    """What the actuators of a joint say, at the joint: the gears of those that move it, by whom; the largest torque,
    None without any; the inertia and the damping that stand on their side of the gear, of a MuJoCo that knows such."""

    gears: tuple[tuple[str, float], ...]
    torque: float | None
    rotor: float
    damping: float


def _drive(model: Any, k: int) -> _Drive:
    at_joint = [a for a in range(model.nu) if int(model.actuator_trnid[a][0]) == k]
    gears = {a: ratio for a in at_joint if (ratio := abs(float(model.actuator_gear[a][0])))}
    # The forces of actuators at one joint add up, and so does what moves with them.
    forces = [ratio * min(_largest(_forces(model, a)), default=math.inf) for a, ratio in gears.items()]
    own = _largest([model.jnt_actfrcrange[k]] if model.jnt_actfrclimited[k] else [])
    torque = min([*own, *([sum(forces)] if forces else [])], default=math.inf)
    sums = [
        sum(ratio**2 * float(getattr(model, what)[a]) for a, ratio in gears.items() if hasattr(model, what))
        for what in ("actuator_armature", "actuator_damping")
    ]
    by = tuple((f"actuator {shortened(model.actuator(a).name) or a + 1}", ratio) for a, ratio in gears.items())
    return _Drive(by, torque if torque < LARGEST else None, *sums)


def _largest(ranges: Iterable[Sequence[Any]]) -> list[float]:
    """What each range allows in both directions, of those that do."""
    both = (min(-float(low), float(high)) for low, high in ranges)
    return [value for value in both if 0 < value < LARGEST]


def _forces(model: Any, a: int) -> Iterator[Sequence[float]]:
    """Ranges of an actuator's force, before its gear."""
    if model.actuator_forcelimited[a]:
        yield model.actuator_forcerange[a]
    if model.actuator_ctrllimited[a] and (model.actuator_gaintype[a], model.actuator_biastype[a]) == PLAIN:
        yield abs(float(model.actuator_gainprm[a][0])) * model.actuator_ctrlrange[a]


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
