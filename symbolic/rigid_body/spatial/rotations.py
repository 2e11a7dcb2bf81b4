"""Angles and axes of a model file as exact rational rotations, so that an equality can be proved and not only measured.

A cosine of an angle that people write is irrational. In its place stands a rational point of the unit circle within
1e-16 of it, so that cos² + sin² = 1 holds exactly; quarter turns, and axes along a coordinate, are what they are.
Everything that is derived of an arm, and everything that proves it, takes its rotations from here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from symbolic.straightline import Turn

SNAP = 1e-5
"""rad; an angle so near a quarter turn, or an axis so near a coordinate's, is meant to be one."""
_DIGITS = 10**9
"""Denominators of half tangents: the nearest such fraction is within 1e-18."""

Matrix = list[list[Any]]
Vector = tuple[Any, Any, Any]


def quarter_turns(angle: float) -> int:
    """The number of quarter turns that are nearest to an angle, in rad."""
    return round(angle / (math.pi / 2))


def exact_turn(angle: float) -> Turn:
    """(cos, sin) of an angle in rad, as fractions on the unit circle."""
    quarters = quarter_turns(angle)
    rest = angle - quarters * (math.pi / 2)
    t = Fraction(0) if abs(rest) <= SNAP else Fraction(math.tan(rest / 2)).limit_denominator(_DIGITS)
    c, s = (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)
    for _ in range(quarters % 4):
        c, s = -s, c
    return Turn(c, s)


def exact_axis(axis: Sequence[float]) -> Vector:
    """(3,) the unit vector along `axis`, of any length but zero, as fractions on the unit sphere."""
    length = math.hypot(*axis)
    unit = [x / length for x in axis]
    pole = max(range(3), key=lambda i: abs(unit[i]))
    others = [i for i in range(3) if i != pole]
    # From the opposite pole onto the plane between them, where a point may be rounded, and back.
    flat = {i: unit[i] / (1 + abs(unit[pole])) for i in others}
    near = {i: Fraction(x).limit_denominator(_DIGITS) if abs(2 * x) > SNAP else Fraction(0) for i, x in flat.items()}
    square = sum((x * x for x in near.values()), Fraction(0))
    result = {i: 2 * x / (1 + square) for i, x in near.items()}
    result[pole] = (1 - square) / (1 + square) * (1 if unit[pole] > 0 else -1)
    return result[0], result[1], result[2]


def exact_rotation(rpy: Sequence[float]) -> Matrix:
    """(3, 3) R = Rz(yaw) Ry(pitch) Rx(roll), in fractions; rad."""
    roll, pitch, yaw = (exact_turn(angle) for angle in rpy)
    one, zero = Fraction(1), Fraction(0)
    Rx = [[one, zero, zero], [zero, roll.cos, -roll.sin], [zero, roll.sin, roll.cos]]
    Ry = [[pitch.cos, zero, pitch.sin], [zero, one, zero], [-pitch.sin, zero, pitch.cos]]
    Rz = [[yaw.cos, -yaw.sin, zero], [yaw.sin, yaw.cos, zero], [zero, zero, one]]
    return product(Rz, product(Ry, Rx))


def product(a: Matrix, b: Matrix) -> Matrix:
    """Matrix product over any ring."""
    columns = list(zip(*b, strict=True))
    return [[sum(x * y for x, y in zip(row, column, strict=True)) for column in columns] for row in a]
