"""Logs of Dynamixel and Feetech servos, as their programs and typical scripts write them: whole steps of registers."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.recordings.columns import RecordedArm
from runtime.recordings.recording import RecordingError, read
from symbolic.model_file.arm import Drive
from tests.runtime.recordings.formats import joint

N = 400
T = np.arange(N) * 10  # ms
POSITION = np.round(2048 + 700 * np.sin(T / 300)).astype(int)
GOAL = np.round(2048 + 700 * np.sin(T / 300 + 0.05)).astype(int)
SPEED = np.round(100 * np.cos(T / 300)).astype(int)
LOAD = np.round(300 * np.sin(T / 200)).astype(int)


def log(path: Path, columns: Mapping[str, np.ndarray]) -> Path:
    rows = "\n".join(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))
    path.write_text(",".join(columns) + "\n" + rows + "\n", encoding="utf-8")
    return path


def servo(law: str = "position_servo", **gains: float) -> RecordedArm:
    return RecordedArm((joint(drive=Drive(law=law, gains=gains)),), space=False)


def test_a_dynamixel_of_the_x_series(tmp_path: Path) -> None:
    columns = {"Time (ms)": T, "Present Position": POSITION, "Present Velocity": SPEED, "Present PWM": LOAD}
    columns |= {"Present Current": LOAD // 3, "Present Input Voltage": 120 + 0 * T, "Goal Position": GOAL}
    path = log(tmp_path / "wizard.csv", columns | {"Present Temperature": 31 + 0 * T})
    r = read(path, servo(kp=2.0, kd=0.0))
    assert r.t == pytest.approx(T / 1000)
    assert r.q[0] == pytest.approx((POSITION - 2048) * 2 * pi / 4096)
    assert r.qd is not None
    assert r.qd[0] == pytest.approx(SPEED * 0.229 * 2 * pi / 60)
    assert r.q_desired is not None
    assert r.q_desired[0] == pytest.approx((GOAL - 2048) * 2 * pi / 4096)
    assert r.commands["duty"][0] == pytest.approx(LOAD * 0.00113)
    assert r.commands["current"][0] == pytest.approx(LOAD // 3 * 2.69e-3)
    assert r.commands["bus_voltage"][0] == pytest.approx(12.0)
    assert r.temperature[0] == pytest.approx(31.0)
    assert r.tau[0] == pytest.approx(2.0 * (GOAL - POSITION) * 2 * pi / 4096)
    assert r.notes[0].startswith("read as registers of Dynamixel servos: present position in tick4096")
    assert '--map current1="Present Current [mA]"' in r.notes[0]


def test_feetech_servos_with_their_numbers(tmp_path: Path) -> None:
    columns = {"timestamp": T / 1000}
    for k in (4, 7):
        columns |= {f"Present_Position_{k}": POSITION + k, f"Present_Speed_{k}": SPEED, f"Present_Load_{k}": LOAD}
        columns |= {f"Present_Voltage_{k}": 74 + 0 * T, f"Present_Current_{k}": LOAD // 3}
    arm = RecordedArm((joint(drive=Drive(law="pwm", gains={"torque_per_volt": 0.5})),) * 2, space=False)
    r = read(log(tmp_path / "sts.csv", columns), arm)
    for i, k in enumerate((4, 7)):
        assert r.q[i] == pytest.approx((POSITION + k - 2048) * 2 * pi / 4096)
        assert r.tau[i] == pytest.approx(0.5 * LOAD * 0.001 * 7.4)
        assert r.commands["current"][i] == pytest.approx(LOAD // 3 * 6.5e-3)
    assert r.qd is not None
    assert r.qd[1] == pytest.approx(SPEED * 2 * pi / 4096)
    assert "servos 4, 7 are the joints in this order" in r.notes[0]


@pytest.mark.parametrize(
    "name", ["[ID:001] Present Position", "present_position_id1", "PresentPosition1", "dxl1_present_position"]
)
def test_names_as_scripts_write_them(tmp_path: Path, name: str) -> None:
    r = read(log(tmp_path / "a.csv", {"t": T / 1000, name: POSITION, "tau1": LOAD / 100}), None)
    assert r.q[0] == pytest.approx((POSITION - 2048) * 2 * pi / 4096)


def test_a_stated_unit_counts_and_map_more(tmp_path: Path) -> None:
    columns = {"t": T / 1000, "Present Position [deg]": POSITION / 10, "Present Current": LOAD}
    path = log(tmp_path / "a.csv", columns)
    r = read(path, servo("current", torque_constant=1.0))
    assert r.q[0] == pytest.approx(POSITION / 10 * pi / 180)
    assert r.tau[0] == pytest.approx(LOAD * 2.69e-3)
    r = read(path, servo("current", torque_constant=1.0), {"current1": "Present Current [3.36 mA]"})
    assert r.tau[0] == pytest.approx(LOAD * 3.36e-3)


@settings(deadline=None, max_examples=25)
@given(st.lists(st.integers(-(2**20), 2**20), min_size=N, max_size=N), st.integers(0, 2**15 - 1))
def test_steps_come_back(tmp_path_factory: pytest.TempPathFactory, steps: list[int], current: int) -> None:
    position = np.array(steps)
    position[0], position[1] = 0, 1  # it moves
    columns = {"t": T / 1000, "present_position": position, "present_current": current - 2 * (T // 10) % 7}
    r = read(log(tmp_path_factory.mktemp("any") / "a.csv", columns), servo("current", torque_constant=1.0))
    assert np.array_equal(np.round(r.q[0] * 4096 / (2 * pi)) + 2048, position)
    assert np.array_equal(np.round(r.commands["current"][0] / 2.69e-3), columns["present_current"])


def said(path: Path) -> str:
    with pytest.raises(RecordingError) as error:
        read(path, servo("current", torque_constant=1.0))
    assert "\n" not in str(error.value)
    return str(error.value)


def test_numbers_without_their_sign(tmp_path: Path) -> None:
    columns = {"t": T / 1000, "Present Position": POSITION, "Present Current": LOAD % 65536}
    expected = (
        "reaches 65533, a negative number that was read without its sign; write what is over 32767 as value - 65536"
    )
    assert expected in said(log(tmp_path / "a.csv", columns))
    columns |= {"Present Load": np.where(LOAD < 0, 1024 - LOAD, LOAD), "Present Current": LOAD}
    assert "write what is over 1023 as 1024 - value" in said(log(tmp_path / "b.csv", columns))


def test_a_row_for_each_servo(tmp_path: Path) -> None:
    columns = {"t": T // 20 / 100, "ID": 1 + T // 10 % 2, "Present Position": POSITION, "Present Current": LOAD}
    expected = (
        "has the samples of 2 servos in rows of their own; write a column for each: Present Position 1,Present Pos"
    )
    assert expected in said(log(tmp_path / "a.csv", columns))


def test_what_a_script_has_converted_is_not_taken_for_steps(tmp_path: Path) -> None:
    columns = {"t": T / 1000, "Present Position": POSITION / 1000, "Present Current": LOAD}
    assert "no column q1" in said(log(tmp_path / "a.csv", columns))
    columns["Present Position"] = np.array(["fast", *map(str, POSITION[1:])])
    assert "expected a number" in said(log(tmp_path / "b.csv", columns))
