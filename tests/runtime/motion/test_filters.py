"""The filters against sines, polynomials and each other; convolution, spectra and windows against SciPy's."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from runtime.model.loader import Library
from runtime.motion.filters import convolved, differentiator, kaiser_window, low_pass, welch, windowed_sinc

RATE = 1000.0


@pytest.mark.parametrize("cutoff", [10.0, 45.0, 150.0])
@pytest.mark.parametrize("part", [0.02, 0.3, 1.0])
def test_derivatives_of_a_sine_in_the_band(cutoff: float, part: float) -> None:
    """The stop-band attenuation of 70 dB bounds the ripple; the derivatives share it."""
    derive = differentiator(cutoff, RATE)
    t = np.arange(8000) / RATE
    omega = 2 * np.pi * part * cutoff
    inner = slice(derive.half, len(t) - derive.half)
    q, qd, qdd = derive(3 + np.sin(omega * t))
    assert np.abs(q - 3 - np.sin(omega * t[inner])).max() < 1e-3
    assert np.abs(qd / omega - np.cos(omega * t[inner])).max() < 1e-3
    assert np.abs(qdd / omega**2 + np.sin(omega * t[inner])).max() < 1e-3


@given(st.lists(st.floats(-5, 5), min_size=3, max_size=3), st.floats(5, 150))
@settings(max_examples=25, deadline=None)
def test_parabolas_are_exact(c: list[float], cutoff: float) -> None:
    """A droop at DC would be read as an offset or a spring."""
    derive = differentiator(cutoff, RATE)
    t = np.arange(2 * derive.half + 50) / RATE
    inner = slice(derive.half, len(t) - derive.half)
    q, qd, qdd = derive(c[0] + c[1] * t + c[2] * t**2)
    assert np.allclose(qd, (c[1] + 2 * c[2] * t)[inner], atol=1e-7 * (1 + np.abs(qd).max()))
    assert np.allclose(qdd, 2 * c[2], atol=1e-5)
    assert np.allclose(q, (c[0] + c[1] * t + c[2] * t**2)[inner], atol=1e-4 * (1 + np.abs(q).max()))


@pytest.mark.parametrize("cutoff", [8.0, 60.0, 150.0, 480.0])
def test_rows_sit_on_their_centres(cutoff: float, library: Library) -> None:
    """A slow ramp comes out as its values at the centres, delayed by what was asked for."""
    band = low_pass(cutoff, RATE, library)
    t = np.arange(6000) / RATE
    rows = band(t[None])
    assert rows.shape == (1, len(band.centres(len(t))))
    assert np.allclose(rows[0], t[band.centres(len(t))], atol=1e-9)
    assert np.allclose(band(t, 0.7), t[band.centres(len(t))] - 0.7 / RATE, atol=1e-9)


def test_linear_relations_survive(library: Library) -> None:
    """Filtering torque and regressors alike keeps a linear model exact."""
    rng = np.random.default_rng(0)
    x = rng.standard_normal((3, 5000))
    band = low_pass(40.0, RATE, library)
    assert np.allclose(band(np.array([2.0, -1.0, 0.5]) @ x), np.array([2.0, -1.0, 0.5]) @ band(x))


def test_noise_above_the_band_is_stopped(library: Library) -> None:
    band = low_pass(40.0, RATE, library)
    t = np.arange(5000) / RATE
    assert np.abs(band(np.sin(2 * np.pi * 70.0 * t))).max() < 2e-3


@given(st.integers(0, 10_000), st.integers(1, 9), st.integers(1, 40), st.integers(0, 200))
@settings(max_examples=40, deadline=None)
def test_decimation_is_convolution_with_every_window(
    library: Library, seed: int, factor: int, taps: int, count: int
) -> None:
    rng = np.random.default_rng(seed)
    kernel, x = rng.standard_normal(taps), rng.standard_normal((2, count))
    out = library.decimate(kernel, factor, x)
    windows = range(0, count - taps + 1, factor)
    assert out.shape == (2, len(windows))
    for k, first in enumerate(windows):
        assert np.allclose(out[:, k], x[:, first : first + taps] @ kernel, atol=1e-12)


@given(st.integers(0, 10_000), st.integers(1, 3), st.integers(1, 60), st.integers(0, 3000))
@settings(max_examples=60, deadline=None)
def test_convolution(seed: int, rows: int, taps: int, more: int) -> None:
    rng = np.random.default_rng(seed)
    x, kernels = rng.standard_normal(taps + more), rng.standard_normal((rows, taps))
    expected = [np.convolve(x, kernel, "valid") for kernel in kernels]
    assert np.allclose(convolved(x, kernels), expected, atol=1e-10)


@given(st.integers(0, 10_000), st.integers(8, 900), st.integers(4, 300), st.sampled_from(["mean", "median"]))
@settings(max_examples=60, deadline=None)
def test_spectral_density(seed: int, count: int, segment: int, average: Literal["mean", "median"]) -> None:
    x = np.random.default_rng(seed).standard_normal(count)
    frequency, density = welch(x, 250.0, segment, average)
    expected = signal.welch(x, 250.0, nperseg=min(segment, count), average=average)
    assert np.allclose(frequency, expected[0])
    assert np.allclose(density, expected[1], rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize(("attenuation", "width"), [(60.0, 0.01), (80.0, 0.2)])
def test_windows(attenuation: float, width: float) -> None:
    taps, beta = kaiser_window(attenuation, width)
    assert (taps, beta) == pytest.approx(signal.kaiserord(attenuation, width))
    assert np.allclose(windowed_sinc(taps, 0.3, beta), signal.firwin(taps, 0.3, window=("kaiser", beta)), atol=1e-14)
