"""Places at which a torque sets in: it does so at a sample, so that the error over the place is a staircase on which no
derivative leads on.

Each is sought in steps, finer than the grid from which a search began, to both sides of where that search has ended.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from runtime.estimation import grids
from runtime.estimation.problem import Problem, Skew, first_least
from runtime.estimation.settings import PLACE_STEPS
from runtime.model.terms import Term, Values

OF_PLACES = ("position", "end", "tip")
"""Grids over a range of places."""


def found(problem: Problem, shapes: Mapping[Term, Values], skew: Skew) -> dict[Term, Values]:
    """Shapes with every such place at the least error within a step of its grid."""
    best = dict(shapes)
    for term in problem.layout.terms:
        for parameter in problem.model.library.effects[term.effect].shape:
            if parameter.grid is None or parameter.grid.of not in OF_PLACES:
                continue
            places = grids.axis(problem.regressors, term, parameter, best[term])
            if len(places) < 2 or not grids.searchable(parameter, places):
                continue
            steps = (places[1] - places[0]) * np.linspace(-1, 1, 2 * PLACE_STEPS + 1)
            steps = steps[np.argsort(np.abs(steps), kind="stable")]  # of equals the nearest
            at = np.clip(best[term][parameter.name] + steps, places[0], places[-1])
            choices = [{**best[term], parameter.name: float(x)} for x in at]
            problem.foresee(term, choices, best)
            errors = problem.errors([{**best, term: shape} for shape in choices], skew)
            best[term] = choices[first_least(errors)]
    return best
