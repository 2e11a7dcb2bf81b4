"""Recordings without a torque: the law of the drive makes it from the command's columns."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import servos

from runtime.workspace.source import Source
from tests.conftest import ARMS
from tests.first_hour import REAL

Run = Callable[..., tuple[int, str, str]]
DRIVE = (ARMS / "drive.toml").read_text(encoding="utf-8")
PENDULUM = """name = "xl330"
gravity = [9.81, 0.0]
[[joint]]
type = "revolute"
rotor_inertia = 0.0018
gear_ratio = 288
[joint.link]
length = 0.10
mass = 0.49
com = [0.10, 0.0]
inertia = 0.0001
[joint.effects.coulomb]
[joint.effects.viscous]
[joint.effects.offset]
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def found(tendon: Run, verb: str, model: Path, *recordings: Path) -> dict[str, Any]:
    """What --json says, without what it was made from."""
    status, out, err = tendon(verb, model, *recordings, "--json", "-")
    assert status in (0, 1), err
    document: dict[str, Any] = json.loads(out)
    document.pop("provenance", None)
    return document


def fitted(document: dict[str, Any]) -> list[dict[str, Any]]:
    """Parameters of effects, in order."""
    return [p for effect in document["effects"] for p in effect["parameters"].values()]


@pytest.fixture(scope="module")
def logs() -> dict[str, servos.ServoLog]:
    return {"position_servo": servos.servo("stribeck", 1), "pwm": servos.bridge("stribeck", 1)}


@pytest.mark.parametrize(("law", "gains"), [("position_servo", servos.SERVO), ("pwm", servos.BRIDGE)])
def test_torque_from_the_command_is_the_torque_of_the_equations(
    tendon: Run, here: Path, logs: dict[str, servos.ServoLog], law: str, gains: str
) -> None:
    plain, driven = written(here / "plain.toml", DRIVE), written(here / "driven.toml", servos.model(gains, DRIVE))
    torque, command = logs[law].write(here / "torque.csv", torque=True), logs[law].write(here / "command.csv")
    document, other = (found(tendon, "identify", *files) for files in ((driven, command), (plain, torque)))
    (delay,) = document["delay"]
    assert delay["hold"] == pytest.approx(1e-3)
    assert "hold" not in other["delay"][0]
    (said,), (joint,) = document["joints"], other["joints"]
    assert said.pop("drive")["law"] == law
    assert said["rms"] == pytest.approx(joint["rms"], rel=1e-3)
    for one, same in zip(fitted(document), fitted(other), strict=True):
        assert abs(one["value"] - same["value"]) < 0.05 * (same["interval"][1] - same["value"])


@pytest.mark.parametrize(
    "drive",
    [
        servos.SERVO,
        f"{servos.SERVO}ki = 40.0\ndelay = 0.004\n",
        'law = "position_servo"\nkp = 300.0\nkd = 0.0\nki = 40.0\n',
        f"{servos.BRIDGE}bus_voltage = 48.0\ndead_duty = 0.02\n",
        'law = "current"\ntorque_constant = 6.0\n',
        'law = "voltage"\ntorque_per_volt = 2.0\nback_emf = 6.0\n',
    ],
)
def test_simulated_commands_make_the_torque_that_was_simulated(tendon: Run, here: Path, drive: str) -> None:
    plain, driven = written(here / "plain.toml", DRIVE), written(here / "driven.toml", servos.model(drive, DRIVE))
    for model, out in ((plain, "torque.csv"), (driven, "command.csv")):
        assert tendon("simulate", model, "--out", out, "--seconds", 12, "--hide", "stribeck@1")[0] == 0
    assert "tau" not in Path("command.csv").read_text(encoding="utf-8").partition("\n")[0]
    assert found(tendon, "compare", driven, Path("command.csv"))["joints"][0]["drive"]["law"] in drive
    torque, made = (
        Source.read(model, None).recordings([Path(name)])[0]
        for model, name in ((plain, "torque.csv"), (driven, "command.csv"))
    )
    # A row's command acts until the next; over many rows the noise of single ones is no more.
    (joint,) = made.driven
    assert joint is not None
    command = made.tau[0] - joint.torque_at_once
    acting = joint.torque_at_once[1:] + (command[1:] + command[:-1]) / 2
    apart = np.convolve(acting - torque.tau[0, 1:], np.ones(40) / 40, "valid")[100:-100]
    assert np.sqrt(np.mean(apart**2)) < 4e-3 * np.std(torque.tau)


def test_what_a_drive_cannot_make_is_not_simulated(tendon: Run, here: Path) -> None:
    for drive, said in (
        (f"{servos.SERVO}saturation = 0.5\n", "the drive's saturation is 0.5"),
        (servos.BRIDGE, "add bus_voltage to [joint.drive]"),
    ):
        model = written(here / "driven.toml", servos.model(drive, DRIVE))
        status, _, err = tendon("simulate", model, "--out", "command.csv", "--seconds", 12)
        assert status == 2
        assert said in err
        assert not Path("command.csv").exists()


