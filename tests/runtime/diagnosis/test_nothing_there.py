"""What is left where nothing is there: springs without stiffness, lines that chance makes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import maximum_filter1d

from runtime.diagnosis.stages import diagnose
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import prepared, without_untold
from runtime.model.loader import Model
from runtime.model.terms import Term, structure
from runtime.motion.filters import low_pass
from runtime.motion.spectra import strongest_line
from runtime.recordings.recording import Recording
from runtime.simulation import simulate
from runtime.simulation.options import SimulationSettings
from tests import bank
from tests.judge.cases import Setting, cases, make
from tests.judge.line import logged, opened
from tests.kept import kept

DT = 1e-3


def test_a_spring_without_stiffness_has_a_torque(drive: Model) -> None:
    """Its rest is nowhere: a quotient of nothing, which a transmission beside it would have to carry."""
    t = np.arange(8000) * DT
    q = 0.5 * np.sin(2 * np.pi * 0.5 * t)
    tau = 0.2365 * np.gradient(np.gradient(q, DT), DT) + 0.5 * np.sign(np.cos(2 * np.pi * 0.5 * t)) - 0.4 * q
    whole = np.zeros(len(t), dtype=np.int64)
    recording = Recording(Path("run.csv"), t, whole, q[None], tau[None], ("revolute",), (slice(0, len(t)),), (None,))
    spring = Term("linear_spring", 1)
    fit = fit_motion(drive, prepared(drive, [recording]), {**structure(drive), spring: {}})
    assert all(np.isfinite(x) for x in fit.prediction.values[spring].values())


@pytest.mark.parametrize("rows", [250, 470])
def test_the_largest_chance_of_a_short_band_is_no_line(drive: Model, rows: int) -> None:
    """Noise that is white up to a cut-off fills four fifths of the spectrum of its rows."""
    rng, found, band = np.random.default_rng(0), 0, low_pass(20.0, 1000.0, drive.library)
    for _ in range(200):
        found += strongest_line(band(rng.standard_normal(rows * band.factor + 2 * band.half)), 50.0) is not None
    assert found < 8


def test_the_largest_chance_of_few_rows_is_no_line() -> None:
    """Of 120 rows among 400 the strongest frequency holds a tenth of the power; a line is found there nevertheless."""
    rng, found = np.random.default_rng(0), 0
    for _ in range(200):
        noise = np.where(rng.random(400) < 0.3, rng.standard_normal(400), 0.0)
        found += strongest_line(noise, 20.0) is not None
    assert found < 8
    line = strongest_line(noise + np.where(noise != 0, 3 * np.sin(np.arange(400)), 0.0), 20.0)
    assert line is not None
    assert line.frequency == pytest.approx(20.0 / (2 * np.pi), abs=0.06)


@pytest.mark.parametrize("rows", [200, 460])
@pytest.mark.parametrize(("slow", "fast"), [(10.0, 0.0), (1.5, 12.0), (0.0, 1e4)])
def test_the_densest_part_of_coloured_noise_is_no_line(rows: int, slow: float, fast: float) -> None:
    """Slow pushes beside white noise, and an encoder's as an inertial torque, with the fourth power of the frequency;
    what is as strong as all noise together is found in each."""
    rng, found, lines, at = np.random.default_rng(0), 0, 0, np.fft.rfftfreq(4 * rows)
    density = (1 + slow / (1 + (at / 0.05) ** 2) + fast * (at / 0.4) ** 4) * (at < 0.4)
    for _ in range(100):
        noise = np.fft.irfft(np.fft.rfft(rng.standard_normal(4 * rows)) * np.sqrt(density))[:rows]
        found += strongest_line(noise, 20.0) is not None
        lines += strongest_line(noise / noise.std() + 1.4 * np.sin(0.9 * np.arange(rows)), 20.0) is not None
    assert found < 4
    assert lines > 90


def test_a_transmission_that_only_noise_would_drive_explains_nothing(drive: Model) -> None:
    """Less the encoder's noise the square of its column is negative: then any error would fall without end."""
    recording, _ = kept(simulate.simulate, drive, settings=SimulationSettings(seconds=1000.0))
    gains = kept(bank.gains, drive, [recording])
    assert len(gains) > 10
    assert max(gains.values()) < 0.03


def with_even_legs(seed: int) -> Recording:
    """A drive that lacks nothing, its positions rounded: sines, then legs forth and back, one at nearly a step a
    sample."""
    step, noise = 2 * np.pi / 200_000, 0.012
    t = np.arange(0.0, 40.0, DT)
    time = t % 20.0
    fast = np.where(time < 10.0, 1.6 * np.sin(2.9 * time) * np.sin(np.pi * time / 10) ** 2, 0.0)
    speed = np.array([0.5, 0.31, 1.012 * step / DT, 0.17])[np.clip((time - 10.0) // 2.5, 0, 3).astype(int)]
    leg = np.where(time >= 10.0, speed * np.sign(np.sin(2 * np.pi * (time - 10.0) / 2.5)), 0.0)
    smoothed = np.convolve(leg, np.hanning(400) / np.hanning(400).sum(), "same")
    qd = fast + smoothed
    q = cumulative_trapezoid(qd, dx=DT, initial=0.0)
    rubbing = 0.5 * np.tanh(qd / 1e-3) + 0.4 * qd + 0.03 * qd**3
    tau = 0.2365 * np.gradient(qd, DT) + rubbing + noise * np.random.default_rng(seed).standard_normal(len(t))
    whole = np.zeros(len(t), dtype=np.int64)
    read = np.round(q / step) * step
    return Recording(Path("run.csv"), t, whole, read[None], tau[None], ("revolute",), (slice(0, len(t)),), (None,))


def test_the_beat_of_an_encoders_steps_with_the_samples_is_no_physics(drive: Model) -> None:
    """Heard as bursts that nothing explains; the rows at which they beat do not count."""
    recording = with_even_legs(1)
    fit = fit_motion(drive, prepared(drive, [recording]), structure(drive))
    motion = without_untold(fit)
    (left_out,) = motion.left_out
    beating = np.abs(fit.motion.row_time(0) % 20.0 - 16.25) < 1.5
    assert left_out.sum() > 50
    assert beating[left_out].all()
    found = kept(diagnose, drive, [recording])
    assert (found.verdict, found.findings) == ("clean", ())


@pytest.mark.usefixtures("cache")
def test_what_folds_into_the_band_is_no_physics() -> None:
    """An arm that turns round within four samples: what of its torque is faster than they tell looked like a soft
    transmission. What is left out is a part of the turns."""
    (case,) = cases(["clean_hz100"], [4], [0.0], [418], Setting(excitation="brief"))
    made = logged(make(case))
    found = diagnose(opened(made.model).compiled.model(), [made.recording])
    assert (found.verdict, found.findings) == ("clean", ())
    motion = found.last.fit.motion
    rows, acceleration = motion.left_out[0], np.abs(motion.rows("qdd", 0)[0])
    assert 0 < rows.mean() < 0.2
    near = maximum_filter1d(acceleration, round(0.4 * motion.row_rate(0)))
    assert np.mean(near[rows] > np.quantile(acceleration, 0.95)) > 0.9
