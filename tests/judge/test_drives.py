"""Recordings of commands in the torque's place: what is written gives the torque again, and what becomes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.identification.identify import prepared
from tests import bank
from tests.judge import drives, plan, rates
from tests.judge.cases import Case, Setting, cases, make
from tests.judge.line import Line, logged, opened
from tests.judge.recorder import Logger
from tests.judge.save import save
from tests.kept import kept

SEED = 42
SLOW = Setting(excitation="brief", logger=Logger(every=4))


def one(name: str, form: str = "", size: float = 1.0) -> Case:
    return next(iter(cases([name], [1], [size], [SEED], replace(SLOW, drive=form))))


def assert_alike(made: np.ndarray, tau: np.ndarray) -> None:
    """In means of a tenth of a second, which the encoder's steps hardly move."""
    apart = np.convolve(made - tau, np.full(25, 1 / 25), "valid")
    assert np.sqrt(np.mean(apart**2)) < 0.02 * np.std(tau)


def test_a_servo_is_told_where_it_makes_the_same_torque() -> None:
    torque, servo = make(one("stribeck")), make(one("stribeck", "servo"))
    (drive,), read = servo.motors, servo.recording
    assert np.array_equal(read.q, torque.recording.q)
    assert np.isnan(read.tau).all()
    assert read.q_desired is not None
    error = read.q_desired[0] - read.q[0]
    assert_alike(drive.kp * error + drive.kd * np.gradient(error, read.t), torque.recording.tau[0])


def test_a_bridge_is_told_its_part_of_a_supply_that_sags() -> None:
    torque, bridge = make(one("stribeck")), make(one("stribeck", "pwm"))
    (drive,), read = bridge.motors, bridge.recording
    duty, supply = read.commands["duty"][0], read.commands["bus_voltage"][0]
    assert 0.1 < np.abs(duty).max() < 1.0
    assert np.ptp(supply) == pytest.approx(drives.SAG, rel=0.01)
    # A duty is the mean over the two periods that follow a sample.
    rate = np.interp(read.t + 1e-3, read.t, np.gradient(read.q[0], read.t))
    made = drive.k / drive.resistance * (duty * supply - drive.k * rate)
    assert_alike(made, torque.recording.tau[0])


def test_the_model_file_states_gains_unless_they_are_open(tmp_path: Path) -> None:
    texts = {form: make(one("stribeck", form)).model for form in drives.FORMS}
    assert "kp = " in texts["servo"]
    assert "kp = " not in texts["servo_open"]
    assert "resistance = " in texts["pwm"]
    assert "resistance = " not in texts["pwm_open"]
    assert (save(one("stribeck", "servo_open"), tmp_path) / "fit.csv.gz").exists()


@pytest.mark.parametrize("form", ["servo_open", "pwm_open"])
def test_a_clear_effect_is_named_without_a_torque(form: str) -> None:
    row = kept(bank.judged, one("stribeck", form))
    assert (row.outcome, row.extra) == ("right", 0), row
    for word in row.gains.split(", "):
        assert float(word.split()[1]) == pytest.approx(1.0, abs=0.03)


def test_rows_are_counted_by_what_is_recorded() -> None:
    rows = [
        Line("stribeck", "single", 1, 1, "", 1.0, truth="stribeck@1", outcome="right", named="stribeck@1"),
        Line(
            "stribeck", "single", 1, 1, "", 1.0, truth="stribeck@1", outcome="wrong", named="lugre@1 payload", extra=1
        ),
        Line("clean", "clean", 1, 1, "", 0.0, outcome="wrong", named="payload", extra=1),
    ]
    assert rates.drives_table(rows) == []
    printed = rates.drives_table([*rows, *(replace(x, drive="servo") for x in rows)])
    assert [x.split() for x in printed[1:]] == [
        ["the", "torque", "2", "1", "2", "3", "(1)"],
        ["servo", "2", "1", "2", "3", "(1)"],
    ]


def test_the_encoders_noise_in_a_servos_torque_widens_no_band() -> None:
    """It grows with the frequency, and is no measure of the torque's own noise in the band."""
    coarse = [replace(c, setting=replace(c.setting, coarse=10.0)) for c in (one("stribeck"), one("stribeck", "servo"))]
    read = [logged(make(case)) for case in coarse]
    torque, servo = (prepared(opened(m.model).compiled.model(), [m.recording]).band.cutoff for m in read)
    assert servo == pytest.approx(torque, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("form", drives.FORMS)
def test_nearly_as_many_are_named_as_with_a_torque(form: str) -> None:
    """Of the development set, the arm of one joint."""
    base = [c for c in plan.driven("") if c.setting.joints == 1 and c.names]
    first = {
        drive: sum(
            kept(bank.judged, replace(c, setting=replace(c.setting, drive=drive))).outcome == "right" for c in base
        )
        for drive in ("", form)
    }
    assert first[form] >= first[""] - 0.1 * len(base)
