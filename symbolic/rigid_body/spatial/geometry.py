"""The geometry of a chain in space: a model file's origins and axes as modified DH frames, in exact numbers.

Frame j is fixed to link j: z_j along joint j's axis, x_j along the common normal of the axes j and j + 1. From
frame j − 1 to frame j:

    turn by twist_j about x, move by a_j along x, turn by theta_j about z, move by d_j along z

theta_j = offset_j + sign_j q_j of a revolute joint, d_j + sign_j q_j of a prismatic one. What the file leaves free is
chosen so that most of it vanishes:

- Frame 0 is fixed to the base, with z_0 = z_1, and coincides with frame 1 where q1 = 0.
- Parallel axes point the same way (sign_j = −1 where the file has them against each other): their twist is 0. What
  they are apart along themselves stands at the last of them.
- A prismatic joint has a direction and no place: its axis goes through the origin before it.
- The last link's frame stands in the one before it where q_n = 0.

Numbers are exact from here on: lengths are rounded to LENGTH_DIGITS, rotations to rational points of the unit circle
or sphere, so that rotation matrices are orthogonal to the last digit in any ring and quarter turns are 0 and ±1.

Source: Khalil & Kleinfinger 1986 (modified Denavit-Hartenberg notation).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
import sympy as sp

from symbolic.model_file.arm import Frame, SpatialArm
from symbolic.straightline import Notes, Turn

LENGTH_DIGITS = 12
"""Decimals of a length in m: what floating point adds to a file's decimals lies beyond them."""
TURN_DIGITS = 14
"""Decimals of the tangent of half an angle, likewise."""
PARALLEL = 1e-10
"""Sine of the angle between two axes below which they are parallel: rounding of rpy in double precision."""

Vector = tuple[Any, Any, Any]
Matrix = tuple[Vector, Vector, Vector]
Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class Placement:
    """A rigid frame in another: its point p is the other's turn · p + at. turn (3, 3) orthogonal; at (3,) m."""

    turn: Matrix
    at: Vector

    def over(self, number: Callable[[Fraction], Any]) -> Placement:
        """The same in another ring."""
        a, b, c = (_vector([number(e) for e in row]) for row in self.turn)
        return Placement((a, b, c), _vector([number(e) for e in self.at]))

    def floats(self) -> tuple[Array, Array]:
        """turn (3, 3) and at (3,) in double precision."""
        return np.array([[float(x) for x in row] for row in self.turn]), np.array([float(x) for x in self.at])


@dataclass(frozen=True)
class LinkFrame:
    """The step from frame j − 1 to frame j, see above.

    sign     1; −1 where the joint turns or slides against z_j
    twist    cosine and sine
    a, d     m
    offset   cosine and sine of theta_j where q_j = 0; of a revolute joint its quarter turns alone, 0 and ±1, and
    rest     the angle beyond them: 0, a Turn, or a symbol
    body     the model file's joint frame, in which mass and inertia are stated, in frame j
    """

    revolute: bool
    sign: int
    twist: Turn
    a: Any
    offset: Turn
    rest: Any
    d: Any
    body: Placement

    @property
    def start(self) -> Placement:
        """The frame in the one before, where q_j = 0 and but for `rest`."""
        (c, s), (ca, sa) = self.offset.pair, self.twist.pair
        turn = ((c, -s, c * 0), (ca * s, ca * c, -sa), (sa * s, sa * c, ca))
        return Placement(turn, (self.a, -sa * self.d, ca * self.d))

    def angle(self, q: Any) -> Any:
        """theta_j of a revolute joint, but for its quarter turns; q: an angle as Notes.sincos takes it."""
        turned = q if self.sign > 0 else -q
        return turned if isinstance(self.rest, int) else turned + self.rest

    def direction(self, q: Any, notes: Notes) -> tuple[Any, Any]:
        """Cosine and sine of theta_j."""
        return quarter_turned(notes.sincos(self.angle(q)), self.offset) if self.revolute else self.offset.pair

    def reach(self, q: Any) -> Any:
        """d_j, and the way of a prismatic joint."""
        return self.d if self.revolute else self.d + self.sign * q


