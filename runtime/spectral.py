"""Lines in a residual's spectrum: a disturbance from outside, or a ripple at constant speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_STANDS_OUT = 0.2
_WIDTH = 3
"""Bins on either side of a peak that a Hann window spreads it over, and the trend's at the beginning."""


@dataclass(frozen=True)
class Line:
    """A frequency, Hz, and the part of the power that lies there."""

    frequency: float
    share: float


def strongest_line(residual: Array, rate: float) -> Line | None:
    """The strongest line of a signal (M,) sampled at `rate`, Hz; None if none stands out."""
    power = np.abs(np.fft.rfft(residual * np.hanning(len(residual)))) ** 2
    total = float(power.sum())
    if len(power) <= 2 * _WIDTH or not total:
        return None
    peak = int(np.argmax(power[_WIDTH:])) + _WIDTH
    share = float(power[max(_WIDTH, peak - _WIDTH) : peak + _WIDTH + 1].sum()) / total
    if share <= _STANDS_OUT:
        return None
    return Line(float(np.fft.rfftfreq(len(residual), 1 / rate)[peak]), share)
