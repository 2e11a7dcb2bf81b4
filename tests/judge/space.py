"""Arms in space to be judged with: bodies by their place where q = 0, and their regressors by virtual work.

What the plant is given (space.h) is in base axes where all angles are zero; the model file is written in frames of its
own, joint by joint, as a user's is. Columns of inertial parameters follow from the virtual work of a body's particles,
which is linear in its mass, its first moments and its matrix of second moments; nothing is shared with the recursions
and the base parameters of the library.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from runtime.arrays import Array

Triple = tuple[float, float, float]

DOWN = (0.0, 0.0, -9.81)
SECOND = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
QUARTERS = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Cosine and sine of none, one, two and three quarter turns."""
PER_BODY = 11
"""Columns of a body: mass, first moments, second moments, all where q = 0 about the joint's point, and the rotor."""


@dataclass(frozen=True)
class SpatialBody:
    """One link in space and the rotor that drives it, SI; friction levels as they are when nothing is hidden.

    frame    quarter turns about the x of the frame before, then m along that x and along the joint's own z (modified
             Denavit-Hartenberg, the joint turns about z)
    com, inertia   in the joint's frame; (ixx, ixy, ixz, iyy, iyz, izz) about the centre of mass
    base     rotation (3, 3) and origin (3,) of the joint's frame in the base where q = 0, row by row
    noise    of its torque, in units of a small drive's
    """

    frame: tuple[int, float, float]
    mass: float
    com: Triple
    inertia: tuple[float, float, float, float, float, float]
    rotor: float
    dry: tuple[float, float]
    viscous: float
    cubic: float
    noise: float = 1.0
    base: tuple[tuple[Triple, Triple, Triple], Triple] = (((1, 0, 0), (0, 1, 0), (0, 0, 1)), (0.0, 0.0, 0.0))

    @property
    def axes(self) -> Array:
        return np.array(self.base[0], dtype=float)

    @property
    def point(self) -> Array:
        return np.array(self.base[1], dtype=float)

    @property
    def tensor(self) -> Array:
        """(3, 3) kg m² about the centre of mass, in base axes where q = 0."""
        return self.axes @ _symmetric(self.inertia) @ self.axes.T

    @property
    def centre(self) -> Array:
        """(3,) m, in base axes where q = 0."""
        return self.point + self.axes @ np.array(self.com)

    def parameters(self) -> dict[str, float]:
        """By laws.h's names."""
        names = ("AXIS", "POINT", "CENTRE")
        triples = (self.axes[:, 2], self.point, self.centre)
        rows = {
            f"{n}_{x}": float(v) for n, t in zip(names, triples, strict=True) for x, v in zip("XYZ", t, strict=True)
        }
        rows |= {f"{'XYZ'[i]}{'XYZ'[j]}": float(self.tensor[i, j]) for i, j in SECOND}
        return {
            **rows,
            "ROTOR": self.rotor,
            "MASS": self.mass,
            "DRY_POSITIVE": self.dry[0],
            "DRY_NEGATIVE": self.dry[1],
            "VISCOUS_POSITIVE": self.viscous,
            "VISCOUS_NEGATIVE": self.viscous,
            "CUBIC": self.cubic,
        }


def _symmetric(six: Sequence[float]) -> Array:
    out = np.zeros((3, 3))
    for (i, j), x in zip(SECOND, six, strict=True):
        out[i, j] = out[j, i] = x
    return out


def chain(bodies: Sequence[SpatialBody]) -> tuple[SpatialBody, ...]:
    """The bodies with their places in the base where q = 0."""
    axes, point, out = np.eye(3), np.zeros(3), []
    for body in bodies:
        quarters, along, up = body.frame
        c, s = QUARTERS[quarters % 4]
        point = point + axes @ np.array([along, 0.0, 0.0])
        axes = axes @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        point = point + axes @ np.array([0.0, 0.0, up])
        placed = (tuple(map(tuple, axes.tolist())), tuple(point.tolist()))
        out.append(replace(body, base=placed))
    return tuple(out)


def tip(bodies: Sequence[SpatialBody]) -> Array:
    """(3,) m, the flange where q = 0, in base axes: TIP along the last joint's z."""
    return bodies[-1].point + bodies[-1].axes @ np.array([0.0, 0.0, TIP])


TIP = 0.1