@pytest.mark.slow
@pytest.mark.parametrize(("law", "gains"), [("position_servo", servos.SERVO), ("pwm", servos.BRIDGE)])
def test_the_hidden_effect_is_named_first_without_a_torque_signal(
    tendon: Run, here: Path, logs: dict[str, servos.ServoLog], law: str, gains: str
) -> None:
    driven, command = written(here / "driven.toml", servos.model(gains, DRIVE)), logs[law].write(here / "command.csv")
    document = found(tendon, "diagnose", driven, command)
    assert document["verdict"] == "effect"
    assert document["findings"][0]["effect"] == "stribeck"


def test_a_missing_column_or_law_is_named(tendon: Run, here: Path) -> None:
    t = np.arange(400) / 100
    rows = np.column_stack([t, np.sin(t), np.cos(t)])
    np.savetxt("run.csv", rows, delimiter=",", header="t,q1,duty1", comments="")
    plain, driven = (
        written(here / "plain.toml", DRIVE),
        written(here / "driven.toml", servos.model(servos.BRIDGE, DRIVE)),
    )
    status, _, err = tendon("compare", plain, "run.csv")
    assert status == 2
    assert 'add [joint.drive] with law = "pwm" to joint 1' in err
    status, _, err = tendon("compare", driven, "run.csv")
    assert status == 2
    assert "no column bus_voltage1" in err
    assert "state bus_voltage under [joint.drive]" in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("drive", "said"),
    [
        ('law = "position_servo"\nkq = 1.0\n', 'the closest known one is "kp"'),
        ('law = "servo"\n', '"position_servo"'),
        ("kp = 1.0\n", 'add law = "position_servo"'),
        ('law = "current"\nkp = 1.0\n', 'unknown key of current "kp"'),
        ('law = "position_servo"\nkp = -1.0\n', "kp is -1"),
        ("direction = 1\n", '"node" or "law"'),
        ('law = "voltage"\nresistance = 1.0\ntorque_per_volt = 2.0\n', "torque_constant over resistance"),
    ],
)
def test_a_wrong_drive_is_an_error_in_one_line(tendon: Run, here: Path, drive: str, said: str) -> None:
    model = written(here / "arm.toml", servos.model(drive, DRIVE))
    status, _, err = tendon("generate", model, "--out", "made")
    assert status == 2
    assert said in err
    assert err.startswith(f"{model}: joint 1: drive")
    assert err.count("\n") == 1


@pytest.mark.skipif(not (REAL / "xl330").is_dir(), reason="no real recordings beside the project")
def test_a_real_bridge_tells_what_its_torque_tells(tendon: Run, here: Path) -> None:
    gains = 'law = "pwm"\ntorque_constant = 0.387\nresistance = 4.02\nback_emf = 0.0\n'
    plain, driven = written(here / "plain.toml", PENDULUM), written(here / "driven.toml", servos.model(gains, PENDULUM))
    log = REAL / "xl330"
    with_torque, without = (
        found(tendon, "compare", model, log / name)
        for model, name in ((plain, "fit.csv.gz"), (driven, "command_fit.csv.gz"))
    )
    assert without["joints"][0]["relative"] == pytest.approx(with_torque["joints"][0]["relative"], rel=1e-4)


@pytest.mark.skipif(not (REAL / "go2").is_dir(), reason="no real recordings beside the project")
def test_real_position_servos_tell_what_their_torques_tell(tendon: Run, here: Path) -> None:
    log = REAL / "go2"
    assert tendon("import", log / "go2.urdf", "--base", "base", "--tip", "FL_foot", "--out", "leg.toml")[0] == 0
    head, *joints = Path("leg.toml").read_text(encoding="utf-8").split("[[joint]]")
    gains = [(20.0, 1.0), (20.0, 1.0), (40.0, 2.0)]
    each = [
        servos.model(f'law = "position_servo"\nkp = {kp}\nkd = {kd}\n', joint)
        for (kp, kd), joint in zip(gains, joints, strict=True)
    ]
    driven = written(here / "driven.toml", "[[joint]]".join([head, *each]))
    with gzip.open(log / "command_fit.csv.gz") as file:
        assert b"tau" not in file.readline()
    with_torque, without = (
        found(tendon, "compare", model, log / name)
        for model, name in ((Path("leg.toml"), "fit.csv.gz"), (driven, "command_fit.csv.gz"))
    )
    for one, other in zip(without["joints"], with_torque["joints"], strict=True):
        # The torques are of the commands and late as a whole; the servos answer to their angles at once.
        assert one["relative"] == pytest.approx(other["relative"], rel=0.08)
