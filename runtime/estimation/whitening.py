"""A residual's autoregression, and the filter that makes such rows white."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from runtime.estimation.settings import MOST_LAGS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def whiten(x: Array, ar: Array, use: Mask, piece: NDArray[np.intp]) -> Array:
    """x (..., M) through the filter (1, a1, ...); rows that do not count enter as zero on both sides of the equation.

    use (M,): rows that count; piece (M,): the stretch of time of a row, over whose ends nothing is filtered
    """
    x = np.where(use, x, 0.0)
    out = ar[0] * x
    edges = [0, *(np.flatnonzero(np.diff(piece)) + 1), len(piece)]
    for start, stop in pairwise(edges):
        for lag in range(1, len(ar)):
            out[..., start + lag : stop] += ar[lag] * x[..., start : max(start, stop - lag)]
    return np.where(use, out, 0.0)


def autoregression(residual: Array, use: Mask, piece: NDArray[np.intp]) -> Array:
    """(1, a1, ..., ap) of a residual (M,), order by BIC; Yule-Walker over pairs of rows that both count."""
    covariance = np.zeros(MOST_LAGS + 1)
    r = np.where(use, residual, 0.0)
    for lag in range(min(MOST_LAGS, len(r) - 1) + 1):
        pair = use[lag:] & use[: len(use) - lag] & (piece[lag:] == piece[: len(r) - lag])
        covariance[lag] = (r[lag:] * r[: len(r) - lag])[pair].sum() / max(1, int(pair.sum()))
    return _levinson(covariance, int(use.sum()))


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
        ar = np.append(ar, 0.0) + reflection * np.append(ar, 0.0)[::-1]
        error *= 1 - reflection**2
        if error <= 0:
            break
        score = count * np.log(error) + order * np.log(count)
        if score < best_score:
            best, best_score = ar, score
    return best
