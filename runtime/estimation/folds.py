"""Normal equations in folds: least squares, cross-validation and the information criterion of one linear model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from runtime.estimation.least_squares import bounded, bounded_each, rank

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations of a base, with a candidate or without, in folds.

    grams (FOLDS, K + 1, K + 1) of the unknowns' columns and the torque, compensated; lower, upper (K,);
    level (FOLDS,) and sizes (FOLDS,): of the noise and of the rows.
    """

    grams: Array
    lower: Array
    upper: Array
    level: Array
    sizes: Array

    @cached_property
    def _whole(self) -> Array:
        return np.asarray(self.grams.sum(axis=0))

    @cached_property
    def coefficients(self) -> Array:
        """(K,) least squares on all rows, every coefficient within its bounds."""
        return bounded(self._whole[:-1, :-1], self._whole[:-1, -1], self.lower, self.upper)

    @cached_property
    def sse(self) -> float:
        direction = np.append(self.coefficients, -1.0)
        return float(direction @ self._whole @ direction + self.level.sum())

    @cached_property
    def rank(self) -> int:
        """Number of separate linear directions that the columns span."""
        return rank(self._whole[:-1, :-1])

    @cached_property
    def held_out(self) -> tuple[Array, Array]:
        """Held-out and training SSE (FOLDS,), every fold left out once."""
        rest = self._whole - self.grams
        whole = self.coefficients
        held = (whole == self.lower) | (whole == self.upper)
        theta = bounded_each(rest[:, :-1, :-1], rest[:, :-1, -1], self.lower, self.upper, held)
        direction = np.column_stack([theta, np.full(len(theta), -1.0)])
        held, trained = (np.einsum("fi,fij,fj->f", direction, gram, direction) for gram in (self.grams, rest))
        return held + self.level, trained + self.level.sum() - self.level

    @cached_property
    def count(self) -> int:
        return int(self.sizes.sum())

    @cached_property
    def bic(self) -> float:
        """Of all that is solved for here; shapes that were searched come on top."""
        return bic(self.sse, self.count, self.rank)

    @cached_property
    def log_likelihood(self) -> float:
        """Cross-validated."""
        return log_likelihood(*self.held_out, self.sizes)


def bic(sse: float, count: int, parameters: int) -> float:
    return count * float(np.log(max(sse, 1e-300) / count)) + parameters * float(np.log(count))


def log_likelihood(held: Array, trained: Array, sizes: Array) -> float:
    """Held-out Gaussian log-likelihood, each fold with the variance of its training rows.

    Minus infinity where compensation leaves no variance: such a model explains noise.
    """
    if np.any(trained <= 0):
        return float("-inf")
    variance = trained / (sizes.sum() - sizes)
    return float(np.sum(-0.5 * sizes * np.log(2 * np.pi * variance) - held / (2 * variance)))
