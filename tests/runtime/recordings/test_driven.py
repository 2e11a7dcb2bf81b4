"""The laws of drives along a recording, against their equations written out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import servos

from runtime.recordings.columns import RecordedArm
from runtime.recordings.driven import ToldGain
from runtime.recordings.recording import Recording, RecordingError, read, write
from runtime.workspace.source import Source
from symbolic.model_file.arm import DescribedJoint, Drive
from tests.conftest import ARMS

T = np.arange(300) / 100
Q = np.sin(1.3 * T)
WANTED = np.sin(1.3 * T + 0.1)
ERROR_RATE = 1.3 * (np.cos(1.3 * T + 0.1) - np.cos(1.3 * T))


def arm(law: str, **gains: float) -> RecordedArm:
    joint = DescribedJoint("revolute", None, 1.0, drive=Drive(law=law, gains=gains))
    return RecordedArm((joint,), space=False)


def recorded(tmp_path: Path, arm: RecordedArm, **columns: np.ndarray) -> Recording:
    header, path = ",".join(("t", "q1", *columns)), tmp_path / "run.csv"
    np.savetxt(path, np.column_stack([T, Q, *columns.values()]), delimiter=",", header=header, comments="")
    return read(path, arm)


def test_a_servo_whose_rates_nobody_recorded(tmp_path: Path) -> None:
    found = recorded(tmp_path, arm("position_servo", kp=7.0, kd=0.5, ki=2.0, saturation=0.5), q1_desired=WANTED)
    error = WANTED - Q
    integral = np.concatenate([[0.0], np.cumsum(error[1:] * np.diff(T))])
    torque = 7.0 * error + 0.5 * ERROR_RATE + 2.0 * integral
    assert np.abs(torque).max() > 0.5
    assert found.tau[0] == pytest.approx(np.clip(torque, -0.5, 0.5), abs=1e-6)


def test_a_position_that_is_read_back_is_no_command(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"run\.csv: q1_desired is q1 in every sample .*; expected the position"):
        recorded(tmp_path, arm("position_servo", kp=7.0), q1_desired=Q)
    assert recorded(tmp_path, arm("position_servo", kp=7.0), q1_desired=np.append(WANTED[:1], Q[1:])).tau.any()


def test_rates_of_a_slow_logger_are_those_of_the_motion(tmp_path: Path) -> None:
    """Differences of these samples are too small by a tenth."""
    quick = 0.1 * np.sin(2 * np.pi * 12.0 * T)
    found = recorded(tmp_path, arm("position_servo", kp=1.0, kd=1.0), q1_desired=Q + quick)
    torque = quick + 0.1 * 2 * np.pi * 12.0 * np.cos(2 * np.pi * 12.0 * T)
    inside = slice(20, -20)
    assert found.tau[0, inside] == pytest.approx(torque[inside], abs=0.02 * torque.max())


def test_a_measured_rate_and_a_demanded_one_are_used(tmp_path: Path) -> None:
    """A servo's rate is scaled to its positions."""
    rate, wanted = 1.3 * np.cos(1.3 * T), np.cos(2 * T)
    drive = arm("position_servo", kp=7.0, kd=0.5)
    found = recorded(tmp_path, drive, qd1=1.02 * rate, q1_desired=WANTED, qd1_desired=wanted)
    assert found.tau[0] == pytest.approx(7.0 * (WANTED - Q) + 0.5 * (wanted - rate), abs=1e-6)


def test_a_command_that_acts_later(tmp_path: Path) -> None:
    found = recorded(tmp_path, arm("current", torque_constant=3.0, delay=0.02), current1=WANTED)
    assert found.tau[0, 2:] == pytest.approx(3.0 * WANTED[:-2], abs=1e-9)


def test_a_bridge_with_dead_time_on_a_stated_supply(tmp_path: Path) -> None:
    duty = np.sin(3 * T)
    gains = {"torque_constant": 2.0, "resistance": 4.0, "bus_voltage": 12.0, "dead_duty": 0.1}
    found = recorded(tmp_path, arm("pwm", **gains), qd1=np.cos(T), duty1=duty)
    volts = 12.0 * np.sign(duty) * np.maximum(np.abs(duty) - 0.1, 0.0)
    (joint,) = found.driven
    assert joint is not None
    assert joint.scale == pytest.approx(2.0 / 4.0 * (volts @ duty) / (duty @ duty))
    assert found.tau[0] == pytest.approx(2.0 / 4.0 * (volts - 2.0 * np.cos(T)), abs=1e-9)


