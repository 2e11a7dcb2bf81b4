"""Rotations, frames and inertias in plain floating-point numbers, and the rounding of angles to exact quarter turns.

Quarter turns are exact: their sines and cosines are 0 and ±1, so that chains of them add no rounding error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass, field

from symbolic.model_file.arm import Frame
from symbolic.model_file.checks import Place

Vector = tuple[float, float, float]
Inertia = tuple[float, float, float, float, float, float]
"""xx, xy, xz, yy, yz, zz of a symmetric matrix (3, 3)."""
Rotation = tuple[Vector, Vector, Vector]
"""(3, 3), by rows: maps components in the turned frame to components in the other."""

QUARTER = math.pi / 2
IDENTITY: Rotation = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_SINES = (0.0, 1.0, 0.0, -1.0)
_LOCKED = 1e-12
"""Cosine of the pitch below which roll and yaw have the same axis (gimbal lock)."""


def cos_sin(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle in rad; exact at quarter turns."""
    turns = round(angle / QUARTER)
    if angle == turns * QUARTER:
        return _SINES[(turns + 1) % 4], _SINES[turns % 4]
    return math.cos(angle), math.sin(angle)


def rotation(rpy: Sequence[float]) -> Rotation:
    """R = Rz(yaw) Ry(pitch) Rx(roll) of rpy (3,) in rad."""
    (cr, sr), (cp, sp), (cy, sy) = (cos_sin(angle) for angle in rpy)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def angles(turned: Rotation) -> Vector:
    """rpy (3,) in rad of a rotation, pitch within ±π/2; in gimbal lock, yaw is 0.

    Roll is computed after yaw has been turned back, so that near gimbal lock, where rounding decides the yaw, the three
    angles still reproduce the rotation to the last digit.
    """
    level = math.hypot(turned[0][0], turned[1][0])
    pitch = math.atan2(-turned[2][0], level)
    if level < _LOCKED:
        return math.atan2(-turned[1][2], turned[1][1]), math.copysign(QUARTER, pitch), 0.0
    yaw = math.atan2(turned[1][0], turned[0][0])
    c, s = cos_sin(yaw)
    across = c * turned[1][1] - s * turned[0][1]
    return math.atan2(s * turned[0][2] - c * turned[1][2], across), pitch, yaw


def about(axis: Sequence[float], angle: float) -> Rotation:
    """The rotation by an angle in rad about an axis (3,) of any length."""
    length = math.hypot(*axis)
    x, y, z = (component / length for component in axis)
    c, s = cos_sin(angle)
    v = 1 - c
    return (
        (c + x * x * v, x * y * v - z * s, x * z * v + y * s),
        (y * x * v + z * s, c + y * y * v, y * z * v - x * s),
        (z * x * v - y * s, z * y * v + x * s, c + z * z * v),
    )


def transposed(matrix: Sequence[Vector]) -> Rotation:
    """Rᵀ of a matrix (3, 3)."""
    a, b, c = zip(*matrix, strict=True)
    return a, b, c


def applied(matrix: Rotation, vector: Sequence[float]) -> Vector:
    """R v, (3,), of a matrix (3, 3) and a vector (3,), each sum rounded once."""
    x, y, z = (math.fsum(m * v for m, v in zip(row, vector, strict=True)) for row in matrix)
    return x, y, z


def product(left: Rotation, right: Rotation) -> Rotation:
    """A B, (3, 3), of two matrices (3, 3)."""
    a, b, c = (applied(left, column) for column in transposed(right))
    return transposed((a, b, c))


def added(left: Sequence[float], right: Sequence[float]) -> Vector:
    """u + v, (3,)."""
    x, y, z = (a + b for a, b in zip(left, right, strict=True))
    return x, y, z


def scaled(factor: float, vector: Sequence[float]) -> Vector:
    """c v, (3,)."""
    x, y, z = (factor * component for component in vector)
    return x, y, z


def dot(left: Sequence[float], right: Sequence[float]) -> float:
    """u · v, rounded once."""
    return math.fsum(a * b for a, b in zip(left, right, strict=True))


