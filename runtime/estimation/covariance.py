"""Uncertainty of a fit: intervals that hold with autocorrelated residuals, and what cannot be separated."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from runtime.model.loader import Model
from runtime.model.terms import Term, Values, unit_of

if TYPE_CHECKING:
    from runtime.estimation.problem import Fit, Problem
from runtime.estimation.robust import over_stretches
from runtime.estimation.settings import (
    INTERVAL_SIGMAS,
    ROTOR_STEP,
    SCORE_BLOCK_S,
    SEPARABLE,
    SHAPE_STEP,
    TANGLED_SHARE,
    VALUE_STEP,
    VALUE_STEP_AT_0,
)
from runtime.wording import number
from symbolic.model_file.arm import ROTOR

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval; `with_others`: parameters with which it can only be told together.

    No interval and no others: no row says anything of it, and it is as the model file has it; NaN where that has
    nothing.
    """

    value: float
    interval: tuple[float, float] | None
    unit: str
    with_others: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """null stands for what has no value: the rest position of a spring of no stiffness."""
        known = self.interval if self.interval and np.all(np.isfinite(self.interval)) else None
        value = self.value if np.isfinite(self.value) else None
        document: dict[str, Any] = {"value": value, "unit": self.unit, "interval": list(known) if known else None}
        if self.with_others:
            document["inseparable_from"] = list(self.with_others)
        return document


@dataclass(frozen=True)
class Inference:
    """Estimates of everything that a fit has found.

    lumps    base inertial parameters; NaN where the user's own model takes their place and nothing tells them
    rotors   inertias of rotors that the model file leaves out and a term told, by joint (0-based)
    """

    lumps: tuple[Estimate, ...]
    values: dict[Term, dict[str, Estimate]]
    skew: float
    skew_interval: tuple[float, float] | None
    rotors: dict[int, Estimate] = field(default_factory=dict)

    def skew_json(self) -> dict[str, Any]:
        return {
            "value": self.skew,
            "unit": "samples",
            "interval": list(self.skew_interval) if self.skew_interval else None,
            "estimated": self.skew_interval is not None,
        }

    def to_json(self, model: Model) -> dict[str, Any]:
        return {
            "inertial": [
                {"joint": info.joint, "name": info.name, "model": info.value, **_as_fit(e)}
                for info, e in zip(model.lumps, self.lumps, strict=True)
            ]
            + [{"joint": joint + 1, "name": ROTOR, "model": None, **_as_fit(e)} for joint, e in self.rotors.items()],
            "effects": [
                {"effect": term.effect, "joint": term.joint, "parameters": {k: e.to_json() for k, e in values.items()}}
                for term, values in self.values.items()
            ],
        }


def _as_fit(e: Estimate) -> dict[str, Any]:
    document = e.to_json()
    return {"fit": document.pop("value"), **document}


def infer(problem: Problem, fit: Fit) -> Inference:
    """Covariance that is robust to residuals that hang together within a block, shape parameters and skew included.

    Source: Liang & Zeger 1986 for the sandwich.
    """
    names, jacobian = _jacobian(problem, fit)
    bread, meat = _sandwich_parts(problem, fit, jacobian)
    there = np.flatnonzero(np.diag(bread) > 0)
    part, scale = np.ix_(there, there), np.sqrt(np.diag(bread)[there])
    value, vector = np.linalg.eigh(bread[part] / np.outer(scale, scale))
    unseen = value < SEPARABLE**2 * value.max(initial=1e-300)
    inverse = np.where(unseen, 0.0, 1 / np.where(unseen, 1.0, value))
    inverted = (vector * inverse) @ vector.T / np.outer(scale, scale)
    # What no row says anything of has no end to its interval.
    covariance = np.diag(np.where(np.diag(bread) > 0, 0.0, np.inf))
    covariance[part] = inverted @ meat[part] @ inverted
    tangled = _tangled(names, there, vector[:, unseen])
    layout = problem.layout
    lumps = tuple(
        Estimate(np.nan, None, info.unit)
        if problem.motion.rigid_given or (info.value is None and not bread[k, k])
        else _estimate(fit.coefficients[k], covariance[k, k], info.unit, tangled.get(k, ()))
        for k, info in enumerate(problem.model.lumps)
    )
    values = {t: _term_estimates(problem, fit, t, covariance, names, tangled) for t in layout.terms}
    rotors = {}
    for joint, found in problem.rotors.items():
        k, kind = names.index(_rotor_name(joint)), problem.model.joints[joint].type
        unit = "kg m^2" if kind == "revolute" else "kg"
        rotors[joint] = _estimate(found, covariance[k, k], unit, tangled.get(k, ()))
    interval = None
    if fit.skew_free:
        spread = INTERVAL_SIGMAS * float(np.sqrt(max(covariance[-1, -1], 0.0)))
        interval = (fit.skew - spread, fit.skew + spread)
    return Inference(lumps, values, fit.skew, interval, rotors)


