"""The three switching primitives, and their exact and smooth forms.

Equations switch only in `sgn`, `step` and `ramp`. Their second argument is the width of the smooth form (a symbol of
WIDTHS, in the unit of the first argument). C and identification use the exact law as a branch and drop the width. The
optimizer uses the smooth form, a piecewise polynomial with two continuous derivatives that equals the exact law outside
|x| < width.
"""

from __future__ import annotations

from functools import cache

import sympy as sp

WIDTH_RATE = sp.Symbol("width_rate", positive=True)
WIDTH_POSITION = sp.Symbol("width_position", positive=True)
WIDTH_FORCE = sp.Symbol("width_force", positive=True)
WIDTH_TIME = sp.Symbol("width_time", positive=True)
WIDTHS = (WIDTH_RATE, WIDTH_POSITION, WIDTH_FORCE, WIDTH_TIME)


class sgn(sp.Function):
    """−1, 0 or 1 by the sign of x."""

    nargs = (2,)


class step(sp.Function):
    """1 for x > 0, else 0."""

    nargs = (2,)


class ramp(sp.Function):
    """x for x > 0, else 0."""

    nargs = (2,)


def absolute(x: sp.Expr, width: sp.Expr) -> sp.Expr:
    """|x|, as the sum of two ramps."""
    return ramp(x, width) + ramp(-x, width)


def exact(expr: sp.Expr) -> sp.Expr:
    """`expr` with exact primitives in SymPy's own functions, for evaluation and proof."""
    return expr.replace(
        lambda e: isinstance(e, (sgn, step, ramp)),
        lambda e: {
            sgn: lambda x: sp.sign(x),
            step: lambda x: sp.Piecewise((1, x > 0), (0, True)),
            ramp: lambda x: sp.Piecewise((x, x > 0), (0, True)),
        }[type(e)](e.args[0]),
    )


def smooth(expr: sp.Expr) -> sp.Expr:
    """`expr` with smooth primitives of finite width."""
    return expr.replace(
        lambda e: isinstance(e, (sgn, step, ramp)),
        lambda e: {sgn: smooth_sgn, step: smooth_step, ramp: smooth_ramp}[type(e)](*e.args),
    )


# Cached: SymPy compares the arguments of Max and Min slowly, and one switch occurs many times in a step.
@cache
def smooth_sgn(x: sp.Expr, width: sp.Expr) -> sp.Expr:
    """Quintic between −width and width: value, slope and curvature join the exact law."""
    s = sp.Max(-1, sp.Min(1, x / width))
    return s * (15 - 10 * s**2 + 3 * s**4) / 8


@cache
def smooth_step(x: sp.Expr, width: sp.Expr) -> sp.Expr:
    """0 below zero, 1 above, smooth within about `width` of it."""
    return (1 + smooth_sgn(x, width)) / 2


@cache
def smooth_ramp(x: sp.Expr, width: sp.Expr) -> sp.Expr:
    """(x + |x|)/2 with |x| the integral of smooth_sgn, exact outside the width."""
    s = sp.Max(-1, sp.Min(1, x / width))
    rounded = width * (5 + 15 * s**2 - 5 * s**4 + s**6) / 16
    return (x + rounded + sp.Max(0, x - width) + sp.Max(0, -x - width)) / 2
