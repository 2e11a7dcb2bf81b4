"""Logs of BAM, written as its recorders write them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.recordings.columns import RecordedArm
from runtime.recordings.recording import RecordingError, read
from symbolic.model_file.arm import Drive
from tests.runtime.recordings.formats import joint

N = 300
T = np.arange(N) / 190
Q, GOAL = np.sin(3 * T), np.sin(3 * T + 0.1)
OFF = T > 1.2


def entries(**more: Any) -> list[dict[str, Any]]:
    found = []
    for k, t in enumerate(T):
        entry = {
            "position": Q[k],
            "speed": 3 * np.cos(3 * t),
            "load": 0.4 * np.sin(t),
            "input_volts": 7.3,
            "temp": 28.0,
        }
        entry |= {"timestamp": t, "goal_position": GOAL[k], "torque_enable": not OFF[k]}
        found.append(entry | {name: value(t) for name, value in more.items()})
    return found


def written(path: Path, listed: Any, **about: Any) -> Path:
    told = {"mass": 0.49, "length": 0.1, "kp": 100, "vin": 7.4, "motor": "xl330", "trajectory": "sin_sin"}
    path.write_text(json.dumps(told | about | {"entries": listed}), encoding="utf-8")
    return path


def servo(law: str, **gains: float) -> RecordedArm:
    return RecordedArm((joint(drive=Drive(law=law, gains=gains)),), space=False)


def test_the_duty_of_a_servo(tmp_path: Path) -> None:
    r = read(written(tmp_path / "a.json", entries()), servo("pwm", torque_per_volt=0.1))
    assert r.q[0] == pytest.approx(Q)
    assert r.qd is not None
    assert r.qd[0] == pytest.approx(3 * np.cos(3 * T))
    assert r.tau[0] == pytest.approx(0.1 * 0.4 * np.sin(T) * 7.3)
    assert r.temperature[0] == pytest.approx(28.0)
    assert r.notes[0] == (
        "a log of BAM: motor xl330, mass 0.49 kg, length 0.1 m, vin 7.4 V, kp 100; mass and length are the model's, "
        "where q = 0 hangs down"
    )


def test_a_motor_that_is_off_makes_no_torque(tmp_path: Path) -> None:
    r = read(written(tmp_path / "a.json", entries()), servo("position_servo", kp=5.0, kd=0.0))
    assert r.tau[0] == pytest.approx(np.where(OFF, 0.0, 5.0 * (GOAL - Q)))
    assert f"the motor is off in {OFF.sum()} entries; q_desired is the position there" in r.notes


def test_a_load_in_steps_of_its_register_and_one_that_was_not_recorded(tmp_path: Path) -> None:
    steps = written(tmp_path / "a.json", entries(load=lambda t: round(400 * np.sin(t))))
    r = read(steps, servo("pwm", torque_per_volt=0.1))
    assert r.commands["duty"][0] == pytest.approx(np.round(400 * np.sin(T)) / 1000)
    silent = read(written(tmp_path / "b.json", entries(load=lambda _: 0)), servo("position_servo", kp=5.0))
    assert "duty" not in silent.commands


def test_a_current_in_milliampere(tmp_path: Path) -> None:
    listed = entries(present_current=lambda t: 100 * np.sin(t))
    r = read(written(tmp_path / "a.json", listed), servo("current", torque_constant=2.0))
    assert r.tau[0] == pytest.approx(2.0 * 0.1 * np.sin(T))


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("{", "the JSON file is damaged or cut off"),
        ("{}", 'is JSON, but no log of BAM, which has "entries" with timestamp and position'),
        ('{"entries": 3}', "is JSON, but no log of BAM"),
        ('{"entries": [[1]]}', "is JSON, but no log of BAM"),
        ('{"entries": [{"timestamp": 0, "position": 0}, 5]}', "entry 2: is no table of numbers"),
        (
            '{"entries": [{"timestamp": 0, "position": 0, "present_current": 0}]}',
            "only 1 sample; expected at least 200",
        ),
        ('{"entries": [{"timestamp": "a", "position": 0, "present_current": 0}]}', "t is NaN"),
        ('{"entries": [{"timestamp": 0, "position": 1e999, "present_current": 0}]}', "q1 is infinite"),
        ('{"entries": [{"timestamp": 0, "position": 0}]}', "no column current1, from which the law current"),
        ("{" * 100_000, "the JSON file is damaged or cut off"),
    ],
)
def test_files_that_are_no_logs(tmp_path: Path, content: str, expected: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(RecordingError) as error:
        read(path, servo("current", torque_constant=1.0))
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


def test_an_entry_that_lacks_a_number(tmp_path: Path) -> None:
    listed = entries()
    del listed[17]["position"]
    with pytest.raises(RecordingError, match=r"entry 18: q1 is NaN; drop the row or pass --allow-gaps"):
        read(written(tmp_path / "a.json", listed), servo("pwm", torque_per_volt=0.1))
