"""Kinematics of a spatial chain's tip: pose, Jacobian, rates, and the joint torques of a mass at the tip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from symbolic.functions import Author, Recorder, SymbolicFunction, output
from symbolic.model_file.arm import Arm
from symbolic.rigid_body.kinematics import NOMINAL_MASS
from symbolic.rigid_body.lagrangian import rational
from symbolic.rigid_body.spatial.composites import JointStep, composites, gradient
from symbolic.rigid_body.spatial.geometry import (
    NOWHERE,
    Geometry,
    Matrix,
    Vector,
    added,
    along,
    applied,
    cross,
    dot,
    less,
    negative,
    scaled,
)
from symbolic.rigid_body.spatial.recursion import Moments, named

NOTATION = {
    "c, s": "cosine and sine",
    "r": "way along the axis of a joint",
    "x, y, z": "axes of a link's frame",
    "o": "origin of a link's frame",
    "p": "the tip, in a link's frame",
    "rx, ry, rz": "from the tip to a joint, along the tip's axes",
    "w": "angular velocity",
    "al": "angular acceleration",
    "v": "velocity of an origin",
    "a": "acceleration of an origin, less gravity",
    "U": "by what the acceleration grows with the place",
}
"""The meaning of names in the generated code."""

LOADS = ("1", "x", "y", "z", "xx", "yy", "zz", "xy", "xz", "yz")
"""Columns of tip_load: moments of order 0, 1 and 2 of a unit mass at a point of the tip's frame."""


@dataclass(frozen=True)
class JointAxes:
    """All joints in one frame.

    before   (n,) x and y axes before each joint moves
    along    (n,) joint axes without their signs
    origin   (n,) origins of the moved frames
    """

    before: list[tuple[Vector, Vector]]
    along: list[Vector]
    origin: list[Vector]


def functions(author: Author, arm: Arm, geometry: Geometry) -> list[SymbolicFunction]:
    """tip, tip_rotation, tip_jacobian, tip_rate, tip_load, moment_jacobian. geometry: with SymPy numbers."""
    return [
        *_pose(author, geometry),
        *_motion(author, geometry),
        _tip_load(author, geometry),
        _moment(author, arm, geometry),
    ]


def _pose(author: Author, geometry: Geometry) -> list[SymbolicFunction]:
    recorder = author.recorder()
    steps = JointStep.all(geometry, author.coordinates.symbols("q"), recorder)
    point, columns = geometry.tip.at, list(zip(*geometry.tip.turn, strict=True))
    for step in reversed(steps):
        point = step.named(("px", "py", "pz"), step.placed(point, "p"))
        columns = [
            step.named([f"{name}{e}_" for e in "xyz"], step.twisted(step.turned(column, name)))
            for name, column in zip("xyz", columns, strict=True)
        ]
    p = geometry.base.placed(point)
    R = list(zip(*(applied(geometry.base.turn, column) for column in columns), strict=True))
    made = partial(
        author.function,
        inputs=("q",),
        recorder=recorder,
        source="Forward kinematics; Khalil & Kleinfinger 1986",
        notation=NOTATION,
    )
    position = output("p", p, unit="m", meaning="x, y and z of the tip along the base's axes")
    rotation = output("R", R, unit="1", meaning="columns: the tip's axes along the base's")
    return [
        made("tip", output=position, doc="Position of the tip of the arm."),
        made("tip_rotation", output=rotation, doc="Rotation matrix of the tip's frame."),
    ]


def _motion(author: Author, geometry: Geometry) -> list[SymbolicFunction]:
    recorder, unit = author.recorder(), author.coordinates.unit("m/rad and 1", "1")
    q, qd = author.coordinates.symbols("q"), author.coordinates.symbols("qd")
    axes, tip = _from_base(geometry, JointStep.all(geometry, q, recorder), recorder)
    rows = list(zip(*_columns(geometry, axes, tip), strict=True))
    rates = _rates(geometry, axes, tip, qd=qd, recorder=recorder)
    return [
        author.function(
            "tip_jacobian",
            ("q",),
            output("J", rows, unit=unit, meaning="rows x, y, z, rotation about base x, y, z"),
            recorder,
            doc="By what the tip moves and turns with each joint.",
            source="Columns z x (p - o) and z of a revolute joint, z and 0 of a prismatic one; Whitney 1972",
            notation=NOTATION,
        ),
        author.function(
            "tip_rate",
            ("q", "qd"),
            output("v", rates, unit="m/s, rad/s", meaning="velocity, angular velocity"),
            recorder,
            doc="Velocity and angular velocity of the tip along the base's axes.",
            source="J qd; Whitney 1972",
            notation=NOTATION,
        ),
    ]


