"""The geometry of a chain in space: a model file's origins and axes as modified DH frames, in exact numbers.

Frame j is fixed to link j: z_j along joint j's axis, x_j along the common normal of the axes j and j + 1. From
frame j − 1 to frame j:

    turn by twist_j about x, move by a_j along x, turn by theta_j about z, move by d_j along z

theta_j = offset_j + sign_j q_j of a revolute joint. A prismatic one moves its link by sign_j q_j in the plane of
x_(j−1) and z_j, tilted from z_j towards x_(j−1). What the file leaves free is chosen so that most of it vanishes:

- Frame 0 is fixed to the base, with z_0 = z_1, and coincides with frame 1 where q1 = 0.
- Parallel axes point the same way (sign_j = −1 where the file has them against each other): their twist is 0. What
  they are apart along themselves stands at the last of them.
- A prismatic joint has a direction and no place: its axis goes through the origin before it. It does not turn its
  link: behind a revolute joint, z stays that one's, so that the twist to the next revolute axis is the angle between
  the two. Before the first revolute joint z is along the slide.
- The last link's frame stands in the one before it where q_n = 0.

Numbers are exact from here on: lengths are rounded to LENGTH_DIGITS, rotations to rational points of the unit circle
or sphere, so that rotation matrices are orthogonal to the last digit in any ring and quarter turns are 0 and ±1. Axes
that are parallel, perpendicular or one in the file are so exactly: base parameters are counted on these numbers.

Source: Khalil & Kleinfinger 1986 (modified Denavit-Hartenberg notation).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import sympy as sp

from symbolic.model_file.arm import Arm
from symbolic.rigid_body.spatial.frames import (
    BASE,
    PARALLEL,
    Standing,
    file_axes,
    file_frames,
    link_frames,
    transposed,
)
from symbolic.rigid_body.spatial.vectors import Matrix, Vector, applied, cross, dot, less, scaled
from symbolic.straightline import Notes, Turn

LENGTH_DIGITS = 12
"""Decimals of a length in m: what floating point adds to a file's decimals lies beyond them."""
TURN_DIGITS = 13
"""Decimals of the tangent of half an angle, likewise: a chain of seven frames adds some 1e-15."""
NO_ANGLE: Any = 0
UPRIGHT = Turn(Fraction(1), Fraction(0))


@dataclass(frozen=True)
class Placement:
    """A rigid frame in another: its point p is the other's turn · p + at. turn (3, 3) orthogonal; at (3,) m."""

    turn: Matrix
    at: Vector

    def over(self, number: Callable[[Fraction], Any]) -> Placement:
        """The same in another ring."""
        a, b, c = (_vector([number(e) for e in row]) for row in self.turn)
        return Placement((a, b, c), _vector([number(e) for e in self.at]))


@dataclass(frozen=True)
class LinkFrame:
    """The step from frame j − 1 to frame j, see above.

    sign     1; −1 where the joint turns or slides against z_j
    twist    cosine and sine
    a, d     m
    offset   cosine and sine of theta_j where q_j = 0; of a revolute joint its quarter turns alone, 0 and ±1, and
    rest     the angle beyond them: 0, a Turn, or a symbol
    tilt     cosine and sine of a slide's angle from z_j towards x_(j−1); of a revolute joint 0
    body     the model file's joint frame, in which mass and inertia are stated, in frame j
    """

    revolute: bool
    sign: int
    twist: Turn
    a: Any
    offset: Turn
    rest: Any
    d: Any
    tilt: Turn
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
        """d_j, and the way of a prismatic joint along z_j."""
        return self.d if self.revolute or self.tilt.cos == 0 else self.d + self.sign * self.tilt.cos * q

    def across(self, q: Any) -> Any:
        """a_j, and the way of a prismatic joint along x_(j−1)."""
        return self.a if self.tilt.sin == 0 else self.a + self.sign * self.tilt.sin * q

    def axis(self, before: tuple[Any, Any]) -> Vector:
        """(3,) that the joint turns about or slides along, but for the sign, along axes that have z_j and in which
        x_(j−1) has this cosine and sine."""
        c, s = before
        return (c * self.tilt.sin, s * self.tilt.sin, self.tilt.cos) if self.tilt.sin != 0 else (0, 0, self.tilt.cos)


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
        """Number of joints."""
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
                tilt=_turn_over(link.tilt, number),
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


