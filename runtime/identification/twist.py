"""What a link-side encoder says of a transmission: the twist regressed on the rate and on the torque that passes.

    q − q_link = s q̇ + τ / k + sgn(τ) g / 2 + constant

s is the time by which the link-side encoder is read later than the motor's, k the stiffness, g the play. τ is what
passes through the transmission: the measured motor torque less what rubs, the drive's own effects and the rotor.
No model of what hangs on the joint enters: other axes that move at the same time are in the motor torque.

Source: Spong 1987, Modeling and control of elastic joint robots, for the spring; a shift in time as one more unknown,
linear after Gauss and Newton: Ljung, System Identification, 1999.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from runtime.arrays import Array
from runtime.identification.estimate import Estimate
from runtime.identification.fit import SKEW, Fit, interval, places, stretches
from runtime.identification.problem import Problem
from runtime.identification.regressors import Regressors
from runtime.identification.settings import HOLD, INTERVAL_SIGMAS
from runtime.model.terms import Term
from runtime.motion.settings import SOME
from runtime.motion.spectra import in_band_white_density
from runtime.regression.bounded import inverse
from runtime.regression.noise import over_stretches
from runtime.regression.rows import Block, Columns, JointRows
from runtime.regression.system import LinearSystem


@dataclass(frozen=True, eq=False)
class TwistEquation:
    """The twist of one joint, with the encoders aligned, in the band: what explains it first, then its cause.

    Signals stand as they were read and as another reading of the motor's encoder would have given them: twist (2, M)
    rad (m); base (2, b, M), the rate first; along (2, a, M), parts of the cause that are not known; cause (2, M).

    rows           of which `use` counts
    torque_noise   variance of white noise that is in the cause beside that
    errors         (m, M) what a standard deviation of each independent error of the fitted model adds to the load
    """

    twist: Array
    base: Array
    along: Array
    cause: Array
    rows: JointRows
    torque_noise: float
    errors: Array

    def of_gap(self) -> TwistEquation:
        """The same with the direction of the load as the cause, where a gap's flanks surely touch: beside a spring,
        linear or hardening, and beside friction that the model does not have right."""
        size, use = np.abs(self.cause[0]), self.rows.use
        largest = without_peaks(self.cause[0][use])
        load = self.cause / largest
        # Friction that is not right has a column of its own there.
        more = np.stack([load, load**3, np.sign(self.base[:, 0])], axis=1)
        base = np.concatenate([self.base, self.along, more], axis=1)
        # Under such a load the flanks of a gap surely touch.
        rows = replace(self.rows, use=use & (size > SOME * largest))
        return replace(
            self, base=base, along=base[:, :0], cause=np.sign(load), rows=rows, torque_noise=0.0, errors=self.errors[:0]
        )

    def beside_gap(self) -> TwistEquation:
        """The same with a gap in the base."""
        loaded = self.of_gap()
        base = np.concatenate([self.base, self.along, loaded.cause[:, None]], axis=1)
        return replace(self, base=base, along=base[:, :0], rows=loaded.rows)

    @cached_property
    def unexplained(self) -> LinearSystem:
        """The twist and what explains it first."""
        read = np.concatenate([np.zeros_like(self.twist[:, None]), self.base], axis=1)
        noise = read[1] - read[0]
        noise[0] = self.twist[0] - self.twist[1]
        free = np.full(self.base.shape[1], np.inf)
        return LinearSystem.of([self.rows], [Block("base", {0: Columns(read[0], noise)}, -free, free)])

    @cached_property
    def block(self) -> Block:
        """The cause, whose coefficient is not negative, and what comes along with it."""
        read = np.concatenate([np.zeros_like(self.cause[:, None]), self.cause[:, None], self.along], axis=1)
        free = np.full(self.along.shape[1], np.inf)
        white = np.append(self.torque_noise, np.zeros(len(free)))
        columns = {0: Columns(read[0], read[1] - read[0], white)}
        return Block("cause", columns, np.append(0.0, -free), np.append(np.inf, free))

    @cached_property
    def system(self) -> LinearSystem:
        """With the cause."""
        return self.unexplained.with_block(self.block)

    @property
    def is_identifiable(self) -> bool:
        """Whether the cause is none that the base can stand for."""
        return self.system.rank == len(self.system.unknown)

    @cached_property
    def solution(self) -> Array:
        """(b + 1 + a,) unknowns: of the base, of the cause, of what comes along."""
        return self.system.least()

    def of_cause(self) -> tuple[float, float, int]:
        """The coefficient of the cause, its variance, and its degrees of freedom."""
        covariance, degrees = self.covariance
        k = self.base.shape[1]
        return float(self.solution[k]), float(covariance[k, k]), degrees

    @cached_property
    def covariance(self) -> tuple[Array, int]:
        """Of the unknowns, for residuals that hang together within each stretch of `rows.piece`; degrees of freedom."""
        rows = self.rows
        x = np.vstack([self.base[0], self.cause[:1], self.along[0]])[:, rows.use]
        scores = x * (self.twist[0, rows.use] - self.solution @ x)
        _, index = np.unique(rows.piece[rows.use], return_inverse=True)
        sums = np.array([np.bincount(index, weights=row) for row in scores]).T
        by_load = x @ (self.solution[self.base.shape[1]] * self.errors[:, rows.use]).T
        inverted = inverse(self.system.normal)
        covariance: Array = inverted @ (over_stretches(sums, 1) + by_load @ by_load.T) @ inverted
        return covariance, len(sums) - len(x)


@dataclass(frozen=True)
class TwistFit:
    """The twist equation of a joint (0-based), solved.

    skew         s by which the link-side encoder is read later than the motor's
    stiffness    of a spring; behind_gap: of the flanks of a gap; None where nothing yields
    gap          from flank to flank; None where there is none, or the load has one direction only
    equation     whose cause is the load
    """

    joint: int
    skew: Estimate
    stiffness: Estimate | None
    gap: Estimate | None
    behind_gap: Estimate | None
    equation: TwistEquation


def without_peaks(torque: Array) -> float:
    """The largest size of a torque (M,), without single peaks."""
    return float(np.quantile(np.abs(torque), 0.99))


def fit_twist(fit: Fit, joint: int) -> TwistFit | None:
    """The twist equation of a joint (0-based); None without a link-side encoder, or where rests reach all rows."""
    problem = fit.problem
    if not problem.motion.has("twist", joint) or not problem.motion.unaffected(joint).any():
        return None
    errors = _load_errors(fit, joint)
    skew, equation = 0.0, _equation(fit, joint, skew=0.0, errors=errors)
    # The shift is short against any motion in the band: the second step moves it by a thousandth.
    for _ in range(2):
        skew += float(equation.solution[0])
        equation = _equation(fit, joint, skew=skew, errors=errors)
    info = problem.model.joints[joint]
    covariance, degrees = equation.covariance
    late = Estimate(skew, interval(skew, float(covariance[0, 0]), degrees), "s")
    unit, loaded = f"{info.force_unit}/{info.position_unit}", equation.of_gap()
    behind = _stiffness(equation.beside_gap(), unit)
    gap = _gap_of(loaded, info.position_unit)
    return TwistFit(joint, late, _stiffness(equation, unit), gap=gap, behind_gap=behind, equation=equation)


def _gap_of(equation: TwistEquation, unit: str) -> Estimate | None:
    half, variance, degrees = equation.of_cause()
    if not equation.is_identifiable or half <= 0:
        return None
    low, high = interval(half, variance, degrees)
    return Estimate(2 * half, (2 * low, 2 * high), unit)


def _stiffness(equation: TwistEquation, unit: str) -> Estimate | None:
    """With an interval that the compliance's own gives, which is the symmetric one; no upper end where that holds 0."""
    compliance, variance, degrees = equation.of_cause()
    if not equation.is_identifiable or compliance <= 0:
        return None
    low, high = interval(compliance, variance, degrees)
    return Estimate(1 / compliance, (1 / high, 1 / low if low > 0 else np.inf), unit)


