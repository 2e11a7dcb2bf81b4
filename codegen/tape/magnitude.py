"""The scale of an expression's rounding errors: the sum of the absolute values of its terms.

Sums add, products multiply; a quotient and an inner function carry the condition number of their argument.
"""

from __future__ import annotations

import math

Pair = tuple[float, float]
"""A value and the sum of the absolute values of its terms."""


def scale(op: str, a: Pair, b: Pair = (0.0, 0.0), c: Pair = (0.0, 0.0)) -> Pair:
    """One operation on such pairs."""
    (x, mx), (y, my) = a, b
    if op in ("add", "sub"):
        return (x + y if op == "add" else x - y), mx + my
    if op == "mul":
        return x * y, mx * my
    if op == "div":
        return x / y, mx / abs(y) * (my / abs(y))
    if op in ("neg", "abs"):
        return (-x if op == "neg" else abs(x)), mx
    if op in ("sin", "cos"):
        value, slope = (math.sin(x), math.cos(x)) if op == "sin" else (math.cos(x), math.sin(x))
        return value, abs(value) + abs(slope) * mx
    if op in ("max", "min"):
        return (max(x, y) if op == "max" else min(x, y)), max(mx, my)
    if op in ("sgn", "step"):
        value = float((x > 0) - (x < 0)) if op == "sgn" else float(x > 0)
        return value, abs(value)
    if op == "gate":
        return b if x > 0 else (0.0, 0.0)
    if op == "side":
        return b if x > 0 else c if x < 0 else (0.0, 0.0)
    if op == "ramp":
        return max(x, 0.0), mx if x > 0 else 0.0
    return _transcendental(op, x, mx, y, my)


def _transcendental(op: str, x: float, mx: float, y: float, my: float) -> Pair:
    if op == "sqrt":
        value = math.sqrt(x)
        return value, value * (mx / x) if x > 0 else 0.0
    if op == "exp":
        value = math.exp(min(x, 700.0))
        return value, value * (1 + mx)
    if op == "rise":
        return -math.expm1(-x), 1.0 + math.exp(-x) * (1 + mx)
    if op == "log":
        return math.log(x), abs(math.log(x)) + mx / abs(x)
    if op == "atan2":
        value = math.atan2(x, y)
        return value, abs(value) + (abs(y) * mx + abs(x) * my) / (x * x + y * y)
    if x <= 0:
        return 0.0, 0.0
    value = x**y
    return value, value * (1 + abs(y) * mx / x + abs(math.log(x)) * my)
