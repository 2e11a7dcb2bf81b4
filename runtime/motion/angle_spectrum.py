"""Waves over an angle: what each order explains of a residual beside a model, and which orders stand out as lines.

A line over the motor's angle (cogging, commutation, wave generator) sweeps through frequencies as the speed varies, so
that no spectrum over time shows it. Samples lie unevenly over the angle: the periodogram is that of least squares
(Lomb 1976, Scargle 1982), a cosine and a sine of every order beside the columns of the model that is fitted anyway,
for all orders at once: samples are spread onto an even grid of the angle (non-uniform FFT, Dutt & Rokhlin 1993), and
the sums over residual, columns and sampling window are one FFT each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft
from scipy.ndimage import maximum_filter1d

from runtime.motion.settings import (
    ANGLE_GRID,
    AROUND,
    LEAST_OF_WAVE,
    LEAST_PERIODS,
    LINE_ABOVE_CHANCE,
    MOST_ANGLES,
    MOST_PEAKS,
    NEAR_SURROUNDINGS,
    ORDERS_A_PERIOD,
    WIDE_SURROUNDINGS,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AngleSpectrum:
    """Orders (K,), ascending and evenly spaced, and by how much a wave of each lowers the squared error, gain (K,).

    period   order of one period over the whole stretch of the angle: finer is not resolved
    """

    order: Array
    gain: Array
    period: float

    @property
    def independent(self) -> int:
        """Number of orders that are resolved."""
        return max(1, round((self.order[-1] - self.order[0]) / self.period)) if len(self.order) else 1

    def at(self, order: float) -> float:
        """The gain of the nearest order."""
        return float(self.gain[int(np.argmin(np.abs(self.order - order)))])

    def peaks(self, span: tuple[float, float]) -> Array:
        """Orders (P,) within a span that gain most of all near them, the strongest first."""
        near = maximum_filter1d(self.gain, 2 * NEAR_SURROUNDINGS * ORDERS_A_PERIOD + 1)
        inside = (self.order >= span[0]) & (self.order <= span[1])
        found = np.flatnonzero((self.gain == near) & (self.gain > 0) & inside)
        return self.order[found[np.argsort(-self.gain[found])]][:MOST_PEAKS]

    def between(self, peak: float) -> float:
        """The order of a peak, between those of the spectrum: where a parabola through three of them has its top."""
        k = int(np.argmin(np.abs(self.order - peak)))
        if not 0 < k < len(self.order) - 1:
            return float(peak)
        before, here, after = self.gain[k - 1 : k + 2]
        bend = before - 2 * here + after
        step = self.order[k] - self.order[k - 1]
        return float(peak + step * (before - after) / (2 * bend)) if bend < 0 else float(peak)

    def level(self, order: float) -> float:
        """Mean gain of chance about an order, from a median, which lines do not move: chance has an exponential
        distribution. Broad structure over the angle falls with the order: about a low one fewer are like it."""
        reach = self.period * float(np.clip(order / self.period / 2, NEAR_SURROUNDINGS, WIDE_SURROUNDINGS))
        return float(np.median(self.gain[np.abs(self.order - order) <= reach])) / float(np.log(2))


def lines(
    angle: Array, left: Array, base: Array, projection: Array, span: tuple[float, float], among: int
) -> dict[float, float]:
    """Orders of waves over the angle that stand out of a residual, and their gains; as for `angle_spectrum`.

    among   number of orders that are looked at in all: a line is more than the largest of so many chances
    The level of chance is that of what a line leaves: where little of the motion shows it, it is broad, and hides what
    surrounds it. At least LEAST_PERIODS of its periods must be there, in whatever pieces.
    """
    found = {}
    least = float(np.log(among)) + LINE_ABOVE_CHANCE
    spectrum = angle_spectrum(angle, left, base, projection, (span[0] / AROUND, span[1] * AROUND))
    for order in spectrum.peaks(span):
        half_periods = np.unique(np.floor(order * angle / np.pi))
        if len(half_periods) < 2 * LEAST_PERIODS:
            continue
        beside = left - wave_beside(order * angle, left, base, projection)
        reach = 2 * WIDE_SURROUNDINGS * spectrum.period
        rest = angle_spectrum(angle, beside, base, projection, (max(order - reach, span[0] / AROUND), order + reach))
        if spectrum.at(order) > least * rest.level(order):
            found[spectrum.between(order)] = spectrum.at(order)
    return found


def wave_beside(phase: Array, left: Array, base: Array, projection: Array) -> Array:
    """(M,) what a wave, with the columns of the model fitted again beside it, takes of a residual; phase (M,) rad, the
    rest as for `angle_spectrum`."""
    wave = np.array([np.cos(phase), np.sin(phase)])
    cross = wave @ base.T
    own = wave @ wave.T - cross @ projection @ cross.T
    amount = np.linalg.lstsq(own, wave @ left, rcond=None)[0]
    taken: Array = amount @ wave - (amount @ cross) @ projection @ base
    return taken


def angle_spectrum(
    angle: Array, left: Array, base: Array, projection: Array, span: tuple[float, float]
) -> AngleSpectrum:
    """What waves over an angle explain of a residual beside a model.

    angle (M,) rad; left (M,) the residual; base (B, M) the model's columns and projection (B, B) the inverse of their
    Gram matrix, over these samples and others where no wave is looked for; span: lowest and highest order, per 2 pi of
    the angle. Fewer orders where the angle is too long.
    """
    extent = float(np.ptp(angle)) if len(angle) else 0.0
    low, high = max(span[0], LEAST_PERIODS * 2 * np.pi / max(extent, 1e-300)), span[1]
    high = min(high, MOST_ANGLES * ANGLE_GRID / max(extent, 1e-300))
    if not low < high or not len(angle):
        return AngleSpectrum(np.empty(0), np.empty(0), 1.0)
    spacing = ANGLE_GRID / high
    size = next_fast_len(ORDERS_A_PERIOD * (int(extent / spacing) + 2), real=True)
    step = 2 * np.pi / (size * spacing)
    index = np.arange(int(np.ceil(low / step)), int(high / step) + 1)
    grid = _Grid((angle - angle.min()) / spacing, spacing, size)
    order, count = index * step, len(angle)
    window = grid.sums(np.ones(count))[2 * index] / grid.response(2 * order)
    response = grid.response(order)
    moment = _cosine_sine(grid.sums(left)[index] / response)
    cross = np.array([_cosine_sine(grid.sums(row)[index] / response) for row in base]).reshape(-1, 2, len(index))
    own = np.array([[count + window.real, -window.imag], [-window.imag, count - window.real]]) / 2
    own -= np.einsum("aik,ab,bjk->ijk", cross, projection, cross, optimize=True)
    determinant = own[0, 0] * own[1, 1] - own[0, 1] ** 2
    solved = own[1, 1] * moment[0] ** 2 - 2 * own[0, 1] * moment[0] * moment[1] + own[0, 0] * moment[1] ** 2
    # Where the model's columns can make the wave themselves, nothing of it is left to be seen.
    seen = (determinant > (LEAST_OF_WAVE * count) ** 2) & (own[0, 0] > 0)
    gain = np.where(seen, solved / np.where(seen, determinant, 1.0), 0.0)
    return AngleSpectrum(order, gain, 2 * np.pi / extent)


@dataclass(frozen=True)
class _Grid:
    """An even grid of the angle: place (M,) of the samples in its steps of `spacing`; its sums are `size` long."""

    place: Array
    spacing: float
    size: int

    def sums(self, x: Array) -> NDArray[np.complex128]:
        """Sum of x (M,) e^(-i order angle) at all orders of the grid: every sample shared by its two neighbours."""
        at = self.place.astype(np.intp)
        upper = x * (self.place - at)
        spread = np.bincount(at, x - upper, self.size) + np.bincount(at + 1, upper, self.size)
        transformed: NDArray[np.complex128] = rfft(spread)
        return transformed

    def response(self, order: Array) -> Array:
        """What sharing leaves of a wave."""
        return np.sinc(order * self.spacing / (2 * np.pi)) ** 2


def _cosine_sine(transformed: NDArray[np.complex128]) -> Array:
    """(2, K): sums with the cosine and with the sine."""
    return np.array([transformed.real, -transformed.imag])
