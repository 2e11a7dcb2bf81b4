"""Joints by the names that the model file gives them, wherever the command line takes a joint; numbers as ever."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from runtime.experiments.asking import parse_rivals
from runtime.notebook import verbs
from runtime.notebook.arm import load
from runtime.sweep import grid
from runtime.workspace.source import Source
from symbolic.effects import LIBRARY
from tests import one_joint
from tests.runtime.conftest import Refused, Run

NAMES = ("shoulder", "1", "left:wrist")
"""One that looks like another joint's number, one with a colon of its own."""
ARM = 'name = "named"\ngravity = [0.0, 0.0]\n' + "".join(
    one_joint.joint_text().replace("[[joint]]", f'[[joint]]\nname = "{name}"') for name in NAMES
)
SCENARIO = """\
name = "swing"
model = "arm.toml"
cycle_time = 1.2
[points.home]
q1 = 0.0
q2 = 0.0
q3 = 0.0
rest = true
[points.turn]
q1 = 1.0
rest = true
[[phase]]
from = "home"
to = "turn"
part = 0.5
degree = 5
[[phase]]
from = "turn"
to = "home"
part = 0.5
degree = 5
"""


@pytest.fixture
def run(tendon: Run, tmp_path: Path) -> Run:
    """`tendon ARGUMENTS` in a folder with arm.toml."""
    (tmp_path / "arm.toml").write_text(ARM)
    return tendon


@pytest.mark.parametrize(("said", "joint"), [("shoulder", 1), ("1", 1), ("2", 2), ("left:wrist", 3), ("3", 3)])
def test_what_is_hidden_may_stand_at_a_joint_by_its_name(run: Run, said: str, joint: int) -> None:
    """A number is one, whatever the joints are called; files and JSON have numbers."""
    hide = ("--hide", f"stribeck@{said}:torque=0.6,speed=0.15", "--json", "-", "--seconds", "5")
    status, out, _ = run("simulate", "arm.toml", "--out", "run.csv", *hide)
    assert status == 0
    hidden = [(e["effect"], e["joint"], e["values"]) for e in json.loads(out)["effects"] if e["hidden"]]
    assert hidden == [("stribeck", joint, {"torque": 0.6, "speed": 0.15})]


def test_an_effect_is_added_by_a_name_as_by_a_number(run: Run) -> None:
    status, out, _ = run("add", "arm.toml", "stribeck", "--joint", "left:wrist", "--json", "-")
    assert (status, json.loads(out)["added"]) == (0, "stribeck@3")
    by_name = Path("arm.toml").read_text()
    Path("arm.toml").write_text(ARM)
    assert verbs.add(load("arm.toml"), "stribeck", "left:wrist").text == by_name
    assert run("add", "arm.toml", "stribeck", "--joint", "3")[0] == 0
    assert Path("arm.toml").read_text() == by_name


def test_rivals_may_stand_at_joints_by_their_names(run: Run) -> None:  # noqa: ARG001 - a folder with arm.toml
    model = Source.read(Path("arm.toml"), None).compiled.model()
    by_name = "elasticity@left:wrist:stiffness=3000,damping=2,torque_delay@shoulder,coupled_friction@1"
    by_number = "elasticity@3:stiffness=3000,damping=2,torque_delay@1,coupled_friction@1"
    assert parse_rivals(by_name, model) == parse_rivals(by_number, model)


def test_springs_that_vary_may_be_named_by_their_joints() -> None:
    for said, axis in (("left:wrist", "stiffness@3"), ("2", "stiffness@2")):
        (found,) = grid.parse([f"stiffness@{said}=5100,5900"], LIBRARY, NAMES)
        assert (found.name, found.values) == (axis, (5100.0, 5900.0))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("simulate", "arm.toml", "--out", "x", "--hide", "stribeck@elbow"),
            '--hide stribeck@elbow: found joint "elbow"',
        ),
        (("simulate", "arm.toml", "--out", "x", "--hide", "stribeck@9"), 'found joint "9"'),
        (("simulate", "arm.toml", "--out", "x", "--hide", f"stribeck@{'9' * 5000}"), "found joint"),
        (("simulate", "arm.toml", "--out", "x", "--hide", "stribeck@left:speed=1"), 'found joint "left"'),
        (("experiment", "arm.toml", "--between", "stribeck@elbow"), '--between stribeck@elbow: found joint "elbow"'),
        (
            ("execute", "arm.toml", "x", "--on", "simulation", "--set", "viscous@elbow:coefficient=1"),
            'found joint "elbow"',
        ),
        (("simulate", "arm.toml", "--out", "x", "--hide", "coupled_friction@elbow"), 'found joint "elbow"'),
        (("add", "arm.toml", "stribeck", "--joint", "elbow"), "arm.toml: there is no joint elbow"),
        (
            ("sweep", "swing.toml", "--table", "x.csv", "--over", "stiffness@elbow=5100,5900"),
            '--over stiffness@elbow=5100,5900: there is no joint "elbow"',
        ),
    ],
)
def test_an_unknown_name_is_one_line_with_those_that_are_known(
    refused: Refused, arguments: tuple[str, ...], message: str
) -> None:
    Path("arm.toml").write_text(ARM)
    Path("swing.toml").write_text(SCENARIO)
    said = refused(*arguments)
    assert message in said
    first = "coupled_friction@elbow" in arguments
    known = "2 or a name: shoulder as the first of the two" if first else "3 or a name: shoulder, left:wrist"
    assert f"expected 1 to {known}" in said
    assert {path.name for path in Path().iterdir()} == {"arm.toml", "swing.toml"}
