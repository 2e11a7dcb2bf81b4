"""Uncertainty of a fit: intervals that hold with autocorrelated residuals, and what cannot be separated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from runtime.documents.fits import FitParameters, FittedEffect, FittedParameter, InertialEntry, RotorEntry
from runtime.documents.parts import SkewEntry
from runtime.identification.estimate import Estimate
from runtime.identification.fitting import gap_estimates
from runtime.identification.problem import Fit, Problem
from runtime.identification.regressors import Regressors
from runtime.identification.settings import (
    INTERVAL_SIGMAS,
    SCORE_BLOCK_S,
    SEPARABLE,
    SMOOTHING_BIAS,
    TANGLED_SHARE,
    WHITENED_BIAS,
)
from runtime.model.loader import Model
from runtime.model.terms import Term, Values, joints_of, structure, unit_of
from runtime.motion.motion import Motion
from runtime.regression.bounded import solve
from runtime.regression.noise import Whitening, autoregression, lag_by_lag, over_stretches
from runtime.wording import number
from symbolic.model_file.arm import ROTOR

Array = NDArray[np.float64]

_STEP: Final = 1e-3
"""part of a rotor's inertia, a shape or an inertial parameter (its unit where that is 0); over it the derivative of a
torque is taken: between rounding and curvature."""


INERTIA_UNIT = {"revolute": "kg m^2", "prismatic": "kg"}


@dataclass(frozen=True)
class Inference:
    """Estimates of everything that a fit has found.

    lumps   base inertial parameters; NaN where the user's own model takes their place and nothing tells them
    rotors  there, by joint, the inertia at the motor that the user's own model lacks
    open    inertias of rotors that the model file leaves out and a term told, by joint (0-based)
    """

    lumps: tuple[Estimate, ...]
    rotors: tuple[Estimate, ...]
    values: dict[Term, dict[str, Estimate]]
    skew: float
    skew_interval: tuple[float, float] | None
    open: Mapping[int, Estimate] = field(default_factory=dict)

    def skew_entry(self) -> SkewEntry:
        """By how many samples the torque is late, with its interval where it was estimated."""
        return SkewEntry(
            value=self.skew, unit="samples", interval=self.skew_interval, estimated=self.skew_interval is not None
        )

    def rotor_entries(self) -> list[RotorEntry]:
        """What the rigid-body torque of the user's own model lacks of each rotor's inertia."""
        return [
            RotorEntry(
                joint=k,
                name=f"rotor{k}",
                fit=e.known_value,
                unit=e.unit,
                interval=e.known_interval,
                inseparable_from=e.inseparable_from,
            )
            for k, e in enumerate(self.rotors, start=1)
        ]

    def inertial_entries(self, model: Model) -> list[InertialEntry]:
        """Base inertial parameters with intervals."""
        lumps = [(info.joint, info.name, info.value, e) for info, e in zip(model.lumps, self.lumps, strict=True)]
        rotors = [(joint + 1, ROTOR, None, e) for joint, e in self.open.items()]
        return [
            InertialEntry(
                joint=joint,
                name=name,
                model=value,
                fit=e.known_value,
                unit=e.unit,
                interval=e.known_interval,
                inseparable_from=e.inseparable_from,
            )
            for joint, name, value, e in [*lumps, *rotors]
        ]

    def document(self, model: Model) -> FitParameters:
        """Base parameters and effects with intervals, as `tendon identify --json`."""
        stated = structure(model)
        effects = [
            FittedEffect(
                effect=term.effect,
                joint=term.joint,
                name=term.name,
                parameters={
                    k: e.document().as_part_of(FittedParameter, model=stated.get(term, {}).get(k))
                    for k, e in values.items()
                },
            )
            for term, values in self.values.items()
        ]
        return FitParameters(inertial=self.inertial_entries(model), rotors=self.rotor_entries(), effects=effects)


@dataclass(frozen=True)
class Uncertainty:
    """Of all unknowns of a fit: those of the layout, the shape parameters, the skew where it is free.

    names         (K',)
    jacobian      per joint (K', M) derivatives of the predicted torque
    covariance    (K', K'); infinite on the diagonal for what no row tells
    tangled       by index, the names of those with which an unknown can only be told together
    degrees       of freedom of the covariance
    """

    names: list[str]
    jacobian: list[Array]
    covariance: Array
    tangled: dict[int, tuple[str, ...]]
    degrees: int


def uncertainty(problem: Problem, fit: Fit) -> Uncertainty:
    """Covariance that is robust to residuals that hang together within a stretch of time.

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
    moved = np.linalg.solve(np.eye(len(there)) + inverted @ through_prediction(problem, fit, jacobian)[part], inverted)
    covariance[part] = moved @ meat[part] @ moved.T
    other, soft = whitened_shift(problem, fit, jacobian)[there], 1.0
    if any(problem.model.library.effects[t.effect].gives_way for t in problem.layout.terms):
        shift, soft = moved @ smoothing_score(problem, fit, jacobian)[there], WHITENED_BIAS
        covariance[part] += SMOOTHING_BIAS**2 * np.outer(shift, shift)
    covariance[part] += soft**2 * np.outer(other, other)
    degrees = len(np.unique(stretches(problem.motion, 0))) - 1
    return Uncertainty(names, jacobian, covariance, tangled=_tangled(names, there, vector[:, unseen]), degrees=degrees)


def infer(problem: Problem, fit: Fit) -> Inference:
    """Every parameter with its interval."""
    found, layout = uncertainty(problem, fit), problem.layout
    covariance, tangled, sigmas = found.covariance, found.tangled, quantile(found.degrees)
    lumps = tuple(
        Estimate(np.nan, None, info.unit)
        if problem.motion.rigid_given or (info.value is None and not np.isfinite(covariance[k, k]))
        else _estimate(fit.coefficients[k], covariance[k, k], sigmas, unit=info.unit, others=tangled.get(k, ()))
        for k, info in enumerate(problem.model.lumps)
    )
    rotors = tuple(
        _estimate(
            fit.coefficients[k], covariance[k, k], sigmas, unit=INERTIA_UNIT[joint.type], others=tangled.get(k, ())
        )
        for k, joint in enumerate(problem.model.joints, start=layout.rotors.start)
        if k < layout.rotors.stop
    )
    values = {t: _term_estimates(problem, fit, t, found) for t in layout.terms}
    values.update({term: dict(estimates) for term, estimates in fit.witnessed.items()})
    held = None
    if fit.skew_free:
        held = interval(fit.skew, float(covariance[-1, -1]), found.degrees)
    left_open = {}
    for joint, value in problem.rotors.items():
        k, unit = found.names.index(_rotor_name(joint)), INERTIA_UNIT[problem.model.joints[joint].type]
        left_open[joint] = _estimate(value, covariance[k, k], sigmas, unit=unit, others=tangled.get(k, ()))
    return Inference(lumps, rotors, values, skew=fit.skew, skew_interval=held, open=left_open)


def _jacobian(problem: Problem, fit: Fit) -> tuple[list[str], list[Array]]:
    """Names of all unknowns and per joint (K', M) derivatives of the predicted torque."""
    model = problem.model
    names = [lump.name for lump in model.lumps]
    for term in problem.layout.terms:
        names += [f"{term} {c.name}" for c in model.library.effects[term.effect].coefficients]
    names += [f"rotor{k}" for k in range(1, 1 + problem.layout.rotors.stop - problem.layout.rotors.start)]
    rows = [problem.rows(i, fit.shapes)[0] for i in range(model.n)]
    for term, name, step in shape_steps(problem, fit):
        names.append(f"{term} {name}")
        for i in range(model.n):
            rows[i] = np.vstack([rows[i], shape_derivative(problem, fit, term, name=name, step=step, joint=i)])
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
        more, less = (problem.with_rotors({**problem.rotors, joint: (1 + s) * value}) for s in (_STEP, -_STEP))
        found[joint] = (more, less, 2 * _STEP * value)
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
                found.append((term, name, _STEP * abs(value) if value else _STEP))
    return found


def shape_derivative(problem: Problem, fit: Fit, term: Term, name: str, step: float, joint: int) -> Array:
    """(M,) derivative of a joint's predicted torque by a shape parameter."""
    sides = []
    for sign in (1, -1):
        moved = {**fit.shapes[term], name: fit.shapes[term][name] + sign * step}
        x, fixed = problem.rows(joint, {**fit.shapes, term: moved})
        sides.append(fixed + fit.coefficients @ x)
    return (sides[0] - sides[1]) / (2 * step)


def stretches(motion: Motion, joint: int) -> NDArray[np.intp]:
    """(M,) the stretch of each row of a joint (0-based): residuals of different ones are taken to be independent."""
    second, piece = motion.row_time(joint), motion.row_piece(joint)
    found: NDArray[np.intp] = np.floor(second / SCORE_BLOCK_S).astype(int) + piece * 1_000_000
    return found


def interval(value: float, variance: float, degrees: int) -> tuple[float, float]:
    """Of 95 %, of a value whose variance is known from so many degrees of freedom (Student 1908)."""
    spread = quantile(degrees) * float(np.sqrt(max(variance, 0.0)))
    return value - spread, value + spread


def quantile(degrees: int) -> float:
    """Standard deviations to either end of a 95 % interval, of a variance with so many degrees of freedom (Student
    1908)."""
    return float(stdtrit(max(1, degrees), ndtr(INTERVAL_SIGMAS)))


def _sandwich_parts(problem: Problem, fit: Fit, jacobian: list[Array]) -> tuple[Array, Array]:
    size = len(jacobian[0])
    motion = problem.motion
    each = [stretches(motion, i) for i in range(motion.n)]
    every = np.unique(np.concatenate(each))
    scores = np.zeros((len(every), size))
    bread = np.zeros((size, size))
    for i, x in enumerate(jacobian):
        use, w = motion.moving(i), problem.weights[i]
        bread += w**2 * x[:, use] @ x[:, use].T
        contribution, index = x * (w**2 * fit.residual[i]), np.searchsorted(every, each[i])
        for k in range(size):
            scores[:, k] += np.bincount(index, weights=contribution[k], minlength=len(scores))
    return bread, over_stretches(scores, len(jacobian))


def _tangled(names: list[str], there: NDArray[np.intp], null: Array) -> dict[int, tuple[str, ...]]:
    """By index of an unknown, the names of those with which it can only be told together; null: of those `there`."""
    found: dict[int, set[str]] = {}
    for direction in null.T:
        members = there[np.abs(direction) > TANGLED_SHARE]
        for k in members:
            found.setdefault(int(k), set()).update(names[int(j)] for j in members if j != k)
    return {k: tuple(sorted(others)) for k, others in found.items()}


def _estimate(value: float, variance: float, sigmas: float, unit: str, others: tuple[str, ...]) -> Estimate:
    spread = sigmas * float(np.sqrt(max(variance, 0.0)))
    told = not others and np.isfinite(spread)
    return Estimate(float(value), (float(value) - spread, float(value) + spread) if told else None, unit, others)


def places(problem: Problem, fit: Fit, term: Term, names: list[str]) -> list[int]:
    """Where a term's unknowns stand among all: its coefficients, then its shape parameters."""
    part = problem.layout.slices[term]
    free = [name for t, name, _ in shape_steps(problem, fit) if t == term]
    return [*range(part.start, part.stop), *(names.index(f"{term} {name}", problem.layout.size) for name in free)]


def given_shape(problem: Problem, fit: Fit, term: Term) -> dict[str, Estimate]:
    """A term's parameters, as sure as they are if its shape is what was found.

    Where a term vanishes any shape fits it, so that what is not known of its shape says nothing against the term.
    Source: a nuisance parameter that is there under the alternative only: Davies 1977, Biometrika 64(2).
    """
    found = uncertainty(problem, fit)
    coefficients = problem.layout.slices[term].stop - problem.layout.slices[term].start
    shape = places(problem, fit, term, found.names)[coefficients:]
    own, cross = found.covariance[np.ix_(shape, shape)], found.covariance[:, shape]
    if shape and np.isfinite(own).all():
        known = np.isfinite(cross).all(axis=1)
        found.covariance[np.ix_(known, known)] -= cross[known] @ np.linalg.pinv(own, hermitian=True) @ cross[known].T
    return _term_estimates(problem, fit, term, found)


def _term_estimates(problem: Problem, fit: Fit, term: Term, among: Uncertainty) -> dict[str, Estimate]:
    """Declared parameters out of linear coefficients and shapes, by the delta method."""
    library, part = problem.model.library, problem.layout.slices[term]
    coefficients = fit.coefficients[part]
    shape: Values = fit.shapes[term]
    free = [name for t, name, _ in shape_steps(problem, fit) if t == term]
    where = places(problem, fit, term, among.names)
    base = library.recover(term.effect, coefficients, shape)
    gradient = {name: np.zeros(len(where)) for name in base}
    for k in range(len(where)):
        moved, moved_shape = coefficients.copy(), dict(shape)
        at = moved[k] if k < len(moved) else shape[free[k - len(moved)]]
        # A declared parameter is a smooth function in closed form.
        step = 1e-5 * abs(at) if at else 1e-8
        if k < len(moved):
            moved[k] += step
        else:
            moved_shape[free[k - len(moved)]] += step
        after = library.recover(term.effect, moved, moved_shape)
        for name in base:
            gradient[name][k] = (after[name] - base[name]) / step
    part_covariance, sigmas = among.covariance[np.ix_(where, where)], quantile(among.degrees)
    found = {}
    for name, value in base.items():
        others = {o for k, g in zip(where, gradient[name], strict=True) if g for o in among.tangled.get(k, ())}
        used = np.flatnonzero(gradient[name])
        slope = gradient[name][used]
        variance = float(slope @ part_covariance[np.ix_(used, used)] @ slope)
        found[name] = _estimate(
            value, variance, sigmas, unit=unit_of(problem.model, term, name), others=tuple(sorted(others))
        )
    for name, ends in _onset_intervals(problem, fit, term).items():
        found[name] = replace(found[name], interval=ends, with_others=())
    return gap_estimates(problem, fit, term, found)


# places and moments at which a torque sets in ------------------------------------------------------------------------
#
# Such a torque jumps at a moment or a place, so that no derivative gives an interval: it reaches as far as the jump can
# be moved without explaining the recordings significantly less.


def _onset_intervals(problem: Problem, fit: Fit, term: Term) -> dict[str, tuple[float, float]]:
    """The 95 % intervals of where a term's torque jumps, by the parameters' names; empty where it does not."""
    info = problem.model.library.effects[term.effect]
    onset, begin, end = info.of_kind("onset"), info.of_kind("begin"), info.of_kind("end")
    found = {}
    for parameter, where in ((onset, _moments), (begin, _positions), (end, _positions)):
        if parameter is not None:
            found[parameter.name] = _ends(problem, fit, term, name=parameter.name, span=where(problem, term))
    return found


def _moments(problem: Problem, term: Term) -> tuple[float, float, float]:
    """First and last moment of the recordings, and a row of the band, s."""
    pieces = problem.motion.pieces
    low, high = min(p.began + float(p.t[0]) for p in pieces), max(p.began + float(p.t[-1]) for p in pieces)
    return low, high, 1 / problem.motion.row_rate(joints_of(problem.model, term)[0])


def _positions(problem: Problem, term: Term) -> tuple[float, float, float]:
    """Lowest and highest position of the term's joint, and how far it goes from sample to sample."""
    joint = joints_of(problem.model, term)[0]
    pieces = problem.motion.pieces_of(joint)
    low, high = min(float(p.q[joint].min()) for p in pieces), max(float(p.q[joint].max()) for p in pieces)
    return low, high, float(np.mean([np.abs(p.qd[joint]).mean() * p.dt for p in pieces]))


def _ends(problem: Problem, fit: Fit, term: Term, name: str, span: tuple[float, float, float]) -> tuple[float, float]:
    """The first and the last place that is as good, to the finest step; span: low, high and that step."""
    low, high, finest = span
    at = fit.shapes[term][name]

    def as_good(place: float) -> bool:
        return not _worse(problem, fit, term, {**fit.shapes[term], name: place})

    def end(limit: float) -> float:
        near, step = at, finest if limit > at else -finest
        while abs(limit - near) > finest and as_good(near + step if abs(step) < abs(limit - near) else limit):
            near = near + step if abs(step) < abs(limit - near) else limit
            step *= 2
        far = near + step if abs(step) < abs(limit - near) else limit
        while abs(far - near) > finest:
            middle = (near + far) / 2
            near, far = (middle, far) if as_good(middle) else (near, middle)
        return far

    return min(at, end(min(low, at))), max(at, end(max(high, at)))


def _worse(problem: Problem, fit: Fit, term: Term, shape: dict[str, float]) -> bool:
    """Whether the squared error with this shape is larger by more than the noise makes it, whose rows hang together."""
    part = fit.coefficients[problem.layout.slices[term]]
    loss, noise = 0.0, []
    for joint in joints_of(problem.model, term):
        here, there = (problem.regressors.columns(term, joint, s) for s in (fit.shapes[term], shape))
        use, change = problem.motion.moving(joint), np.append(1.0, part) @ (there - here)
        weight = problem.weights[joint] ** 2
        noise.append(weight * (fit.residual[joint] * change)[use])
        loss += weight * float(change[use] @ change[use]) / 2 - float(noise[-1].sum())
    return loss > INTERVAL_SIGMAS * float(np.sqrt(max(lag_by_lag(np.concatenate(noise)), 0.0)))


# biases that no residual shows ---------------------------------------------------------------------------------------


def through_prediction(problem: Problem, fit: Fit, jacobian: list[Array]) -> Array:
    """(K', K') what an unknown (second index) adds to the equations' derivative because effects read the torque that is
    predicted with it: what hangs on a transmission is as heavy as the fitted arm.

    The equations were solved with the prediction held, and then again with what that gave.
    """
    model, motion, size = problem.model, problem.motion, len(jacobian[0])
    reading = [t for t in problem.layout.terms if "arm" in model.library.needs[t.effect]]
    found = np.zeros((size, size))
    if motion.rigid_given or not reading:
        return found
    as_fitted = Regressors(model, motion, fit.prediction)
    for k in range(problem.layout.lumps.start, problem.layout.lumps.stop):
        step = _STEP * abs(fit.coefficients[k]) or _STEP
        theta = fit.coefficients + step * (np.arange(len(fit.coefficients)) == k)
        other = Regressors(model, motion, problem.prediction(theta, fit.shapes))
        for i, more in _torque_change(problem, fit, reading, one=as_fitted, other=other).items():
            use = motion.moving(i)
            found[:, k] += problem.weights[i] ** 2 * (jacobian[i][:, use] @ more[use]) / step
    return found


def whitened_shift(problem: Problem, fit: Fit, jacobian: list[Array]) -> Array:
    """(K',) by which the unknowns move, to first order, if every joint's rows are whitened by its residual.

    What pushes the link from outside is answered by the controller, in whose motion it comes back, at the link's
    resonance most: noise and motion hang together, and plain least squares takes the one for a torque of the other.
    With the noise's own spectrum it does so less; where the two estimates differ, the equations are not exact, and the
    difference is as much as is known of the error.

    Source: Hausman 1978, Specification tests in econometrics, Econometrica 46(6); for the bias of the closed loop and a
    model of the noise against it: Ljung, System Identification, 1999.
    """
    motion, size = problem.motion, len(jacobian[0])
    gram, moment = np.zeros((size, size)), np.zeros(size)
    for i, x in enumerate(jacobian):
        use, residual = motion.moving(i), fit.residual[i]
        if not use.any():
            continue
        ar = autoregression(residual, motion.unaffected(i), motion.row_piece(i))
        by = Whitening.of(ar, use, motion.row_piece(i), motion.eliminated(i))
        white, noise = by(np.vstack([x, residual])), by(_read(problem, fit, i, size))
        # A residual that is mere rounding weighs no more than in the fit itself.
        rms = float(np.sqrt(white[-1] @ white[-1] / white.shape[1]))
        weight = 1 / max(rms, 1e-12) ** 2
        gram += weight * (white[:-1] @ white[:-1].T - noise[:-1] @ noise[:-1].T)
        moment += weight * (white[:-1] @ white[-1] - noise[:-1] @ noise[-1])
    return solve(gram, moment)


def _read(problem: Problem, fit: Fit, joint: int, size: int) -> Array:
    """(size + 1, M) what the encoders' noise adds to a joint's rows of a Jacobian and to its residual (0-based)."""
    columns, fixed = problem.noise_rows(joint, fit.shapes)
    noise = np.zeros((size + 1, len(fixed)))
    noise[: len(columns)] = columns
    noise[-1] = -(fixed + fit.coefficients @ columns)
    return noise


def _torque_change(
    problem: Problem, fit: Fit, terms: Sequence[Term], one: Regressors, other: Regressors
) -> dict[int, Array]:
    """By joint (0-based), (M,) by which the torque of some terms changes if other regressors are read than one's."""
    found = {i: np.zeros(len(fit.residual[i])) for i in range(problem.model.n)}
    for term in terms:
        theta = np.append(1.0, fit.coefficients[problem.layout.slices[term]])
        for i in joints_of(problem.model, term):
            there, here = (r.columns(term, i, fit.shapes[term]) for r in (other, one))
            found[i] += theta @ (there - here)
    return found


def smoothing_change(problem: Problem, fit: Fit) -> dict[int, Array]:
    """By joint (0-based), (M,) by which the torque changes if what a transmission is simulated under keeps all of the
    encoder's noise; empty where nothing gives way.

    The load is smoothed, which takes some of the motion away near a resonance and makes the joint look stiffer and
    less damped; without it, noise passes for motion, and the joint looks softer and more damped. The truth lies
    between the two.
    """
    effects = problem.model.library.effects
    soft = [t for t in problem.layout.terms if effects[t.effect].gives_way]
    if not soft:
        return {}
    smooth, raw = (
        Regressors(problem.model, motion, fit.prediction) for motion in (problem.motion, problem.motion.unsmoothed)
    )
    return _torque_change(problem, fit, soft, one=smooth, other=raw)


def smoothing_score(problem: Problem, fit: Fit, jacobian: list[Array]) -> Array:
    """(K',) by which the scores change with `smoothing_change`."""
    score = np.zeros(len(jacobian[0]))
    for i, more in smoothing_change(problem, fit).items():
        use = problem.motion.moving(i)
        score -= problem.weights[i] ** 2 * (jacobian[i][:, use] @ more[use])
    return score


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
