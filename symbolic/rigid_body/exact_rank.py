"""Which columns of a regressor depend on others, exactly: rank and combinations modulo a large prime.

The columns are evaluated at random points modulo PRIME. Those that depend on earlier ones, in an order of preference,
are combinations of them with rational coefficients, which are recovered from their residues.

Source: Gautier & Khalil 1990 (minimum inertial parameters), by exact instead of numerical rank.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import isqrt

from symbolic.straightline import Turn

PRIME = 2**1279 - 1
"""Large enough to recover a coefficient of 190 digits over 190 from its residue: a few angles of 15 digits multiply."""

Column = tuple[str, int]
"""Kind and index (0-based) of an elementary parameter."""

Combination = dict[Column, Fraction]


@dataclass(frozen=True)
class BaseParameters:
    """values: the base parameters in order, None where a number behind one is not known; merged: what went into each,
    (column, coefficient) pairs."""

    values: dict[Column, Fraction | None]
    merged: dict[Column, tuple[tuple[Column, Fraction], ...]]


def exact(value: float) -> Fraction:
    """The decimal number that a person wrote, as a fraction."""
    return Fraction(repr(float(value)))


def known_sum(values: Mapping[Column, Fraction | None], parts: Sequence[tuple[Column, Fraction]]) -> Fraction | None:
    """What the parts of a base parameter come to; None if one of them is not known."""
    total = Fraction(0)
    for column, factor in parts:
        value = values[column]
        if value is None:
            return None
        total += factor * value
    return total


def dependencies(rows: Mapping[Column, Sequence[int]]) -> dict[Column, Combination]:
    """For every column, given by its residues, that depends on earlier independent ones: its combination of them.

    ArithmeticError if a coefficient has more digits than the prime can hold.
    """
    independent: list[Column] = []
    # Pivot row, the column in the rows that are no pivots up to it, and its combination of independent ones.
    reduced: list[tuple[int, list[int], list[int]]] = []
    dependent: dict[Column, Combination] = {}
    for column, residues in rows.items():
        vector, combination = list(residues), [0] * len(independent)
        for pivot, other, used in reduced:
            factor = vector.pop(pivot)
            if factor:
                vector = [(a - factor * b) % PRIME for a, b in zip(vector, other, strict=True)]
                for j, c in enumerate(used):
                    combination[j] = (combination[j] + factor * c) % PRIME
        pivot_row = next((r for r, v in enumerate(vector) if v), None)
        if pivot_row is None:
            fractions = zip(independent, map(fraction, combination), strict=True)
            dependent[column] = {c: f for c, f in fractions if f}
            continue
        inverse = pow(vector.pop(pivot_row), -1, PRIME)
        own = [-c * inverse % PRIME for c in combination] + [inverse]
        independent.append(column)
        reduced.append((pivot_row, [v * inverse % PRIME for v in vector], own))
    return dependent


def random_turn(rng: random.Random) -> Turn:
    """An angle modulo PRIME, by the tangent of its half."""
    t = rng.randrange(PRIME)
    inverse = pow(1 + t * t, -1, PRIME)
    return Turn((1 - t * t) * inverse % PRIME, 2 * t * inverse % PRIME)


def residue(x: Fraction | int) -> int:
    """Of a fraction modulo PRIME."""
    x = Fraction(x)
    return x.numerator * pow(x.denominator, -1, PRIME) % PRIME


def fraction(residue: int) -> Fraction:
    """The fraction of small numerator and denominator with this residue (Wang 1981)."""
    bound = isqrt(PRIME // 2)
    (r0, r1), (s0, s1) = (PRIME, residue), (0, 1)
    while r1 > bound:
        quotient = r0 // r1
        r0, r1, s0, s1 = r1, r0 - quotient * r1, s1, s0 - quotient * s1
    if abs(s1) > bound:
        raise ArithmeticError("a coefficient of the base parameters has more digits than the prime can hold")
    return Fraction(r1, s1)
