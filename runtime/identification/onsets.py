"""How well is known from where, or from when, an effect acts: as well as the torque around it shows, and no better.

The torque of such an effect jumps at a moment, or at a place, so that no derivative tells its interval. It reaches as
far as the jump may be moved without explaining the recordings significantly less.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from runtime.identification.settings import INTERVAL_SIGMAS
from runtime.model.terms import Term, joints_of
from runtime.regression.noise import lag_by_lag

if TYPE_CHECKING:
    from runtime.identification.problem import Fit, Problem

Array = NDArray[np.float64]


def intervals(problem: Problem, fit: Fit, term: Term) -> dict[str, tuple[float, float]]:
    """The 95 % intervals of where a term's torque jumps, by the parameters' names; empty where it does not."""
    info = problem.model.library.effects[term.effect]
    onset, begin, end = info.of_kind("onset"), info.of_kind("begin"), info.of_kind("end")
    found = {}
    for parameter, where in ((onset, _moments), (begin, _places), (end, _places)):
        if parameter is not None:
            found[parameter.name] = _ends(problem, fit, term, name=parameter.name, span=where(problem, term))
    return found


def _moments(problem: Problem, term: Term) -> tuple[float, float, float]:
    """First and last moment of the recordings, and a row of the band, s."""
    pieces = problem.motion.pieces
    low, high = min(p.began + float(p.t[0]) for p in pieces), max(p.began + float(p.t[-1]) for p in pieces)
    return low, high, 1 / problem.motion.row_rate(joints_of(problem.model, term)[0])


def _places(problem: Problem, term: Term) -> tuple[float, float, float]:
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
