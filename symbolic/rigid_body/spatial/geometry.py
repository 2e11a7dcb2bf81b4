"""The geometry of a spatial chain: the model file's origins and axes as modified DH frames, in exact numbers.

Frame j is fixed to link j: z_j lies along joint j's axis, x_j along the common normal of the axes j and j + 1. The step
from frame j − 1 to frame j:

    turn by twist_j about x, move by a_j along x, turn by theta_j about z, move by d_j along z

theta_j = offset_j + sign_j q_j of a revolute joint. A prismatic joint moves its link by sign_j q_j in the plane of
x_(j−1) and z_j, tilted from z_j towards x_(j−1). The notation leaves some frames free; they are chosen so that most of
their parameters are 0:

- Frame 0 is fixed to the base, with z_0 = z_1, and coincides with frame 1 where q1 = 0.
- Parallel axes point the same way (sign_j = −1 where the file has them antiparallel), so that their twist is 0. The
  offset along parallel axes is given to the last of them.
- A prismatic joint has a direction and no position: its axis passes through the origin before it. Its link does not
  turn: behind a revolute joint, z stays that joint's, so that the twist to the next revolute axis is the angle between
  the two revolute axes. Before the first revolute joint, z is along the slide.
- The last link's frame coincides with the one before it where q_n = 0.

Lengths are rounded to LENGTH_DIGITS, rotations to rational points of the unit circle or sphere, so that rotation
matrices are exactly orthogonal in any ring and quarter turns are exactly 0 and ±1. Axes that are parallel,
perpendicular or coincident in the file are exactly so here: base parameters are counted on these numbers.

Source: Khalil & Kleinfinger 1986 (modified Denavit-Hartenberg notation).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, NamedTuple

import sympy as sp

from symbolic.functions import Notes, Turn, residue
from symbolic.model_file.arm import Arm, Frame
from symbolic.model_file.frames import IDENTITY, rotation, transposed

Vector = tuple[Any, Any, Any]
Matrix = tuple[Vector, Vector, Vector]

NOWHERE: Vector = (0, 0, 0)


def vector(elements: Sequence[Any]) -> Vector:
    """Three elements as a vector."""
    x, y, z = elements
    return x, y, z


def added(u: Sequence[Any], v: Sequence[Any]) -> Vector:
    """u + v, (3,)."""
    return u[0] + v[0], u[1] + v[1], u[2] + v[2]


def less(u: Sequence[Any], v: Sequence[Any]) -> Vector:
    """u − v, (3,)."""
    return u[0] - v[0], u[1] - v[1], u[2] - v[2]


def negative(v: Sequence[Any]) -> Vector:
    """−v, (3,)."""
    return -v[0], -v[1], -v[2]


def scaled(factor: Any, v: Sequence[Any]) -> Vector:
    """c v, (3,)."""
    return factor * v[0], factor * v[1], factor * v[2]


def cross(u: Sequence[Any], v: Sequence[Any]) -> Vector:
    """u × v, (3,)."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


