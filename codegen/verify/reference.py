"""The value of a SymbolicFunction to 50 digits, from its own expressions: what generated code is held against.

Nothing of the tape is used here, so that a mistake of the tape is found.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import mpmath
import sympy as sp

from codegen.tape.lowering import Lowering
from symbolic import primitives
from symbolic.functions import SymbolicFunction

DIGITS = 50


def _power(base: Any, exponent: Any) -> Any:
    """Generated code defines 0 to any power that is not a whole number as 0."""
    if base == 0 and exponent != int(exponent):
        return mpmath.mpf(0)
    return base**exponent


_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    sp.Add: lambda *a: mpmath.fsum(a),
    sp.Mul: lambda *a: mpmath.fprod(a),
    sp.Pow: _power,
    sp.sin: mpmath.sin,
    sp.cos: mpmath.cos,
    sp.tan: mpmath.tan,
    sp.tanh: mpmath.tanh,
    sp.sinh: mpmath.sinh,
    sp.cosh: mpmath.cosh,
    sp.asin: mpmath.asin,
    sp.acos: mpmath.acos,
    sp.atan: mpmath.atan,
    sp.atan2: mpmath.atan2,
    sp.exp: mpmath.exp,
    sp.log: mpmath.log,
    sp.Abs: abs,
    sp.sign: mpmath.sign,
    sp.Max: max,
    sp.Min: min,
}


class Reference:
    """A function ready to be evaluated at many points; lowering "exact" or "smooth"."""

    def __init__(self, function: SymbolicFunction, lowering: Lowering = "exact") -> None:
        lower = primitives.exact if lowering == "exact" else primitives.smooth
        self.definitions = [(symbol, lower(sp.sympify(e))) for symbol, e in function.definitions]
        self.outputs = [lower(sp.sympify(e)) for output in function.outputs for e in output.expressions]

    def __call__(self, values: Mapping[sp.Symbol, float]) -> list[mpmath.mpf]:
        """All outputs, flat, for `values` of inputs, struct and (smooth) widths."""
        with mpmath.workdps(DIGITS):
            known: dict[sp.Expr, Any] = {symbol: mpmath.mpf(value) for symbol, value in values.items()}
            for symbol, expr in self.definitions:
                known[symbol] = _value(expr, known)
            return [_value(e, known) for e in self.outputs]


def _value(expr: sp.Expr, known: dict[sp.Expr, Any]) -> Any:
    found = known.get(expr)
    if found is None:
        found = known[expr] = _compute(expr, known)
    return found


def _compute(expr: sp.Expr, known: dict[sp.Expr, Any]) -> Any:
    if expr.is_Rational:
        return mpmath.mpf(int(expr.p)) / int(expr.q)
    if expr.is_Float:
        return mpmath.mpf(repr(float(expr)))
    if expr.is_number and not expr.args:
        return mpmath.mpf(str(sp.N(expr, DIGITS)))
    if isinstance(expr, sp.Piecewise):
        return next(_value(e, known) for e, condition in expr.args if _holds(condition, known))
    return _FUNCTIONS[expr.func](*(_value(a, known) for a in expr.args))


def _holds(condition: Any, known: dict[sp.Expr, Any]) -> bool:
    """Of the conditions that primitives.exact writes: x > 0, or always."""
    if condition in (sp.true, True):
        return True
    left, right = (_value(a, known) for a in condition.args)
    return bool(left > right) if isinstance(condition, sp.StrictGreaterThan) else bool(left < right)
