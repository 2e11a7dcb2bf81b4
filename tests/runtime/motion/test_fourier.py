"""Convolution, spectra and windows against SciPy's."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from runtime.motion.filters import convolved, kaiser_window, welch, windowed_sinc


@given(st.integers(0, 10_000), st.integers(1, 3), st.integers(1, 60), st.integers(0, 3000))
@settings(max_examples=60, deadline=None)
def test_convolution(seed: int, rows: int, taps: int, more: int) -> None:
    rng = np.random.default_rng(seed)
    x, kernels = rng.standard_normal(taps + more), rng.standard_normal((rows, taps))
    expected = [np.convolve(x, kernel, "valid") for kernel in kernels]
    assert np.allclose(convolved(x, kernels), expected, atol=1e-10)


@given(st.integers(0, 10_000), st.integers(8, 900), st.integers(4, 300), st.sampled_from(["mean", "median"]))
@settings(max_examples=60, deadline=None)
def test_density(seed: int, count: int, segment: int, average: Literal["mean", "median"]) -> None:
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
