"""The library's laws as numbers: any expression at given values, effects with a memory along samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache

import sympy as sp

from symbolic.effects import LIBRARY
from symbolic.effects.declaration import DT, SIGNAL, Effect, parameter
from symbolic.primitives import exact

Values = Mapping[sp.Symbol, float]


@cache
def compiled(law: sp.Expr) -> tuple[Callable[..., float], tuple[sp.Symbol, ...]]:
    expr = exact(law)
    symbols = tuple(sorted(expr.free_symbols, key=lambda s: s.name))
    sign = {"sign": lambda x: (x > 0) - (x < 0)}
    return sp.lambdify(symbols, expr, modules=[sign, "math"], cse=True), symbols


def evaluate(expr: sp.Expr, values: Values) -> float:
    function, symbols = compiled(expr)
    return float(function(*(values[s] for s in symbols)))


def torque(
    name: str, parameters: Mapping[str, float], library: Mapping[str, Effect] = LIBRARY, **signals: float
) -> float:
    """Torque of a static effect of a library, as a planar arm has it if nothing else is said."""
    values = {parameter(k): v for k, v in parameters.items()}
    return evaluate(library[name].torque, values | {SIGNAL[k].symbol: v for k, v in signals.items()})


def simulate(name: str, parameters: Mapping[str, float], dt: float, samples: list[dict[str, float]]) -> list[float]:
    """Torque of an effect with memory along samples, as generated code steps it: torque first, then the step."""
    return [at["torque"] for at in trace(name, parameters, dt, samples)]


def trace(
    name: str, parameters: Mapping[str, float], dt: float, samples: list[dict[str, float]]
) -> list[dict[str, float]]:
    """The same with the states of each sample, by name."""
    effect = LIBRARY[name]
    fixed = {parameter(k): v for k, v in parameters.items()} | {DT: dt}
    first = fixed | {SIGNAL[k].symbol: v for k, v in samples[0].items()}
    states = {s.symbol: evaluate(s.initial, first) for s in effect.states}
    found = []
    for sample in samples:
        values = fixed | states | {SIGNAL[k].symbol: v for k, v in sample.items()}
        named = {s.name: states[s.symbol] for s in effect.states}
        found.append({"torque": evaluate(effect.torque, values), **named})
        states = {s.symbol: evaluate(s.step, values) for s in effect.states}
    return found