def file_joints(bodies: Sequence[SpatialBody], believed: Sequence[str], ratio: float) -> list[str]:
    """The joints of a model file, and its tip, in the frames of URDF."""
    lines = []
    for number, body in enumerate(bodies, 1):
        quarters, along, up = body.frame
        c, s = QUARTERS[quarters % 4]
        xyz = [along, -up * s, up * c]
        lines += [
            "",
            "[[joint]]",
            f'name = "axis_{number}"',
            'type = "revolute"',
            f"origin = {{ xyz = [{', '.join(f'{x:.12g}' for x in xyz)}], rpy = [{quarters * np.pi / 2!r}, 0.0, 0.0] }}",
            "axis = [0.0, 0.0, 1.0]",
            f"rotor_inertia = {body.rotor}",
            f"gear_ratio = {ratio:g}",
            "[joint.link]",
            f"mass = {body.mass}",
            f"com = {list(body.com)}",
            f"inertia = {list(body.inertia)}",
            *(f"[joint.effects.{name}]" for name in believed),
        ]
    return [*lines, "", "[tip]", f"origin = {{ xyz = [0.0, 0.0, {TIP}], rpy = [0.0, 0.0, 0.0] }}"]


# --- virtual work ---


@dataclass(frozen=True)
class Moving:
    """Along N samples: axes (n, 3, N) and points (n, 3, N) of the joints; of every body the displacement from q = 0
    (rotation (n, 3, 3, N)), and at its joint's point acceleration less gravity (n, 3, N), and the matrix (n, 3, 3, N)
    by which the acceleration grows with the distance from there."""

    axes: Array
    points: Array
    turned: Array
    fall: Array
    spread: Array


def _skew(w: Array) -> Array:
    zero = np.zeros_like(w[0])
    return np.array([[zero, -w[2], w[1]], [w[2], zero, -w[0]], [-w[1], w[0], zero]])


