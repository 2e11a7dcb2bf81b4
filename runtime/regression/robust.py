"""Variances that hold where rows hang together: what follows from a sum over rows is not as sure as their number says.

Two estimators of one thing, the variance of a sum of scores: sums over stretches where a stretch is long against what
hangs together, and lag by lag where one mean of many rows is asked for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