def cross(left: Sequence[float], right: Sequence[float]) -> Vector:
    """u × v, (3,)."""
    (a, b, c), (x, y, z) = left, right
    return b * z - c * y, c * x - a * z, a * y - b * x


def composed(outer: Frame, inner: Frame) -> Frame:
    """The composition of two frames; if only one of them is rotated, its angles are kept exactly."""
    turned = rotation(outer.rpy)
    xyz = added(outer.xyz, applied(turned, inner.xyz))
    if not any(outer.rpy) or not any(inner.rpy):
        return Frame(xyz, inner.rpy if any(inner.rpy) else outer.rpy)
    return Frame(xyz, angles(product(turned, rotation(inner.rpy))))


def symmetric(inertia: Sequence[float]) -> Rotation:
    """The symmetric matrix (3, 3) of ixx, ixy, ixz, iyy, iyz, izz."""
    xx, xy, xz, yy, yz, zz = inertia
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


def principal_moments(inertia: Sequence[float]) -> Vector:
    """The eigenvalues of a body's inertia, ascending. Source: Smith 1961, Eigenvalues of a symmetric 3 x 3 matrix."""
    xx, xy, xz, yy, yz, zz = inertia
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    spread = math.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    if spread == 0:
        return mean, mean, mean
    a, b, c, d, e, f = (component / spread for component in (a, b, c, xy, xz, yz))
    half = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / 2
    turn = math.acos(min(1.0, max(-1.0, half))) / 3
    largest = mean + 2 * spread * math.cos(turn)
    smallest = mean + 2 * spread * math.cos(turn + 2 * math.pi / 3)
    return smallest, 3 * mean - smallest - largest, largest


SLACK = 1e-3
"""Relative to the largest principal moment: published inertias have three or four digits."""
ROUNDED = 1e-12
"""kg m²; rounding errors of this size, of either sign, stand for 0 in files written by programs."""


def impossible_moment(inertia: Sequence[float]) -> float | None:
    """A negative principal moment beyond rounding, which no body can have; None if there is none."""
    small, _, large = principal_moments(inertia)
    return small if small < -max(SLACK * large, ROUNDED) else None


CLOSE = 1e-5
"""rad; an angle closer than this to a quarter turn is one that was rounded when written. Published URDFs are off by
4.9e-12 to 3.7e-6; the smallest intended deviation among them is 0.049."""
UNREPORTED = 4e-15
"""rad; a smaller deviation is the rounding of a double and is not reported."""


@dataclass
class Snapping:
    """Angles and axes of a file that were rounded to exact quarter turns, with their locations and deviations."""

    changed: list[tuple[str, str, float]] = field(default_factory=list)
    """What was rounded, the joint or the tip, and by how much."""

    def frame(self, where: str, frame: Frame) -> Frame:
        """The frame with exact quarter turns."""
        turns = [round(angle / QUARTER) * QUARTER for angle in frame.rpy]
        snapped = [b if abs(a - b) < CLOSE else a for a, b in zip(frame.rpy, turns, strict=True)]
        off = max(abs(a - b) for a, b in zip(frame.rpy, snapped, strict=True))
        if off > UNREPORTED:
            self.changed.append(("the angles", where, off))
        roll, pitch, yaw = snapped
        return Frame(frame.xyz, (roll, pitch, yaw))

    def axis(self, place: Place, where: str, axis: Sequence[float]) -> Vector:
        """The axis without components that are rounding errors; a unit vector if it is along an axis of the frame.

        Raises ModelError for one without a direction.
        """
        length = math.hypot(*axis)
        if not SHORTEST <= length <= 1 / SHORTEST:
            place.fail(f"axis has the length {length:g}; expected a direction, such as [0.0, 0.0, 1.0]")
        x, y, z = (0.0 if abs(a / length) < CLOSE else a for a in axis)
        if sum(component != 0.0 for component in (x, y, z)) == 1:
            x, y, z = (math.copysign(1.0, a) if a else 0.0 for a in (x, y, z))
        snapped = (x, y, z)
        off = max(abs(a / length - b / math.hypot(*snapped)) for a, b in zip(axis, snapped, strict=True))
        if off > UNREPORTED:
            self.changed.append(("the axis", where, off))
        return snapped

    def notes(self, places: Set[str] | None = None) -> list[str]:
        """A warning about what was rounded at these places (None: all), or an empty list."""
        parts = []
        for kind, unit in (("the angles", " rad"), ("the axis", "")):
            changed = [(where, off) for what, where, off in self.changed if what == kind]
            changed = [entry for entry in changed if places is None or entry[0] in places]
            if changed:
                off = max(off for _, off in changed)
                parts.append(f"{kind} of {listed([where for where, _ in changed])} (off by up to {off:.1g}{unit})")
        return [f"taken as exact quarter turns: {'; '.join(parts)}"] if parts else []