def late(fit: Fit) -> Array:
    """(n,) s by which the link-side encoders are read later than the motors'; 0 where there is none."""
    problem = fit.problem
    found = [fit_twist(fit, i) for i in range(problem.model.n)]
    return np.array([0.0 if f is None else f.skew.value for f in found])


def _equation(fit: Fit, joint: int, skew: float, errors: Array) -> TwistEquation:
    problem = fit.problem
    motion, band = problem.motion, problem.motion.band
    # What rests is eliminated from linear equations; this one has the direction of the load, too.
    whole = replace(problem.regressors, motion=motion.with_standstill)
    twists, bases, alongs, causes = zip(
        *(_signals(fit, joint, skew=skew, regressors=r) for r in (whole, whole.perturbed)), strict=True
    )
    # What is measured far above the band may be the drive's own, and no noise of the torque within it.
    cutoff = motion.cutoff(joint)
    inside = in_band_white_density(motion.recorded(joint, fit.skew), motion.row_rate(joint), cutoff)
    return TwistEquation(
        np.array(twists),
        np.array(bases),
        np.array(alongs),
        np.array(causes),
        rows=JointRows(twists[0], motion.unaffected(joint), stretches(motion, joint)),
        torque_noise=cutoff * min(inside, float(band.torque_density[joint])),
        errors=errors,
    )


