"""The library's laws as numbers: any expression at given values, effects with a memory along samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache

import sympy as sp

from symbolic.effects import LIBRARY
from symbolic.effects.declaration import DT, SIGNAL, parameter
from symbolic.primitives import exact

Values = Mapping[sp.Symbol, float]


@cache
def compiled(expr: sp.Expr) -> tuple[Callable[..., float], tuple[sp.Symbol, ...]]:
    symbols = tuple(sorted(expr.free_symbols, key=lambda s: s.name))
    sign = {"sign": lambda x: (x > 0) - (x < 0)}
    return sp.lambdify(symbols, expr, modules=[sign, "math"]), symbols


def evaluate(expr: sp.Expr, values: Values) -> float:
    function, symbols = compiled(exact(expr))
    return float(function(*(values[s] for s in symbols)))


def torque(name: str, parameters: Mapping[str, float], **signals: float) -> float:
    """Torque of a static effect of the library."""
    values = {parameter(k): v for k, v in parameters.items()}
    return evaluate(LIBRARY[name].torque, values | {SIGNAL[k].symbol: v for k, v in signals.items()})


def simulate(name: str, parameters: Mapping[str, float], dt: float, samples: list[dict[str, float]]) -> list[float]:
    """Torque of an effect with memory along samples, as generated code steps it: torque first, then the step."""
    effect = LIBRARY[name]
    fixed = {parameter(k): v for k, v in parameters.items()} | {DT: dt}
    first = fixed | {SIGNAL[k].symbol: v for k, v in samples[0].items()}
    states = {s.symbol: evaluate(s.initial, first) for s in effect.states}
    torques = []
    for sample in samples:
        values = fixed | states | {SIGNAL[k].symbol: v for k, v in sample.items()}
        torques.append(evaluate(effect.torque, values))
        states = {s.symbol: evaluate(s.step, values) for s in effect.states}
    return torques