def dot(u: Sequence[Any], v: Sequence[Any]) -> Any:
    """u · v."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def along(v: Sequence[Any], x: Sequence[Any], y: Sequence[Any], z: Sequence[Any]) -> Vector:
    """The vector with components v along the axes x, y, z."""
    return added(added(scaled(v[0], x), scaled(v[1], y)), scaled(v[2], z))


def applied(R: Sequence[Sequence[Any]], v: Sequence[Any]) -> Vector:
    """R v."""
    return dot(R[0], v), dot(R[1], v), dot(R[2], v)


PARALLEL = 1e-10
"""Sine of an angle below which two axes are parallel: rounding of rpy in double precision."""
COINCIDENT = 1e-12
"""m; axes closer than this coincide."""


class Placement(NamedTuple):
    """The pose of a frame in another: point p is turn · p + at there. turn (3, 3) orthogonal; at (3,) m."""

    turn: Matrix
    at: Vector

    def placed(self, point: Sequence[Any]) -> Vector:
        """A point of the frame in the other."""
        return added(applied(self.turn, point), self.at)

    def joined(self, inner: Placement) -> Placement:
        """The pose of a frame that has the pose `inner` in this one."""
        return Placement(_times(self.turn, inner.turn), self.placed(inner.at))

    def inside(self, other: Placement) -> Placement:
        """The pose in another frame."""
        back = transposed(other.turn)
        return Placement(_times(back, self.turn), applied(back, less(self.at, other.at)))

    def over(self, number: Callable[[Fraction], Any]) -> Placement:
        """The same with numbers of another ring."""
        a, b, c = (vector([number(e) for e in row]) for row in self.turn)
        return Placement((a, b, c), vector([number(e) for e in self.at]))


def _times(left: Matrix, right: Matrix) -> Matrix:
    return transposed([applied(left, column) for column in transposed(right)])


BASE = Placement(IDENTITY, (0.0, 0.0, 0.0))


def _pose(frame: Frame) -> Placement:
    return Placement(rotation(frame.rpy), frame.xyz)


def file_frames(arm: Arm) -> list[Placement]:
    """Poses of the model file's joint frames at q = 0, (n,)."""
    frames, last = [], BASE
    for joint in arm.joints:
        last = last.joined(_pose(joint.origin))
        frames.append(last)
    return frames


def places(arm: Arm) -> tuple[tuple[float, ...], ...]:
    """Origins of the joint frames where q = 0, n tuples of 2 numbers (planar) or 3, m in base axes."""
    return tuple(tuple(map(float, frame.at[: len(arm.stated_gravity)])) for frame in file_frames(arm))


def file_axes(arm: Arm, files: Sequence[Placement]) -> list[Vector]:
    """The joints' axes at q = 0, (n,) unit vectors in the base."""
    return [applied(file.turn, _unit(joint.axis)) for joint, file in zip(arm.joints, files, strict=True)]


def link_frames(arm: Arm, files: Sequence[Placement]) -> list[Placement]:
    """The links' DH frames at q = 0, (n,). z is along the joint's axis; along the previous z if the axes are parallel
    or the joint is a slide behind a revolute joint."""
    own = file_axes(arm, files)
    axes: list[Vector] = []
    turning = False
    for joint, z in zip(arm.joints, own, strict=True):
        stays = turning and joint.type == "prismatic"
        axes.append(axes[-1] if stays or (axes and math.hypot(*cross(axes[-1], z)) < PARALLEL) else z)
        turning = turning or joint.type == "revolute"
    frames: list[Placement] = []
    foot = files[0].at  # foot of the common normal with the previous axis
    for j, z in enumerate(axes):
        x, origin = None, foot
        if j + 1 < len(axes):
            if arm.joints[j + 1].type == "revolute":
                x, origin, foot = _normal(foot, z, files[j + 1].at, axes[j + 1])
            else:
                x, origin = _slope(z, axes[j + 1], own[j + 1]), foot
        x_before, y_before, _ = transposed(frames[-1].turn if frames else BASE.turn)
        if x is None:
            # The previous x axis (or y, if x is closer to z) without its part along z.
            x = less(x_before, scaled(dot(x_before, z), z))
            x = _unit(x if math.hypot(*x) ** 2 > 0.5 else less(y_before, scaled(dot(y_before, z), z)))
        elif frames:
            # Of the two directions of a normal, the one that turns the frame less.
            cosine = dot(x, x_before)
            side = cosine if abs(cosine) > PARALLEL else dot(cross(x_before, x), z)
            x = x if side > 0 else scaled(-1.0, x)
        frames.append(Placement(transposed((x, cross(z, x), z)), origin))
    return frames


def _slope(z: Vector, z_next: Vector, slide: Vector) -> Vector | None:
    """x before a slide: perpendicular to z and z_next or, if these are parallel, perpendicular to z in the plane of the
    slide; None if it is arbitrary."""
    across = cross(z, z_next)
    if math.hypot(*across) < PARALLEL:
        across = cross(cross(z, slide), z)
    return None if math.hypot(*across) < PARALLEL else _unit(across)