def _signals(fit: Fit, joint: int, skew: float, regressors: Regressors) -> tuple[Array, Array, Array, Array]:
    """Twist (M,); the rate and a constant a recording (b, M); the acceleration where the rotor's inertia is not known
    (a, M); the load (M,)."""
    problem = fit.problem
    motion, shift = regressors.motion, np.zeros(problem.model.n)
    shift[joint] = skew
    parts = []
    for piece in motion.pieces_of(joint):
        twist = piece.sensors.aligned(piece.t, piece.q, piece.qdd, shift).twist
        assert twist is not None
        parts.append(piece.in_band(np.array([twist[joint], piece.qd[joint], piece.qdd[joint]])))
    twists, rate, acceleration = np.concatenate(parts, axis=1)
    rotor = problem.model.joints[joint].rotor_inertia
    load = motion.recorded(joint, fit.skew) - _at_the_motor(fit, joint, regressors)
    base, along = np.array([rate, *_constants(problem, joint)]), acceleration[None, :]
    if rotor is not None:
        load, along = load - rotor * acceleration, along[:0]
    return twists, base, along, load


def _constants(problem: Problem, joint: int) -> list[Array]:
    """(M,) a recording: the zeros of a joint's two encoders are apart by any constant."""
    of = np.array([p.recording for p in problem.motion.pieces])[problem.motion.row_piece(joint)]
    return [(of == k).astype(float) for k in np.unique(of)]


def _at_the_motor(fit: Fit, joint: int, regressors: Regressors) -> Array:
    """(M,) torque that the fitted model spends before the transmission."""
    problem = fit.problem
    spent = np.zeros(len(problem.motion.row_piece(joint)))
    for term in _motor_terms(problem, joint):
        columns = regressors.columns(term, joint, fit.shapes[term])
        spent += np.append(1.0, fit.coefficients[problem.layout.slices[term]]) @ columns
    return spent


def _motor_terms(problem: Problem, joint: int) -> list[Term]:
    effects = problem.model.library.effects
    return [t for t in problem.layout.terms if t.joint == joint + 1 and effects[t.effect].side == "motor"]


def _load_errors(fit: Fit, joint: int) -> Array:
    """(m, M) of the load, from what the fitted model spends before the transmission and from when the torque is taken:
    its principal errors, a standard deviation each."""
    problem = fit.problem
    found = fit.uncertainty
    where = [k for t in _motor_terms(problem, joint) for k in places(fit, t, found.names)]
    where += [found.names.index(SKEW)] if fit.skew_free else []
    told = [k for k in where if np.isfinite(found.covariance[k, k])]
    size, direction = np.linalg.eigh(found.covariance[np.ix_(told, told)])
    errors: Array = (direction * np.sqrt(np.maximum(size, 0.0))).T @ found.columns(joint)[told]
    if fit.skew_free:
        return errors
    # Where it was not estimated, it is anything that a hold explains.
    shift = (HOLD[1] - HOLD[0]) / (2 * INTERVAL_SIGMAS)
    return np.vstack([errors, shift * problem.regressors.skew(joint, fit.skew)])