def _from_base(geometry: Geometry, steps: Sequence[JointStep], recorder: Recorder) -> tuple[JointAxes, Vector]:
    """The joints and the tip in the base frame."""
    x, y, z = zip(*geometry.base.turn, strict=True)
    o, axes = geometry.base.at, JointAxes([], [], [])
    for step in steps:
        (_, s), (ct, st) = step.direction, step.link.twist.pair
        y, z = added(scaled(ct, y), scaled(st, z)), added(scaled(ct, z), scaled(-st, y))
        o = step.named(("ox", "oy", "oz"), added(o, along(step.at, x, y, z)))
        axes.before.append((x, y))
        axes.along.append(along(step.axis, x, y, z))
        axes.origin.append(o)
        x, y = _turned_axes(step, x, y, s)
    tip = added(o, along(geometry.tip.at, x, y, z))
    return axes, named("tip", "", tip, recorder)


def _turned_axes(step: JointStep, x: Vector, y: Vector, s: Any) -> tuple[Vector, Vector]:
    c, _ = step.direction
    turned = added(scaled(c, x), scaled(s, y)), added(scaled(c, y), scaled(-s, x))
    x, y = (step.named([f"{name}{e}" for e in "xyz"], v) for name, v in zip("xy", turned, strict=True))
    return x, y


def _columns(geometry: Geometry, axes: JointAxes, point: Vector) -> list[tuple[Any, ...]]:
    """(n,) columns of a point's Jacobian: velocity and angular velocity at a unit rate of each joint."""
    columns = []
    for link, z, o in zip(geometry.links, axes.along, axes.origin, strict=True):
        z = scaled(link.sign, z)
        columns.append((*cross(z, less(point, o)), *z) if link.revolute else (*z, 0, 0, 0))
    return columns


def _rates(geometry: Geometry, axes: JointAxes, tip: Vector, qd: Sequence[Any], recorder: Recorder) -> tuple[Any, ...]:
    """Velocity and angular velocity of the tip, summed from joint to joint."""
    w: Vector = NOWHERE
    v: Vector = NOWHERE
    ends = [*axes.origin[1:], tip]
    for k, (link, z, o, end, rate) in enumerate(zip(geometry.links, axes.along, axes.origin, ends, qd, strict=True), 1):
        own = scaled(link.sign * rate, z)
        if link.revolute:
            w = named(f"w{k}", "", added(w, own), recorder)
        else:
            v = added(v, own)
        v = named(f"v{k}", "", added(v, cross(w, less(end, o))), recorder)
    return (*v, *w)


