"""An arm whose file leaves numbers out is simulated with likely ones, and every one of them is said."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from runtime.cli import output
from runtime.cli.main import app
from runtime.exchange.bodies import is_possible
from runtime.workspace.source import Source
from symbolic.model_file.frames import parameters
from symbolic.model_file.likely import likely_arm, likely_bodies

BARE = """
name = "bare"
gravity = [0.0, 0.0, -9.81]
[[joint]]
type = "revolute"
gear_ratio = 100
origin = { xyz = [0.0, 0.0, 0.1], rpy = [0.0, 0.0, 0.0] }
axis = [0.0, 0.0, 1.0]
[joint.limits]
torque = 50.0
[joint.link]
[[joint]]
type = "prismatic"
gear_ratio = 1
origin = { xyz = [0.4, 0.0, 0.0], rpy = [0.0, 0.0, 0.0] }
axis = [1.0, 0.0, 0.0]
[joint.link]
mass = 2.0
com = [0.0, 0.0, 0.0]
inertia = [0.01, 0.0, 0.0, 0.01, 0.0, 0.01]
[joint.effects.viscous]
[tip]
origin = { xyz = [0.2, 0.0, 0.0], rpy = [0.0, 0.0, 0.0] }
"""


def test_an_unknown_arm_is_simulated_and_says_what_was_assumed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The recording is read again for the file as it is; a stated number is never changed."""
    model, run, told = tmp_path / "bare.toml", tmp_path / "run.csv.gz", tmp_path / "told.json"
    model.write_text(BARE)
    assert output.run(app, ["simulate", str(model), "--out", str(run), "--seconds", "10", "--json", str(told)]) == 0
    said = {(a["joint"], a["parameter"]): a["value"] for a in json.loads(told.read_text())["assumed"]}
    assert set(said) == {(1, "mass"), (1, "com"), (1, "inertia"), (1, "rotor_inertia"), (2, "rotor_inertia")}
    assert said[1, "rotor_inertia"] == pytest.approx(50.0 / 100.0)
    assert said[2, "rotor_inertia"] == 2.0
    printed = capsys.readouterr().out
    assert "Not in the model file, and assumed" in printed
    assert "joint 2: rotor_inertia 2 kg (as much as its link)" in printed
    assert np.isfinite(Source.read(model, None).recordings([run])[0].tau).all()


def test_assumed_bodies_are_possible_and_stated_numbers_stay(tmp_path: Path) -> None:
    model = tmp_path / "bare.toml"
    model.write_text(BARE)
    arm = Source.read(model, None).arm()
    full, numbers = likely_arm(arm)
    assert not any(joint.unknown for joint in full.joints)
    assert [number.parameter for number in numbers if number.joint == 2] == ["rotor_inertia"]
    assert full.joints[1].link == arm.joints[1].link
    assert all(is_possible(np.array(parameters(body))) for body in likely_bodies(arm))
    assert likely_arm(full) == (full, ())


def test_a_file_that_states_everything_is_taken_as_it_is() -> None:
    known = Source.shipped("vishard4").compiled
    assert known.with_likely_numbers() == (known, [])


def test_friction_without_values_follows_the_largest_torque(tmp_path: Path) -> None:
    """A joint that hardly carries anything rubs by its drive's size: 5 % of the largest torque, RMS."""
    from runtime.simulation.simulate import simulate

    model = tmp_path / "light.toml"
    model.write_text(BARE.replace("[joint.link]\n[[", "[joint.link]\n[joint.effects.coulomb]\n[["))
    arm, _ = Source.read(model, None).compiled.with_likely_numbers()
    values = simulate(arm.model())[1]
    found = next(v for term, v in values.items() if term.effect == "coulomb")
    assert 0.04 * 50.0 < found["torque"] < 0.08 * 50.0
