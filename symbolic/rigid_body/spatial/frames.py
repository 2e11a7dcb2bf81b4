"""Where the frames of a chain stand at q = 0, in double precision: those of the model file, and those of its links.

Source: Khalil & Kleinfinger 1986; see geometry.py for what the notation leaves free, and how it is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from symbolic.model_file.arm import Arm, Frame
from symbolic.rigid_body.spatial.vectors import Matrix, Vector, added, applied, cross, dot, less, scaled

PARALLEL = 1e-10
"""Sine of the angle between two axes below which they are parallel: rounding of rpy in double precision."""
COINCIDENT = 1e-12
"""m; axes that are less apart coincide: likewise."""


class Standing(NamedTuple):
    """A frame in the base: rotation matrix and origin."""

    turn: Matrix
    at: Vector

    def inside(self, other: Standing) -> Standing:
        """It as the other frame sees it."""
        back = transposed(other.turn)
        columns = [applied(back, column) for column in transposed(self.turn)]
        return Standing(transposed(columns), applied(back, less(self.at, other.at)))

    def followed(self, origin: Frame) -> Standing:
        """The frame that stands in it at `origin`."""
        columns = [applied(self.turn, column) for column in transposed(rotation(origin.rpy))]
        return Standing(transposed(columns), added(self.at, applied(self.turn, origin.xyz)))


def transposed(M: Sequence[Sequence[float]]) -> Matrix:
    """Mᵀ, (3, 3)."""
    x, y, z = zip(*M, strict=True)
    return x, y, z


def rotation(rpy: Sequence[float]) -> Matrix:
    """R (3, 3) = Rz(yaw) Ry(pitch) Rx(roll), as URDF says it."""
    (cr, cp, cy), (sr, sp, sy) = ([f(angle) for angle in rpy] for f in (math.cos, math.sin))
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


BASE = Standing(rotation((0.0, 0.0, 0.0)), (0.0, 0.0, 0.0))


def file_frames(arm: Arm) -> list[Standing]:
    """The model file's joint frames, (n,)."""
    frames, last = [], BASE
    for joint in arm.joints:
        last = last.followed(joint.origin)
        frames.append(last)
    return frames


def places(arm: Arm) -> tuple[tuple[float, ...], ...]:
    """Origins of the joint frames where q = 0, n tuples of 2 numbers (planar) or 3, m in base axes."""
    return tuple(tuple(map(float, frame.at[: len(arm.stated_gravity)])) for frame in file_frames(arm))


def file_axes(arm: Arm, files: Sequence[Standing]) -> list[Vector]:
    """The joints' axes, (n,) unit vectors in the base."""
    return [applied(file.turn, _unit(joint.axis)) for joint, file in zip(arm.joints, files, strict=True)]


def link_frames(arm: Arm, files: Sequence[Standing]) -> list[Standing]:
    """Frame j of every link, (n,): z along its joint's axis or, after a parallel axis, along that one's z; of a slide
    behind a revolute joint along that one's z."""
    own = file_axes(arm, files)
    axes: list[Vector] = []
    turning = False
    for joint, z in zip(arm.joints, own, strict=True):
        stays = turning and joint.type == "prismatic"
        axes.append(axes[-1] if stays or (axes and _length(cross(axes[-1], z)) < PARALLEL) else z)
        turning = turning or joint.type == "revolute"
    frames: list[Standing] = []
    foot = files[0].at  # where the common normal from the joint before meets this axis
    for j, z in enumerate(axes):
        x, origin = None, foot
        if j + 1 < len(axes):
            if arm.joints[j + 1].type == "revolute":
                x, origin, foot = _normal(foot, z, files[j + 1].at, axes[j + 1])
            else:
                x, origin = _slope(z, axes[j + 1], own[j + 1]), foot
        before = transposed(frames[-1].turn) if frames else transposed(BASE.turn)
        x = _across(z, before) if x is None else _nearer(x, before[0], z) if frames else x
        frames.append(Standing(transposed((x, cross(z, x), z)), origin))
    return frames


def _slope(z: Vector, z_next: Vector, slide: Vector) -> Vector | None:
    """x before a slide: across z and z_next or, where they are one, across z in the plane of the slide; None where any
    will do."""
    across = cross(z, z_next)
    if _length(across) < PARALLEL:
        across = cross(cross(z, slide), z)
    return None if _length(across) < PARALLEL else _unit(across)


def _normal(foot: Vector, z: Vector, point: Vector, z_next: Vector) -> tuple[Vector | None, Vector, Vector]:
    """The common normal of two axes, a point and a direction each: direction, or None where any will do; its feet."""
    across = cross(z, z_next)
    size = _length(across)
    apart = less(point, foot)
    if size < PARALLEL:
        apart = less(apart, scaled(dot(apart, z), z))
        return (None if _length(apart) < COINCIDENT else _unit(apart)), foot, added(foot, apart)
    normal = _unit(across)
    origin = added(foot, scaled(dot(cross(apart, z_next), across) / size**2, z))
    return normal, origin, added(origin, scaled(dot(apart, normal), normal))


def _across(z: Vector, before: Matrix) -> Vector:
    """A direction across z: the x axis before it or, where that is nearer to z, the y axis, less what is along z."""
    x = less(before[0], scaled(dot(before[0], z), z))
    return _unit(x if _length(x) ** 2 > 0.5 else less(before[1], scaled(dot(before[1], z), z)))


def _nearer(x: Vector, before: Vector, z: Vector) -> Vector:
    """Of the two directions of a normal, the one that turns the frame less against the x axis before it."""
    cosine = dot(x, before)
    side = cosine if abs(cosine) > PARALLEL else dot(cross(before, x), z)
    return x if side > 0 else scaled(-1.0, x)


def _length(v: Sequence[float]) -> float:
    return math.sqrt(dot(v, v))


def _unit(v: Sequence[float]) -> Vector:
    return scaled(1 / _length(v), v)
