"""Unknown gains of drives on simulated servos, whose equations are written apart from the library's."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import servos

from tests.conftest import ARMS
from tests.judge.bench import Setting
from tests.judge.cases import cases, make
from tests.judge.recorder import Logger
from tests.judge.save import save

Run = Callable[..., tuple[int, str, str]]
DRIVE = (ARMS / "drive.toml").read_text(encoding="utf-8")
NOTHING_KNOWN = "\n".join(
    line for line in DRIVE.splitlines() if not line.startswith(("rotor_inertia", "mass", "com", "inertia"))
)
SERVO, BRIDGE = 'law = "position_servo"\n', 'law = "pwm"\n'


@pytest.fixture(scope="module")
def logs() -> dict[str, servos.ServoLog]:
    return {"servo": servos.servo("stribeck", 1), "bridge": servos.bridge("stribeck", 1)}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def identified(
    tendon: Run, drive: str, text: str, log: servos.ServoLog, verb: str = "identify"
) -> tuple[dict[str, Any], str]:
    """What --json says, and standard error."""
    Path("arm.toml").write_text(servos.model(drive, text), encoding="utf-8")
    status, out, err = tendon(verb, "arm.toml", log.write(Path("run.csv")), "--json", "-")
    assert status in (0, 1), err
    return json.loads(out), err


def inside(gain: dict[str, Any], truth: float) -> bool:
    low, high = gain["interval"]
    return bool(low <= truth <= high)


@pytest.mark.usefixtures("here")
def test_a_known_inertia_tells_the_gains_of_a_servo(tendon: Run, logs: dict[str, servos.ServoLog]) -> None:
    """Although the model lacks an effect."""
    document, err = identified(tendon, SERVO, DRIVE, logs["servo"])
    drive = document["joints"][0]["drive"]
    assert drive["law"] == "position_servo"
    assert drive["gains"]["kp"]["value"] == pytest.approx(servos.KP, rel=0.02)
    assert drive["gains"]["kd"]["value"] == pytest.approx(servos.KD, rel=0.03)
    assert inside(drive["gains"]["kp"], servos.KP)
    assert inside(drive["gains"]["kd"], servos.KD)
    assert drive["unit"] == "rad"
    assert drive["rms"] == pytest.approx(document["joints"][0]["rms"] / drive["gains"]["kp"]["value"])
    assert "identified kp = " in err


@pytest.mark.usefixtures("here")
def test_samples_at_a_drives_limit_do_not_count_for_its_gains(tendon: Run) -> None:
    """A tenth of them."""
    log = servos.servo("stribeck", 1, most=6.0)
    assert 0.05 < np.mean(np.abs(log.tau) >= 6.0) < 0.15
    document, _ = identified(tendon, f"{SERVO}saturation = 6.0\n", DRIVE, log)
    gains = document["joints"][0]["drive"]["gains"]
    assert gains["kp"]["value"] == pytest.approx(servos.KP, rel=0.05)
    assert gains["kd"]["value"] == pytest.approx(servos.KD, rel=0.05)


@pytest.mark.usefixtures("here")
def test_a_known_inertia_tells_the_torque_per_volt(tendon: Run, logs: dict[str, servos.ServoLog]) -> None:
    for known in ("", f"torque_constant = {servos.KT}\n"):
        document, _ = identified(tendon, BRIDGE + known, DRIVE, logs["bridge"])
        gains = document["joints"][0]["drive"]["gains"]
        assert gains["torque_per_volt"]["value"] == pytest.approx(servos.KT / servos.OHM, rel=0.02)
    # Only a known back-EMF takes the motor's braking out of the joint's friction.
    (viscous,) = (e["parameters"]["coefficient"] for e in document["effects"] if e["effect"] == "viscous")
    assert viscous["value"] == pytest.approx(1.14, abs=0.4)


@pytest.mark.usefixtures("here")
def test_without_any_scale_ratios_alone_are_told_and_nothing_is_written(
    tendon: Run, logs: dict[str, servos.ServoLog]
) -> None:
    document, err = identified(tendon, SERVO, NOTHING_KNOWN, logs["servo"])
    gains = document["joints"][0]["drive"]["gains"]
    assert gains["kp"] == {"value": 1.0, "unit": "N m/rad", "interval": None}
    assert gains["kd"]["value"] == pytest.approx(servos.KD / servos.KP, rel=0.03)
    assert gains["kd"]["interval"] is None
    assert "nothing known gives the scale of kp; ratios alone are told" in err
    assert "State kp in the model file, or the inertia or the weight" in err
    known, _ = identified(tendon, servos.SERVO, NOTHING_KNOWN, logs["servo"])
    assert document["joints"][0]["relative"] == pytest.approx(known["joints"][0]["relative"], rel=0.02)
    before = Path("arm.toml").write_text(servos.model(SERVO, NOTHING_KNOWN), encoding="utf-8")
    status, _, err = tendon("identify", "arm.toml", "run.csv", "--write")
    assert status == 2
    assert "nothing is written" in err
    assert len(Path("arm.toml").read_text(encoding="utf-8")) == before


@pytest.mark.usefixtures("here")
def test_a_recording_with_a_torque_gives_the_scale_of_one_without(tendon: Run) -> None:
    Path("arm.toml").write_text(servos.model(SERVO, NOTHING_KNOWN), encoding="utf-8")
    with_torque = servos.servo(None, 2).write(Path("torque.csv"), torque=True)
    command = servos.servo(None, 1).write(Path("run.csv"))
    for order in ((command, with_torque), (with_torque, command)):
        status, _, err = tendon("compare", "arm.toml", *order)
        assert status == 0
        (value,) = re.findall(r"identified kp = ([\d.]+) N m/rad", err)
        assert float(value) == pytest.approx(servos.KP, rel=0.03)


@pytest.mark.usefixtures("here")
def test_inspect_fits_with_the_gains_that_it_finds(tendon: Run, logs: dict[str, servos.ServoLog]) -> None:
    Path("arm.toml").write_text(servos.model(SERVO, DRIVE), encoding="utf-8")
    status, out, _ = tendon("inspect", logs["servo"].write(Path("run.csv")), "arm.toml")
    assert status == 0
    assert "unreliable" not in out


@pytest.mark.usefixtures("here")
def test_gains_that_are_told_are_written(tendon: Run) -> None:
    Path("arm.toml").write_text(servos.model(SERVO, DRIVE), encoding="utf-8")
    clean = servos.servo(None, 1).write(Path("run.csv"))
    status, out, _ = tendon("identify", "arm.toml", clean, "--write")
    assert status == 0
    assert "kp@1, kd@1" in out
    assert "kp = 300.1" in Path("arm.toml").read_text(encoding="utf-8")


@pytest.mark.usefixtures("here")
def test_a_gain_that_an_effect_imitates_is_said_to_be_in_it(tendon: Run, logs: dict[str, servos.ServoLog]) -> None:
    """A servo that is told no rate, and the friction that grows with it."""
    log = logs["servo"]
    still = {**log.columns, "qd1_desired [rad/s]": 0.0 * log.tau}
    _, err = identified(tendon, SERVO, DRIVE, servos.ServoLog(still, log.tau))
    assert "joint 1: kd makes the torque of an effect of the joint, and counts for it" in err


def test_a_late_command_moves_the_gains_until_it_is_named(tendon: Run, here: Path) -> None:
    """Until then, its torque is taken for that of other gains. The improved model file states those that are told."""
    setting = Setting(excitation="brief", drive="servo_open", logger=Logger(every=4))
    (case,) = cases(["delay_of_samples"], [1], [1.0], [42], setting)
    folder, (drive,) = save(case, here), make(case).motors
    status, out, err = tendon("improve", folder / "model.toml", folder / "fit.csv.gz", "--out", "b.toml", "--json", "-")
    assert status in (0, 1), err
    document = json.loads(out)
    assert "torque_delay" in str(document["history"])
    gains = document["joints"][0]["drive"]["gains"]
    assert gains["kp"]["value"] == pytest.approx(drive.kp, rel=0.02)
    assert gains["kd"]["value"] == pytest.approx(drive.kd, rel=0.05)
    (written,) = re.findall(r"kp = ([\d.]+)", Path("b.toml").read_text(encoding="utf-8"))
    assert float(written) == pytest.approx(gains["kp"]["value"], rel=1e-3)


@pytest.mark.slow
@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(("law", "text"), [(SERVO, DRIVE), (SERVO, NOTHING_KNOWN), (BRIDGE, DRIVE)])
def test_the_hidden_effect_is_named_first_whatever_of_the_drive_is_unknown(
    tendon: Run, logs: dict[str, servos.ServoLog], law: str, text: str
) -> None:
    document, _ = identified(tendon, law, text, logs["bridge" if law == BRIDGE else "servo"], verb="diagnose")
    assert document["verdict"] == "effect"
    assert document["findings"][0]["effect"] == "stribeck"


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_stated_masses_tell_the_gains_of_every_joint(tendon: Run) -> None:
    """Of an arm whose joints share inertias, although one of them has an effect that the model lacks."""
    head, *joints = (ARMS / "vishard4.toml").read_text(encoding="utf-8").split("[[joint]]")
    truth = [(200.0 + 50 * k, 10.0 + 3 * k) for k in range(len(joints))]
    for name, gains in (
        ("known.toml", [f"kp = {kp}\nkd = {kd}\n" for kp, kd in truth]),
        ("open.toml", [""] * len(joints)),
    ):
        each = [servos.model(SERVO + gain, joint) for gain, joint in zip(gains, joints, strict=True)]
        Path(name).write_text("[[joint]]".join([head, *each]), encoding="utf-8")
    assert tendon("simulate", "known.toml", "--out", "run.csv", "--hide", "stribeck@2")[0] == 0
    status, out, _ = tendon("compare", "open.toml", "run.csv", "--json", "-")
    assert status == 0
    for joint, (kp, kd) in zip(json.loads(out)["joints"], truth, strict=True):
        gains = joint["drive"]["gains"]
        assert gains["kp"]["value"] == pytest.approx(kp, rel=0.03)
        assert gains["kd"]["value"] == pytest.approx(kd, rel=0.05)
