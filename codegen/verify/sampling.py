"""Random arguments for generated functions, all of them exactly representable as float."""

from __future__ import annotations

import random
import struct
from collections.abc import Mapping
from math import isfinite, pi

import sympy as sp

from codegen.verify.reference import Reference
from symbolic.controller_law import C_E, C_U, Compensation
from symbolic.effects.declaration import DT, Effect, Parameter
from symbolic.functions import SymbolicFunction
from symbolic.model import ArmModel
from symbolic.model_file.arm import Arm
from symbolic.primitives import WIDTHS

Values = dict[sp.Symbol, float]

_SCALES = {"qd": 5.0, "qdd": 20.0, "tau": 50.0, "wdd": 20.0}


def single(value: float) -> float:
    """The nearest float, as a double."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def arm_values(
    rng: random.Random, arm: Arm, function: SymbolicFunction, others: Mapping[str, SymbolicFunction]
) -> Values:
    """Arguments of an arm's function; contact coordinates are those of a random posture: they can be reached."""
    values: Values = {}
    if function.struct is not None:
        stated = zip(function.struct.symbols, function.struct.defaults, strict=True)
        # What the model file leaves open is an input like others.
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