@dataclass(frozen=True)
class Geometry:
    """A chain in exact numbers.

    links     from the base outwards
    gravity   the acceleration vector in frame 0, m/s²
    base      frame 0 in the model file's base frame
    tip       the tip in frame n
    """

    links: tuple[LinkFrame, ...]
    gravity: Vector
    base: Placement
    tip: Placement

    @property
    def n(self) -> int:
        return len(self.links)

    def over(self, number: Callable[[Fraction], Any], rests: Sequence[Any]) -> Geometry:
        """The same in another ring: every number converted; rests (n,) stand for the angles beyond quarter turns."""
        links = tuple(
            replace(
                link,
                twist=_turn_over(link.twist, number),
                a=number(link.a),
                offset=_turn_over(link.offset, number),
                rest=rest,
                d=number(link.d),
                body=link.body.over(number),
            )
            for link, rest in zip(self.links, rests, strict=True)
        )
        gravity = _vector([number(g) for g in self.gravity])
        return Geometry(links, gravity, self.base.over(number), self.tip.over(number))

    def symbolic(self) -> Geometry:
        """For emission: SymPy's rationals, and a symbol for every angle beyond quarter turns."""
        rests = [0 if isinstance(link.rest, int) else offset_symbol(j) for j, link in enumerate(self.links, 1)]
        return self.over(lambda x: sp.Rational(x.numerator, x.denominator), rests)

    def residues(self, prime: int) -> Geometry:
        """Modulo a prime."""

        def number(x: Fraction) -> int:
            return x.numerator * pow(x.denominator, -1, prime) % prime

        return self.over(number, [r if isinstance(r, int) else _turn_over(r, number) for r in self.rests])

    @property
    def rests(self) -> tuple[Any, ...]:
        """(n,) angles beyond quarter turns: 0 or a Turn."""
        return tuple(link.rest for link in self.links)


def offset_symbol(joint: int) -> sp.Symbol:
    """The constant of the struct that stands for the angle of a joint (1-based) beyond quarter turns."""
    return sp.Symbol(f"offset{joint}", real=True)


def quarter_turned(direction: tuple[Any, Any], quarter: Turn) -> tuple[Any, Any]:
    """(cos, sin) of the sum of an angle and quarter turns."""
    c, s = direction
    return c * quarter.cos - s * quarter.sin, s * quarter.cos + c * quarter.sin


def _turn_over(turn: Turn, number: Callable[[Fraction], Any]) -> Turn:
    return Turn(number(turn.cos), number(turn.sin))


def rotation(rpy: Sequence[float]) -> Array:
    """R (3, 3) = Rz(yaw) Ry(pitch) Rx(roll), as URDF says it."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def geometry(arm: SpatialArm) -> Geometry:
    """The frames of an arm."""
    files = _file_frames(arm)
    axes = _axes(arm, files)
    frames = _link_frames(arm, files, axes)
    first = frames[0]
    links, before = [], first
    for joint, frame, own in zip(arm.joints, frames, files, strict=True):
        (turn, at), (R, p) = before, frame
        sign = 1 if own[0] @ np.array(joint.axis) @ R[:, 2] > 0 else -1
        step, reach = turn.T @ R, turn.T @ (p - at)
        twist = exact_turn(step[2, 2], -step[1, 2])
        along = np.array([0.0, -float(twist.sin), float(twist.cos)])
        offset, rest = exact_turn(step[0, 0], -step[0, 1]), _NONE
        if joint.type == "revolute" and 0 not in offset.pair:
            offset, rest = Turn(Fraction(1), Fraction(0)), offset
        a, d = exact_length(reach[0]), exact_length(float(reach @ along))
        links.append(LinkFrame(joint.type == "revolute", sign, twist, a, offset, rest, d, _placement(frame, own)))
        before = frame
    gravity = first[0].T @ np.array(arm.gravity)
    tip = _after(files[-1], arm.tip)
    return Geometry(
        tuple(links),
        _vector([exact_length(g) for g in gravity]),
        _placement((np.eye(3), np.zeros(3)), first),
        _placement(frames[-1], tip),
    )


_NONE: Any = 0
_Frame = tuple[Array, Array]
"""Rotation matrix and origin in the base, where all q are 0."""


def _file_frames(arm: SpatialArm) -> list[_Frame]:
    """The model file's joint frames in the base, where all q are 0."""
    frames, last = [], (np.eye(3), np.zeros(3))
    for joint in arm.joints:
        last = _after(last, joint.origin)
        frames.append(last)
    return frames


def _after(frame: _Frame, origin: Frame) -> _Frame:
    turn, at = frame
    return turn @ rotation(origin.rpy), at + turn @ np.array(origin.xyz)


def _axes(arm: SpatialArm, files: Sequence[_Frame]) -> list[Array]:
    """z_j in the base: the joints' axes, parallel ones pointing the same way."""
    axes: list[Array] = []
    for joint, (turn, _) in zip(arm.joints, files, strict=True):
        z = turn @ np.array(joint.axis, dtype=float) / np.linalg.norm(joint.axis)
        if axes and _parallel(axes[-1], z):
            z = axes[-1]
        axes.append(z)
    return axes


def _parallel(u: Array, v: Array) -> bool:
    return bool(np.linalg.norm(np.cross(u, v)) < PARALLEL)


