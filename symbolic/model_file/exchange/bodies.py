"""Bodies put together: masses, centres and inertias of what is rigidly joined, in one frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from symbolic.model_file.arm import Frame
from symbolic.model_file.frames import Vector, added, applied, product, rotation, symmetric, transposed

Inertia = tuple[float, float, float, float, float, float]
NOWHERE = Frame()


@dataclass(frozen=True)
class StatedBody:
    """mass in kg, com (3,) in m in some frame, inertia about it in kg m² along that frame's axes, as Link's."""

    mass: float
    com: Vector
    inertia: Inertia

    @property
    def is_nothing(self) -> bool:
        """Whether the file states a body without mass and without inertia."""
        return self.mass == 0 and not any(self.inertia)


NOTHING = StatedBody(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def placed(body: StatedBody, frame: Frame) -> StatedBody:
    """A body of an inner frame, which stands at `frame`, in the outer one."""
    if frame == NOWHERE:
        return body
    com = added(frame.xyz, applied(rotation(frame.rpy), body.com))
    return StatedBody(body.mass, com, turned(body.inertia, frame.rpy))


def turned(inertia: Inertia, rpy: Vector) -> Inertia:
    """R I Rᵀ; as it is where nothing turns."""
    if not any(rpy):
        return inertia
    R = rotation(rpy)
    return packed(product(product(R, symmetric(inertia)), transposed(R)))


def packed(matrix: Sequence[Sequence[float]]) -> Inertia:
    """The six of a symmetric (3, 3)."""
    return matrix[0][0], matrix[0][1], matrix[0][2], matrix[1][1], matrix[1][2], matrix[2][2]


def together(bodies: Sequence[StatedBody]) -> StatedBody:
    """One body of several in one frame, by the parallel axis theorem; of a single one, itself."""
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
