"""Values of a SymbolicFunction to 50 digits from its own expressions, not from the tape, and random arguments for it.

All arguments are exact as float.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Mapping
from math import isfinite, pi
from typing import Any

import mpmath
import sympy as sp

from codegen.tape.numbering import Lowering
from symbolic import primitives
from symbolic.controller_law import C_E, C_U, Compensation
from symbolic.effects.declaration import DT, Effect, Parameter
from symbolic.functions import SymbolicFunction
from symbolic.model import ArmModel
from symbolic.model_file.arm import Arm
from symbolic.primitives import WIDTHS

DIGITS = 50


def _power(base: Any, exponent: Any) -> Any:
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
    """A function for evaluation at many points, with exact or smooth switches."""

    def __init__(self, function: SymbolicFunction, lowering: Lowering = "exact") -> None:
        lower = primitives.exact if lowering == "exact" else primitives.smooth
        self.definitions = [(symbol, lower(sp.sympify(e))) for symbol, e in function.definitions]
        self.outputs = [lower(sp.sympify(e)) for output in function.outputs for e in output.expressions]

    def __call__(self, values: Mapping[sp.Symbol, float]) -> list[mpmath.mpf]:
        """All outputs as a flat list, for values of inputs, struct and, if smooth, widths."""
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
    if condition in (sp.true, True):
        return True
    left, right = (_value(a, known) for a in condition.args)
    return bool(left > right) if isinstance(condition, sp.StrictGreaterThan) else bool(left < right)


Values = dict[sp.Symbol, float]

_SCALES = {"qd": 5.0, "qdd": 20.0, "tau": 50.0, "wdd": 20.0}


def single(value: float) -> float:
    """The nearest float32."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def arm_values(
    rng: random.Random, arm: Arm, function: SymbolicFunction, others: Mapping[str, SymbolicFunction]
) -> Values:
    """Random arguments of an arm's function. Contact coordinates are those of a random posture, so that they are
    reachable."""
    values: Values = {}
    if function.struct is not None:
        stated = zip(function.struct.symbols, function.struct.defaults, strict=True)
        values |= {s: single(rng.lognormvariate(0.0, 1.0) if v is None else v) for s, v in stated}
    posture = [single(rng.uniform(-pi, pi) if j.type == "revolute" else rng.uniform(-1, 1)) for j in arm.joints]
    for argument in function.inputs:
        if argument.name == "q":
            numbers = posture
        elif argument.name == "w":
            phi = others["contact_coordinates"]
            at = values | dict(zip(phi.inputs[0].symbols, posture, strict=True))
            numbers = [single(float(w)) for w in Reference(phi)(at)]
        elif argument.name == "elbow":
            numbers = [1.0 if 0 < posture[1] < pi else -1.0]
        else:
            scale = _SCALES.get(argument.name, 1.0)
            numbers = [single(rng.uniform(-scale, scale)) for _ in argument.symbols]
        values |= dict(zip(argument.symbols, numbers, strict=True))
    return values


def controller_values(rng: random.Random, model: ArmModel, found: Compensation) -> Values:
    """Arguments of a controller's compensation: a random state, and parameters within their bounds."""
    values = arm_values(rng, model.arm, model.function("coriolis"), {})
    for site in (*found.compensated, *found.touched):
        values |= {site.symbol(p): single(_parameter(rng, p)) for p in site.effect.parameters}
    for spring in found.springs:
        lumps = zip(spring.symbols, spring.lumps, strict=True)
        values |= {symbol: single(_parameter(rng, p)) for symbol, (p, _) in lumps}
    return values | {C_U: single(rng.uniform(0.0, 1.0)), C_E: single(rng.uniform(1.0, 200.0))}


def effect_values(rng: random.Random, effect: Effect) -> Values:
    """Signals, parameters within their bounds, states, dt and widths."""
    values: Values = {}
    for signal in effect.signals:
        values[signal.symbol] = float(rng.randint(0, 1)) if signal.switch else single(rng.uniform(*signal.span))
    values |= {p.symbol: single(_parameter(rng, p)) for p in effect.parameters}
    values |= {s.symbol: single(rng.uniform(-0.01, 0.01)) for s in effect.states}
    values[DT] = single(rng.uniform(1e-4, 1e-2))
    return values | {w: single(rng.uniform(0.01, 2.0)) for w in WIDTHS}


def _parameter(rng: random.Random, parameter: Parameter) -> float:
    low, high = parameter.bounds
    if isfinite(low) and isfinite(high):
        return rng.uniform(low, high)
    if isfinite(low):
        return low + rng.lognormvariate(0.0, 1.0)
    if isfinite(high):
        return high - rng.lognormvariate(0.0, 1.0)
    return rng.gauss(0.0, 1.0)