def _link_frames(arm: SpatialArm, files: Sequence[_Frame], axes: Sequence[Array]) -> list[_Frame]:
    """Frame j of every link in the base, where all q are 0; see the head of this file for what is chosen."""
    frames: list[_Frame] = []
    foot = files[0][1]  # where the common normal from the joint before meets this axis
    for j, z in enumerate(axes):
        x, origin = None, foot
        if j + 1 < len(axes):
            slides = arm.joints[j + 1].type == "prismatic"
            x, origin, foot = _normal((foot, z), (None if slides else files[j + 1][1], axes[j + 1]))
        before = frames[-1][0] if frames else None
        x = _across(z, before) if x is None else _nearer(x, before, z)
        frames.append((np.column_stack([x, np.cross(z, x), z]), origin))
    return frames


def _normal(axis: tuple[Array, Array], following: tuple[Array | None, Array]) -> tuple[Array | None, Array, Array]:
    """The common normal of two axes (a point, a direction each): direction, or None where any will do; its feet.

    An axis without a point goes through that of the other one.
    """
    (foot, z), (point, z_next) = axis, following
    across = np.cross(z, z_next)
    size = float(np.linalg.norm(across))
    if size < PARALLEL:
        if point is None:
            return None, foot, foot
        apart = point - foot
        apart = apart - z * (apart @ z)
        return _direction(apart), foot, foot + apart
    normal = across / size
    if point is None:
        return normal, foot, foot
    apart = point - foot
    origin = foot + z * (np.cross(apart, z_next) @ across) / size**2
    return normal, origin, origin + normal * (apart @ normal)


def _direction(vector: Array) -> Array | None:
    length = float(np.linalg.norm(vector))
    return None if length < 10.0**-LENGTH_DIGITS else vector / length


def _across(z: Array, before: Array | None) -> Array:
    """A direction across z: as near as can be to the x axis before it, or to the base's axes."""
    candidates = np.eye(3) if before is None else np.column_stack([before[:, 0], before[:, 1]])
    projected = candidates - np.outer(z, z @ candidates)
    best = int(np.argmax(np.linalg.norm(projected, axis=0) > np.sqrt(0.5)))
    return np.asarray(projected[:, best] / np.linalg.norm(projected[:, best]))


def _nearer(x: Array, before: Array | None, z: Array) -> Array:
    """Of the two directions of a normal, the one that turns the frame less against the one before it."""
    if before is None:
        return x
    cosine = float(x @ before[:, 0])
    if abs(cosine) > PARALLEL:
        return x if cosine > 0 else -x
    return x if float(np.cross(before[:, 0], x) @ z) > 0 else -x


def exact_length(value: float) -> Fraction:
    """A decimal number within LENGTH_DIGITS."""
    return Fraction(repr(round(float(value), LENGTH_DIGITS)))


def exact_turn(cosine: float, sine: float) -> Turn:
    """The rational point of the unit circle at an angle: exact at quarter turns."""
    half = (1.0 + cosine, sine) if cosine > 0 else (sine, 1.0 - cosine)
    w, x = _scaled(half)
    size = w * w + x * x
    return Turn((w * w - x * x) / size, 2 * w * x / size)


def exact_rotation(R: Array) -> Matrix:
    """The nearest rotation with rational elements, by its quaternion: exact where it turns axes into axes."""
    w, x, y, z = _scaled(_quaternion(R))
    size = w * w + x * x + y * y + z * z
    rows = (
        (w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )
    a, b, c = (_vector([e / size for e in row]) for row in rows)
    return a, b, c


def _quaternion(R: Array) -> Sequence[float]:
    """(w, x, y, z) of any length, from the largest of four that are the same but for their length."""
    t = float(np.trace(R))
    rows = np.array(
        [
            [1 + t, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], 1 + 2 * R[0, 0] - t, R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
            [R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], 1 + 2 * R[1, 1] - t, R[1, 2] + R[2, 1]],
            [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], 1 + 2 * R[2, 2] - t],
        ]
    )
    return [float(e) for e in rows[int(np.argmax(np.diag(rows)))]]


def _scaled(vector: Sequence[float]) -> list[Fraction]:
    """With its largest element ±1, rounded to TURN_DIGITS."""
    largest = max(abs(e) for e in vector)
    return [Fraction(repr(round(float(e) / float(largest), TURN_DIGITS))) for e in vector]


def _placement(outer: _Frame, inner: _Frame) -> Placement:
    turn, at = outer[0].T @ inner[0], outer[0].T @ (inner[1] - outer[1])
    return Placement(exact_rotation(turn), _vector([exact_length(e) for e in at]))


def _vector(elements: Sequence[Any]) -> Vector:
    x, y, z = elements
    return x, y, z