def geometry(arm: Arm) -> Geometry:
    """The frames of an arm."""
    files = file_frames(arm)
    frames = link_frames(arm, files)
    axes = file_axes(arm, files)
    before = [frames[0], *frames[:-1]]
    links = tuple(
        _link(joint.type == "revolute", axis, *standing)
        for joint, axis, *standing in zip(arm.joints, axes, frames, before, files, strict=True)
    )
    gravity = Standing(BASE.turn, arm.gravity).inside(Standing(frames[0].turn, (0.0, 0.0, 0.0))).at
    return Geometry(
        links,
        _settled(_vector([exact_length(g) for g in gravity]), _still_axes(links)),
        _placement(frames[0]),
        _placement(files[-1].followed(arm.tip).inside(frames[-1])),
    )


def _link(revolute: bool, axis: Vector, frame: Standing, before: Standing, file: Standing) -> LinkFrame:
    x, z = transposed(before.turn)[0], transposed(frame.turn)[2]
    sign = 1 if dot(axis, z) > -PARALLEL else -1
    tilt = UPRIGHT if revolute else exact_turn(sign * dot(axis, z), sign * dot(axis, x))
    step, reach = frame.inside(before)
    twist = exact_turn(step[2][2], -step[1][2])
    offset, rest = exact_turn(step[0][0], -step[0][1]), NO_ANGLE
    if revolute and 0 not in offset.pair:
        offset, rest = UPRIGHT, offset
    a, d = exact_length(reach[0]), exact_length(dot(reach, (0.0, -float(twist.sin), float(twist.cos))))
    return LinkFrame(revolute, sign, twist, a, offset, rest, d, tilt, _placement(file.inside(frame)))


def _still_axes(links: Sequence[LinkFrame]) -> list[Vector]:
    """The axes that stand still in frame 0: those up to the first revolute joint."""
    axes: list[Vector] = []
    turn: Matrix = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    for link in links:
        start = link.start.turn
        turn = transposed([applied(turn, column) for column in transposed(start)])
        axes.append(transposed(turn)[2])
        if link.revolute:
            break
    return axes


def _settled(gravity: Vector, axes: Sequence[Vector]) -> Vector:
    """Gravity, along or across each of these unit vectors exactly where it is so but for rounding."""
    size, level = math.hypot(*map(float, gravity)), None
    for axis in axes:
        pull = dot(gravity, axis)
        if math.hypot(*map(float, cross(gravity, axis))) <= PARALLEL * size:
            return scaled(pull, axis)
        if abs(pull) > PARALLEL * size:
            continue
        normal = axis if level is None else cross(level, axis)
        if not any(normal):
            continue
        if level is None:
            gravity, level = less(gravity, scaled(pull, axis)), axis
        else:
            return scaled(dot(gravity, normal) / dot(normal, normal), normal)
    return gravity


def exact_length(value: float) -> Fraction:
    """A decimal number within LENGTH_DIGITS."""
    return Fraction(repr(round(value, LENGTH_DIGITS)))


def exact_turn(cosine: float, sine: float) -> Turn:
    """The rational point of the unit circle at an angle: exact at quarter turns."""
    half = (1.0 + cosine, sine) if cosine > 0 else (sine, 1.0 - cosine)
    w, x = _scaled(half)
    size = w * w + x * x
    return Turn((w * w - x * x) / size, 2 * w * x / size)


def exact_rotation(R: Matrix) -> Matrix:
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


def _quaternion(R: Matrix) -> Sequence[float]:
    """(w, x, y, z) of any length, from the largest of four that are the same but for their length."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R
    t = xx + yy + zz
    rows = (
        (1 + t, zy - yz, xz - zx, yx - xy),
        (zy - yz, 1 + 2 * xx - t, xy + yx, xz + zx),
        (xz - zx, xy + yx, 1 + 2 * yy - t, yz + zy),
        (yx - xy, xz + zx, yz + zy, 1 + 2 * zz - t),
    )
    return max(enumerate(rows), key=lambda item: item[1][item[0]])[1]


def _scaled(elements: Sequence[float]) -> list[Fraction]:
    """With the largest element ±1, rounded to TURN_DIGITS."""
    largest = max(abs(e) for e in elements)
    return [Fraction(repr(round(e / largest, TURN_DIGITS))) for e in elements]


def _placement(frame: Standing) -> Placement:
    return Placement(exact_rotation(frame.turn), _vector([exact_length(e) for e in frame.at]))


def _vector(elements: Sequence[Any]) -> Vector:
    x, y, z = elements
    return x, y, z
