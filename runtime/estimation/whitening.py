"""A residual's autoregression, and the filter that makes such rows white."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.estimation.settings import MOST_LAGS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def whiten(x: Array, ar: Array, use: Mask, piece: NDArray[np.intp]) -> Array:
    """x (..., M) through the filter (1, a1, ...); rows that do not count are zero.

    The first rows of a run go through the filters of as many lags as there are rows before them, each scaled to the
    same variance: with zeros in the place of what is missing, the terms of a sharp filter would not cancel there, and
    few rows would outweigh all others.

    use (M,): rows that count; piece (M,): the stretch of time of a row, over whose ends nothing is filtered
    Source: the exact likelihood of an autoregression, as a Cholesky factor of its covariance; Brockwell & Davis, Time
    Series: Theory and Methods, section 5.2.
    """
    x = np.where(use, x, 0.0)
    orders, before = _growing(ar), np.minimum(_rows_before(use, piece), len(ar) - 1)
    out: Array = orders[before, 0] * x
    for lag in range(1, len(ar)):
        out[..., lag:] += orders[before[lag:], lag] * x[..., :-lag]
    return np.where(use, out, 0.0)


def _growing(ar: Array) -> Array:
    """(p + 1, p + 1) the filters of 0 to p lags that belong to one of p, a row each, scaled to its error: Durbin's
    recursion backwards."""
    order = len(ar) - 1
    found = np.zeros((order + 1, order + 1))
    filter_, scale = ar, 1.0
    for lags in range(order, -1, -1):
        found[lags, : lags + 1] = scale * filter_
        reflection = filter_[-1] if lags else 0.0
        left = 1 - reflection**2
        filter_, scale = (filter_ - reflection * filter_[::-1])[:-1] / left, scale * np.sqrt(left)
    return found


def _rows_before(use: Mask, piece: NDArray[np.intp]) -> NDArray[np.intp]:
    """(M,) how many rows that count lead to a row without a gap, in its stretch of time."""
    at = np.arange(len(use))
    begins = np.ones(len(use), dtype=bool)
    begins[1:] = ~use[:-1] | (piece[1:] != piece[:-1])
    return at - np.maximum.accumulate(np.where(begins, at, 0))


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
