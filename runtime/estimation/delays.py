"""How far a recorded torque is ahead of the motion, where no hold explains it: each joint's by itself, at any time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from runtime.estimation.least_squares import bounded
from runtime.estimation.problem import Problem
from runtime.estimation.regressors import Ahead
from runtime.estimation.settings import DELAY_ACCURACY, DELAY_STEPS, LONGEST_DELAY, LONGEST_LAG, SMALL_DELAY
from runtime.model.terms import Term, Values
from runtime.motion.motion import Motion

Array = NDArray[np.float64]


def ahead(problem: Problem, shapes: Mapping[Term, Values], skew: float) -> Ahead:
    """The time beyond `skew` samples that leaves least of each joint's torque; 0 for a joint that does not move.

    A delay shifts the torque and no regressor: the equations stay, and only their right side is filtered again.
    Source: separable least squares in the delay, Ljung, System Identification, 1999.
    """
    return large(problem.motion, skew, [_of_joint(problem, shapes, i, skew) for i in range(problem.model.n)])


def large(motion: Motion, skew: float, times: Sequence[float]) -> Ahead:
    """These times (n,) s, where first order does not do for them: it has the encoders' noise in it, that is known."""
    given = np.array(times)
    small = 2 * np.pi * motion.band.cutoff * np.abs(given) < SMALL_DELAY
    return Ahead(skew, np.where(small, 0.0, given))


def _of_joint(problem: Problem, shapes: Mapping[Term, Values], joint: int, skew: float) -> float:
    use = problem.motion.moving(joint)
    if not use.any():
        return 0.0
    x, fixed = (rows[..., use] for rows in problem.rows(joint, shapes))
    gram, layout = x @ x.T, problem.layout

    def left(time: float) -> float:
        y = problem.motion.torque_ahead(joint, skew, time)[use] - fixed
        rest = y - bounded(gram, x @ y, layout.lower, layout.upper, layout.stated) @ x
        return float(rest @ rest) / max(float(y @ y), 1e-300)

    step = 1 / (DELAY_STEPS * problem.motion.band.cutoff)
    times = step * np.arange(-np.ceil(LONGEST_LAG / step), np.ceil(LONGEST_DELAY / step) + 1)
    best = float(times[int(np.argmin([left(float(t)) for t in times]))])
    found = minimize_scalar(
        left, bounds=(best - step, best + step), method="bounded", options={"xatol": DELAY_ACCURACY * step}
    )
    return float(found.x)
