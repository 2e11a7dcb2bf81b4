"""Spectra of a residual over time and over an angle: lines, slow parts and bursts that are no noise.

A line over the motor's angle (cogging, commutation, wave generator) sweeps through frequencies as the speed varies, so
that no spectrum over time shows it. Over the angle samples lie unevenly: the periodogram is that of least squares (Lomb
1976, Scargle 1982), computed by a non-uniform FFT (Dutt & Rokhlin 1993, Beylkin 1995).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft
from scipy.ndimage import maximum_filter1d
from scipy.sparse import csc_array

from runtime.arrays import Array
from runtime.motion.filters import welch
from runtime.motion.settings import CLEARLY_LIKELIER, LEAST_PERIODS, LITTLE, ROWS_OVER_CUTOFF, SLOW_PART, WHITE_PART

# --- over time ---


@dataclass(frozen=True)
class SpectralLine:
    """A line over time: its frequency, Hz, and its share of the power."""

    frequency: float
    share: float


def strongest_line(residual: Array, rate: float) -> SpectralLine | None:
    """The strongest line of a signal (M,), zero where no row counts, sampled at `rate`, Hz; None if chance explains it.

    Noise is coloured: the logarithm of its spectrum follows a cubic, and one signal in a thousand passes. A Hann window
    spreads a line, and the trend, over three bins, and makes about two frequencies one: 1 + 2 (2/3)² + 2 (1/6)².
    Source: Fisher 1929, Tests of significance in harmonic analysis, Proceedings of the Royal Society A 125.
    """
    width, blurred, degree, once_in_a_thousand = 3, 2, 3, 6.9
    power = np.abs(np.fft.rfft(residual * np.hanning(len(residual)))) ** 2
    inside = int(len(power) * 2 / ROWS_OVER_CUTOFF)
    if inside <= 2 * width or not power.any():
        return None
    band, bins = power[:inside], np.arange(inside)
    level = np.log(np.maximum(band, np.finfo(float).eps * band.max()))
    even = band / np.exp(Polynomial.fit(bins, level, degree)(bins))
    peak = int(np.argmax(even[width:])) + width
    line = slice(max(width, peak - width), peak + width + 1)
    share = float(power[line].sum() / power.sum())
    frequencies = max(1.0, min(np.count_nonzero(residual) / 2, inside / blurred))
    chance = (np.log(inside) + once_in_a_thousand) / frequencies + 2 * width / inside
    if share <= LITTLE or float(even[line].sum() / even.sum()) <= chance:
        return None
    return SpectralLine(float(np.fft.rfftfreq(len(residual), 1 / rate)[peak]), share)


def density(residual: Array, rate: float) -> tuple[Array, Array]:
    """Frequencies (F,) Hz and one-sided density (F,) of a residual (M,), with bins of a third of a Hz, as it is drawn
    and searched for peaks."""
    least = 32
    return welch(residual, rate, max(least, round(3 * rate)))


def peaks(residual: Array, rate: float, cutoff: float) -> list[float]:
    """Frequencies, Hz, of the three highest peaks of a residual's density (M,) below `cutoff`, Hz, above chance, the
    strongest first.

    A bin is compared with the median of those 4 to 16 bins away on either side: nearer, the Hann window spreads it,
    and further a slope of the noise would count. Windows that overlap by half have 1.8 times the freedom of others.
    Source: the spread of an average of spectra, Welch 1967; quantiles of chi-square, Wilson & Hilferty 1931.
    """
    near, far = 4, 16
    f, power = density(residual, rate)
    inside = int(np.searchsorted(f, cutoff, side="right"))
    freedom = 2 * max(1.0, 1.8 * np.count_nonzero(residual) / (2 * (len(f) - 1)))
    chance = 4.5  # standard deviations: a bin of noise exceeds it three times in a million
    most = (1 - 2 / (9 * freedom) + chance * np.sqrt(2 / (9 * freedom))) ** 3
    found = []
    for k in range(far, inside):
        around = power[k - near : k + near + 1]
        sides = power[k - far : k - near], power[k + near + 1 : min(k + far + 1, inside)]
        level = max(float(np.median(side)) for side in sides if len(side) >= near)
        if power[k] == around.max() and power[k] > most * level:
            found.append((float(power[k]), float(f[k])))
    return [frequency for _, frequency in sorted(found, reverse=True)[:3]]


def _slow_and_white(x: Array, rate: float, cutoff: float) -> tuple[Array, Array]:
    """Density of x (M,) in the bins of the slow part of the band, and of its upper part, which slow physics does not
    reach."""
    f, power = welch(x, rate, 256)
    return power[f < SLOW_PART * cutoff], power[(f > WHITE_PART[0] * cutoff) & (f < WHITE_PART[1] * cutoff)]


def slow_over_white(residual: Array, use: NDArray[np.bool_], rate: float, cutoff: float) -> float:
    """Density of a residual (M,) at low frequencies over that in the upper part of the band; 1 for white noise."""
    slow, white = _slow_and_white(residual, rate, cutoff)
    if not use.any() or not len(white) or np.median(white) <= 0:
        return 1.0
    return float(slow.mean() / np.median(white))


def in_band_white_density(x: Array, rate: float, cutoff: float) -> float:
    """One-sided density of the white noise in x (M,), from the upper part of the band; infinite where x is too
    short."""
    _, white = _slow_and_white(x, rate, cutoff)
    return float(np.median(white)) if len(white) else float("inf")


def bursts(residual: Array, use: NDArray[np.bool_], expected: Array, rate: float) -> tuple[float, NDArray[np.intp]]:
    """Variance of the second worst stretch of a second over the median stretch's, and the first rows (S,) of the
    stretches with at least half of it.

    expected (M,): variance of noise, up to a factor.
    """
    width = max(1, round(rate))
    starts = np.arange(0, len(residual) - width + 1, width)
    counts = np.array([use[s : s + width].sum() for s in starts])
    starts = starts[counts > width / 2]
    if len(starts) < 3:
        return 1.0, starts[:0]
    inside = [np.arange(s, s + width)[use[s : s + width]] for s in starts]
    power = np.array([np.mean(residual[k] ** 2) / np.mean(expected[k]) for k in inside])
    middle, second = float(np.median(power)), float(np.sort(power)[-2])
    worst = second / middle if middle > 0 else float("inf") if second > 0 else 1.0
    return worst, starts[power > 0.5 * second]


# --- over an angle ---


@dataclass(frozen=True)
class AngleSpectrum:
    """Orders (K,), ascending and evenly spaced, and by how much a wave of each lowers the squared error, gain (K,).

    period   order of one period over the whole range of the angle: the resolution
    """

    order: Array
    gain: Array
    period: float

    def at(self, order: float) -> float:
        """The gain of the nearest order."""
        return float(self.gain[int(np.argmin(np.abs(self.order - order)))])

    def strongest(self, low: float, high: float) -> tuple[float, float]:
        """The order between two that gains most, and its gain; 0 where there is none."""
        inside = np.flatnonzero((self.order >= low) & (self.order <= high))
        if not len(inside):
            return low, 0.0
        best = inside[int(np.argmax(self.gain[inside]))]
        return float(self.order[best]), float(self.gain[best])

    def peaks(self, span: tuple[float, float]) -> Array:
        """The five highest peaks' orders (P,) in a span; nearer to a stronger one a peak may be its shadow.

        Where a motor stops at even angles, orders that lie such a step apart gain nearly alike.
        """
        near = maximum_filter1d(self.gain, 2 * round(2 * LEAST_PERIODS) * 4 + 1)
        inside = (self.order >= span[0]) & (self.order <= span[1])
        found = np.flatnonzero((self.gain == near) & (self.gain > 0) & inside)
        return self.order[found[np.argsort(-self.gain[found])]][:5]

    def refined(self, peak: float) -> float:
        """The order of a peak, interpolated by a parabola through three orders."""
        k = int(np.argmin(np.abs(self.order - peak)))
        if not 0 < k < len(self.order) - 1:
            return float(peak)
        before, here, after = self.gain[k - 1 : k + 2]
        bend = before - 2 * here + after
        step = self.order[k] - self.order[k - 1]
        return float(peak + step * (before - after) / (2 * bend)) if bend < 0 else float(peak)

    def chance_level(self, order: float) -> float:
        """Mean gain of chance about an order, from a median, which lines do not move: chance has an exponential
        distribution."""
        near = np.abs(self.order - order) <= neighbourhood(order, self.period)
        return float(np.median(self.gain[near])) / float(np.log(2))


def neighbourhood(order: float, period: float) -> float:
    """Half width of the orders about one whose gains are compared, 8 to 40 periods (`AngleSpectrum.period`): noise is
    even over them, but broad structure over the angle falls with the order."""
    near, wide = 2 * LEAST_PERIODS, 10 * LEAST_PERIODS
    return period * float(np.clip(order / period / 2, near, wide))


def lines(
    angle: Array, left: Array, base: Array, projection: Array, span: tuple[float, float], among: int
) -> dict[float, float]:
    """Orders of waves over the angle that stand out of a residual, and their gains; as for `LombScargle.of`.

    among   number of orders that are looked at in all: a line exceeds the largest of so many chances
    The level of chance is measured without the line, which may be broad. A line needs LEAST_PERIODS of its periods, in
    any pieces.
    """
    found: dict[float, float] = {}
    period = rayleigh_period(angle)
    low, high = (end + side * neighbourhood(end, period) for end, side in zip(span, (-1, 1), strict=True))
    periodogram = LombScargle.of(angle, base, projection, (low, high))
    least = float(np.log(among)) + CLEARLY_LIKELIER
    spectrum = periodogram.spectrum(left)
    for order in spectrum.peaks(span):
        half_periods = np.floor(order * angle / np.pi).astype(np.intp)
        if np.count_nonzero(np.bincount(half_periods - half_periods.min())) < 2 * LEAST_PERIODS:
            continue
        beside = left - fitted_wave(order * angle, left, base, projection)
        reach = neighbourhood(order, period)
        rest = periodogram.about(order - reach, order + reach).spectrum(beside)
        if spectrum.at(order) > least * rest.chance_level(order):
            found[spectrum.refined(order)] = spectrum.at(order)
    return found


def fitted_wave(phase: Array, left: Array, base: Array, projection: Array) -> Array:
    """(M,) part of a residual that a wave explains, with the model's columns fitted again beside it; phase (M,) rad,
    the rest as for `LombScargle.of`."""
    wave = np.array([np.cos(phase), np.sin(phase)])
    cross = wave @ base.T
    own = wave @ wave.T - cross @ projection @ cross.T
    amount = np.linalg.lstsq(own, wave @ left, rcond=None)[0]
    taken: Array = amount @ wave - (amount @ cross) @ projection @ base
    return taken


def rayleigh_period(angle: Array) -> float:
    """Order of one period over the whole range of an angle (M,), rad."""
    return 2 * np.pi / max(float(np.ptp(angle)) if len(angle) else 0.0, 1e-300)


@dataclass(frozen=True)
class LombScargle:
    """Least-squares periodogram over an angle, beside the columns of a model, for any number of residuals.

    grid    None where the angle's range is too short for a wave
    index   (K,) of their orders among the grid's
    own     (3, K) squares of what the columns leave of cosine and sine, and between these their product
    count   number of samples
    """

    grid: _NonuniformFFT | None
    index: NDArray[np.intp]
    own: Array
    period: float
    count: int

    @classmethod
    def of(cls, angle: Array, base: Array, projection: Array, span: tuple[float, float]) -> LombScargle:
        """angle (M,) rad; base (B, M) the model's columns and projection (B, B) the inverse of their Gram matrix, over
        these samples and others where no wave is looked for; span: lowest and highest order, periods per 2 pi.

        The angle's grid is 1.4 rad of the highest order's phase: the amplitude of an alias is then below a hundredth,
        (1.4 / (2 pi - 1.4))^4. A range of more than 250,000 grid steps holds lower orders only.
        """
        fine, most = 1.4, 250_000
        extent, period = float(np.ptp(angle)) if len(angle) else 0.0, rayleigh_period(angle)
        low, high = max(span[0], LEAST_PERIODS * period), min(span[1], most * fine / max(extent, 1e-300))
        if not low < high or not len(angle):
            return cls(None, np.empty(0, dtype=np.intp), np.empty((3, 0)), 1.0, 0)
        grid = _NonuniformFFT.of(angle, fine / high)
        index = np.arange(int(np.ceil(low / grid.step)), int(high / grid.step) + 1)
        count = len(angle)
        # cos² = (1 + cos 2x) / 2: sums of squares are those of a wave of twice the order.
        window = grid.doubled().sums(np.ones(count), index)
        own: Array = np.array([count + window.real, -window.imag, count - window.real]) / 2
        value, vector = np.linalg.eigh(projection)
        # The projection as a square: what the columns explain of a wave stays positive. One column at a time, as
        # transforms of all fill the memory.
        for column in (vector * np.sqrt(np.maximum(value, 0.0))).T:
            cross = grid.sums(column @ base, index)
            own -= [cross.real**2, -cross.real * cross.imag, cross.imag**2]
        return cls(grid, index, own, period, count)

    def about(self, low: float, high: float) -> LombScargle:
        """Those between two orders."""
        if self.grid is None:
            return self
        order = self.index * self.grid.step
        part = slice(int(np.searchsorted(order, low)), int(np.searchsorted(order, high, side="right")))
        return replace(self, index=self.index[part], own=self.own[:, part])

    def spectrum(self, left: Array) -> AngleSpectrum:
        """By how much they lower the squared error of a residual (M,); 0 where the model's columns make the wave
        themselves: of half a per cent that they leave their rounding decides."""
        if self.grid is None:
            return AngleSpectrum(np.empty(0), np.empty(0), 1.0)
        moment = self.grid.sums(left, self.index)
        cosine, sine = moment.real, -moment.imag
        determinant = self.own[0] * self.own[2] - self.own[1] ** 2
        solved = self.own[2] * cosine**2 - 2 * self.own[1] * cosine * sine + self.own[0] * sine**2
        seen = (determinant > (0.005 * self.count) ** 2) & (self.own[0] > 0)
        gain = np.where(seen, solved / np.where(seen, determinant, 1.0), 0.0)
        return AngleSpectrum(np.asarray(self.index * self.grid.step, dtype=np.float64), gain, self.period)


@dataclass(frozen=True)
class _NonuniformFFT:
    """An even grid of the angle: place (M,) of the samples in its steps of `spacing`, rad; an FFT over it has `size`
    places, four for each that the samples span: a line between two orders loses a twentieth of its power."""

    place: Array
    spacing: float
    size: int

    @classmethod
    def of(cls, angle: Array, spacing: float) -> _NonuniformFFT:
        place = (angle - angle.min()) / spacing
        return cls(place, spacing, next_fast_len(4 * (int(place.max()) + 4), real=True))

    @property
    def step(self) -> float:
        """From one order to the next."""
        return 2 * np.pi / (self.size * self.spacing)

    def doubled(self) -> _NonuniformFFT:
        """A grid for twice the orders, of half the spacing; its FFT has as many places, most of them empty."""
        return _NonuniformFFT(2 * self.place, self.spacing / 2, self.size)

    @cached_property
    def _shares(self) -> csc_array:
        """(size, M) share of every sample in each of its four neighbours, by a cubic B-spline."""
        at = self.place.astype(np.intp)
        x = self.place - at
        y = 1 - x
        shares = np.stack([y**3, 4 - 3 * x**2 * (1 + y), 4 - 3 * y**2 * (1 + x), x**3], axis=1) / 6
        places = at[:, None] + np.arange(4)
        return csc_array((shares.ravel(), places.ravel(), 4 * np.arange(len(at) + 1)), (self.size, len(at)))

    def sums(self, x: Array, index: NDArray[np.intp]) -> NDArray[np.complex128]:
        """(K,) sums of x (M,) e^(-i order angle) at orders of the grid, the angle from its least."""
        found: NDArray[np.complex128] = rfft(self._shares @ x)[index] * self._unblurred[index]
        return found

    @cached_property
    def _unblurred(self) -> NDArray[np.complex128]:
        """(size // 2 + 1,) by which a transform is multiplied: a spline stands one step behind its first share, and its
        spectrum is the fourth power of a sinc."""
        phase = np.arange(self.size // 2 + 1) * (2 * np.pi / self.size)
        return np.asarray(np.exp(1j * phase) / np.sinc(phase / (2 * np.pi)) ** 4)
