"""Convolution, spectra and window design with NumPy and FFTs alone.

SciPy has them in scipy.signal, which brings all of its statistics and takes longer to load than most recordings take to
be identified; tests hold these to be equal.
"""

from __future__ import annotations

from math import ceil, pi
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from runtime.motion.settings import BLOCK_OF_KERNEL, KAISER_BETA, KAISER_TAPS

Array = NDArray[np.float64]


def convolved(x: Array, kernels: Array) -> Array:
    """(R, N − T + 1) x (N,) with kernels (R, T), N >= T: what whole kernels cover.

    Source: overlap and save, Oppenheim & Schafer, Discrete-Time Signal Processing; spectra of x are computed once.
    """
    taps, count = kernels.shape[1], len(x) - kernels.shape[1] + 1
    size = next_fast_len(min(BLOCK_OF_KERNEL * taps, len(x)), real=True)
    hop = size - taps + 1
    blocks = ceil(count / hop)
    padded = np.pad(x, (0, blocks * hop + taps - 1 - len(x)))
    spectra = rfft(sliding_window_view(padded, size)[::hop], axis=1)
    out = np.empty((len(kernels), count))
    for row, response in zip(out, rfft(kernels, size, axis=1), strict=True):
        row[:] = irfft(spectra * response, size, axis=1)[:, taps - 1 :].ravel()[:count]
    return out


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
    """Number of taps and shape of a Kaiser window; attenuation in dB, above 50; width of the transition over half the
    sampling rate. Source: Kaiser 1974."""
    (least, a_tap), (flat, taper) = KAISER_TAPS, KAISER_BETA
    return ceil((attenuation - least) / (a_tap * pi * width) + 1), taper * (attenuation - flat)


def windowed_sinc(taps: int, cutoff: float, beta: float) -> Array:
    """(taps,) low-pass to `cutoff`, over half the sampling rate, one at rest, through a Kaiser window."""
    kernel = np.sinc(cutoff * (np.arange(taps) - (taps - 1) / 2)) * np.kaiser(taps, beta)
    return np.asarray(kernel / kernel.sum())
