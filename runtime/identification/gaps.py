"""The width of a gap: what hangs behind one strikes its flanks at instants that follow from everything, so that the
error over the width is rugged, and no derivative tells where it is least or how sure that is.

It is sought in steps over a stretch, and then between them. How stiff the flanks are and how they damp shows above the
band, where nothing is compared: an interval of the width holds the best ones with all flanks that are as good, and of
the flanks nothing is claimed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from runtime.identification import grids
from runtime.identification.estimate import Estimate
from runtime.identification.problem import Fit, Problem, Skew, first_least, weighted
from runtime.identification.settings import AS_GOOD_A_FLANK, GAP_ACCURACY, GAP_REACH, GAP_STEPS, HOPELESS_FLANK
from runtime.model.terms import Term, Values


def found(problem: Problem, shapes: Mapping[Term, Values], skew: Skew) -> dict[Term, Values]:
    """Shapes with the width of every gap at the least error that lies around it."""
    best = dict(shapes)
    for term in problem.layout.terms:
        if problem.model.library.effects[term.effect].has_gap:
            best[term] = _narrowed(problem, best, skew, term)[1]
    return best


def estimates(problem: Problem, fit: Fit, term: Term, values: dict[str, Estimate]) -> dict[str, Estimate]:
    """A term's estimates with the interval that its flanks leave to its gap, and none for themselves; as they are for
    a term without a gap."""
    info = problem.model.library.effects[term.effect]
    play = info.of_kind("play")
    if not info.has_gap or play is None:
        return values
    skew = Skew(fit.skew)
    own = _error(problem, fit.shapes, skew)
    tried = [(own, fit.shapes[term])]
    for flanks in _flanks(problem, fit, term):
        shapes = {**fit.shapes, term: flanks}
        if _error(problem, shapes, skew) < HOPELESS_FLANK**2 * own:
            tried.append(_narrowed(problem, shapes, skew, term))
    least = min(error for error, _ in tried)
    as_good = [shape[play.name] for error, shape in tried if error <= AS_GOOD_A_FLANK**2 * least]
    step = GAP_REACH ** (1 / GAP_STEPS)
    ends = min(as_good) / step, max(as_good) * step
    return {name: replace(e, interval=ends if name == play.name else None) for name, e in values.items()}


def _flanks(problem: Problem, fit: Fit, term: Term) -> list[Values]:
    """The term's shape with the flanks of the grid in the place of its own."""
    own = fit.shapes[term]
    play = problem.model.library.effects[term.effect].of_kind("play")
    kept = {play.name: own[play.name]} if play else {}
    choices = ({**own, **c, **kept} for c in grids.points(problem.regressors, term))
    return list({tuple(c.items()): c for c in choices}.values())


def _narrowed(problem: Problem, shapes: Mapping[Term, Values], skew: Skew, term: Term) -> tuple[float, Values]:
    """The least squared error over the width of a term's gap, and the term's shape there."""
    from scipy.optimize import minimize_scalar  # where it is used: it takes longer to load than a fit

    play = problem.model.library.effects[term.effect].of_kind("play")
    own = shapes[term]
    if play is None or not own[play.name] > 0:
        return _error(problem, shapes, skew), own

    def shape(logarithm: float) -> Values:
        return {**own, play.name: float(np.exp(logarithm))}

    def error(logarithm: float) -> float:
        return _error(problem, {**shapes, term: shape(logarithm)}, skew)

    reach = float(np.log(GAP_REACH))
    widths = np.log(own[play.name]) + np.linspace(-reach, reach, 2 * GAP_STEPS + 1)
    tried = [shape(w) for w in widths]
    problem.foresee(term, tried, shapes)
    errors = problem.errors([{**shapes, term: one} for one in tried], skew)
    best, step = first_least(errors), reach / GAP_STEPS
    bounds = (widths[best] - step, widths[best] + step)
    between = minimize_scalar(error, bounds=bounds, method="bounded", options={"xatol": GAP_ACCURACY * step})
    least, at = min((float(errors[best]), float(widths[best])), (float(between.fun), float(between.x)))
    return least, shape(at)


def _error(problem: Problem, shapes: Mapping[Term, Values], skew: Skew) -> float:
    return weighted(problem.solve(shapes, skew).residual, problem.weights)
