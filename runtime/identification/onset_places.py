"""Places at which a torque sets in: it does so at a sample, so that the error over the place is a staircase on which no
derivative leads on.

Each is sought among fixed places, finer than the grid from which a search began, to both sides of where that search has
ended, first some apart and then between them. That they are the same ones wherever the search has ended shares their
columns between passes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.identification import grids
from runtime.identification.problem import Problem, Skew, first_least
from runtime.identification.settings import PLACE_STEPS, PLACE_STRIDE
from runtime.model.terms import Term, Values

OF_PLACES = ("position", "end", "tip")
"""Grids over a range of places."""


@dataclass(frozen=True)
class _Places:
    """Fixed places, evenly from the first of a grid to its last."""

    first: float
    step: float
    count: int

    @classmethod
    def between(cls, grid: NDArray[np.float64]) -> _Places:
        """PLACE_STEPS to a step of an even grid."""
        return cls(float(grid[0]), float(grid[1] - grid[0]) / PLACE_STEPS, (len(grid) - 1) * PLACE_STEPS + 1)

    def around(self, place: float, stride: int, reach: int) -> list[float]:
        """Those of every `stride` that lie within `reach` of them to either side, the nearest first."""
        middle = round((place - self.first) / self.step / stride)
        numbers = stride * (middle + np.arange(-reach, reach + 1))
        inside = numbers[(numbers >= 0) & (numbers < self.count)]
        found = self.first + self.step * inside
        return [float(x) for x in found[np.argsort(np.abs(found - place), kind="stable")]]


def found(problem: Problem, shapes: Mapping[Term, Values], skew: Skew) -> dict[Term, Values]:
    """Shapes with every such place at the least error within a step of its grid."""
    best = dict(shapes)
    for term in problem.layout.terms:
        for parameter in problem.model.library.effects[term.effect].shape:
            if parameter.grid is None or parameter.grid.of not in OF_PLACES:
                continue
            grid = grids.axis(problem.regressors, term, parameter, best[term])
            if len(grid) < 2 or not grids.searchable(parameter, grid):
                continue
            places = _Places.between(grid)
            for stride, reach in ((PLACE_STRIDE, PLACE_STEPS // PLACE_STRIDE), (1, PLACE_STRIDE - 1)):
                at = float(np.clip(best[term][parameter.name], grid[0], grid[-1]))
                choices = [{**best[term], parameter.name: x} for x in (at, *places.around(at, stride, reach))]
                problem.foresee(term, choices, best)
                errors = problem.errors([{**best, term: shape} for shape in choices], skew)
                best[term] = choices[first_least(errors)]
    return best