def test_the_supply_beside_a_duty_may_be_called_voltage(tmp_path: Path) -> None:
    duty, supply = np.sin(3 * T), 7.0 + 0.2 * np.cos(T)
    found = recorded(tmp_path, arm("pwm", torque_per_volt=0.1), duty1=duty, voltage1=supply)
    assert found.tau[0] == pytest.approx(0.1 * duty * supply, abs=1e-9)
    assert "the column voltage is taken for the supply's voltage" in found.notes[0]


def test_the_generated_function_makes_the_same_torque(tmp_path: Path) -> None:
    text = servos.model(
        f"{servos.BRIDGE}dead_duty = 0.1\nsaturation = 20.0\n", (ARMS / "drive.toml").read_text("utf-8")
    )
    (tmp_path / "arm.toml").write_text(text, encoding="utf-8")
    source = Source.read(tmp_path / "arm.toml", None)
    duty, supply, rate = np.sin(3 * T), 24.0 + np.cos(T), np.cos(T)
    found = recorded(tmp_path, source.recorded_arm(), qd1=rate, duty1=duty, bus_voltage1=supply)
    read = {"q": Q[None], "qd": rate[None], "duty": duty[None], "bus_voltage": supply[None]}
    assert np.abs(found.tau).max() == 20.0
    assert source.compiled.model().call("drive_torque", read) == pytest.approx(found.tau, abs=1e-9)


def test_a_voltage_drives_a_motor_with_back_emf(tmp_path: Path) -> None:
    found = recorded(tmp_path, arm("voltage", torque_per_volt=0.5, back_emf=3.0), voltage1=WANTED, qd1=np.cos(T))
    assert found.tau[0] == pytest.approx(0.5 * (WANTED - 3.0 * np.cos(T)), abs=1e-9)


def test_a_recorded_torque_is_used_as_it_is(tmp_path: Path) -> None:
    torque = np.cos(T)
    found = recorded(tmp_path, arm("position_servo", kp=7.0, kd=0.0), q1_desired=WANTED, tau1=torque)
    assert found.tau[0] == pytest.approx(torque, abs=1e-9)
    assert found.driven == (None,)


def test_what_a_drive_makes_is_the_torque_of_the_motor(tmp_path: Path) -> None:
    """Whatever the torque sensor of the arm measures in other recordings."""
    sensed = replace(arm("current", torque_constant=2.0), torque="link")
    assert recorded(tmp_path, sensed, current1=WANTED).torque == "motor"
    assert recorded(tmp_path, sensed, current1=WANTED, tau1=np.cos(T)).torque == "link"


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    whole = arm("pwm", torque_per_volt=0.1)
    found = recorded(tmp_path, whole, duty1=np.sin(3 * T), bus_voltage1=7.0 + 0 * T)
    write(tmp_path / "again.csv", found)
    assert (tmp_path / "again.csv").read_text(encoding="utf-8").startswith("t [s],q1 [rad],duty1,bus_voltage1 [V]\n")
    assert read(tmp_path / "again.csv", whole).tau == pytest.approx(found.tau, abs=1e-9)


def test_units_of_commands_are_converted(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    rows = np.column_stack([T, Q, 100 * np.sin(3 * T), 7000 + 0 * T])
    np.savetxt(path, rows, delimiter=",", header="t,q1,duty1 [%],bus_voltage1 [mV]", comments="")
    assert read(path, arm("pwm", torque_per_volt=0.1)).tau[0] == pytest.approx(0.7 * np.sin(3 * T), abs=1e-9)
    path.write_text(path.read_text(encoding="utf-8").replace("duty1 [%]", "duty1 [V]"), encoding="utf-8")
    with pytest.raises(RecordingError, match=r"duty1 is in \[V\]; expected a ratio such as 1 or %"):
        read(path, arm("pwm", torque_per_volt=0.1))


def test_an_unknown_gain_leaves_the_torque_in_the_unit_of_the_command(tmp_path: Path) -> None:
    found = recorded(tmp_path, arm("position_servo"), q1_desired=WANTED)
    (joint,) = found.driven
    assert joint is not None
    assert joint.unknown == ("kp", "kd")
    assert found.tau[0] == pytest.approx(WANTED - Q, abs=1e-9)
    gains = {name: ToldGain(name, value, "", None) for name, value in (("kp", 5.0), ("kd", 0.5))}
    told = replace(joint, told=gains)
    assert told.torque == pytest.approx(5.0 * (WANTED - Q) + 0.5 * ERROR_RATE, abs=1e-6)
