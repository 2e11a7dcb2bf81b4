"""A residual's autoregression, and the filter that makes such rows white."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from runtime.arrays import Array, Mask
from runtime.regression.settings import MOST_LAGS, WHITE_LEAST


@dataclass(frozen=True)
class Whitening:
    """Rows (M,) through an autoregressive filter (1, a1, ...), less all that is unknown of them.

    A row that does not count is an unknown of its own, and so is each combination of rows that was eliminated: a filter
    over rows that hold zero in their place would take that for a measurement, and make the more of it the narrower the
    band. What is filtered is projected on what is orthogonal to the unknowns, filtered, which is least squares with the
    noise's own covariance.

    use (M,): rows that count; by (M, M): the filter; unknown (M, K): the unknowns through it.
    Source: Aitken 1936, Proc. Royal Society of Edinburgh 55, for the least squares; Frisch & Waugh 1933, Econometrica
    1(4), for the projection; missing rows as unknowns: Bartlett 1937, J. Royal Statistical Society Supplement 4(2).
    """

    use: Mask
    by: sparse.csr_array
    unknown: sparse.csc_array

    @classmethod
    def of(cls, ar: Array, use: Mask, piece: NDArray[np.intp], directions: sparse.csr_array | None = None) -> Whitening:
        """piece (M,): the stretch of time of a row, over whose ends nothing is filtered; directions (M, K): what was
        eliminated."""
        if not use.any():
            return cls(use, sparse.csr_array((len(use), len(use))), sparse.csc_array((len(use), 0)))
        by = _filter(ar, piece)
        missing = np.flatnonzero(~use)
        ones = sparse.csr_array((np.ones(len(missing)), (missing, np.arange(len(missing)))), (len(use), len(missing)))
        parts = [ones] if directions is None else [ones, sparse.diags_array(use.astype(float)) @ directions]
        unknown = sparse.csc_array(sparse.hstack(parts))
        size = np.sqrt(np.asarray(unknown.power(2).sum(axis=0)))
        there = size > 1e-4  # what the filter leaves less of is rounding
        filtered = sparse.csc_array(by @ unknown[:, there])
        size = np.sqrt(np.asarray(filtered.power(2).sum(axis=0)))
        return cls(use, by, sparse.csc_array(filtered @ sparse.diags_array(1 / size)))

    @cached_property
    def _gram(self) -> SuperLU:
        size = self.unknown.shape[1]
        return splu(sparse.csc_array(self.unknown.T @ self.unknown + 1e-8 * sparse.eye_array(size)))

    def __call__(self, x: Array) -> Array:
        """x (..., M) -> (..., M), of as many rows more than are independent as there are unknowns."""
        rows: Array = self.by @ np.where(self.use, x, 0.0).reshape(-1, x.shape[-1]).T
        if self.unknown.shape[1]:
            rows = rows - self.unknown @ self._gram.solve(np.ascontiguousarray(self.unknown.T @ rows))
        return np.ascontiguousarray(rows.T).reshape(x.shape)


def autoregression(residual: Array, use: Mask, piece: NDArray[np.intp]) -> Array:
    """(1, a1, ..., ap) of a residual (M,), order by BIC; Yule-Walker over pairs of rows that both count."""
    covariance = np.zeros(MOST_LAGS + 1)
    r = np.where(use, residual, 0.0)
    for lag in range(min(MOST_LAGS, len(r) - 1) + 1):
        pair = use[lag:] & use[: len(use) - lag] & (piece[lag:] == piece[: len(r) - lag])
        covariance[lag] = (r[lag:] * r[: len(r) - lag])[pair].sum() / max(1, int(pair.sum()))
    covariance[0] *= 1 + WHITE_LEAST
    return _levinson(covariance, int(use.sum()))


def _filter(ar: Array, piece: NDArray[np.intp]) -> sparse.csr_array:
    """(M, M) the filter; the first rows of a stretch, which have fewer before them, through those of lower orders."""
    order, rows = len(ar) - 1, np.arange(len(piece))
    starts = np.concatenate([[0], np.flatnonzero(np.diff(piece)) + 1])
    before = rows - np.repeat(starts, np.diff(np.append(starts, len(piece))))
    taps = np.zeros((order + 1, order + 1))
    lower, part = ar, 1.0
    for k in range(order, -1, -1):
        taps[k, : k + 1] = lower * np.sqrt(part)
        if k:
            # The recursion of Levinson and Durbin, downward: the lower order's error is so much larger.
            part *= 1 - lower[k] ** 2
            lower = ((lower - lower[k] * lower[::-1]) / (1 - lower[k] ** 2))[:k]
    weights = taps[np.minimum(before, order)]
    reaches = np.arange(order + 1) <= before[:, None]
    ends = np.concatenate([[0], np.cumsum(np.minimum(before, order) + 1)])
    columns = (rows[:, None] - np.arange(order + 1))[reaches]
    return sparse.csr_array((weights[reaches], columns, ends), (len(piece), len(piece)))


def _levinson(covariance: Array, count: int) -> Array:
    """Autoregressive filter (order + 1,), 1 first, of the order that BIC chooses.

    covariance   (orders + 1,) of the series by lag      count   of its samples
    Source: the recursion of Levinson 1947 and Durbin 1960 on the Yule-Walker equations; BIC: Schwarz 1978.
    """
    ar: Array = np.array([1.0])
    error = float(covariance[0])
    best, best_score = ar, count * np.log(max(error, 1e-300))
    for order in range(1, len(covariance)):
        if error <= 0:
            break
        reflection = -float(ar @ covariance[order:0:-1]) / error
        if abs(reflection) >= 1:
            break
        ar = np.append(ar, 0.0) + reflection * np.append(ar, 0.0)[::-1]
        error *= 1 - reflection**2
        score = count * np.log(error) + order * np.log(count)
        if score < best_score:
            best, best_score = ar, score
    return best


def over_stretches(sums: Array, equations: int) -> Array:
    """(K, K) covariance of the sum of scores, of their sums (S, K) over stretches that count as independent.

    A stretch holds rows of that many equations, one a joint, and the K unknowns take their degrees of freedom from all
    of them together. Source: Liang & Zeger 1986.
    """
    stretches, unknowns = sums.shape
    covariance: Array = sums.T @ sums * stretches / max(1.0, stretches - unknowns / equations)
    return covariance


def lag_by_lag(scores: Array) -> float:
    """Variance of the sum of scores (N,) about their mean, with weights that fall to zero at a lag that grows with N.

    Source: Newey & West 1987; for the lag, 4 (N/100)^(2/9), 1994.
    """
    centred = scores - scores.mean()
    lags = int(4 * (len(scores) / 100) ** (2 / 9)) + 1
    variance = float(centred @ centred)
    for lag in range(1, lags + 1):
        variance += 2 * (1 - lag / (lags + 1)) * float(centred[lag:] @ centred[:-lag])
    return variance
