"""The symbolic functions that are generated from an effect's declaration.

Their inputs are the effect's signals, the time step dt if time passes, `p` (all parameters in declared order) and `x`
(the states). Several printers use each function, so all are cached.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import sympy as sp

from symbolic import units as u
from symbolic.effects.declaration import DT, Effect, Parameter, State
from symbolic.functions import Argument, Output, SymbolicFunction


@functools.cache
def _inputs(effect: Effect, passes_time: bool) -> tuple[Argument, ...]:
    inputs = [Argument(s.name, (s.symbol,), (), unit=s.unit.text(), meaning=s.meaning) for s in effect.signals]
    if passes_time:
        inputs.append(Argument("dt", (DT,), (), unit="s", meaning="step"))
    p = tuple(p.symbol for p in effect.parameters)
    x = tuple(s.symbol for s in effect.states)
    inputs.append(Argument("p", p, (len(p),), *_listed(effect.parameters, "parameters")))
    inputs.append(Argument("x", x, (len(x),), *_listed(effect.states, "memory")))
    return tuple(inputs)


def _listed(quantities: Sequence[Parameter | State], what: str) -> tuple[str, str]:
    return ", ".join(q.unit.text() for q in quantities), ", ".join(q.name for q in quantities) or f"empty: no {what}"


def _function(effect: Effect, suffix: str, doc: str, output: Output, passes_time: bool = False) -> SymbolicFunction:
    return SymbolicFunction(
        f"{effect.name}_{suffix}", _inputs(effect, passes_time), (output,), doc=doc, source=effect.source
    )


def _states(effect: Effect, expressions: Sequence[sp.Expr], meaning: str) -> Output:
    units, _ = _listed(effect.states, "memory")
    return Output("x_next", tuple(sp.sympify(e) for e in expressions), (len(expressions),), unit=units, meaning=meaning)


@functools.cache
def torque(effect: Effect) -> SymbolicFunction:
    """signals, p, x -> torque."""
    output = Output(
        "torque", (sp.sympify(effect.torque),), (), unit=u.FORCE.text(), meaning="added to the motor torque"
    )
    return _function(effect, "torque", f"{effect.summary} {effect.equation}", output)


@functools.cache
def columns(effect: Effect) -> SymbolicFunction:
    """signals, p, x -> fixed part, then the derivative by each linear parameter: (1 + k,)."""
    expressions = (sp.sympify(effect.fixed), *effect.columns)
    output = Output(
        "columns", expressions, (len(expressions),), unit="as declared", meaning="fixed part, then a column a parameter"
    )
    return _function(effect, "columns", f"Regressor: {effect.summary} {effect.equation}", output)


@functools.cache
def states(effect: Effect) -> SymbolicFunction:
    """signals, p, x -> x: what the batch gives of the memory along the samples."""
    output = Output(
        "states", tuple(s.symbol for s in effect.states), (len(effect.states),), unit="as declared", meaning="states"
    )
    names = ", ".join(s.name for s in effect.states)
    return _function(effect, "states", f"States of {effect.name}: {names}.", output)


@functools.cache
def step(effect: Effect) -> SymbolicFunction:
    """signals, dt, p, x -> states of the next sample."""
    output = _states(effect, [s.step for s in effect.states], "at the next sample")
    return _function(effect, "step", f"The memory of {effect.name}, a sample later.", output, passes_time=True)


@functools.cache
def start(effect: Effect) -> SymbolicFunction:
    """signals of the first sample, p, x (not read) -> initial states."""
    output = _states(effect, [s.initial for s in effect.states], "at the first sample")
    return _function(effect, "start", f"The memory of {effect.name} where a motion begins.", output)
