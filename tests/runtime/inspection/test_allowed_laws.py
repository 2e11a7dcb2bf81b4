"""Which laws of a drive inspect finds in the columns, in words and in JSON, and what the other verbs ask for."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import one_joint
from tests.runtime.conftest import Run

REAL = Path(__file__).parents[4] / "shared" / "data" / "real"
T = np.arange(600) / 100
MODEL = one_joint.model_text("[joint.effects.viscous]\n", "servo")
NOISE = 1e-4 * np.random.default_rng(1).normal(size=(2, len(T)))
SIGNALS = {
    "q1": np.sin(2 * T) + NOISE[0],
    "q1_desired": np.sin(2 * T + 0.1) + NOISE[1],
    "tau1": np.cos(2 * T),
    "current1": np.cos(2 * T),
    "duty1": 0.3 * np.cos(2 * T),
    "voltage1": 3 * np.cos(2 * T),
    "bus_voltage1": 7 + 0 * T,
}


def recorded(path: Path, *names: str) -> Path:
    columns = {"t": T} | {name: SIGNALS[name] for name in names}
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


def inspected(tendon: Run, path: Path, *more: Path) -> Mapping[str, Any]:
    found: Mapping[str, Any] = json.loads(tendon("inspect", path, *more, "--json", "-")[1])
    return found


def laws(document: Mapping[str, Any]) -> dict[str, list[list[str]]]:
    return {entry["law"]: entry["needs"] for entry in document["drive_laws"]}


PER_VOLT = [["torque_per_volt"], ["torque_constant", "resistance"]]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["tau1"], {"torque": []}),
        (["current1"], {"current": [["torque_constant"]]}),
        (["voltage1"], {"voltage": PER_VOLT}),
        (["duty1", "bus_voltage1"], {"pwm": PER_VOLT}),
        (["duty1", "voltage1"], {"pwm": PER_VOLT}),
        (["duty1", "voltage1", "bus_voltage1"], {"voltage": PER_VOLT, "pwm": PER_VOLT}),
        (["q1_desired"], {"position_servo": [["kp"]]}),
        (["tau1", "q1_desired"], {"torque": [], "position_servo": [["kp"]]}),
        (["tau1", "duty1"], {"torque": [], "pwm": [[*keys, "bus_voltage"] for keys in PER_VOLT]}),
    ],
)
def test_laws_by_columns(tmp_path: Path, tendon: Run, names: list[str], expected: Any) -> None:
    document = inspected(tendon, recorded(tmp_path / "a.csv", "q1", *names))
    assert document["problem"] is None
    assert laws(document) == expected


def test_the_same_in_words(tmp_path: Path, tendon: Run) -> None:
    path = recorded(tmp_path / "a.csv", "q1", "q1_desired", "duty1", "voltage1")
    status, said, _ = tendon("inspect", path)
    assert status == 0
    assert "no torque is recorded, and no law of a drive is stated" in said
    expected = "pwm from duty, voltage (needs torque_per_volt or torque_constant and resistance); position_servo"
    assert f"Drive laws for joint 1: {expected} from q_desired (needs kp)" in " ".join(said.split())
    assert "Drive laws" not in tendon("inspect", recorded(tmp_path / "b.csv", "q1", "tau1"))[1]


def test_a_model_without_a_law_is_told_what_to_add(tmp_path: Path, tendon: Run) -> None:
    """inspect shows the file all the same; the other verbs say the same line."""
    (tmp_path / "servo.toml").write_text(MODEL, encoding="utf-8")
    path = recorded(tmp_path / "a.csv", "q1", "q1_desired")
    asked = "no column tau1 (the model has 1 joint); its columns are those of a drive: add [joint.drive] with "
    asked += 'law = "position_servo" to joint 1 of the model file'
    document = inspected(tendon, path, tmp_path / "servo.toml")
    assert asked in document["problem"]
    assert laws(document) == {"position_servo": [["kp"]]}
    assert [entry["signal"] for entry in document["signals"]] == ["q1", "q1_desired"]
    for verb in ("identify", "compare", "diagnose"):
        status, _, err = tendon(verb, tmp_path / "servo.toml", path)
        assert status == 2
        assert asked in err
    with_law = MODEL.replace("[joint.link]", '[joint.drive]\nlaw = "position_servo"\nkp = 3.0\nkd = 0.1\n[joint.link]')
    (tmp_path / "servo.toml").write_text(with_law, encoding="utf-8")
    assert inspected(tendon, path, tmp_path / "servo.toml")["problem"] is None


def test_positions_alone(tmp_path: Path, tendon: Run) -> None:
    """What is there is not suggested again, and what would help is said."""
    path = tmp_path / "a.csv"
    steps = np.column_stack([T, 2048 + np.round(600 * np.sin(2 * T))])
    np.savetxt(path, steps, "%.6g", delimiter=",", header="Time,Present Position", comments="")
    document = inspected(tendon, path)
    expected = "record the torque, or what the drive is told: current1, voltage1, duty1, q1_desired"
    assert document["problem"].endswith(expected)
    assert (document["suggested"], document["drive_laws"]) == ([], [])


def test_a_made_torque_that_brakes_is_no_sign_to_turn(tmp_path: Path, tendon: Run) -> None:
    rows = np.column_stack([T, np.sin(2 * T), np.sin(2 * T - 0.1)])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="t,q1,q1_desired", comments="")
    assert inspected(tendon, tmp_path / "a.csv")["cures"] == []


@pytest.mark.parametrize(
    ("name", "expected", "joints"), [("xl330", {"pwm", "position_servo"}, 1), ("go2", {"position_servo"}, 3)]
)
def test_commands_of_real_machines(tendon: Run, name: str, expected: set[str], joints: int) -> None:
    path = REAL / name / "command_held.csv.gz"
    if not path.is_file():
        pytest.skip("../shared/data/real is not there")
    document = inspected(tendon, path)
    assert document["problem"] is None
    assert set(laws(document)) == expected
    assert {entry["joint"] for entry in document["drive_laws"]} == set(range(1, joints + 1))
