"""How well a moment is known from which an effect acts: as well as the torque around it shows, and no better.

The torque of such an effect jumps with its moment, so that no derivative tells its interval. It reaches as far as the
moment may be moved without explaining the recordings significantly less.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from runtime.estimation.robust import lag_by_lag
from runtime.estimation.settings import INTERVAL_SIGMAS
from runtime.model.terms import Term, joints_of

if TYPE_CHECKING:
    from runtime.estimation.problem import Fit, Problem

Array = NDArray[np.float64]


def interval(problem: Problem, fit: Fit, term: Term) -> dict[str, tuple[float, float]]:
    """The 95 % interval of the moment from which a term acts, by that parameter's name; empty where it has none."""
    onset = problem.model.library.effects[term.effect].of_kind("onset")
    return {} if onset is None else {onset.name: _ends(problem, fit, term, onset.name)}


def _ends(problem: Problem, fit: Fit, term: Term, name: str) -> tuple[float, float]:
    """The first and the last moment that is as good, to a row of the band, within the recordings."""
    pieces = problem.motion.pieces
    row = 1 / problem.motion.row_rate
    low, high = min(p.began + float(p.t[0]) for p in pieces), max(p.began + float(p.t[-1]) for p in pieces)
    at = fit.shapes[term][name]

    def as_good(moment: float) -> bool:
        return not _worse(problem, fit, term, {**fit.shapes[term], name: moment})

    def end(limit: float) -> float:
        near, step = at, row if limit > at else -row
        while abs(limit - near) > row and as_good(near + step if abs(step) < abs(limit - near) else limit):
            near = near + step if abs(step) < abs(limit - near) else limit
            step *= 2
        far = near + step if abs(step) < abs(limit - near) else limit
        while abs(far - near) > row:
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
