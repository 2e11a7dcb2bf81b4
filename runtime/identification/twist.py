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
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from runtime.identification.covariance import interval, places, stretches, uncertainty
from runtime.identification.estimate import Estimate
from runtime.identification.regressors import Regressors
from runtime.identification.settings import HOLD, INTERVAL_SIGMAS, LARGEST_QUANTILE, LOADED, TWIST_PASSES
from runtime.model.terms import Term
from runtime.motion.spectrum import white_inside
from runtime.regression.least_squares import bounded, inverse, rank
from runtime.regression.robust import over_stretches

if TYPE_CHECKING:
    from runtime.identification.problem import Fit, Problem

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class TwistRows:
    """In-band rows of one joint (0-based), and what yields.

    twist (M,) rad (m); base (b, M), what may explain it first; cause (M,) what is asked for beside that; use (M,) rows
    that count
    """

    twist: Array
    base: Array
    cause: Array
    use: Mask

    @property
    def columns(self) -> Array:
        """(b + 1, m) of the rows that count, the cause last."""
        return np.vstack([self.base, self.cause])[:, self.use]

    def less(self, other: TwistRows) -> TwistRows:
        """What this one has and another has not."""
        return TwistRows(self.twist - other.twist, self.base - other.base, self.cause - other.cause, self.use)


@dataclass(frozen=True)
class TwistEquation:
    """Rows with the encoders aligned, and as another reading of the motor's encoder would have given them.

    torque_noise   variance of white noise that is in the cause beside that
    along          how many of the base's last rows stand for a part of the cause that is not known
    errors         (m, M) what a standard deviation of each independent error of the fitted model adds to the load
    """

    rows: TwistRows
    noisy: TwistRows
    torque_noise: float
    errors: Array
    along: int = 0

    @cached_property
    def noise(self) -> TwistRows:
        return self.noisy.less(self.rows)

    def of_gap(self) -> TwistEquation:
        """The same with the direction of the load as the cause, where a gap's flanks surely touch: beside a spring,
        linear or hardening, and beside friction that the model does not have right."""
        size = np.abs(self.rows.cause)
        largest = float(np.quantile(size[self.rows.use], LARGEST_QUANTILE))
        use = self.rows.use & (size > LOADED * largest)
        # Friction that is not right has a column of its own there.
        return TwistEquation(_gap(self.rows, largest, use), _gap(self.noisy, largest, use), 0.0, self.errors[:0])

    def beside_gap(self) -> TwistEquation:
        """The same with a gap in the base."""
        loaded = self.of_gap()

        def both(rows: TwistRows, gap: TwistRows) -> TwistRows:
            return replace(rows, base=np.vstack([rows.base, gap.cause]), use=gap.use)

        return TwistEquation(
            both(self.rows, loaded.rows), both(self.noisy, loaded.noisy), self.torque_noise, self.errors
        )

    @cached_property
    def gram(self) -> Array:
        """(b + 1, b + 1), compensated for the noise."""
        x, n = self.rows.columns, self.noise.columns
        gram: Array = x @ x.T - n @ n.T
        gram[-1, -1] -= self.torque_noise * x.shape[1]
        return gram

    @property
    def tells(self) -> bool:
        """Whether the cause is none that the base can stand for."""
        return rank(self.gram) == len(self.gram)

    @cached_property
    def solution(self) -> Array:
        """(b + 1,) unknowns; that of the cause is not negative."""
        x, n, use = self.rows.columns, self.noise.columns, self.rows.use
        moment = x @ self.rows.twist[use] - n @ self.noise.twist[use]
        free = np.full(len(moment), np.inf)
        return bounded(self.gram, moment, np.append(-free[1:], 0.0), free)

    def covariance(self, stretch: NDArray[np.intp]) -> tuple[Array, int]:
        """Of the unknowns, for residuals that hang together within a stretch (M,); its degrees of freedom."""
        x, use = self.rows.columns, self.rows.use
        scores = x * (self.rows.twist[use] - self.solution @ x)
        _, index = np.unique(stretch[use], return_inverse=True)
        sums = np.array([np.bincount(index, weights=row) for row in scores]).T
        by_load = x @ (self.solution[-1] * self.errors[:, use]).T
        inverted = inverse(self.gram)
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


def fit_twist(problem: Problem, fit: Fit, joint: int) -> TwistFit | None:
    """The twist equation of a joint (0-based); None without a link-side encoder, or where rests reach all rows."""
    if not problem.motion.has("twist", joint) or not problem.motion.untouched(joint).any():
        return None
    errors = _load_errors(problem, fit, joint)
    skew, equation = 0.0, _equation(problem, fit, joint, skew=0.0, errors=errors)
    for _ in range(TWIST_PASSES):
        skew += float(equation.solution[0])
        equation = _equation(problem, fit, joint, skew=skew, errors=errors)
    info, stretch = problem.model.joints[joint], stretches(problem.motion, joint)
    covariance, degrees = equation.covariance(stretch)
    late = Estimate(skew, interval(skew, float(covariance[0, 0]), degrees), "s")
    unit, loaded = f"{info.force_unit}/{info.position_unit}", equation.of_gap()
    behind = _stiffness(equation.beside_gap(), stretch, unit)
    gap = _gap_of(loaded, stretch, info.position_unit)
    return TwistFit(joint, late, _stiffness(equation, stretch, unit), gap=gap, behind_gap=behind, equation=equation)


