"""Normal equations in folds: least squares, cross-validation and the information criterion of one linear model."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from runtime.regression.alike import Alike, Sides, times
from runtime.regression.least_squares import rank

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Grams:
    """The left-hand sides of normal equations in folds: folds (FOLDS, K, K) of the unknowns' columns, compensated;
    lower, upper (K,); lean (K,): as much again speaks for zero of each where a fold is left out; ends as for `Alike`,
    shared with others of the same unknowns; core: those of the first of the unknowns alone."""

    folds: Array
    lower: Array
    upper: Array
    lean: Array
    ends: list[Sides] = field(default_factory=list)
    core: Grams | None = None

    @cached_property
    def whole(self) -> Alike:
        core = None if self.core is None else self.core.whole
        return Alike(self.folds.sum(axis=0)[None], self.lower, self.upper, ends=self.ends, core=core)

    @cached_property
    def rests(self) -> Alike:
        """Every fold left out once."""
        core = None if self.core is None else self.core.rests
        return Alike(self.left + np.diag(self.lean), self.lower, self.upper, ends=self.ends, core=core)

    @property
    def left(self) -> Array:
        """(FOLDS, K, K) without each of the folds."""
        return self.whole.grams - self.folds

    @cached_property
    def rank(self) -> int:
        """Number of separate linear directions that the columns span."""
        return rank(self.whole.grams[0])


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations of a base, with a candidate or without, in folds.

    moments (FOLDS, K) of the unknowns' columns with the torque, squares (FOLDS,) of the torque; level (FOLDS,) and
    sizes (FOLDS,): of the noise and of the rows.
    """

    grams: Grams
    moments: Array
    squares: Array
    level: Array
    sizes: Array

    @cached_property
    def coefficients(self) -> Array:
        """(K,) least squares on all rows, every coefficient within its bounds."""
        found: Array = self.grams.whole.solve(self.moments.sum(axis=0)[None])[0]
        return found

    @cached_property
    def sse(self) -> float:
        """Sum of squares that the coefficients leave of all rows, as these are weighted."""
        theta, moment = self.coefficients[None], self.moments.sum(axis=0)[None]
        left = _left(self.grams.whole.grams, moment, self.squares.sum()[None], theta)
        return float(left[0] + self.level.sum())

    @property
    def rank(self) -> int:
        """Number of columns that are independent."""
        return self.grams.rank

    @cached_property
    def held_out(self) -> tuple[Array, Array]:
        """Held-out and training SSE (FOLDS,), every fold left out once."""
        moments, squares = self.moments.sum(axis=0) - self.moments, self.squares.sum() - self.squares
        theta = self.grams.rests.solve(moments)
        held = _left(self.grams.folds, self.moments, self.squares, theta)
        trained = _left(self.grams.left, moments, squares, theta)
        return held + self.level, trained + self.level.sum() - self.level

    @cached_property
    def count(self) -> int:
        """Number of rows of all folds."""
        return round(float(self.sizes.sum()))

    @cached_property
    def bic(self) -> float:
        """Of all that is solved for here; shapes that were searched come on top."""
        return bic(self.sse, self.count, self.rank)

    @cached_property
    def log_likelihood(self) -> float:
        """Cross-validated."""
        return log_likelihood(*self.held_out, self.sizes)


def _left(grams: Array, moments: Array, squares: Array, theta: Array) -> Array:
    """(F,) squared errors of coefficients theta (F, K)."""
    left: Array = squares + (theta * (times(grams, theta) - 2 * moments)).sum(axis=1)
    return left


def bic(sse: float, count: int, parameters: int) -> float:
    """Bayesian information criterion of a sum of squares over `count` rows, up to a constant. Source: Schwarz 1978."""
    return count * float(np.log(max(sse, 1e-300) / count)) + parameters * float(np.log(count))


def log_likelihood(held: Array, trained: Array, sizes: Array) -> float:
    """Held-out Gaussian log-likelihood, each fold with the variance of its training rows.

    Minus infinity where compensation leaves no variance: such a model explains noise.
    """
    if np.any(trained <= 0):
        return float("-inf")
    variance = trained / (sizes.sum() - sizes)
    return float(np.sum(-0.5 * sizes * np.log(2 * np.pi * variance) - held / (2 * variance)))