def _times(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ijt,jkt->ikt", a, b))


def moving(bodies: Sequence[SpatialBody], q: Array, qd: Array, qdd: Array, gravity: Sequence[float]) -> Moving:
    count = q.shape[1]
    E = np.repeat(np.eye(3)[:, :, None], count, axis=2)
    rate, turn = np.zeros((3, count)), np.zeros((3, count))
    place, fall = np.zeros((3, count)), np.tile(-np.array(gravity)[:, None], (1, count))
    before, out = np.zeros(3), ([], [], [], [], [])
    spread = np.zeros((3, 3, count))
    for body, angle, speed, gain in zip(bodies, q, qd, qdd, strict=True):
        arm = np.einsum("ijt,j->it", E, body.point - before)
        place, fall = place + arm, fall + np.einsum("ijt,jt->it", spread, arm)
        axis = np.einsum("ijt,j->it", E, body.axes[:, 2])
        turn = turn + gain * axis + speed * np.cross(rate, axis, axis=0)
        rate = rate + speed * axis
        K = _skew(axis)
        E = _times(np.eye(3)[:, :, None] + np.sin(angle) * K + (1 - np.cos(angle)) * _times(K, K), E)
        W = _skew(rate)
        spread, before = _skew(turn) + _times(W, W), body.point
        for kept, value in zip(out, (axis, place, E, fall, spread), strict=True):
            kept.append(value)
    return Moving(*map(np.array, out))


def joint_columns(bodies: Sequence[SpatialBody], at: Moving, qdd: Array, joint: int) -> Array:
    """Torque of one joint (0-based) per unit of every inertial parameter, (11 n, N)."""
    n, count = len(bodies), qdd.shape[1]
    out = np.zeros((PER_BODY * n, count))
    U = _skew(at.axes[joint])
    for k in range(joint, n):
        # A particle x from the joint's point where q = 0: moved by u x (c + E x), accelerated by a + S E x.
        E, S, a = at.turned[k], at.spread[k], at.fall[k]
        moved = np.einsum("ijt,jt->it", U, at.points[k] - at.points[joint])
        UE, SE = _times(U, E), _times(S, E)
        out[PER_BODY * k] = (moved * a).sum(0)
        out[PER_BODY * k + 1 : PER_BODY * k + 4] = np.einsum("it,ijt->jt", moved, SE) + np.einsum("ijt,it->jt", UE, a)
        second = np.einsum("ijt,ikt->jkt", UE, SE)
        for place, (i, j) in enumerate(SECOND, PER_BODY * k + 4):
            out[place] = second[i, j] if i == j else second[i, j] + second[j, i]
    out[PER_BODY * joint + 10] = qdd[joint]
    return out


def values(bodies: Sequence[SpatialBody]) -> Array:
    """(11 n,) values of the parameters of joint_columns."""
    rows = []
    for b in bodies:
        away = b.centre - b.point
        second = 0.5 * np.trace(b.tensor) * np.eye(3) - b.tensor + b.mass * np.outer(away, away)
        rows.append([b.mass, *(b.mass * away), *(second[i, j] for i, j in SECOND), b.rotor])
    return np.array(rows).ravel()


# --- arms ---


def _cylinder(mass: float, radius: float, length: float) -> tuple[float, float, float, float, float, float]:
    """Along x, a little askew: (ixx, ixy, ixz, iyy, iyz, izz)."""
    thin, wide = 0.5 * mass * radius**2, mass * (radius**2 / 4 + length**2 / 12)
    return (thin, 0.03 * thin, -0.05 * thin, wide, 0.04 * thin, 1.02 * wide)


def _link(
    frame: tuple[int, float, float],
    mass: float,
    com: Triple,
    size: tuple[float, float],
    rotor: float,
    dry: tuple[float, float],
    viscous: float,
    cubic: float,
    noise: float,
) -> SpatialBody:
    return SpatialBody(frame, mass, com, _cylinder(mass, *size), rotor, dry, viscous, cubic, noise)


SPATIAL: dict[int, tuple[SpatialBody, ...]] = {
    6: chain(
        (  # of the proportions of a UR10
            _link((0, 0.0, 0.1807), 7.4, (0.0, -0.02, -0.03), (0.08, 0.18), 1.6, (12.0, 9.5), 14.0, -0.5, 2.5),
            _link((1, 0.0, 0.0), 13.0, (-0.28, 0.0, 0.16), (0.07, 0.61), 1.6, (13.0, 11.0), 15.0, -0.6, 2.5),
            _link((0, -0.6127, 0.0), 4.0, (-0.26, 0.0, 0.05), (0.05, 0.57), 0.9, (8.0, 6.5), 9.0, -0.4, 1.5),
            _link((0, -0.57155, 0.17415), 2.1, (0.0, -0.01, 0.01), (0.045, 0.12), 0.2, (3.0, 2.4), 2.4, -0.06, 1.0),
            _link((1, 0.0, 0.11985), 2.0, (0.0, 0.01, 0.01), (0.045, 0.12), 0.2, (2.8, 2.2), 2.3, -0.06, 1.0),
            _link((-1, 0.0, 0.11655), 0.8, (0.02, 0.01, 0.03), (0.04, 0.08), 0.2, (2.4, 2.0), 2.0, -0.05, 1.0),
        )
    ),
    7: chain(
        (  # of the proportions of a Panda
            _link((0, 0.0, 0.333), 4.9, (0.0, -0.03, -0.07), (0.06, 0.28), 0.5, (2.4, 2.0), 2.4, -0.05, 1.5),
            _link((-1, 0.0, 0.0), 3.2, (0.0, -0.09, 0.02), (0.06, 0.24), 0.5, (2.5, 2.1), 2.6, -0.05, 1.5),
            _link((1, 0.0, 0.316), 3.6, (0.03, 0.03, -0.05), (0.06, 0.22), 0.4, (2.0, 1.7), 2.0, -0.05, 1.2),
            _link((1, 0.0825, 0.0), 3.5, (-0.05, 0.05, 0.02), (0.06, 0.22), 0.4, (2.0, 1.6), 2.0, -0.05, 1.2),
            _link((-1, -0.0825, 0.384), 2.8, (0.0, 0.03, -0.1), (0.05, 0.25), 0.2, (1.4, 1.1), 1.2, -0.03, 1.0),
            _link((1, 0.0, 0.0), 1.7, (0.05, -0.01, 0.0), (0.05, 0.12), 0.2, (1.3, 1.0), 1.1, -0.03, 1.0),
            _link((1, 0.088, 0.0), 1.4, (0.02, 0.01, 0.09), (0.045, 0.14), 0.15, (1.0, 0.8), 0.9, -0.02, 1.0),
        )
    ),
}

HOME: dict[int, tuple[float, ...]] = {6: (0.0, -1.1, 1.3, -0.4, 1.2, 0.3), 7: (0.0, -0.5, 0.2, -1.6, 0.3, 1.4, 0.5)}
"""rad, about which the arms move: not stretched, and no two axes parallel that need not be."""