def _tip_load(author: Author, geometry: Geometry) -> SymbolicFunction:
    recorder = author.recorder()
    q, qd, qdd = (author.coordinates.symbols(name) for name in ("q", "qd", "qdd"))
    steps = JointStep.all(geometry, q, recorder)
    axes, pull = _from_tip(geometry, steps, recorder)
    a, U = _acceleration(geometry, steps, axes, pull=pull, qd=qd, qdd=qdd)
    # Force and moment of each of LOADS: (a, 0) of 1; (U e, e x a) of x, with e along x; (0, e x U e) of xx.
    e: list[Vector] = [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
    grown = [applied(U, axis) for axis in e]
    wrenches: list[tuple[Vector, Vector]] = [(a, NOWHERE), *((grown[i], cross(e[i], a)) for i in range(3))]
    wrenches += [(NOWHERE, cross(e[i], grown[i])) for i in range(3)]
    pairs = ((0, 1), (0, 2), (1, 2))
    wrenches += [(NOWHERE, added(cross(e[i], grown[j]), cross(e[j], grown[i]))) for i, j in pairs]
    rows = [
        [dot(column[:3], f) + dot(column[3:], m) for f, m in wrenches] for column in _columns(geometry, axes, NOWHERE)
    ]
    return author.function(
        "tip_load",
        ("q", "qd", "qdd"),
        output("load", rows, unit="torque by kg, kg m and kg m^2", meaning=f"columns {', '.join(LOADS)}"),
        recorder,
        doc="Torques that a unit mass at (x, y, z) of the tip's frame asks of the joints, less gravity's pull on it: "
        "load . (1, x, y, z, xx, yy, zz, xy, xz, yz).",
        source="J^T (force, moment) of a field of accelerations a + U p",
        notation=NOTATION,
    )


def _from_tip(geometry: Geometry, steps: Sequence[JointStep], recorder: Recorder) -> tuple[JointAxes, Vector]:
    """The joints and gravity in the tip's frame."""
    x, y, z = geometry.tip.turn
    o, axes = negative(applied(list(zip(*geometry.tip.turn, strict=True)), geometry.tip.at)), JointAxes([], [], [])
    for step in reversed(steps):
        (_, s), (ct, st) = step.direction, step.link.twist.pair
        axes.origin.append(o)
        x, y = _turned_axes(step, x, y, -s)
        axes.before.append((x, y))
        axes.along.append(along(step.axis, x, y, z))
        o = step.named(("rx", "ry", "rz"), less(o, along(step.at, x, y, z)))
        y, z = added(scaled(ct, y), scaled(-st, z)), added(scaled(ct, z), scaled(st, y))
    pull = along(geometry.gravity, x, y, z)
    reverse = JointAxes(axes.before[::-1], axes.along[::-1], axes.origin[::-1])
    return reverse, named("g", "", pull, recorder)


def _acceleration(
    geometry: Geometry, steps: Sequence[JointStep], axes: JointAxes, pull: Vector, qd: Sequence[Any], qdd: Sequence[Any]
) -> tuple[Vector, Matrix]:
    """Acceleration of the tip minus gravity, and U of the last link."""
    w, al, a = NOWHERE, NOWHERE, negative(pull)
    U: Matrix = (NOWHERE, NOWHERE, NOWHERE)
    ends = [*axes.origin[1:], NOWHERE]
    for k, (link, step) in enumerate(zip(geometry.links, steps, strict=True)):
        z, o = axes.along[k], axes.origin[k]
        own, rise = scaled(link.sign * qd[k], z), scaled(link.sign * qdd[k], z)
        if link.revolute:
            al = step.named(("alx", "aly", "alz"), added(al, added(rise, cross(w, own))))
            w = step.named(("wx", "wy", "wz"), added(w, own))
            U = gradient(step, w, al)
        else:
            a = added(a, added(rise, scaled(2, cross(w, own))))
        a = step.named(("ax", "ay", "az"), added(a, applied(U, less(ends[k], o))))
    return a, U


def _moment(author: Author, arm: Arm, geometry: Geometry) -> SymbolicFunction:
    recorder = author.recorder()
    steps = JointStep.all(geometry, author.coordinates.symbols("q"), recorder)
    wholes = composites(steps, [_mass(arm, geometry, j) for j in range(geometry.n)])
    axes, _ = _from_base(geometry, steps, recorder)
    columns = []
    for link, b, (x, y), z in zip(geometry.links, wholes, axes.before, axes.along, strict=True):
        slope = less(scaled(b.x, y), scaled(b.y, x)) if link.revolute else scaled(b.m, z)
        columns.append(scaled(link.sign, slope))
    rows = list(zip(*columns, strict=True))
    return author.function(
        "moment_jacobian",
        ("q",),
        output("M", rows, unit=author.coordinates.unit("kg m/rad", "kg"), meaning="rows x, y, z"),
        recorder,
        doc="Derivative of the arm's first mass moment, the sum of mass times position, by q; "
        "masses of the model file.",
        source="Potential energy V = -gravity . sum m_i c_i",
        notation=NOTATION,
    )


def _mass(arm: Arm, geometry: Geometry, j: int) -> Moments:
    """Mass and first moment of a link in its frame."""
    link, body = arm.joints[j].link, geometry.links[j].body
    m = rational(NOMINAL_MASS if link.mass is None else link.mass)
    com = nominal_com(arm, j) if link.com is None else link.com
    x, y, z = body.placed([rational(c) for c in com])
    return Moments(m=m, x=m * x, y=m * y, z=m * z)


def nominal_com(arm: Arm, j: int) -> Sequence[float]:
    """(3,) replaces an unknown centre of mass: half way to the next joint or the tip; if that is at the same place, 1 m
    from the joint's axis."""
    following = arm.joints[j + 1].origin if j + 1 < len(arm.joints) else arm.tip
    if any(following.xyz):
        return [c / 2 for c in following.xyz]
    across = min(range(3), key=lambda k: abs(arm.joints[j].axis[k]))
    return [float(k == across) for k in range(3)]
