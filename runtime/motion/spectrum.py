"""What tells a residual from noise where nothing repeats: lines, slow parts, bursts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from runtime.motion.fourier import welch
from runtime.motion.settings import (
    BURST_STRETCHES,
    LINE_BLURRED,
    LINE_CHANCE,
    LINE_COLOUR,
    LINE_STANDS_OUT,
    LINE_WIDTH,
    NAMED_PEAKS,
    PEAK_CHANCE,
    PEAK_FAR,
    PEAK_NEAR,
    PEAK_OVERLAP,
    PEAK_SEGMENT,
    RESIDUAL_SEGMENT,
    ROWS_OVER_CUTOFF,
    SLOW_PART,
    WHITE_PART,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SpectralLine:
    """A frequency, Hz, and the part of the power that lies there."""

    frequency: float
    share: float


def strongest_line(residual: Array, rate: float) -> SpectralLine | None:
    """The strongest line of a signal (M,) sampled at `rate`, Hz, which is zero where there is none; None if none stands
    out, also of what chance makes of few samples.

    A frequency is held against those around it: noise is coloured, an encoder's most of all, and where it is densest
    the largest of chances is far above all others.
    Source: Fisher 1929, Tests of significance in harmonic analysis, Proceedings of the Royal Society A 125.
    """
    power = np.abs(np.fft.rfft(residual * np.hanning(len(residual)))) ** 2
    inside = int(len(power) * 2 / ROWS_OVER_CUTOFF)
    if inside <= 2 * LINE_WIDTH or not power.any():
        return None
    even = power[:inside] / _colour(power[:inside])
    peak = int(np.argmax(even[LINE_WIDTH:])) + LINE_WIDTH
    line = slice(max(LINE_WIDTH, peak - LINE_WIDTH), peak + LINE_WIDTH + 1)
    share = float(power[line].sum() / power.sum())
    frequencies = max(1.0, min(np.count_nonzero(residual) / 2, inside / LINE_BLURRED))
    chance = (np.log(inside) + LINE_CHANCE) / frequencies + 2 * LINE_WIDTH / inside
    if share <= LINE_STANDS_OUT or float(even[line].sum() / even.sum()) <= chance:
        return None
    return SpectralLine(float(np.fft.rfftfreq(len(residual), 1 / rate)[peak]), share)


def density(residual: Array, rate: float) -> tuple[Array, Array]:
    """Frequencies (F,) Hz and one-sided density (F,) of a residual (M,), as it is drawn and searched for peaks."""
    return welch(residual, rate, max(2 * PEAK_FAR, round(PEAK_SEGMENT * rate)))


def peaks(residual: Array, rate: float, cutoff: float) -> list[float]:
    """Frequencies, Hz, at which the density of a residual (M,) up to `cutoff`, Hz, stands out of the bins on both sides
    by more than chance, the strongest first. They may hold far less power than a line.

    Source: the spread of an average of spectra, Welch 1967; quantiles of chi-square, Wilson & Hilferty 1931.
    """
    f, power = density(residual, rate)
    inside = int(np.searchsorted(f, cutoff, side="right"))
    freedom = 2 * max(1.0, PEAK_OVERLAP * np.count_nonzero(residual) / (2 * (len(f) - 1)))
    most = (1 - 2 / (9 * freedom) + PEAK_CHANCE * np.sqrt(2 / (9 * freedom))) ** 3
    found = []
    for k in range(PEAK_FAR, inside):
        around = power[k - PEAK_NEAR : k + PEAK_NEAR + 1]
        sides = power[k - PEAK_FAR : k - PEAK_NEAR], power[k + PEAK_NEAR + 1 : min(k + PEAK_FAR + 1, inside)]
        level = max(float(np.median(side)) for side in sides if len(side) >= PEAK_NEAR)
        if power[k] == around.max() and power[k] > most * level:
            found.append((float(power[k]), float(f[k])))
    return [frequency for _, frequency in sorted(found, reverse=True)[:NAMED_PEAKS]]


def _colour(power: Array) -> Array:
    """The smooth course of a spectrum (K,), whose logarithm lines hardly move, up to a factor."""
    level = np.log(np.maximum(power, np.finfo(float).eps * power.max()))
    at = np.arange(len(power))
    return np.exp(Polynomial.fit(at, level, LINE_COLOUR)(at))


def slow_over_white(residual: Array, use: NDArray[np.bool_], rate: float, cutoff: float) -> float:
    """Density of a residual (M,) at low frequencies over that in the upper part of the band; 1 for white noise."""
    f, power = welch(residual, rate, RESIDUAL_SEGMENT)
    white = power[(f > WHITE_PART[0] * cutoff) & (f < WHITE_PART[1] * cutoff)]
    if not use.any() or not len(white) or np.median(white) <= 0:
        return 1.0
    return float(power[f < SLOW_PART * cutoff].mean() / np.median(white))


def white_inside(x: Array, rate: float, cutoff: float) -> float:
    """One-sided density of the white noise in x (M,), in the upper part of the band, which slow physics does not
    reach; infinite where the signal is too short to tell."""
    f, power = welch(x, rate, RESIDUAL_SEGMENT)
    inside = power[(f > WHITE_PART[0] * cutoff) & (f < WHITE_PART[1] * cutoff)]
    return float(np.median(inside)) if len(inside) else float("inf")


def bursts(residual: Array, use: NDArray[np.bool_], expected: Array, rate: float) -> tuple[float, NDArray[np.intp]]:
    """How much more variance than in most stretches of a second the second worst has, and the rows (S,) at which
    the stretches begin that are at least half as bad.

    expected (M,): variance that noise has there, known up to a factor.
    """
    width = max(1, round(rate))
    starts = np.arange(0, len(residual) - width + 1, width)
    counts = np.array([use[s : s + width].sum() for s in starts])
    starts = starts[counts > width / 2]
    if len(starts) < BURST_STRETCHES:
        return 1.0, starts[:0]
    inside = [np.arange(s, s + width)[use[s : s + width]] for s in starts]
    power = np.array([np.mean(residual[k] ** 2) / np.mean(expected[k]) for k in inside])
    middle, second = float(np.median(power)), float(np.sort(power)[-2])
    worst = second / middle if middle > 0 else float("inf") if second > 0 else 1.0
    return worst, starts[power > 0.5 * second]
