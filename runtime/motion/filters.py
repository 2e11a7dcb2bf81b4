"""Zero-phase FIR filters, spectra and convolution with NumPy and FFTs alone.

Positions are differentiated, and model and torque compared in a band: every regressor and the torque pass the same
linear-phase low-pass and decimation, so that a linear model holds between filtered quantities as between raw ones.
scipy.signal takes longer to load than most recordings take to be identified; tests hold these functions equal to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, pi
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from runtime.arrays import Array
from runtime.model.loader import Library
from runtime.motion.settings import MOST_DELAY, ROWS_OVER_CUTOFF, SMOOTHING_OVER_CUTOFF


def convolved(x: Array, kernels: Array) -> Array:
    """(R, N − T + 1) x (N,) convolved with kernels (R, T), N >= T, where a whole kernel fits.

    Source: overlap and save, Oppenheim & Schafer, Discrete-Time Signal Processing; spectra of x are computed once.
    """
    taps, count = kernels.shape[1], len(x) - kernels.shape[1] + 1
    # Blocks of eight kernels cost least.
    block = 8 * taps
    size = next_fast_len(min(block, len(x)), real=True)
    hop = size - taps + 1
    blocks = ceil(count / hop)
    padded = np.pad(x, (0, blocks * hop + taps - 1 - len(x)))
    spectra = rfft(sliding_window_view(padded, size)[::hop], axis=1)
    out = np.empty((len(kernels), count))
    for row, response in zip(out, rfft(kernels, size, axis=1), strict=True):
        row[:] = irfft(spectra * response, size, axis=1)[:, taps - 1 :].ravel()[:count]
    return out


def moving_mean(x: Array, width: int) -> Array:
    """(N − width + 1,) means of every `width` consecutive samples of x (N,)."""
    total = np.concatenate([[0.0], np.cumsum(x)])
    return (total[width:] - total[:-width]) / width


def welch(x: Array, rate: float, segment: int, average: Literal["mean", "median"] = "mean") -> tuple[Array, Array]:
    """Frequencies (F,) Hz and one-sided density (F,) of x (N,), from Hann windows of `segment` samples that overlap by
    half, each without its mean.

    Source: Welch 1967; the bias of the median, Allen et al. 2012, "FINDCHIRP", appendix B.
    """
    length = min(segment, len(x))
    window = 0.5 - 0.5 * np.cos(2 * pi * np.arange(length) / length)
    parts = sliding_window_view(x, length)[:: length - length // 2]
    power = np.abs(rfft((parts - parts.mean(axis=1, keepdims=True)) * window, axis=1)) ** 2
    power /= rate * (window @ window)
    # Negative frequencies fold onto the others, but not zero nor half the sampling rate.
    power[:, 1 : None if length % 2 else -1] *= 2
    if average == "mean":
        density = power.mean(axis=0)
    else:
        even = 2.0 * np.arange(1, (len(parts) - 1) // 2 + 1)
        density = np.median(power, axis=0) / (1 + np.sum(1 / (even + 1) - 1 / even))
    return np.fft.rfftfreq(length, 1 / rate).astype(np.float64), np.asarray(density)


def kaiser_window(attenuation: float, width: float) -> tuple[int, float]:
    """Number of taps and shape beta of a Kaiser window; attenuation in dB, above 50; width of the transition over half
    the sampling rate. Source: Kaiser 1974."""
    return ceil((attenuation - 7.95) / (2.285 * pi * width) + 1), 0.1102 * (attenuation - 8.7)


def windowed_sinc(taps: int, cutoff: float, beta: float) -> Array:
    """(taps,) low-pass of unit gain to `cutoff`, over half the sampling rate, by a Kaiser window."""
    kernel = np.sinc(cutoff * (np.arange(taps) - (taps - 1) / 2)) * np.kaiser(taps, beta)
    return np.asarray(kernel / kernel.sum())


@dataclass(frozen=True)
class Differentiator:
    """FIR kernels (2 half + 1,) that make position, rate and acceleration of sampled positions."""

    position: Array
    rate: Array
    acceleration: Array

    @property
    def half(self) -> int:
        """Number of samples that a kernel reaches to either side."""
        return len(self.position) // 2

    def fits(self, size: int) -> bool:
        """Whether two kernels fit into so many samples; fewer do not separate an inertia from other torques."""
        return size > 2 * (len(self.position) - 1)

    def __call__(self, x: Array) -> tuple[Array, Array, Array]:
        """x (N,) -> smoothed x, x', x'' (N − 2 half,) each, where a whole kernel fits."""
        kernels = np.array([self.position, self.rate, self.acceleration])
        position, rate, acceleration = convolved(x - x[0], kernels)
        return position + x[0], rate, acceleration

    def rows(self, x: Array) -> tuple[Array, Array, Array]:
        """x (n, N) -> x, x', x'' (n, N − 2 half) of every signal."""
        position, rate, acceleration = np.empty((3, len(x), x.shape[1] - 2 * self.half))
        for k, row in enumerate(x):
            position[k], rate[k], acceleration[k] = self(row)
        return position, rate, acceleration


