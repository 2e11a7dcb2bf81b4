"""Where a joint rests or turns: what its dry friction is there, nobody knows, and no equation holds it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.motion.settings import (
    STANDSTILL_BLUR,
    STANDSTILL_PERIODS,
    STANDSTILL_S,
    STANDSTILL_SHARP_HZ,
    STANDSTILL_TAPER,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def known(qd: Array, dt: float, cutoff: float, standstill: float) -> Array:
    """(N,) how much samples of a joint's rate qd (N,) at steps of dt count: 0 at rest and where it turns, as any torque
    below its friction holds it there; 1 away from that, with a soft passage between.

    What is equal at every sample is equal in any weighted sum of them, whatever the weights: a row that passes over a
    turn is then an equation without it. A hard edge would let the noise above the band into that row.
    standstill: the rate below which it rests.
    """
    blurred = min(STANDSTILL_S * (STANDSTILL_SHARP_HZ / cutoff) ** STANDSTILL_BLUR, STANDSTILL_PERIODS / cutoff)
    reach, taper = (max(1, round(x / dt)) for x in (max(STANDSTILL_S, blurred), STANDSTILL_TAPER / cutoff))
    lost = _mean(np.abs(qd) < standstill, reach) > 0
    turning = np.diff(np.sign(qd)) != 0
    lost[:-1] |= turning
    lost[1:] |= turning
    around = (_mean(lost, taper) > 0).astype(np.float64)
    kept: Array = 1 - _mean(_mean(around, taper - taper // 2), taper // 2)
    return kept


def _mean(x: Array | Mask, half: int) -> Array:
    """(N,) means of x (N,) over as many samples to either side, as far as there are any."""
    total, at = np.concatenate([[0], np.cumsum(x)]), np.arange(len(x))
    low, high = np.maximum(at - half, 0), np.minimum(at + half + 1, len(x))
    mean: Array = (total[high] - total[low]) / (high - low)
    return mean