def _jacobian(problem: Problem, fit: Fit) -> tuple[list[str], list[Array]]:
    """Names of all unknowns and per joint (K', M) derivatives of the predicted torque."""
    model = problem.model
    names = [lump.name for lump in model.lumps]
    for term in problem.layout.terms:
        names += [f"{term} {c.name}" for c in model.library.effects[term.effect].coefficients]
    rows = [problem.rows(i, fit.shapes)[0] for i in range(model.n)]
    for term, name, step in shape_steps(problem, fit):
        names.append(f"{term} {name}")
        for i in range(model.n):
            rows[i] = np.vstack([rows[i], shape_derivative(problem, fit, term, name, step, i)])
    for joint, sides in _rotor_sides(problem).items():
        names.append(_rotor_name(joint))
        for i in range(model.n):
            rows[i] = np.vstack([rows[i], _difference(sides, fit, i)])
    if fit.skew_free:
        names.append("skew")
        rows = [np.vstack([r, -problem.regressors.skew(i)]) for i, r in enumerate(rows)]
    return names, rows


def _rotor_name(joint: int) -> str:
    return f"{ROTOR} {joint + 1}"


def _rotor_sides(problem: Problem) -> dict[int, tuple[Problem, Problem, float]]:
    """By joint (0-based) of a rotor that a fit told: the problem with a little more and a little less of it, and what
    lies between."""
    found = {}
    for joint, value in problem.rotors.items():
        more, less = (
            problem.with_rotors({**problem.rotors, joint: (1 + s) * value}) for s in (ROTOR_STEP, -ROTOR_STEP)
        )
        found[joint] = (more, less, 2 * ROTOR_STEP * value)
    return found


def _difference(sides: tuple[Problem, Problem, float], fit: Fit, joint: int) -> Array:
    """(M,) derivative of a joint's predicted torque by what two problems differ in."""
    more, less = (fixed + fit.coefficients @ x for x, fixed in (p.rows(joint, fit.shapes) for p in sides[:2]))
    derivative: Array = (more - less) / sides[2]
    return derivative


def shape_steps(problem: Problem, fit: Fit) -> list[tuple[Term, str, float]]:
    """Every shape parameter with a step for its derivative."""
    found = []
    for term in problem.layout.terms:
        for name, value in fit.shapes[term].items():
            parameter = problem.model.library.effects[term.effect].parameter(name)
            if parameter.grid is not None and parameter.grid.continuous:
                found.append((term, name, SHAPE_STEP * abs(value) if value else SHAPE_STEP))
    return found


def shape_derivative(problem: Problem, fit: Fit, term: Term, name: str, step: float, joint: int) -> Array:
    """(M,) derivative of a joint's predicted torque by a shape parameter."""
    sides = []
    for sign in (1, -1):
        moved = {**fit.shapes[term], name: fit.shapes[term][name] + sign * step}
        x, fixed = problem.rows(joint, {**fit.shapes, term: moved})
        sides.append(fixed + fit.coefficients @ x)
    return (sides[0] - sides[1]) / (2 * step)


