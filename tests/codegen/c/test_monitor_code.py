"""The monitor's step: false alarms as rare as stated, changes found soon, and numbers that are none."""

from __future__ import annotations

import numpy as np
import pytest

from codegen import render
from codegen.c.monitor import SIGNALS, VERDICTS
from codegen.monitor.alarm import alarm, run_length, score_probabilities
from codegen.monitor.settings import STEPS_A_LEVEL
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file import reader
from tests.one_joint import refusal
from tests.watched_arm import MONITOR, watch_text, watched_text
from tests.watched_noise import FREEDOM, RATE, WatchedNoise, noise_gain


def monitor_code(text: str) -> str:
    return render.controller_files(derive(reader.parse(text, "arm.toml")), LIBRARY)["arm_monitor_f32.c"]


def test_run_length_is_that_of_simulated_sums() -> None:
    """2,000 sums of scores, each until its alarm."""
    probabilities, rng = score_probabilities(FREEDOM), np.random.default_rng(1)
    reference, level = alarm(FREEDOM, 1000.0, 1).reference, 12
    sums, taken, running = np.zeros(2000), np.zeros(2000), np.ones(2000, dtype=bool)
    while running.any():
        scores = STEPS_A_LEVEL * rng.choice(len(probabilities), size=2000, p=probabilities)
        sums = np.maximum(sums + scores - reference, 0.0)
        taken += running
        running &= sums < level
    assert run_length(probabilities, reference, level) == pytest.approx(taken.mean(), rel=0.1)


@pytest.mark.parametrize("false_alarms", [0.01, 1.0, 1000.0])
@pytest.mark.parametrize("joints", [1, 7])
def test_an_alarm_is_as_rare_as_stated_and_no_rarer_than_a_step_makes_it(false_alarms: float, joints: int) -> None:
    found, hours = alarm(FREEDOM, false_alarms, joints), 1000 * joints / false_alarms
    assert found.hours >= hours
    lower = run_length(score_probabilities(FREEDOM), found.reference, found.level - 1)
    assert lower * found.hours / run_length(score_probabilities(FREEDOM), found.reference, found.level) < hours


def test_false_alarms_of_the_generated_code() -> None:
    """One an hour is stated: in 100 hours of noise at the floor there are as many, but for chance."""
    found = WatchedNoise(1000.0).alarms(100, np.random.default_rng(2))
    assert 40 < found <= 100 + 3 * 10


@pytest.mark.slow
def test_false_alarms_in_a_thousand_hours() -> None:
    assert WatchedNoise(1.0).alarms(1000, np.random.default_rng(3)) <= 4


@pytest.mark.parametrize(("ratio", "seconds"), [(2.0, 5.0), (5.0, 1.5)])
def test_a_louder_residual_is_found(ratio: float, seconds: float) -> None:
    delays = WatchedNoise(1.0).delays(ratio, 40, np.random.default_rng(4))
    assert (delays > 0).all()
    assert delays.max() < seconds


CHANGES = {
    "dry friction": ("velocity", lambda motion: np.sign(motion[1])),
    "viscous friction": ("velocity", lambda motion: motion[1]),
    "spring": ("position", lambda motion: motion[0]),
    "payload": ("acceleration", lambda motion: motion[2]),
}


@pytest.mark.parametrize("ratio", [1.4, 2.0])
@pytest.mark.parametrize("change", CHANGES)
def test_a_small_change_is_named_at_its_alarm_and_stays(change: str, ratio: float) -> None:
    """Of energies of 1.4 and 2 floors, of which the floor's noise is much, for five minutes in nine seeds; before, two
    minutes in which nothing is said."""
    signal, law = CHANGES[change]
    right, t, before = 0, np.arange(0.0, 420.0, 1 / RATE), round(120 * RATE)
    for seed in range(9):
        rng = np.random.default_rng(seed)
        w, phase = 2 * np.pi * np.array([[0.23], [0.61]]), rng.uniform(0, 6, (2, 1))
        motion = np.array([np.sum(w**k * np.sin(w * t + phase + k * np.pi / 2), axis=0) for k in range(3)])
        lacking = law(motion) * (np.arange(len(t)) >= before)
        size = np.sqrt((ratio - 1) / np.mean(lacking[before:] ** 2))
        residual = rng.standard_normal(len(t)) / noise_gain() + size * lacking
        verdict, said = WatchedNoise(1.0).said(residual, 0 * t, motion.T)
        alarm = int(np.argmax(verdict != VERDICTS["holds"]))
        turns = np.count_nonzero(np.diff(4 * said[alarm:] + verdict[alarm:]))
        right += bool(alarm >= before and said[alarm] == SIGNALS[signal] and turns <= 1)
    assert right >= 8


def test_more_load_may_leave_more_residual() -> None:
    rng = np.random.default_rng(5)
    noise, load = rng.standard_normal(60_000, dtype=np.float32), np.full(60_000, 20.0, dtype=np.float32)
    assert WatchedNoise(1.0).watch(4 * noise, load) < 60_000
    assert WatchedNoise(1.0, load_floor=0.2).watch(4 * noise, load) == 60_000


def test_what_is_no_number_is_left_out() -> None:
    noise = 0.1 * np.random.default_rng(6).standard_normal(60_000, dtype=np.float32)
    noise[::7], noise[3::11] = np.nan, np.inf
    watched = WatchedNoise(1.0)
    assert watched.watch(noise) == 60_000
    assert watched.watch(np.full(1000, 5.0, dtype=np.float32)) < 1000


def test_a_measured_warmth_is_taken_into_account() -> None:
    """The generated step adds what the effect says, and nothing where the file states no values."""
    heated = "[joint.effects.thermal_friction]\ncoulomb = -0.02\nviscous = 0.5\ntime_constant = 100.0\n"
    code = monitor_code(watched_text(2, tables=heated))
    assert "heated[1] = warmth[1] * (0.5f * qd[1] - 0.02f * tendon_sgn_f32(qd[1]));" in code
    assert "(torque[1] - model[1]) - heated[1]" in code
    assert "heated" not in monitor_code(watched_text(2, tables="[joint.effects.thermal_friction]\n"))


def test_a_model_file_without_a_part_of_it_is_refused() -> None:
    whole = watched_text(2)
    monitor = reader.parse(whole, "arm.toml").monitor
    assert monitor is not None
    assert (monitor.cutoff, monitor.false_alarms, monitor.joints[1].floor) == (8.0, 1.0, 0.08)
    assert refusal(whole.replace(MONITOR, "")) == (
        "arm.toml: joint 1: [joint.monitor] needs [monitor] with its cutoff; expected both"
    )
    assert refusal(whole.replace(watch_text(0.08), "", 1)) == (
        "arm.toml: joint 1: [monitor] needs [joint.monitor] with a floor at every joint"
    )
    assert "cutoff is 400" in refusal(whole.replace("cutoff = 8.0", "cutoff = 400.0"))
