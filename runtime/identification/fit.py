"""A fit and its uncertainty: intervals that hold with autocorrelated residuals, and what cannot be separated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from runtime.arrays import Array
from runtime.documents.fits import FitParameters, FittedEffect, FittedParameter, InertialEntry, RotorEntry
from runtime.documents.parts import SkewEntry
from runtime.identification.estimate import Estimate
from runtime.identification.jumps import gap_estimates, onset_intervals
from runtime.identification.problem import DERIVATIVE_STEP, LATE, Nonlinear, Problem, Skew
from runtime.identification.regressors import Ahead, Regressors, unseen_rotors
from runtime.identification.settings import (
    INTERVAL_SIGMAS,
    NOMINAL_SKEW,
    ROTOR_STATED,
    SCORE_BLOCK_S,
    SEPARABLE,
    SMOOTHING_BIAS,
    WHITENED_BIAS,
)
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Term, Values, joints_of, structure, unit_of
from runtime.motion.motion import Motion
from runtime.motion.settings import SOME
from runtime.regression.noise import over_stretches
from runtime.regression.rows import JointAt
from runtime.regression.system import LinearSystem
from symbolic.model_file.arm import ROTOR

SKEW: Final = "skew"
"""name of the samples by which the torque is taken later, among the unknowns."""

INERTIA_UNIT = {"revolute": "kg m^2", "prismatic": "kg"}


@dataclass(frozen=True, eq=False)
class Fit:
    """A structure fitted to a motion, with its uncertainty.

    problem       the equations, with the joints' weights and the torque that effects read as it was predicted last
    prediction    inertial parameters and effects' values
    coefficients  (K,) linear unknowns in the order of `LinearUnknowns`
    shapes        shape parameters by term
    skew          samples by which the torque is taken later
    skew_free     whether it was estimated, and is what a hold explains
    residual      per joint (M,), unweighted, zero in rows that do not count
    ahead         by how much torques lead the motion beyond what a hold explains; None where nothing is beyond it
    witnessed     terms that a further sensor shows and the torque does not, with their parameters; no part of the fit
    """

    problem: Problem
    prediction: Prediction
    coefficients: Array
    shapes: dict[Term, Values]
    skew: float
    skew_free: bool
    residual: list[Array]
    ahead: Ahead | None = None
    witnessed: Mapping[Term, Mapping[str, Estimate]] = field(default_factory=dict)

    @property
    def model(self) -> Model:
        return self.problem.model

    @property
    def motion(self) -> Motion:
        return self.problem.motion

    def on(self, motion: Motion) -> Motion:
        """Another motion, with the drives' gains of this one."""
        told = {i: joint.told for i, joint in enumerate(self.motion.driven) if joint is not None and joint.unknown}
        same = motion.with_gains(told) if told else motion
        return same if same.gains == self.motion.gains else replace(same, gains=self.motion.gains)

    @cached_property
    def linearised(self) -> LinearSystem:
        """The equations about the fit: beside what is linear, changes of parameters that are not, and of the skew where
        it is free."""
        problem = self.problem
        blocks = [problem.derivative(self.shapes, self.coefficients, of) for of in problem.searched(self.shapes)]
        return problem.system(self.shapes, Skew(self.skew, "shared" if self.skew_free else "no"), blocks)

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """The covariance of all unknowns."""
        return _uncertainty(self)

    @cached_property
    def inference(self) -> Inference:
        """Every parameter with its interval."""
        return _inference(self)


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
        return [RotorEntry(joint=k, name=f"rotor{k}", **e.fitted) for k, e in enumerate(self.rotors, start=1)]

    def inertial_entries(self, model: Model) -> list[InertialEntry]:
        """Base inertial parameters with intervals."""
        lumps = [(info.joint, info.name, info.value, e) for info, e in zip(model.lumps, self.lumps, strict=True)]
        rotors = [(joint + 1, ROTOR, None, e) for joint, e in self.open.items()]
        return [
            InertialEntry(joint=joint, name=name, model=value, **e.fitted)
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
    """Of all unknowns of a fit: those of the layout, then the skew where it is free, shape parameters and rotors.

    names       (K',)
    system      the linearised equations       joints  every joint's residual and columns at the fit
    covariance  (K', K'); infinite on the diagonal for what no row tells
    tangled     by index, the names of those with which an unknown can only be told together
    degrees     of freedom of the covariance
    by_rotors   names of shape parameters most of whose variance is that of rotors' inertias in the model file
    """

    names: list[str]
    system: LinearSystem
    joints: tuple[JointAt, ...]
    covariance: Array
    tangled: dict[int, tuple[str, ...]]
    degrees: int
    by_rotors: tuple[str, ...]

    def columns(self, joint: int) -> Array:
        """(K', M) derivatives of a joint's predicted torque (0-based); zero in rows that do not count."""
        rows, own = self.system.joints[joint], self.joints[joint]
        found = np.zeros((len(self.names), len(rows.use)))
        found[own.unknown] = rows.spread(own.columns)
        return found


def _uncertainty(fit: Fit) -> Uncertainty:
    """Covariance that is robust to residuals that hang together within a stretch of time.

    Source: Liang & Zeger 1986 for the sandwich.
    """
    problem = fit.problem
    system = fit.linearised
    found = np.zeros(len(system.unknown))
    found[: problem.layout.size] = fit.coefficients
    at, along = system.at(found), problem.directions(found)
    plain, each = system.plain_normal(at), [stretches(problem.motion, i) for i in range(problem.motion.n)]
    bread = along.T @ plain @ along
    meat = along.T @ over_stretches(system.scores(at, each), problem.model.n) @ along
    there = np.flatnonzero(np.diag(bread) > 0)
    part, scale = np.ix_(there, there), np.sqrt(np.diag(bread)[there])
    value, vector = np.linalg.eigh(bread[part] / np.outer(scale, scale))
    unseen = value < SEPARABLE**2 * value.max(initial=1e-300)
    inverse = np.where(unseen, 0.0, 1 / np.where(unseen, 1.0, value))
    inverted = (vector * inverse) @ vector.T / np.outer(scale, scale)
    # What no row says anything of has no end to its interval.
    covariance = np.diag(np.where(np.diag(bread) > 0, 0.0, np.inf))
    through = (along.T @ through_prediction(fit, system, at) @ along)[part]
    moved = np.linalg.solve(np.eye(len(there)) + inverted @ through, inverted)
    names = _names(problem, system)
    covariance[part] = moved @ meat[part] @ moved.T
    other, soft = whitened_shift(fit, system, found, along)[there], 1.0
    if smoothed := smoothing_change(fit):
        shift, soft = moved @ (along.T @ system.products(at, smoothed))[there], WHITENED_BIAS
        covariance[part] += SMOOTHING_BIAS**2 * np.outer(shift, shift)
    covariance[part] += soft**2 * np.outer(other, other)
    if fit.skew_free:
        shift = _between_holds(fit, along[names.index(SKEW), there], moved)
        covariance[part] += SMOOTHING_BIAS**2 * np.outer(shift, shift)
    of_rotors = np.zeros(len(names))
    for shift, spread in _of_stated_rotors(fit, found, along[:, there], moved, smoothed):
        covariance[part] += spread**2 * np.outer(shift, shift)
        of_rotors += (spread * along[:, there] @ shift) ** 2
    endless = np.abs(along) @ np.isinf(np.diag(covariance)) > 0
    covariance = along @ np.where(np.isinf(covariance), 0.0, covariance) @ along.T
    covariance[endless, endless] = np.inf
    for place, stated, size in problem.known_sizes:
        # A vector that turns by so much from its place leaves the tangent plane, too.
        part, bent = np.ix_(place, place), stated + found[place]
        if np.isfinite(covariance[part]).all():
            covariance[part] += (INTERVAL_SIGMAS * np.trace(covariance[part]) / (2 * size**2)) ** 2 * np.outer(
                bent, bent
            )
    tangled = _tangled(names, along[:, there] @ vector[:, unseen])
    most = np.flatnonzero(of_rotors > np.diag(covariance) / 2)
    by_rotors = tuple(names[k] for k in most if k >= problem.layout.size)
    return Uncertainty(names, system, at, covariance, tangled, len(np.unique(each[0])) - 1, by_rotors)


def _inference(fit: Fit) -> Inference:
    """Every parameter with its interval."""
    problem = fit.problem
    found, layout = fit.uncertainty, problem.layout
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
    values = {t: _term_estimates(fit, t, found) for t in layout.terms}
    values.update({term: dict(estimates) for term, estimates in fit.witnessed.items()})
    held = None
    if fit.skew_free:
        k = found.names.index(SKEW)
        held = interval(fit.skew, float(covariance[k, k]), found.degrees)
    left_open = {}
    for joint, value in problem.rotors.items():
        k, unit = found.names.index(_rotor_name(joint)), INERTIA_UNIT[problem.model.joints[joint].type]
        left_open[joint] = _estimate(value, covariance[k, k], sigmas, unit=unit, others=tangled.get(k, ()))
    return Inference(lumps, rotors, values, skew=fit.skew, skew_interval=held, open=left_open)


def _names(problem: Problem, system: LinearSystem) -> list[str]:
    """Of all unknowns of the linearised equations, in their order."""
    model = problem.model
    names = [lump.name for lump in model.lumps]
    for term in problem.layout.terms:
        names += [f"{term} {c.name}" for c in model.library.effects[term.effect].coefficients]
    names += [f"rotor{k}" for k in range(1, 1 + problem.layout.rotors.stop - problem.layout.rotors.start)]
    names += [f"{name} {joint + 1}" for joint, name in problem.motion.gains]
    for block in system.blocks:
        if isinstance(block.key, Nonlinear):
            of = block.key
            names.append(_rotor_name(of.joint) if of.term is None else f"{of.term} {of.name}")
        elif block.key == (LATE, 1):
            names.append(SKEW)
    return names


def _rotor_name(joint: int) -> str:
    return f"{ROTOR} {joint + 1}"


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


def _tangled(names: list[str], null: Array) -> dict[int, tuple[str, ...]]:
    """By index of an unknown, the names of those with which it can only be told together; null: (K', ...)."""
    found: dict[int, set[str]] = {}
    for direction in null.T:
        # What has less of the unseen direction, of length 1, is told without the others.
        members = np.flatnonzero(np.abs(direction) > SOME)
        for k in members:
            found.setdefault(int(k), set()).update(names[int(j)] for j in members if j != k)
    return {k: tuple(sorted(others)) for k, others in found.items()}


def _estimate(value: float, variance: float, sigmas: float, unit: str, others: tuple[str, ...]) -> Estimate:
    spread = sigmas * float(np.sqrt(max(variance, 0.0)))
    told = not others and np.isfinite(spread)
    return Estimate(float(value), (float(value) - spread, float(value) + spread) if told else None, unit, others)


def places(fit: Fit, term: Term, names: list[str]) -> list[int]:
    """Where a term's unknowns stand among all: its coefficients, then its shape parameters."""
    problem = fit.problem
    part = problem.layout.slices[term]
    free = [of.name for of in problem.searched(fit.shapes) if of.term == term]
    return [*range(part.start, part.stop), *(names.index(f"{term} {name}", problem.layout.size) for name in free)]


def _term_estimates(fit: Fit, term: Term, among: Uncertainty) -> dict[str, Estimate]:
    """Declared parameters out of linear coefficients and shapes, by the delta method."""
    problem = fit.problem
    library, part = problem.model.library, problem.layout.slices[term]
    coefficients = fit.coefficients[part]
    shape: Values = fit.shapes[term]
    free = [of.name for of in problem.searched(fit.shapes) if of.term == term]
    where = places(fit, term, among.names)
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
        # What hangs on no unknown is as the file states it.
        variance = float(slope @ part_covariance[np.ix_(used, used)] @ slope) if len(used) else np.inf
        found[name] = _estimate(
            value, variance, sigmas, unit=unit_of(problem.model, term, name), others=tuple(sorted(others))
        )
    for name, ends in onset_intervals(problem, term, shape, np.append(1.0, coefficients), fit.residual).items():
        found[name] = replace(found[name], interval=ends, with_others=())
    return gap_estimates(problem, fit.shapes, Skew(fit.skew), term=term, values=found)


# biases that no residual shows ---------------------------------------------------------------------------------------


def through_prediction(fit: Fit, system: LinearSystem, at: Sequence[JointAt]) -> Array:
    """(K', K') what an unknown (second index) adds to the equations' derivative because effects read the torque that is
    predicted with it: what hangs on a transmission is as heavy as the fitted arm.

    The equations were solved with the prediction held, and then again with what that gave.
    """
    problem = fit.problem
    model, motion, size = problem.model, problem.motion, len(system.unknown)
    reading = [t for t in problem.layout.terms if "arm" in model.library.needs[t.effect]]
    found = np.zeros((size, size))
    if motion.rigid_given or not reading:
        return found
    as_fitted = Regressors(model, motion, fit.prediction)
    for k in range(problem.layout.lumps.start, problem.layout.lumps.stop):
        step = DERIVATIVE_STEP * abs(fit.coefficients[k]) or DERIVATIVE_STEP
        theta = fit.coefficients + step * (np.arange(len(fit.coefficients)) == k)
        other = Regressors(model, motion, problem.prediction(theta, fit.shapes))
        found[:, k] = system.products(at, _torque_change(fit, reading, one=as_fitted, other=other)) / step
    return found


def whitened_shift(fit: Fit, system: LinearSystem, theta: Array, along: Array) -> Array:
    """(F,) by which the unknowns move from theta, to first order, in directions along (K', F), if every joint's rows
    are whitened by its residual.

    What pushes the link from outside is answered by the controller, in whose motion it comes back, at the link's
    resonance most: noise and motion hang together, and plain least squares takes the one for a torque of the other.
    With the noise's own spectrum it does so less; where the two estimates differ, the equations are not exact, and the
    difference is as much as is known of the error.

    Source: Hausman 1978, Specification tests in econometrics, Econometrica 46(6); for the bias of the closed loop and a
    model of the noise against it: Ljung, System Identification, 1999.
    """
    by = [rows.whitening(residual) for rows, residual in zip(system.joints, fit.residual, strict=True)]
    return system.whitened(by, fit.residual).shift(theta, along)


def _torque_change(fit: Fit, terms: Sequence[Term], one: Regressors, other: Regressors) -> dict[int, Array]:
    """By joint (0-based), (M,) by which the torque of some terms changes if other regressors are read than one's."""
    problem = fit.problem
    found = {i: np.zeros(len(fit.residual[i])) for i in range(problem.model.n)}
    for term in terms:
        theta = np.append(1.0, fit.coefficients[problem.layout.slices[term]])
        for i in joints_of(problem.model, term):
            there, here = (r.columns(term, i, fit.shapes[term]) for r in (other, one))
            found[i] += theta @ (there - here)
    return found


def _between_holds(fit: Fit, skew: Array, covariance: Array) -> Array:
    """(F,) by which the unknowns move from a command's hold as it was found to that of half a row, if that is near.

    Samples of an angle do not tell what lies between them: a turn's kink, a step of the command. Both may be as large
    as what a stiff servo's motion tells of its hold; the truth lies between the two.

    skew (F,): the skew along each unknown; covariance (F, F): with white rows of variance 1
    """
    apart, own = fit.skew - NOMINAL_SKEW, float(skew @ covariance @ skew)
    near = fit.motion.commanded and abs(apart) < SOME and own > 0
    return apart * covariance @ skew / own if near else np.zeros(len(skew))


def _of_stated_rotors(
    fit: Fit, found: Array, along: Array, covariance: Array, smoothed: Mapping[int, Array]
) -> Iterator[tuple[Array, float]]:
    """(F,) by which the unknowns move, in directions along (K', F), for a unit of each rotor's inertia that the model
    file states and no rigid motion shows, and by how much it may be off.

    A stiffness grows with the square of the link's inertia, and that is the joint's less the rotor's. What the data say
    of the rotor counts as much as what the file says of it, or alone where they contradict it beyond ROTOR_STATED: the
    file's spread is then what the difference makes it, which is likeliest (Efron & Morris 1973).

    found (K',): all unknowns; covariance (F, F): with white rows of variance 1; smoothed: as `smoothing_change`
    """
    problem, system = fit.problem, fit.linearised
    joints = () if problem.motion.rigid_given else unseen_rotors(problem.model, problem.layout.terms)
    stated_at = {j: problem.model.joints[j].rotor_inertia for j in joints}
    for joint, stated in ((j, x) for j, x in stated_at.items() if x is not None):
        opened = problem.with_rotors({**problem.rotors, joint: stated})
        whole = system.with_block(opened.derivative(fit.shapes, fit.coefficients, Nonlinear(ROTOR, joint=joint)))
        there = whole.at(np.append(found, 0.0))
        shift = covariance @ along.T @ whole.plain_normal(there)[:-1, -1]
        alone = np.append(-along @ shift, 1.0)
        normal = whole.plain_normal(there)
        if (seen := float(alone @ normal @ alone)) <= 1e-12 * normal[-1, -1]:
            yield shift, ROTOR_STATED * stated  # the data say nothing of it
            continue
        scores = whole.scores(there, [stretches(problem.motion, i) for i in range(problem.motion.n)]) @ alone / seen
        biased = SMOOTHING_BIAS * float(whole.products(there, smoothed) @ alone) / seen
        off, variance = float(scores.sum()), float(scores @ scores) + biased**2
        spread = max((ROTOR_STATED * stated) ** 2, off**2 - variance)
        share = spread / max(spread + variance, 1e-300)
        yield shift, float(np.sqrt(share * variance + (share * off) ** 2))


def smoothing_change(fit: Fit) -> dict[int, Array]:
    """By joint (0-based), (M,) by which the torque changes if what a transmission is simulated under keeps all of the
    encoder's noise; empty where nothing gives way.

    The load is smoothed, which takes some of the motion away near a resonance and makes the joint look stiffer and
    less damped; without it, noise passes for motion, and the joint looks softer and more damped. The truth lies
    between the two.
    """
    problem = fit.problem
    effects = problem.model.library.effects
    soft = [t for t in problem.layout.terms if effects[t.effect].gives_way]
    if not soft:
        return {}
    smooth, raw = (
        Regressors(problem.model, motion, fit.prediction) for motion in (problem.motion, problem.motion.unsmoothed)
    )
    return _torque_change(fit, soft, one=smooth, other=raw)
