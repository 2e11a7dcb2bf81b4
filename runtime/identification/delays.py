"""How far a recorded torque is ahead of the motion, where no hold explains it: each joint's by itself, at any time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from runtime.documents.parts import DelayEntry
from runtime.identification.covariance import Estimate, Inference
from runtime.identification.problem import Problem
from runtime.identification.regressors import Ahead
from runtime.identification.settings import (
    CLEAR_DELAY,
    DELAY_ACCURACY,
    DELAY_STEPS,
    LONGEST_DELAY,
    LONGEST_LAG,
    SMALL_DELAY,
)
from runtime.model.loader import Model
from runtime.model.terms import Term, Values
from runtime.motion.motion import Motion
from runtime.regression.bounded import bounded

Array = NDArray[np.float64]


def ahead(problem: Problem, shapes: Mapping[Term, Values], skew: float) -> Ahead:
    """The time beyond `skew` samples that leaves least of each joint's torque; 0 for a joint that does not move, and
    where that is hardly less than without.

    A delay shifts the torque and no regressor: the equations stay, and only their right side is filtered again. A
    torque at a time that is none of its own would have the noise of both times in its column.
    Source: separable least squares in the delay, Ljung, System Identification, 1999.
    """
    return large(problem.motion, skew, [_of_joint(problem, shapes, i, skew) for i in range(problem.model.n)])


def large(motion: Motion, skew: float, times: Sequence[float]) -> Ahead:
    """These times (n,) s, where first order does not do for them: it has the encoders' noise in it, that is known."""
    given = np.array(times)
    small = 2 * np.pi * motion.band.cutoffs * np.abs(given) < SMALL_DELAY
    return Ahead(skew, np.where(small, 0.0, given))


def _of_joint(problem: Problem, shapes: Mapping[Term, Values], joint: int, skew: float) -> float:
    use = problem.motion.moving(joint)
    if not use.any():
        return 0.0
    x, fixed = (rows[..., use] for rows in problem.rows(joint, shapes))
    gram, layout = x @ x.T, problem.layout

    def left(time: float) -> float:
        y = problem.motion.torque_ahead(joint, skew, time)[use] - fixed
        rest = y - bounded(gram, x @ y, layout.lower, upper=layout.upper, near=layout.stated) @ x
        return float(rest @ rest) / max(float(y @ y), 1e-300)

    step = 1 / (DELAY_STEPS * problem.motion.cutoff(joint))
    times = step * np.arange(-np.ceil(LONGEST_LAG / step), np.ceil(LONGEST_DELAY / step) + 1)
    best = float(times[int(np.argmin([left(float(t)) for t in times]))])
    from scipy.optimize import minimize_scalar  # where it is used: it takes longer to load than a fit

    found = minimize_scalar(
        left, bounds=(best - step, best + step), method="bounded", options={"xatol": DELAY_ACCURACY * step}
    )
    rows = int(use.sum()) - problem.motion.dependent(joint, use)
    clear = rows * np.log(left(0.0) / max(float(found.fun), 1e-300)) > CLEAR_DELAY
    return float(found.x) if clear else 0.0


def entries(model: Model, inference: Inference, dt: float) -> list[DelayEntry]:
    """The whole delay from torque to motion of every joint, s, as verbs print it: what is assumed of it (half a sample
    of a hold) and what is estimated, the shift between the samples or an effect that leads. dt: s between samples."""
    document = []
    for joint in range(1, model.n + 1):
        shift = dt * inference.skew
        assumed, estimated, interval = shift, 0.0, None
        if inference.skew_interval is not None:
            assumed, estimated = 0.0, shift
            interval = (dt * inference.skew_interval[0], dt * inference.skew_interval[1])
        for found in _leads(model, inference, joint):
            estimated += found.value
            interval = None if found.interval is None else (found.interval[0] + shift, found.interval[1] + shift)
        document.append(
            DelayEntry(
                joint=joint,
                value=assumed + estimated,
                unit="s",
                interval=interval,
                assumed=assumed,
                estimated=estimated,
            )
        )
    return document


def _leads(model: Model, inference: Inference, joint: int) -> list[Estimate]:
    """Times by which effects say that a joint's recorded torque is ahead."""
    found = []
    for term, values in inference.values.items():
        lead = model.library.effects[term.effect].of_kind("lead")
        if lead is not None and term.joint == joint:
            found.append(values[lead.name])
    return found
