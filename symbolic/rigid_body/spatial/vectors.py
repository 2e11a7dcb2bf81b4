"""Vectors of three elements over any ring."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Vector = tuple[Any, Any, Any]
Matrix = tuple[Vector, Vector, Vector]

NOWHERE: Vector = (0, 0, 0)


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
    """The vector whose elements stand along the axes x, y, z."""
    return added(added(scaled(v[0], x), scaled(v[1], y)), scaled(v[2], z))


def applied(R: Sequence[Sequence[Any]], v: Sequence[Any]) -> Vector:
    """R v."""
    return dot(R[0], v), dot(R[1], v), dot(R[2], v)


def placed(turn: Sequence[Sequence[Any]], at: Sequence[Any], point: Sequence[Any]) -> Vector:
    """A point of the frame that stands at `at`, turned by `turn`."""
    return added(applied(turn, point), at)