def _normal(foot: Vector, z: Vector, point: Vector, z_next: Vector) -> tuple[Vector | None, Vector, Vector]:
    """The common normal of two axes (point and direction each): its direction, or None if arbitrary, and its feet."""
    across = cross(z, z_next)
    size = math.hypot(*across)
    apart = less(point, foot)
    if size < PARALLEL:
        apart = less(apart, scaled(dot(apart, z), z))
        return (None if math.hypot(*apart) < COINCIDENT else _unit(apart)), foot, added(foot, apart)
    normal = _unit(across)
    origin = added(foot, scaled(dot(cross(apart, z_next), across) / size**2, z))
    return normal, origin, added(origin, scaled(dot(apart, normal), normal))


def _unit(v: Sequence[float]) -> Vector:
    return scaled(1 / math.hypot(*v), v)


LENGTH_DIGITS = 12
"""Decimals of a length in m, so that floating-point errors are rounded away."""
TURN_DIGITS = 13
"""Decimals of the tangent of half an angle; a chain of seven frames has errors of some 1e-15."""
NO_ANGLE: Any = 0
UPRIGHT = Turn(Fraction(1), Fraction(0))


@dataclass(frozen=True)
class LinkFrame:
    """The step from frame j − 1 to frame j, see the module.

    sign     1, or −1 where the joint turns or slides against z_j
    twist    cosine and sine
    a, d     m
    offset   cosine and sine of theta_j at q_j = 0; of a revolute joint only its quarter turns, and
    rest     the remaining angle: 0, a Turn, or a symbol
    tilt     cosine and sine of a slide's angle from z_j towards x_(j−1); angle 0 of a revolute joint
    body     pose in frame j of the model file's joint frame, in which mass and inertia are stated
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
        """The pose in the previous frame at q_j = 0, without `rest`."""
        (c, s), (ca, sa) = self.offset.pair, self.twist.pair
        turn = ((c, -s, c * 0), (ca * s, ca * c, -sa), (sa * s, sa * c, ca))
        return Placement(turn, (self.a, -sa * self.d, ca * self.d))

    def angle(self, q: Any) -> Any:
        """theta_j of a revolute joint without its quarter turns. q: an angle as Notes.sincos takes it."""
        turned = q if self.sign > 0 else -q
        return turned if isinstance(self.rest, int) else turned + self.rest

    def direction(self, q: Any, notes: Notes) -> tuple[Any, Any]:
        """Cosine and sine of theta_j."""
        return quarter_turned(notes.sincos(self.angle(q)), self.offset) if self.revolute else self.offset.pair

    def reach(self, q: Any) -> Any:
        """d_j plus the displacement of a prismatic joint along z_j."""
        return self.d if self.revolute or self.tilt.cos == 0 else self.d + self.sign * self.tilt.cos * q

    def across(self, q: Any) -> Any:
        """a_j plus the displacement of a prismatic joint along x_(j−1)."""
        return self.a if self.tilt.sin == 0 else self.a + self.sign * self.tilt.sin * q

    def axis(self, before: tuple[Any, Any]) -> Vector:
        """The joint's axis (3,) without its sign, in axes with z = z_j. before: cosine and sine of x_(j−1) there."""
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
        """The same with numbers of another ring. rests: (n,) the angles beyond quarter turns."""
        links = tuple(
            replace(
                link,
                twist=link.twist.over(number),
                a=number(link.a),
                offset=link.offset.over(number),
                rest=rest,
                d=number(link.d),
                tilt=link.tilt.over(number),
                body=link.body.over(number),
            )
            for link, rest in zip(self.links, rests, strict=True)
        )
        gravity = vector([number(g) for g in self.gravity])
        return Geometry(links, gravity, self.base.over(number), self.tip.over(number))

    def symbolic(self) -> Geometry:
        """For emission: SymPy rationals, and symbols for angles beyond quarter turns."""
        rests = [0 if isinstance(link.rest, int) else offset_symbol(j) for j, link in enumerate(self.links, 1)]
        return self.over(lambda x: sp.Rational(x.numerator, x.denominator), rests)

    def residues(self, prime: int) -> Geometry:
        """Modulo a prime."""
        number = functools.partial(residue, prime=prime)
        return self.over(number, [r if isinstance(r, int) else r.over(number) for r in self.rests])

    @property
    def rests(self) -> tuple[Any, ...]:
        """(n,) angles beyond quarter turns: 0 or a Turn."""
        return tuple(link.rest for link in self.links)


