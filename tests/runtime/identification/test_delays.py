"""A torque that is recorded ahead of its motion: found in time, whatever the sampling, and said as a whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.arrays import Array
from runtime.diagnosis.stages import diagnose
from runtime.fit_warnings import warnings
from runtime.identification.compare import compare
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import fit_document, identify, prepared
from runtime.model.loader import Model
from runtime.model.terms import Term, structure
from runtime.recordings.recording import Recording
from runtime.report.diagnosed import document as diagnosed
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import Hidden, simulate
from tests.kept import kept

RATE = 200.0
HOLD = 0.5 / RATE  # s
DELAY = Term("torque_delay", 1)


def chirped(delay: float, seed: int = 0) -> Recording:
    """30 s of a rigid drive at 200 Hz, a chirp from 0.2 to 8 Hz whose torque is commanded `delay` s before it acts.

    Everything in closed form, at the instants at which it is; half a sample of a hold comes on top.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(6000) / RATE

    def turned(s: Array, along: Array) -> Array:
        """Position (along = 0) at the instants s + along."""
        s = s + along
        f = 0.2 + 7.8 * s / 30
        phase = 2 * np.pi * (0.2 * s + 0.13 * s**2)
        return 0.6 / (1 + np.maximum(f, 0.0) ** 1.2) * np.sin(phase) + 0.25 * np.sin(0.8 * s)

    h, at = 1e-4 * np.ones_like(t), t + delay + HOLD
    before, here, after = turned(at, -h), turned(at, 0 * h), turned(at, h)
    qd, qdd = (after - before) / 2e-4, (after - 2 * here + before) / 1e-8
    tau = 0.2365 * qdd + 0.5 * np.tanh(qd / 0.02) + 0.5 * qd + 0.03 * rng.standard_normal(len(t))
    q = turned(t, 0 * h) + 2e-5 * rng.standard_normal(len(t))
    whole = np.zeros(len(t), dtype=np.int64)
    return Recording(Path("run.csv"), t, whole, q[None], tau[None], ("revolute",), (slice(0, len(t)),), (None,))


@pytest.mark.parametrize("samples", [-2, 1, 2, 3, 4, 6])
def test_a_delay_of_samples_is_found_in_time(drive: Model, samples: int) -> None:
    """To a thirtieth of a sample or 1 %, where first order is wrong by a third; the total has the hold in it."""
    delay = samples / RATE
    motion = prepared(drive, [chirped(delay)])
    plain = fit_motion(drive, motion, structure(drive))
    found = fit_motion(drive, motion, {**structure(drive), DELAY: {}}, start=plain)
    estimate = found.inference.values[DELAY]["time"]
    assert estimate.value == pytest.approx(delay, rel=0.01, abs=0.03 / RATE)
    (total,) = fit_document(found).to_json()["delay"]
    assert total["assumed"] == pytest.approx(HOLD, rel=1e-3)
    assert total["estimated"] == estimate.value
    assert total["value"] == pytest.approx(delay + HOLD, abs=0.05 / RATE)
    low, high = total["interval"]
    assert low < total["value"] < high
    assert high - low < 0.1 / RATE
    errors = [float(np.linalg.norm(f.residual[0])) for f in (plain, found)]
    assert errors[1] < 0.25 * errors[0]


def test_a_delay_is_named_first(drive: Model) -> None:
    """At 15 ms and 8 Hz no first order explains it; a cable or gravity was nearer."""
    recording = chirped(0.015)
    said = warnings(kept(compare, drive, [recording]).fit)
    assert any("0.015 s ahead of its motion" in warning for warning in said)
    found = kept(diagnose, drive, [recording])
    assert found.findings[0].term == DELAY
    assert diagnosed(found).to_json()["delay"][0]["value"] == pytest.approx(0.0175, abs=2e-4)


def test_a_hold_is_no_delay(drive: Model) -> None:
    """Half a sample is estimated, not assumed, and no column changes."""
    found = kept(identify, drive, [chirped(0.0)])
    assert found.ahead is None
    (total,) = fit_document(found).to_json()["delay"]
    assert total["assumed"] == 0.0
    assert total["value"] == pytest.approx(HOLD, abs=0.05 / RATE)


def test_noise_of_the_torque_shortens_no_delay(drive: Model) -> None:
    """A time between two of the recorded torques would average their noise."""
    delay, held = 2 / RATE, []
    for seed in range(3):
        clean, rng = chirped(delay, seed), np.random.default_rng(seed)
        motion = prepared(drive, [replace(clean, tau=clean.tau + 4.0 * rng.standard_normal(clean.tau.shape))])
        plain = fit_motion(drive, motion, structure(drive))
        found = fit_motion(drive, motion, {**structure(drive), DELAY: {}}, start=plain)
        estimate = found.inference.values[DELAY]["time"]
        assert estimate.value == pytest.approx(delay, rel=0.03)
        assert estimate.interval is not None
        held.append(estimate.interval[0] < delay < estimate.interval[1])
    assert all(held)


@pytest.mark.parametrize("time", [0.008, -0.004])
def test_a_delay_that_is_simulated_is_one(time: float, drive: Model) -> None:
    """To first order, 8 ms at 15 Hz would be a torque larger by a quarter."""
    t = np.arange(4000) / 1000
    path = 0.05 * np.sin(2 * np.pi * 15 * t)[None] + 0.3 * np.sin(2 * np.pi * 0.7 * t)[None]
    quiet = SimulationSettings(noise=0.0)
    plain, _ = simulate(drive, settings=quiet, motion=path)
    late, _ = simulate(drive, [Hidden(DELAY, {"time": time})], quiet, path)
    inner = slice(20, -20)
    np.testing.assert_allclose(late.tau[0][inner], np.roll(plain.tau[0], -round(1000 * time))[inner], rtol=0, atol=1e-9)


def test_nothing_is_named_beside_a_delay_that_is_simulated(drive: Model) -> None:
    made, _ = simulate(drive, [Hidden(DELAY, {"time": 0.008})], SimulationSettings(seconds=30.0, noise=0.02))
    found = kept(diagnose, drive, [made])
    assert [f.term for f in found.findings] == [DELAY]
    assert diagnosed(found).to_json()["delay"][0]["value"] == pytest.approx(0.008, abs=1e-4)
