"""Expressions with their switching primitives lowered, as a tape takes them.

The surrogates are made of Max and Min, whose arguments SymPy compares at every change of the expression,
for seconds where switches stand within switches. Here they are built once on plain symbols, with
functions in place of Max and Min that SymPy takes as they are.
"""

from __future__ import annotations

import functools
from typing import Any, Literal

import sympy as sp

from symbolic import primitives

Lowering = Literal["exact", "smooth"]

_PRIMITIVES = (primitives.sgn, primitives.step, primitives.ramp)
_X, _WIDTH = sp.Dummy("x", real=True), sp.Dummy("width", positive=True)


class Larger(sp.Function):
    """The larger of two."""

    is_extended_real = True


class Smaller(sp.Function):
    """The smaller of two."""

    is_extended_real = True


def lower(expr: Any, lowering: Lowering) -> sp.Expr:
    """`expr` for a tape: as it is, or as primitives.smooth gives it, with Larger and Smaller for Max and Min."""
    e = sp.sympify(expr)
    return _smooth(e, {}) if lowering == "smooth" else e


@functools.cache
def _surrogates() -> dict[Any, sp.Expr]:
    """The surrogate of every primitive in _X and _WIDTH."""
    plain = {kind: primitives.smooth(kind(_X, _WIDTH)) for kind in _PRIMITIVES}
    return {kind: e.replace(sp.Max, Larger).replace(sp.Min, Smaller) for kind, e in plain.items()}


def _smooth(e: sp.Expr, done: dict[sp.Expr, sp.Expr]) -> sp.Expr:
    """Equal parts are lowered once."""
    if e not in done:
        if not e.has(*_PRIMITIVES):
            done[e] = e
        else:
            args = [_smooth(a, done) for a in e.args]
            surrogate = _surrogates().get(type(e))
            done[e] = e.func(*args) if surrogate is None else surrogate.xreplace({_X: args[0], _WIDTH: args[1]})
    return done[e]
