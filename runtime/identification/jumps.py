"""Shape parameters over which the error is no smooth curve: places and moments at which a torque sets in, widths of
gaps. They are tried one after another, and their intervals reach as far as other values are as good.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from runtime.arrays import Array
from runtime.identification.estimate import Estimate
from runtime.identification.grids import OF_PLACES, axis, points, searchable
from runtime.identification.problem import Problem, Skew, first_least, weighted
from runtime.identification.settings import AS_GOOD_A_FLANK, HOPELESS_FLANK, INTERVAL_SIGMAS
from runtime.model.terms import Term, Values, joints_of
from runtime.motion.settings import CLEARLY_LIKELIER
from runtime.regression.noise import lag_by_lag

_GAP_REACH: Final = 2.5
"""ratio; so far to either side of where a search over candidates, in steps of 2, left a gap its width is sought."""
_GAP_STEPS: Final = 6
"""number of steps to either side: among those that chance makes the least error is not missed."""


# places and moments at which a torque sets in ------------------------------------------------------------------------


def least_places(problem: Problem, shapes: Mapping[Term, Values], skew: Skew) -> dict[Term, Values]:
    """Shapes with every place at which a torque sets in at the least error within a step of its grid.

    A torque sets in at a sample, so that the error over the place is a staircase without a useful derivative. Fixed
    places are tried, 16 to a step of the grid, about as far as an arm goes in a sample: first every fourth and then
    those between. Their columns are shared, wherever the search began. A place that the motion does not reach stays
    where the model file has it, unless another is clearly likelier.
    """
    best = dict(shapes)
    for term in problem.layout.terms:
        for parameter in problem.model.library.effects[term.effect].shape:
            if parameter.grid is None or parameter.grid.of not in OF_PLACES:
                continue
            grid = axis(problem.regressors, term, parameter, best[term])
            if len(grid) < 2 or not searchable(parameter, grid):
                continue
            if grid[0] <= best[term][parameter.name] <= grid[-1]:
                best = _refined(problem, best, skew, term, parameter.name, grid)
                continue
            reached = _least(problem, best, skew, term, [{**best[term], parameter.name: float(x)} for x in grid])
            other = _refined(problem, reached, skew, term, parameter.name, grid)
            best = other if _clear(problem, best, other, skew) else best
    return best


def _refined(
    problem: Problem, shapes: Mapping[Term, Values], skew: Skew, term: Term, place: str, grid: Array
) -> dict[Term, Values]:
    """Shapes with a term's place, which is on the grid, at the least error within a step of it."""
    best, fine, coarse = dict(shapes), 16, 4
    for every, reach in ((coarse, fine // coarse), (1, coarse - 1)):
        at = best[term][place]
        near = (at, *_around(at, grid, fine, every=every, reach=reach))
        best = _least(problem, best, skew, term, [{**best[term], place: x} for x in near])
    return best


def _least(
    problem: Problem, shapes: Mapping[Term, Values], skew: Skew, term: Term, choices: Sequence[Values]
) -> dict[Term, Values]:
    problem.foresee(term, choices, shapes)
    errors = problem.errors([{**shapes, term: shape} for shape in choices], skew)
    return {**shapes, term: choices[first_least(errors)]}


def _clear(problem: Problem, one: Mapping[Term, Values], other: Mapping[Term, Values], skew: Skew) -> bool:
    rows = sum(int(problem.motion.moving(i).sum()) for i in range(problem.model.n))
    errors = problem.errors([one, other], skew)
    return bool(rows * np.log(errors[0] / max(errors[1], 1e-300)) > 2 * CLEARLY_LIKELIER)


def _around(place: float, grid: Array, fine: int, every: int, reach: int) -> list[float]:
    """Of places `fine` to a step of an even grid, one of `every` within `reach` of them to either side of a place, the
    nearest first."""
    first, step = float(grid[0]), float(grid[1] - grid[0]) / fine
    numbers = every * (round((place - first) / step / every) + np.arange(-reach, reach + 1))
    inside = numbers[(numbers >= 0) & (numbers <= (len(grid) - 1) * fine)]
    found = first + step * inside
    return [float(x) for x in found[np.argsort(np.abs(found - place), kind="stable")]]


def onset_intervals(
    problem: Problem, term: Term, shape: Values, theta: Array, residual: Sequence[Array]
) -> dict[str, tuple[float, float]]:
    """The 95 % intervals of where a term's torque jumps, by the parameters' names; empty where it does not.

    No derivative gives them: they reach as far as the jump can be moved without explaining the recordings significantly
    less.

    shape, theta   as found; theta (1 + k,) with 1 first      residual  per joint (M,)
    """

    def as_good(moved: Values) -> bool:
        """Whether the squared error is larger by no more than the noise makes it, whose rows hang together."""
        loss, noise = 0.0, []
        for joint in joints_of(problem.model, term):
            here, there = (problem.regressors.columns(term, joint, s) for s in (shape, moved))
            use, change = problem.motion.moving(joint), theta @ (there - here)
            weight = problem.weights[joint] ** 2
            noise.append(weight * (residual[joint] * change)[use])
            loss += weight * float(change[use] @ change[use]) / 2 - float(noise[-1].sum())
        return loss <= INTERVAL_SIGMAS * float(np.sqrt(max(lag_by_lag(np.concatenate(noise)), 0.0)))

    info, found = problem.model.library.effects[term.effect], {}
    kinds = (info.of_kind("onset"), _moments), (info.of_kind("begin"), _positions), (info.of_kind("end"), _positions)
    for parameter, where in kinds:
        if parameter is not None:
            name = parameter.name
            found[name] = _ends(partial(_placed, as_good, shape, name), shape[name], where(problem, term))
    return found


def _placed(as_good: Callable[[Values], bool], shape: Values, name: str, place: float) -> bool:
    return as_good({**shape, name: place})


def _moments(problem: Problem, term: Term) -> tuple[float, float, float]:
    """First and last moment of the recordings, and a row of the band, s."""
    pieces = problem.motion.pieces
    low, high = min(p.began + float(p.t[0]) for p in pieces), max(p.began + float(p.t[-1]) for p in pieces)
    return low, high, 1 / problem.motion.row_rate(joints_of(problem.model, term)[0])


def _positions(problem: Problem, term: Term) -> tuple[float, float, float]:
    joint = joints_of(problem.model, term)[0]
    pieces = problem.motion.pieces_of(joint)
    low, high = min(float(p.q[joint].min()) for p in pieces), max(float(p.q[joint].max()) for p in pieces)
    return low, high, float(np.mean([np.abs(p.qd[joint]).mean() * p.dt for p in pieces]))


def _ends(as_good: Callable[[float], bool], at: float, span: tuple[float, float, float]) -> tuple[float, float]:
    """The first and the last place that is as good, to the finest step; span: low, high and that step."""
    low, high, finest = span

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


# the width of a gap --------------------------------------------------------------------------------------------------
#
# What lies behind a gap strikes its flanks at instants that depend on everything: the error over the width is rugged,
# and no derivative leads to its minimum. It is sought in steps over a range, and then between them. Stiffness and
# damping of the flanks act above the band, where nothing is compared: the interval of the width holds the best widths
# with all flanks that are as good, and nothing is claimed of the flanks.


def with_gaps(problem: Problem, shapes: Mapping[Term, Values], skew: Skew) -> dict[Term, Values]:
    """Shapes with the width of every gap at the least error that lies around it."""
    best = dict(shapes)
    for term in problem.layout.terms:
        if problem.model.library.effects[term.effect].has_gap:
            best[term] = _narrowed(problem, best, skew, term)[1]
    return best


def gap_estimates(
    problem: Problem, shapes: Mapping[Term, Values], skew: Skew, term: Term, values: dict[str, Estimate]
) -> dict[str, Estimate]:
    """A term's estimates with the interval that its flanks leave to its gap, and none for themselves; as they are for
    a term without a gap."""
    info = problem.model.library.effects[term.effect]
    play = info.of_kind("play")
    if not info.has_gap or play is None:
        return values
    own = _squared_error(problem, shapes, skew)
    tried = [(own, shapes[term])]
    for flanks in _flanks(problem, shapes[term], term):
        other = {**shapes, term: flanks}
        if _squared_error(problem, other, skew) < HOPELESS_FLANK**2 * own:
            tried.append(_narrowed(problem, other, skew, term))
    least = min(error for error, _ in tried)
    as_good = [shape[play.name] for error, shape in tried if error <= AS_GOOD_A_FLANK**2 * least]
    step = _GAP_REACH ** (1 / _GAP_STEPS)
    ends = min(as_good) / step, max(as_good) * step
    return {name: replace(e, interval=ends if name == play.name else None) for name, e in values.items()}


def _flanks(problem: Problem, own: Values, term: Term) -> list[Values]:
    play = problem.model.library.effects[term.effect].of_kind("play")
    kept = {play.name: own[play.name]} if play else {}
    choices = ({**own, **c, **kept} for c in points(problem.regressors, term))
    return list({tuple(c.items()): c for c in choices}.values())


def _narrowed(problem: Problem, shapes: Mapping[Term, Values], skew: Skew, term: Term) -> tuple[float, Values]:
    """The least squared error over the width of a term's gap, and the term's shape there."""
    from scipy.optimize import minimize_scalar  # where it is used: it takes longer to load than a fit

    play = problem.model.library.effects[term.effect].of_kind("play")
    own = shapes[term]
    if play is None or not own[play.name] > 0:
        return _squared_error(problem, shapes, skew), own

    def shape(logarithm: float) -> Values:
        return {**own, play.name: float(np.exp(logarithm))}

    def error(logarithm: float) -> float:
        return _squared_error(problem, {**shapes, term: shape(logarithm)}, skew)

    reach = float(np.log(_GAP_REACH))
    widths = np.log(own[play.name]) + np.linspace(-reach, reach, 2 * _GAP_STEPS + 1)
    tried = [shape(w) for w in widths]
    problem.foresee(term, tried, shapes)
    errors = problem.errors([{**shapes, term: one} for one in tried], skew)
    best, step = first_least(errors), reach / _GAP_STEPS
    bounds = (widths[best] - step, widths[best] + step)
    # Finer, the width is chance.
    between = minimize_scalar(error, bounds=bounds, method="bounded", options={"xatol": step / 5})
    least, at = min((float(errors[best]), float(widths[best])), (float(between.fun), float(between.x)))
    return least, shape(at)


def _squared_error(problem: Problem, shapes: Mapping[Term, Values], skew: Skew) -> float:
    return weighted(problem.solve(shapes, skew).residual, problem.weights)
