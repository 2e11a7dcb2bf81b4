"""What tells a residual from noise where nothing repeats: lines, slow parts, bursts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

Array = NDArray[np.float64]

_STANDS_OUT = 0.1
_LOW = 0.15
_WHITE = (0.35, 0.85)
"""Parts of the cut-off: where slow disturbances lie, and where noise is taken to be white."""
_SEGMENT = 256
_WIDTH = 3
"""Bins on either side of a peak that a Hann window spreads it over, and the trend's at the beginning."""


@dataclass(frozen=True)
class SpectralLine:
    """A frequency, Hz, and the part of the power that lies there."""

    frequency: float
    share: float


def strongest_line(residual: Array, rate: float) -> SpectralLine | None:
    """The strongest line of a signal (M,) sampled at `rate`, Hz; None if none stands out."""
    power = np.abs(np.fft.rfft(residual * np.hanning(len(residual)))) ** 2
    total = float(power.sum())
    if len(power) <= 2 * _WIDTH or not total:
        return None
    peak = int(np.argmax(power[_WIDTH:])) + _WIDTH
    share = float(power[max(_WIDTH, peak - _WIDTH) : peak + _WIDTH + 1].sum()) / total
    if share <= _STANDS_OUT:
        return None
    return SpectralLine(float(np.fft.rfftfreq(len(residual), 1 / rate)[peak]), share)


def slow_over_white(residual: Array, use: NDArray[np.bool_], rate: float, cutoff: float) -> float:
    """Density of a residual (M,) at low frequencies over that in the upper part of the band; 1 for white noise."""
    f, power = welch(residual, rate, nperseg=min(len(residual), _SEGMENT))
    white = power[(f > _WHITE[0] * cutoff) & (f < _WHITE[1] * cutoff)]
    if not use.any() or not len(white) or np.median(white) <= 0:
        return 1.0
    return float(power[f < _LOW * cutoff].mean() / np.median(white))


def bursts(residual: Array, use: NDArray[np.bool_], expected: Array, rate: float) -> tuple[float, NDArray[np.intp]]:
    """How much more variance than in most stretches of a second the second worst has, and the rows (S,) at which
    the stretches begin that are at least half as bad.

    expected (M,): variance that noise has there, known up to a factor.
    """
    width = max(1, round(rate))
    starts = np.arange(0, len(residual) - width + 1, width)
    counts = np.array([use[s : s + width].sum() for s in starts])
    starts = starts[counts > width / 2]
    if len(starts) < 3:
        return 1.0, starts[:0]
    inside = [np.arange(s, s + width)[use[s : s + width]] for s in starts]
    power = np.array([np.mean(residual[k] ** 2) / np.mean(expected[k]) for k in inside])
    worst = float(np.sort(power)[-2] / np.median(power))
    return worst, starts[power > 0.5 * worst * np.median(power)]
