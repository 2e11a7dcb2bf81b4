"""What a joint's dry friction holds while it rests or turns leaks into no equation; what is left of rows is fitted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.estimation.identify import identify_motion, prepared
from runtime.model.loader import Library, Model
from runtime.model.terms import Term, structure
from runtime.motion import turns
from runtime.motion.filters import low_pass
from runtime.motion.spectrum import strongest_line
from runtime.recordings.recording import Recording
from tests.runtime.conftest import recorded

DT = 1e-3


def test_samples_at_rest_and_at_a_turn_count_nothing() -> None:
    """And those half a second away from it wholly, with a passage between that never falls back."""
    t = np.arange(4000) * DT
    qd = np.where(t < 2.0, np.sin(2 * np.pi * t / 2), 0.0)
    known = turns.known(qd, DT, 50.0, 0.01)
    assert np.all(known[t >= 2.0] == 0.0)
    assert np.all(known[np.abs(t - 1.0) < 0.004] == 0.0)
    assert np.all(known[np.abs(t - 0.5) < 0.4] == 1.0)
    assert np.all(np.diff(known[(t > 0.5) & (t < 1.0)]) <= 1e-12)


def test_no_torque_of_a_joint_that_rests_reaches_a_row(drive: Model) -> None:
    """A hundred newton metres more while it turns change no row that counts, by more than rounding."""
    recording = recorded(None, 3)
    motion = prepared(drive, [recording])
    (piece,) = motion.pieces
    use = motion.moving(0)
    wild = replace(piece, tau=piece.tau + np.where(piece.known == 0.0, 100.0, 0.0))
    np.testing.assert_allclose(wild.torque(0, 0.0)[use], piece.torque(0, 0.0)[use], atol=1e-9)
    assert np.abs(wild.low_pass(wild.tau[0]) - piece.low_pass(piece.tau[0]))[use].max() > 0.1
    # Where nothing is left out, a row is what the filter makes of it.
    clear = motion.clear(0)
    assert 0.5 < clear.mean() < use.mean() < 1.0
    np.testing.assert_allclose(piece.torque(0, 0.4)[clear], piece.low_pass(piece.tau[0], 0.4)[clear], atol=0.2)


def test_a_weighted_row_is_as_late_as_any_other(library: Library) -> None:
    """What is weighted out is where the torque acts, not where it was recorded."""
    band, n = low_pass(40.0, 1 / DT, library), np.arange(3000)
    known = 1 - np.exp(-(((n - 1500) / 12.0) ** 2))
    x = np.sin(2 * np.pi * 7.0 * n * DT)
    late = np.sin(2 * np.pi * 7.0 * (n - 0.6) * DT)
    delayed = band(x * np.interp(n + 0.6, n, known), 0.6)
    np.testing.assert_allclose(delayed, band(late * known), atol=1e-3)


def test_a_peak_of_friction_at_creep_is_found_as_high_as_it_is(drive: Model) -> None:
    """Beside it, the joint sticks: what leaked from there took a twentieth of it away."""
    found = [_creep(drive, seed) for seed in (1, 2, 3)]
    assert np.mean(found) == pytest.approx(0.6, rel=0.04)


def _creep(drive: Model, seed: int) -> float:
    term = Term("stribeck", 1)
    motion = prepared(drive, [recorded("stribeck", seed)])
    fit = identify_motion(drive, motion, {**structure(drive), term: {}}).fit
    return fit.prediction.values[term]["torque"]


def test_a_spring_without_stiffness_has_a_torque(drive: Model) -> None:
    """Its rest is nowhere: a quotient of nothing, which a transmission beside it would have to carry."""
    t = np.arange(8000) * DT
    q = 0.5 * np.sin(2 * np.pi * 0.5 * t)
    tau = 0.2365 * np.gradient(np.gradient(q, DT), DT) + 0.5 * np.sign(np.cos(2 * np.pi * 0.5 * t)) - 0.4 * q
    whole = np.zeros(len(t), dtype=np.int64)
    recording = Recording(Path("run.csv"), t, whole, q[None], tau[None], ("revolute",), (slice(0, len(t)),), (None,))
    spring = Term("linear_spring", 1)
    fit = identify_motion(drive, prepared(drive, [recording]), {**structure(drive), spring: {}}).fit
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
    line = strongest_line(noise + np.where(noise != 0, 2 * np.sin(np.arange(400)), 0.0), 20.0)
    assert line is not None
    assert line.frequency == pytest.approx(20.0 / (2 * np.pi), abs=0.06)
