"""Measured rates: used where they are better, and refused where they are differences, filtered, or something else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter, savgol_filter

from runtime.arrays import Array
from runtime.identification.fit import Fit
from runtime.identification.identify import identify
from runtime.model.loader import Model
from runtime.recordings.recording import Recording
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import simulate
from tests.kept import kept

DT = 1e-3  # s
ENCODER, TACHOMETER = 3e-4, 2e-3  # rad and rad/s of noise


@pytest.fixture(scope="module")
def noisy(drive: Model) -> tuple[Recording, Array]:
    """A recording with a poor encoder, and its true rate."""
    run = simulate(drive, settings=SimulationSettings(seconds=20.0, seed=3))[0]
    true = savgol_filter(run.q[0], 31, 4, deriv=1, delta=DT)
    errors = ENCODER * np.random.default_rng(1).standard_normal(run.q.shape)
    return replace(run, q=run.q + errors), true


def tachometer(_: Array, rate: Array) -> Array:
    return rate + TACHOMETER * np.random.default_rng(2).standard_normal(len(rate))


def low_passed(_: Array, rate: Array) -> Array:
    """At 20 Hz: 8 ms late."""
    part = 1 - np.exp(-2 * np.pi * 20 * DT)
    return np.asarray(lfilter([part], [1, part - 1], tachometer(_, rate)))


def fitted(drive: Model, noisy: tuple[Recording, Array], qd: Array) -> Fit:
    return kept(identify, drive, [replace(noisy[0], qd=qd[None])])


@pytest.mark.parametrize("step", [0.0, 0.01])
def test_a_quiet_rate_is_used_and_widens_the_band(drive: Model, noisy: tuple[Recording, Array], step: float) -> None:
    """Also one that is quantised: its steps are noise like another."""
    rate = tachometer(noisy[0].q[0], noisy[1])
    found = fitted(drive, noisy, step * np.round(rate / step) if step else rate)
    plain = kept(identify, drive, [noisy[0]])
    used, without = found.inference.lumps[0], plain.inference.lumps[0]
    assert found.motion.band.rates[0] is not None
    assert found.motion.band.rates[0].used
    assert found.motion.band.cutoff > 1.3 * plain.motion.band.cutoff
    assert used.value == pytest.approx(0.2365, rel=2e-3)
    assert used.interval is not None
    assert without.interval is not None
    assert np.ptp(used.interval) < 0.9 * np.ptp(without.interval)


@pytest.mark.parametrize(
    ("measured", "use"),
    [
        (lambda q, _: np.gradient(q, DT), "no quieter"),
        (lambda q, _: np.append(0.0, np.diff(q)) / DT, "no quieter"),
        (lambda q, _: savgol_filter(q, 41, 3, deriv=1, delta=DT), "difference"),
        (low_passed, "filtered"),
        (lambda q, v: 9.55 * tachometer(q, v), "other unit"),
        (lambda q, v: np.degrees(tachometer(q, v)), "other unit"),
        (lambda q, v: -tachometer(q, v), "other unit"),
        (lambda _, v: np.zeros_like(v), "other unit"),
        (lambda _, v: np.random.default_rng(3).standard_normal(len(v)), "unrelated"),
    ],
    ids=["difference", "backward", "smoothed", "filtered", "rpm", "degrees", "turned", "zero", "other"],
)
def test_any_other_is_left_alone(
    drive: Model, noisy: tuple[Recording, Array], measured: Callable[[Array, Array], Array], use: str
) -> None:
    found = fitted(drive, noisy, measured(noisy[0].q[0], noisy[1]))
    plain = kept(identify, drive, [noisy[0]])
    rate = found.motion.band.rates[0]
    assert rate is not None
    assert rate.use == use
    assert found.inference.lumps[0] == plain.inference.lumps[0]


def test_a_rate_that_is_not_in_all_recordings_is_not_used(drive: Model, noisy: tuple[Recording, Array]) -> None:
    with_rate = replace(noisy[0], qd=noisy[1][None])
    without = replace(noisy[0], tau=noisy[0].tau + 1e-6)
    assert kept(identify, drive, [with_rate, without]).motion.band.rates == (None,)
