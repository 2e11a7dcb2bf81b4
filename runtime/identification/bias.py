"""What makes an estimate less sure than its residuals say: what the model reads of itself, and biases that no residual
shows, of effects that are simulated along the motion.

Scores and shifts are first-order: of the unknowns' order in a fit's Jacobian, per joint (K', M).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from runtime.identification.regressors import Regressors
from runtime.identification.settings import SHAPE_STEP
from runtime.model.terms import Term, joints_of
from runtime.regression.bounded import solve
from runtime.regression.noise import Whitening, autoregression

if TYPE_CHECKING:
    from runtime.identification.problem import Fit, Problem

Array = NDArray[np.float64]


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
        step = SHAPE_STEP * abs(fit.coefficients[k]) or SHAPE_STEP
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
