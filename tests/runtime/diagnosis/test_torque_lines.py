"""Torque ripples of any order: found in the residual's spectrum over the motor's angle, each a finding of its own."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.diagnosis.stages import diagnose
from runtime.diagnosis.steps import Step, lines_above
from runtime.diagnosis.verdict import Diagnosis
from runtime.identification.identify import identify, prepared
from runtime.loop.improve import improve
from runtime.motion.spectra import LombScargle, lines
from runtime.report.diagnosed import document as diagnosed
from runtime.report.reasons import reason
from runtime.wording import per_turn
from runtime.workspace.source import Source
from tests.kept import kept
from tests.motors import GEARED, Motor, record, sines, steps
from tests.variants import slow

WAVES = ((72.0, 0.05, 0.5), (18.0, 0.02, 1.0), (144.0, 0.02, 2.0))


def source(folder: Path, motor: Motor, effects: tuple[str, ...] = ("coulomb", "viscous")) -> Source:
    path = folder / "motor.toml"
    path.write_text(motor.model(effects))
    return Source.read(path, None)


def found_waves(found: Diagnosis) -> list[tuple[float, float, float]]:
    """(order, amplitude, phase) of every finding, the highest amplitude first."""
    values = found.steps[-1].fit.inference.values
    waves = [tuple(values[f.term][name].value for name in ("order", "amplitude", "phase")) for f in found.findings]
    return sorted(waves, key=lambda wave: -wave[1])  # type: ignore[arg-type, return-value]


def assert_same(found: list[tuple[float, float, float]], hidden: tuple[tuple[float, float, float], ...]) -> None:
    assert len(found) == len(hidden)
    for order, amplitude, phase in hidden:
        nearest = min(found, key=lambda wave: abs(wave[0] - order))
        assert nearest[0] == pytest.approx(order, rel=2e-3)
        assert nearest[1] == pytest.approx(amplitude, rel=0.1)
        assert abs(math.remainder(nearest[2] - phase, 2 * math.pi)) < 0.2


def test_a_spectrum_over_an_uneven_angle_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(0, 20, 0.01)
    angle = 30 * np.sin(0.7 * t) + 8 * np.sin(2.9 * t)
    rate = np.gradient(angle, t)
    base = np.array([np.gradient(rate, t), rate, np.sign(rate), np.ones_like(t)])
    torque = 0.3 * np.cos(7.3 * angle + 1) + rng.normal(0, 0.2, len(t))
    projection = np.linalg.inv(base @ base.T)
    left = torque - (torque @ base.T) @ projection @ base
    spectrum = LombScargle.of(angle, base, projection, (0.0, 40.0)).spectrum(left)
    for k in range(0, len(spectrum.order), 97):
        phase = spectrum.order[k] * angle
        rows = np.vstack([base, np.cos(phase), np.sin(phase)])
        rest = torque - np.linalg.lstsq(rows.T, torque, rcond=None)[0] @ rows
        fall = left @ left - rest @ rest
        assert spectrum.gain[k] == pytest.approx(fall, rel=0.03, abs=1e-3 * float(spectrum.gain.max()))
    found = lines(angle, left, base, projection, (1.0, 40.0), 500)
    assert max(found, key=lambda order: found[order]) == pytest.approx(7.3, abs=spectrum.period / 2)


def test_noise_has_no_lines() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(0, 20, 0.01)
    angle, base = 40 * np.sin(0.4 * t), np.ones((1, len(t)))
    for _ in range(100):
        noise = rng.standard_normal(len(t))
        assert not lines(angle, noise - noise.mean(), base, np.array([[1 / len(t)]]), (1.0, 30.0), 400)


def test_ripples_of_high_order_are_found_each_by_itself(tmp_path: Path) -> None:
    arm, motor = source(tmp_path, Motor()), Motor()
    recording = kept(record, motor, steps((2.0, -3.0, 4.0, -2.5), 14.0), WAVES)
    found = kept(diagnose, arm.compiled.model(), [recording])
    assert found.verdict == "effect"
    assert {(f.term.effect, f.term.joint) for f in found.findings} == {("torque_ripple", 1)}
    assert_same(found_waves(found), WAVES)
    document = diagnosed(found).to_json()
    assert [entry["effect"] for entry in document["findings"]] == ["torque_ripple"] * 3
    assert "at 72 per turn" in reason(found)


def test_a_motor_that_its_magnets_stop_again_and_again_lacks_ripples_alone(tmp_path: Path) -> None:
    """It rests for a few milliseconds at hundreds of angles, where what it lacks is strongest: no friction is to be
    named for that."""
    motor = Motor(inertia=6e-6, coulomb=2e-3, viscous=1e-4, noise=1e-4, counts=20_000)
    waves = ((72.0, 1.4e-2, 0.5), (186.0, 2e-3, 0.3), (18.0, 1e-3, 0.2))
    arm, recording = source(tmp_path, motor), kept(record, motor, steps((6.0, 5.7), 8.0), waves)
    rate = prepared(arm.compiled.model(), [recording]).pieces[0].qd[0]
    assert np.count_nonzero(np.diff(np.sign(rate))) > 200
    found = kept(diagnose, arm.compiled.model(), [recording])
    assert {f.term.effect for f in found.findings} == {"torque_ripple"}
    assert found.findings[0].term.number == 1
    assert_same(found_waves(found)[:3], waves)


def test_ripples_of_a_geared_joint_are_found_and_said_in_both_counts(tmp_path: Path) -> None:
    arm, waves = source(tmp_path, GEARED), ((4.0, 0.6, 0.5), (2.0, 0.3, 0.1))
    recording = kept(record, GEARED, sines(0.35, 16.0, 0), waves)
    found = kept(diagnose, arm.compiled.model(), [recording])
    assert_same(found_waves(found), waves)
    assert "at 4 per turn of the motor, 200 of the joint" in reason(found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motor", "order", "size"),
    [
        (replace(GEARED, ratio=160.0), 1.0, 0.4),
        (GEARED, 0.5, 0.4),
        (replace(GEARED, ratio=101.0), 25 / 101, 0.4),
        (replace(GEARED, ratio=30.0), 20 / 3, 0.3),
        (Motor(), 200.0, 0.05),
    ],
)
def test_ripples_of_any_order_are_found(tmp_path: Path, motor: Motor, order: float, size: float) -> None:
    arm = source(tmp_path, motor)
    desired = steps((0.8, -1.0, 0.5, -1.2), 16.0) if motor.ratio == 1.0 else sines(0.35, 16.0, 3)
    recording = kept(record, motor, desired, [(order, size, 0.7)])
    assert_same(found_waves(kept(diagnose, arm.compiled.model(), [recording])), ((order, size, 0.7),))


@pytest.mark.parametrize("seed", [0, 1, *(slow(k) for k in range(2, 12))])
@pytest.mark.parametrize("geared", [True, slow(False)])
def test_a_clean_recording_has_no_ripple(tmp_path: Path, seed: int, geared: bool) -> None:
    motor = GEARED if geared else Motor()
    desired = sines(0.35, 10.0, seed) if geared else steps((2.0, -3.0, 2.5, -2.0), 10.0)
    arm, recording = source(tmp_path, motor), kept(record, motor, desired, (), seed)
    found = kept(diagnose, arm.compiled.model(), [recording])
    assert not [f for f in found.findings if f.term.effect == "torque_ripple"]


def test_a_wave_over_the_time_is_no_ripple(tmp_path: Path) -> None:
    motor = Motor()
    arm = source(tmp_path, motor)
    recording = kept(record, motor, steps((2.0, 2.1, 2.0, 1.9), 10.0), (), outside=0.05)
    found = kept(diagnose, arm.compiled.model(), [recording])
    assert not [f for f in found.findings if f.term.effect == "torque_ripple"]


@pytest.mark.parametrize(
    ("order", "amplitude"), [(45.0, 0.015), (45.5, 0.015), pytest.param(45.5, 0.009, marks=pytest.mark.slow)]
)
def test_a_line_that_comes_back_after_no_turn_is_no_ripple(tmp_path: Path, order: float, amplitude: float) -> None:
    """A direct drive over a third of a turn: its order is known to some tenths, and a whole one is never far away."""
    motor = Motor(ratio=1.0, inertia=0.24, coulomb=1.0, viscous=1.0, noise=0.02, counts=800_000)
    arm, recording = source(tmp_path, motor), kept(record, motor, sines(0.25, 20.0, 3), ((order, amplitude, 0.7),))
    found = kept(diagnose, arm.compiled.model(), [recording])
    assert [f.term.effect for f in found.findings] == (["torque_ripple"] if order == 45.0 else [])


def test_a_line_above_the_band_raises_it_or_is_reported(tmp_path: Path) -> None:
    fine, coarse = Motor(noise=0.002, counts=2e4), Motor(noise=0.002, counts=3000)
    desired = steps((5.0, 6.0, 5.5), 8.0)
    cutoffs = []
    for motor in (fine, coarse):
        arm = source(tmp_path, motor)
        recording = kept(record, motor, desired, [(72.0, 0.2, 0.5)])
        model = arm.compiled.model()
        band = prepared(model, [recording]).band
        cutoffs.append(band.cutoff)
        if motor is fine:
            assert "72 times per turn" in band.reason
            assert band.cutoff > 72 * 5.5 / (2 * math.pi)
            assert not band.above
        else:
            assert [round(line.order) for line in band.above] == [72]
            assert lines_above(Step.of(kept(identify, model, [recording]))) == list(band.above)
    assert cutoffs[0] > cutoffs[1]


def test_a_model_file_may_have_several_and_all_are_fitted_written_and_compensated(tmp_path: Path) -> None:
    motor = Motor()
    arm = source(tmp_path, motor)
    recording = kept(record, motor, steps((2.0, -3.0, 4.0, -2.5), 14.0), WAVES[:2])
    better = kept(improve, arm, [recording])
    assert [str(f.term) for f in better.findings] == ["torque_ripple@1", "torque_ripple_2@1"]
    effects = arm.with_text(better.model_text).arm().joints[0].effects
    waves = [tuple(effects[name].values()) for name in ("torque_ripple", "torque_ripple_2")]
    assert_same(sorted(waves, key=lambda wave: -wave[1]), WAVES[:2])  # type: ignore[arg-type]
    assert not better.left.findings


def test_orders_that_a_model_file_leaves_open_are_found(tmp_path: Path) -> None:
    motor = Motor()
    arm = source(tmp_path, motor, ("coulomb", "viscous", "torque_ripple", "torque_ripple_2"))
    recording = kept(record, motor, steps((2.0, -3.0, 4.0, -2.5), 14.0), WAVES[:2])
    model = arm.compiled.model()
    values = kept(identify, model, [recording]).inference.values
    orders = sorted(entry["order"].value for term, entry in values.items() if term.effect == "torque_ripple")
    assert orders == pytest.approx([18.0, 72.0], rel=1e-3)


def test_orders_are_said_per_turn() -> None:
    assert per_turn(72.0, 1.0) == "72 per turn"
    assert per_turn(2.0, 100.0) == "2 per turn of the motor, 200 of the joint"
