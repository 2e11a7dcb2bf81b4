"""From an arm to its missing effect, by what a user types: a motion is designed, played by the compiled controller on
an arm that hides an effect, and the recording names it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from runtime.cli import output
from runtime.cli.main import app


def typed(*arguments: object) -> Any:
    """The document of a command that succeeds."""
    status = output.run(app, [*map(str, arguments), "--json", "said.json"])
    assert status == 0, arguments
    return json.loads(Path("said.json").read_text())


def excite(arm: str, *asked: object) -> str:
    """Motions motion.csv and check.csv; the arm's model with a controller."""
    model = arm
    if arm != "vishard4":
        typed("init", "--controller", arm, "--out", "arm.toml")
        model = "arm.toml"
    designed = typed("experiment", model, "--out", "motion.csv", "--held-out", "check.csv", *asked)
    assert designed["unchecked"]
    return model


def record(model: str, hidden: str, name: str) -> dict[str, float]:
    """Into NAME.rec.csv; the values of what was hidden."""
    played = typed("execute", model, f"{name}.csv", "--on", "simulation", "--hide", hidden, "--out", f"{name}.rec.csv")
    assert played["status"] == "done"
    assert played["unchecked"][0].startswith("People")
    values: dict[str, float] = next(effect["values"] for effect in played["effects"] if effect["hidden"])
    return values


def check_named(model: str, hidden: str) -> None:
    run, check = "motion.rec.csv", "check.rec.csv"
    values = record(model, hidden, "motion")
    # The same arm again: without values, moderate ones are chosen for each motion.
    record(model, f"{hidden}:{','.join(f'{name}={value}' for name, value in values.items())}", "check")
    found = typed("improve", model, run, "--held-out", check)
    assert [step["added"] for step in found["history"]] == [None, hidden]
    assert (found["verdict"], {joint["verdict"] for joint in found["joints"]}) == ("effect", {"clean"})
    joint = int(hidden.partition("@")[2]) - 1
    before, after = (step["held_out"][joint] for step in found["history"])
    assert after < 0.7 * before


def test_what_is_hidden_in_a_drive_is_named(here: None) -> None:  # noqa: ARG001
    check_named(excite("drive", "--seconds", 20), "stribeck@1")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "hidden", "asked"),
    [
        ("drive", "load_friction@1", ("--seconds", 30)),
        ("vishard4", "load_friction@2", ("--seconds", 30)),
        ("emps", "friction_patch@1", ("--seconds", 30)),
        ("ur10", "stribeck@3", ()),
        ("panda", "stribeck@2", ()),
    ],
)
def test_what_is_hidden_in_every_arm_is_named(here: None, arm: str, hidden: str, asked: tuple[object, ...]) -> None:  # noqa: ARG001
    check_named(excite(arm, *asked), hidden)