def _sandwich_parts(problem: Problem, fit: Fit, jacobian: list[Array]) -> tuple[Array, Array]:
    size = len(jacobian[0])
    motion = problem.motion
    block = np.floor(motion.row_time / SCORE_BLOCK_S).astype(int) + motion.row_piece * 1_000_000
    _, index = np.unique(block, return_inverse=True)
    scores = np.zeros((index.max() + 1, size))
    bread = np.zeros((size, size))
    for i, x in enumerate(jacobian):
        use, w = motion.moving(i), problem.weights[i]
        bread += (x[:, use] * w**2) @ x[:, use].T
        contribution = x * (w**2 * fit.residual[i])
        for k in range(size):
            scores[:, k] += np.bincount(index, weights=contribution[k], minlength=len(scores))
    return bread, over_stretches(scores)


def _tangled(names: list[str], there: NDArray[np.intp], null: Array) -> dict[int, tuple[str, ...]]:
    """By index of an unknown, the names of those with which it can only be told together; null: of those `there`."""
    found: dict[int, set[str]] = {}
    for direction in null.T:
        members = there[np.abs(direction) > TANGLED_SHARE]
        for k in members:
            found.setdefault(int(k), set()).update(names[int(j)] for j in members if j != k)
    return {k: tuple(sorted(others)) for k, others in found.items()}


def _estimate(value: float, variance: float, unit: str, others: tuple[str, ...]) -> Estimate:
    spread = INTERVAL_SIGMAS * float(np.sqrt(max(variance, 0.0)))
    told = not others and np.isfinite(spread)
    return Estimate(float(value), (float(value) - spread, float(value) + spread) if told else None, unit, others)


def _term_estimates(
    problem: Problem, fit: Fit, term: Term, covariance: Array, names: list[str], tangled: dict[int, tuple[str, ...]]
) -> dict[str, Estimate]:
    """Declared parameters out of linear coefficients and shapes, by the delta method."""
    library, part = problem.model.library, problem.layout.slices[term]
    coefficients = fit.coefficients[part]
    where = list(range(part.start, part.stop))
    shape: Values = fit.shapes[term]
    free = [name for t, name, _ in shape_steps(problem, fit) if t == term]
    where += [names.index(f"{term} {name}", problem.layout.size) for name in free]
    base = library.recover(term.effect, coefficients, shape)
    gradient = {name: np.zeros(len(where)) for name in base}
    for k in range(len(where)):
        moved, moved_shape = coefficients.copy(), dict(shape)
        at = moved[k] if k < len(moved) else shape[free[k - len(moved)]]
        step = VALUE_STEP * abs(at) if at else VALUE_STEP_AT_0
        if k < len(moved):
            moved[k] += step
        else:
            moved_shape[free[k - len(moved)]] += step
        after = library.recover(term.effect, moved, moved_shape)
        for name in base:
            gradient[name][k] = (after[name] - base[name]) / step
    part_covariance = covariance[np.ix_(where, where)]
    found = {}
    for name, value in base.items():
        others = {o for k, g in zip(where, gradient[name], strict=True) if g for o in tangled.get(k, ())}
        used = np.flatnonzero(gradient[name])
        slope = gradient[name][used]
        variance = float(slope @ part_covariance[np.ix_(used, used)] @ slope)
        found[name] = _estimate(value, variance, unit_of(problem.model, term, name), tuple(sorted(others)))
    return found


def estimate(e: Estimate | None) -> str:
    """Value ± half of its 95 % interval, to the digits that the interval supports."""
    if e is None:
        return ""
    if e.interval is None:
        together = f" (only together with {', '.join(e.with_others)})" if e.with_others else ""
        return number(e.value) + together
    half = (e.interval[1] - e.interval[0]) / 2
    if half <= 0 or not math.isfinite(half):
        return number(e.value)
    places = 1 - math.floor(math.log10(half))
    if not -6 <= places <= 9:
        return f"{number(e.value)} ± {number(half, 2)}"
    shown = max(0, places)
    return f"{round(e.value, places):.{shown}f} ± {round(half, places):.{shown}f}".replace("-", "−")
