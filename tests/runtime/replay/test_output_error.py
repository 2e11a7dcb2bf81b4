"""Parameters by the motion: a servo written apart, whose coarse encoder is on both sides of the torque's equation."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import servos

from runtime.workspace.source import Source

Run = Callable[..., tuple[int, str, str]]
STEP = 2 * np.pi / 4096
"""rad; of the encoder of a bus servo, at its output."""
UNKNOWN = 'law = "position_servo"\n'


def coarse(seed: int, path: Path) -> Path:
    """A log of the servo at 100 Hz, without its rate, from a coarse encoder."""
    log = servos.servo(None, seed, every=10)
    columns = {cell: x for cell, x in log.columns.items() if cell != "qd1 [rad/s]"}
    columns["q1 [rad]"] = np.round(columns["q1 [rad]"] / STEP) * STEP
    return servos.ServoLog(columns, log.tau).write(path)


def test_the_motion_tells_gains_and_friction(tendon: Run, tmp_path: Path) -> None:
    """The gain is unknown, the inertia is stated; Coulomb friction 1.72 and 1.05 N m, viscous 1.14 N m s/rad."""
    model = tmp_path / "servo.toml"
    model.write_text(servos.model(UNKNOWN, Source.shipped("drive").text))
    coarse(1, tmp_path / "a.csv")
    coarse(2, tmp_path / "b.csv")
    (tmp_path / "plain.toml").write_text(model.read_text())
    assert tendon("identify", "plain.toml", "a.csv", "--write")[0] == 0
    status, out, _ = tendon("identify", "servo.toml", "a.csv", "--output-error", "--write", "--json", "said.json")
    assert status == 0
    assert "Refined by the motion" in out
    said = json.loads((tmp_path / "said.json").read_text())["output_error"]
    assert said["better"]
    by_name = {p["name"]: p for p in said["parameters"]}
    truth = {
        "kp": servos.KP,
        "kd": servos.KD,
        "coulomb_asymmetric: positive": 1.72,
        "coulomb_asymmetric: negative": 1.05,
        "viscous: coefficient": 1.14,
    }
    off = {name: abs(by_name[name]["after"] / value - 1) for name, value in truth.items()}
    assert all(error < 0.02 for error in off.values()), off
    assert all(low < truth[name] < high for name in truth for low, high in [by_name[name]["interval"]]), by_name
    written = re.search(r"kp = ([\d.]+)\nkd", model.read_text())
    assert written is not None
    assert float(written[1]) == pytest.approx(by_name["kp"]["after"], rel=1e-5)
    tendon("replay", "servo.toml", "b.csv", "--before", "plain.toml", "--json", "replayed.json")
    steps = json.loads((tmp_path / "replayed.json").read_text())["steps"]
    before, after = (step["joints"][0]["closed_loop"]["rms"] for step in steps)
    assert after < before


def test_a_fit_that_is_refused_is_not_refined(tendon: Run, tmp_path: Path) -> None:
    t = np.arange(0, 4, 0.001)
    rows = np.column_stack([t, 0.0 * t, 0.0 * t])
    np.savetxt(tmp_path / "still.csv", rows, delimiter=",", header="t [s],q1 [rad],tau1 [N m]", comments="")
    status, _, _ = tendon("identify", "drive", "still.csv", "--output-error")
    assert status in (1, 2)


def test_a_right_fit_stays_right(tendon: Run, tmp_path: Path) -> None:
    """At 1 kHz with a fine encoder, both errors say the same."""
    (tmp_path / "servo.toml").write_text(servos.model(servos.SERVO, Source.shipped("drive").text))
    servos.servo(None, 3).write(tmp_path / "a.csv")
    status, _, _ = tendon("identify", "servo.toml", "a.csv", "--output-error", "--json", "said.json")
    assert status == 0
    found = json.loads((tmp_path / "said.json").read_text())["output_error"]
    for entry in found["parameters"]:
        assert entry["after"] == pytest.approx(entry["before"], rel=0.01)
    assert found["search"]["ended"] == "complete"
    status, out, _ = tendon("identify", "servo.toml", "a.csv", "--output-error", "--budget", "1")
    assert status == 1
    assert "The search was cut after 1 iterations by its budget of 1" in out
    status, _, err = tendon("identify", "servo.toml", "a.csv", "--budget", "1")
    assert status == 2
    assert "--budget and --time-limit are of the search of --output-error" in err