def offset_symbol(joint: int) -> sp.Symbol:
    """The struct's constant for a joint's (1-based) angle beyond quarter turns."""
    return sp.Symbol(f"offset{joint}", real=True)


def quarter_turned(direction: tuple[Any, Any], quarter: Turn) -> tuple[Any, Any]:
    """(cos, sin) of an angle plus quarter turns."""
    c, s = direction
    return c * quarter.cos - s * quarter.sin, s * quarter.cos + c * quarter.sin


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
    gravity = Placement(BASE.turn, arm.gravity).inside(Placement(frames[0].turn, (0.0, 0.0, 0.0))).at
    return Geometry(
        links,
        _settled(vector([exact_length(g) for g in gravity]), links),
        _exact(frames[0]),
        _exact(files[-1].joined(_pose(arm.tip)).inside(frames[-1])),
    )


def _link(revolute: bool, axis: Vector, frame: Placement, before: Placement, file: Placement) -> LinkFrame:
    x, z = transposed(before.turn)[0], transposed(frame.turn)[2]
    sign = 1 if dot(axis, z) > -PARALLEL else -1
    tilt = UPRIGHT if revolute else exact_turn(sign * dot(axis, z), sign * dot(axis, x))
    step, reach = frame.inside(before)
    twist = exact_turn(step[2][2], -step[1][2])
    offset, rest = exact_turn(step[0][0], -step[0][1]), NO_ANGLE
    if revolute and 0 not in offset.pair:
        offset, rest = UPRIGHT, offset
    a, d = exact_length(reach[0]), exact_length(dot(reach, (0.0, -float(twist.sin), float(twist.cos))))
    return LinkFrame(
        revolute, sign, twist, a=a, offset=offset, rest=rest, d=d, tilt=tilt, body=_exact(file.inside(frame))
    )


def _settled(gravity: Vector, links: Sequence[LinkFrame]) -> Vector:
    """Gravity made exactly parallel or perpendicular, where it is so up to rounding, to the axes that are fixed in
    frame 0: those up to the first revolute joint."""
    axes: list[Vector] = []
    turn: Matrix = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    for link in links:
        turn = _times(turn, link.start.turn)
        axes.append(transposed(turn)[2])
        if link.revolute:
            break
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
    """A length rounded to LENGTH_DIGITS decimals."""
    return Fraction(repr(round(value, LENGTH_DIGITS)))


def exact_turn(cosine: float, sine: float) -> Turn:
    """A rational point of the unit circle near an angle; exact at quarter turns."""
    half = (1.0 + cosine, sine) if cosine > 0 else (sine, 1.0 - cosine)
    w, x = _scaled(half)
    size = w * w + x * x
    return Turn((w * w - x * x) / size, 2 * w * x / size)


def exact_rotation(R: Matrix) -> Matrix:
    """A rational rotation matrix near R, by its quaternion; exact where axes map to axes."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R
    t = xx + yy + zz
    # (w, x, y, z) of any length: the largest of four proportional candidates.
    candidates = (
        (1 + t, zy - yz, xz - zx, yx - xy),
        (zy - yz, 1 + 2 * xx - t, xy + yx, xz + zx),
        (xz - zx, xy + yx, 1 + 2 * yy - t, yz + zy),
        (yx - xy, xz + zx, yz + zy, 1 + 2 * zz - t),
    )
    w, x, y, z = _scaled(max(enumerate(candidates), key=lambda item: item[1][item[0]])[1])
    size = w * w + x * x + y * y + z * z
    rows = (
        (w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )
    a, b, c = (vector([e / size for e in row]) for row in rows)
    return a, b, c


def _scaled(elements: Sequence[float]) -> list[Fraction]:
    largest = max(abs(e) for e in elements)
    return [Fraction(repr(round(e / largest, TURN_DIGITS))) for e in elements]


def _exact(frame: Placement) -> Placement:
    return Placement(exact_rotation(frame.turn), vector([exact_length(e) for e in frame.at]))