def differentiator(cutoff: float, rate: float) -> Differentiator:
    """Kernels that are flat up to `cutoff` and stop at SMOOTHING_OVER_CUTOFF times it, Hz; `rate` of sampling, Hz.

    The derivatives are (jω)^k times the response of the smoothing. Their moments are then made exact: constants, ramps
    and parabolas pass unchanged, as a droop at zero frequency would look like an offset or a spring.

    Source: linear-phase differentiators by windowing, Oppenheim & Schafer, Discrete-Time Signal Processing; window and
    length, Kaiser 1974; moments as constraints, Savitzky & Golay 1964.
    """
    # The middle of the transition lies below 0.45 of the sampling rate, the stop-band below half of it.
    cutoff = min(cutoff, 0.45 * rate / (1 + SMOOTHING_OVER_CUTOFF) * 2)
    passband, stopband = cutoff, min(SMOOTHING_OVER_CUTOFF * cutoff, 0.499 * rate)
    # The second derivative raises noise at three cut-offs by (2 pi f)^2; 70 dB attenuate it again.
    taps, beta = kaiser_window(70, (stopband - passband) / (rate / 2))
    taps |= 1
    smoothing = windowed_sinc(taps, (passband + stopband) / rate, beta)
    pad, size = taps // 2, 8 * taps
    spectrum = np.fft.fft(smoothing, size)
    omega = 2 * np.pi * np.fft.fftfreq(size, 1 / rate)
    length = taps + 2 * pad
    kernels = [np.roll(np.fft.ifft(spectrum * (1j * omega) ** k).real, pad)[:length] for k in range(3)]
    t = (np.arange(length) - length // 2) / rate
    window = np.kaiser(length, beta)
    window /= window.sum()
    curved = window * t**2
    curved -= window * curved.sum()
    position, slope, curvature = kernels
    slope = (slope - slope[::-1]) / 2
    slope /= -(slope @ t)
    curvature = (curvature + curvature[::-1]) / 2
    curvature -= window * curvature.sum()
    curvature += curved * (2 - curvature @ t**2) / (curved @ t**2)
    return Differentiator(position / position.sum(), slope, curvature)


@dataclass(frozen=True)
class Smoother:
    """Zero-phase FIR low-pass at full rate, kernel (2 half + 1,); the ends are continued by odd reflection."""

    kernel: Array

    def __call__(self, x: Array) -> Array:
        """x (N,) -> (N,)."""
        return convolved(_odd_extended(x, len(self.kernel) // 2), self.kernel[None])[0]


def smoother(response: Array) -> Smoother:
    """The smoother with a response (F,) at even frequencies from 0 to half the sampling rate."""
    kernel = np.fft.fftshift(np.fft.irfft(response))[1:]
    return Smoother(kernel * np.hanning(len(kernel)))


@dataclass(frozen=True)
class LowPass:
    """Linear-phase low-pass to `cutoff` Hz with decimation by `factor`; kernel (2 half + 1,), Kaiser's beta."""

    cutoff: float
    rate: float
    factor: int
    half: int
    beta: float
    library: Library

    def __call__(self, x: Array, delay: float = 0.0) -> Array:
        """x (..., N) -> (..., M): in-band samples at centres(N), of x `delay` samples late (|delay| < MOST_DELAY)."""
        return self.library.decimate(self._taps(delay), self.factor, x)

    @property
    def kernel(self) -> Array:
        """(2 half + 1,) taps of the filter without delay."""
        return self._taps(0.0)

    def rows(self, samples: slice, within: int, size: int) -> slice:
        """Rows, of `size`, whose centres lie within so many samples of these."""
        first = -((self.half + within - samples.start) // self.factor)
        last = (samples.stop - 1 + within - self.half) // self.factor
        return slice(min(max(first, 0), size), min(max(last + 1, 0), size))

    def response(self, samples: slice, rows: slice) -> Array:
        """(rows, samples): weight of each sample in each row."""
        at = np.arange(samples.start, samples.stop) - self.factor * np.arange(rows.start, rows.stop)[:, None]
        inside = (at >= 0) & (at <= 2 * self.half)
        return np.where(inside, self.kernel[np.clip(at, 0, 2 * self.half)], 0.0)

    def _taps(self, delay: float) -> Array:
        return _delayed_taps(self.cutoff / self.rate, self.half, self.half + MOST_DELAY, self.beta, delay)

    def centres(self, size: int) -> NDArray[np.intp]:
        """(M,) indices of the samples at the centres of the rows."""
        return np.arange(self.half, size - self.half, self.factor)

    def narrowed(self, rows: Array, cutoff: float) -> Array:
        """In-band rows (..., M) low-passed to a lower cut-off, Hz; the ends as a `Smoother` continues them."""
        narrow = low_pass(cutoff, self.rate / self.factor, self.library)
        return replace(narrow, factor=1)(_odd_extended(rows, narrow.half))


@lru_cache(maxsize=32)
def _delayed_taps(cutoff: float, half: int, room: float, beta: float, delay: float) -> Array:
    """(2 half + 1,) taps, in the order of the samples, of a low-pass `delay` samples late; cutoff over the rate, room:
    half of the window."""
    n = np.arange(-half, half + 1) - delay
    window = np.i0(beta * np.sqrt(np.clip(1 - (n / room) ** 2, 0, None)))
    kernel = np.sinc(2 * cutoff * n) * window
    kernel /= kernel.sum()
    # Truncation moves the kernel's centre a little; a ramp must come out late by `delay` exactly.
    tilt = window * (n - (window @ n) / window.sum())
    return np.ascontiguousarray((kernel - tilt * (kernel @ n) / (tilt @ n))[::-1])


def _odd_extended(x: Array, by: int) -> Array:
    """x (..., N) -> (..., by + N + by), by odd reflection."""
    return np.pad(x, [(0, 0)] * (x.ndim - 1) + [(by, by)], "reflect", reflect_type="odd")


def low_pass(cutoff: float, rate: float, library: Library) -> LowPass:
    """Half power at `cutoff`, stop-band (60 dB) a quarter above it, decimated to just above twice that."""
    # With its transition the filter ends below half of the sampling rate.
    cutoff = min(cutoff, 0.39 * rate)
    taps, beta = kaiser_window(60, (ROWS_OVER_CUTOFF - 2) * cutoff / (rate / 2))
    factor = max(1, int(rate / (ROWS_OVER_CUTOFF * cutoff)))
    return LowPass(cutoff, rate, factor, half=taps // 2, beta=beta, library=library)