LISTED = 8
"""Joints listed in a message; of further ones, only the count is given."""
SHORTEST = 1e-6
"""Minimum length of an axis, below which rounding decides its direction; the inverse is the maximum."""


def listed(places: Sequence[str]) -> str:
    """Places as text: joints 1, 2 and the tip."""
    joints = [place.removeprefix("joint ") for place in places if place.startswith("joint ")]
    others = [place for place in places if not place.startswith("joint ")]
    shown = [*joints[:LISTED], *([f"{len(joints) - LISTED} more"] if len(joints) > LISTED else [])]
    named = [f"joint{'s' if len(joints) > 1 else ''} {', '.join(shown)}"] if joints else []
    return " and ".join([*named, *others])


# --- bodies ---


@dataclass(frozen=True)
class StatedBody:
    """A body in some frame: mass in kg, com (3,) in m, inertia about com along the frame's axes in kg m², as Link's."""

    mass: float
    com: Vector
    inertia: Inertia

    @property
    def is_nothing(self) -> bool:
        """Whether mass and inertia are zero."""
        return self.mass == 0 and not any(self.inertia)


NO_BODY = StatedBody(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def placed(body: StatedBody, frame: Frame) -> StatedBody:
    """A body given in an inner frame, in the outer frame in which the inner one has the pose `frame`."""
    if frame == Frame():
        return body
    com = added(frame.xyz, applied(rotation(frame.rpy), body.com))
    return StatedBody(body.mass, com, rotated(body.inertia, frame.rpy))


def rotated(inertia: Inertia, rpy: Vector) -> Inertia:
    """R I Rᵀ; unchanged where rpy is zero."""
    if not any(rpy):
        return inertia
    R = rotation(rpy)
    return packed(product(product(R, symmetric(inertia)), transposed(R)))


def packed(matrix: Sequence[Sequence[float]]) -> Inertia:
    """The six independent entries of a symmetric matrix (3, 3)."""
    return matrix[0][0], matrix[0][1], matrix[0][2], matrix[1][1], matrix[1][2], matrix[2][2]


def together(bodies: Sequence[StatedBody]) -> StatedBody:
    """Several bodies in one frame as one body, by the parallel axis theorem."""
    bodies = [body for body in bodies if not body.is_nothing]
    if len(bodies) == 1:
        return bodies[0]
    mass = math.fsum(body.mass for body in bodies)
    x, y, z = (math.fsum(b.mass * b.com[k] for b in bodies) / mass if mass else 0.0 for k in range(3))
    shifted = [about_point(body, (x, y, z)) for body in bodies]
    xx, xy, xz, yy, yz, zz = (math.fsum(inertia[k] for inertia in shifted) for k in range(6))
    return StatedBody(mass, (x, y, z), (xx, xy, xz, yy, yz, zz))


def about_point(body: StatedBody, point: Vector) -> Inertia:
    """The body's inertia about a point (Steiner)."""
    m, (x, y, z) = body.mass, (a - b for a, b in zip(body.com, point, strict=True))
    xx, xy, xz, yy, yz, zz = body.inertia
    return (
        xx + m * (y * y + z * z),
        xy - m * x * y,
        xz - m * x * z,
        yy + m * (x * x + z * z),
        yz - m * y * z,
        zz + m * (x * x + y * y),
    )


def parameters(body: StatedBody) -> list[float]:
    """The ten inertial parameters: m; m x, m y, m z; Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the origin."""
    return [body.mass, *scaled(body.mass, body.com), *about_point(body, (0.0, 0.0, 0.0))]