def _gap_of(equation: TwistEquation, stretch: NDArray[np.intp], unit: str) -> Estimate | None:
    half = float(equation.solution[-1])
    if not equation.tells or half <= 0:
        return None
    low, high = interval(half, *_of_cause(equation, stretch))
    return Estimate(2 * half, (2 * low, 2 * high), unit)


def _of_cause(equation: TwistEquation, stretch: NDArray[np.intp]) -> tuple[float, int]:
    covariance, degrees = equation.covariance(stretch)
    return float(covariance[-1, -1]), degrees


def _stiffness(equation: TwistEquation, stretch: NDArray[np.intp], unit: str) -> Estimate | None:
    """With an interval that the compliance's own gives, which is the symmetric one; no upper end where that holds 0."""
    compliance = float(equation.solution[-1])
    if not equation.tells or compliance <= 0:
        return None
    low, high = interval(compliance, *_of_cause(equation, stretch))
    return Estimate(1 / compliance, (1 / high, 1 / low if low > 0 else np.inf), unit)


def late(problem: Problem, fit: Fit) -> Array:
    """(n,) s by which the link-side encoders are read later than the motors'; 0 where there is none."""
    found = [fit_twist(problem, fit, i) for i in range(problem.model.n)]
    return np.array([0.0 if f is None else f.skew.value for f in found])


def _equation(problem: Problem, fit: Fit, joint: int, skew: float, errors: Array) -> TwistEquation:
    motion, band = problem.motion, problem.motion.band
    # What rests is eliminated from linear equations; this one has the direction of the load, too.
    whole = replace(problem.regressors, motion=motion.with_standstill)
    plain, again = (_rows(problem, fit, joint, skew=skew, regressors=r) for r in (whole, whole.perturbed))
    # What is measured far above the band may be the drive's own, and no noise of the torque within it.
    cutoff = motion.cutoff(joint)
    inside = white_inside(motion.recorded(joint, fit.skew), motion.row_rate(joint), cutoff)
    noise = cutoff * min(inside, float(band.torque_density[joint]))
    along = int(problem.model.joints[joint].rotor_inertia is None)
    return TwistEquation(plain, again, noise, errors=errors, along=along)


def _rows(problem: Problem, fit: Fit, joint: int, skew: float, regressors: Regressors) -> TwistRows:
    """The rate, a constant a recording and, where the rotor's inertia is not known, the acceleration; the load."""
    motion, shift = regressors.motion, np.zeros(problem.model.n)
    shift[joint] = skew
    parts = []
    for piece in motion.pieces_of(joint):
        twist = piece.sensors.aligned(piece.t, piece.q, piece.qdd, shift).twist
        assert twist is not None
        parts.append(piece.in_band(np.array([twist[joint], piece.qd[joint], piece.qdd[joint]])))
    twists, rate, acceleration = np.concatenate(parts, axis=1)
    rotor = problem.model.joints[joint].rotor_inertia
    load = motion.recorded(joint, fit.skew) - _at_the_motor(problem, fit, joint, regressors)
    base = [rate, *_constants(problem, joint)]
    if rotor is None:
        base.append(acceleration)
    else:
        load = load - rotor * acceleration
    return TwistRows(twists, np.array(base), load, problem.motion.untouched(joint))


def _gap(rows: TwistRows, largest: float, use: Mask) -> TwistRows:
    load = rows.cause / largest
    base = np.vstack([rows.base, load, load**3, np.sign(rows.base[0])])
    return TwistRows(rows.twist, base, np.sign(load), use)


def _constants(problem: Problem, joint: int) -> list[Array]:
    """(M,) a recording: the zeros of a joint's two encoders are apart by any constant."""
    of = np.array([p.recording for p in problem.motion.pieces])[problem.motion.row_piece(joint)]
    return [(of == k).astype(float) for k in np.unique(of)]


def _at_the_motor(problem: Problem, fit: Fit, joint: int, regressors: Regressors) -> Array:
    """(M,) torque that the fitted model spends before the transmission."""
    spent = np.zeros(len(problem.motion.row_piece(joint)))
    for term in _motor_terms(problem, joint):
        columns = regressors.columns(term, joint, fit.shapes[term])
        spent += np.append(1.0, fit.coefficients[problem.layout.slices[term]]) @ columns
    return spent


def _motor_terms(problem: Problem, joint: int) -> list[Term]:
    effects = problem.model.library.effects
    return [t for t in problem.layout.terms if t.joint == joint + 1 and effects[t.effect].side == "motor"]


def _load_errors(problem: Problem, fit: Fit, joint: int) -> Array:
    """(m, M) of the load, from what the fitted model spends before the transmission and from when the torque is taken:
    its principal errors, a standard deviation each."""
    found = uncertainty(problem, fit)
    where = [k for t in _motor_terms(problem, joint) for k in places(problem, fit, t, found.names)]
    where += [len(found.names) - 1] if fit.skew_free else []
    told = [k for k in where if np.isfinite(found.covariance[k, k])]
    size, direction = np.linalg.eigh(found.covariance[np.ix_(told, told)])
    errors: Array = (direction * np.sqrt(np.maximum(size, 0.0))).T @ found.jacobian[joint][told]
    if fit.skew_free:
        return errors
    # Where it was not estimated, it is anything that a hold explains.
    shift = (HOLD[1] - HOLD[0]) / (2 * INTERVAL_SIGMAS)
    return np.vstack([errors, shift * problem.regressors.skew(joint)])
