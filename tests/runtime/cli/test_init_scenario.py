"""A task begun from points: what is written is planned at once, and what cannot be is refused when it is typed."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest

from runtime.documents import verbs
from tests.runtime.conftest import Refused, Run

SWING = ("--from", "0,0,0,0", "--to", "0,0,0,-1.5707963", "--duration", "1.2")


def planned(tendon: Run, scenario: str = "task.toml") -> dict:
    status, _, err = tendon("optimize", scenario, "--out", "plan.json", "--json", "planned.json")
    assert status == 0, err
    return json.loads(Path("planned.json").read_text())


def test_joint_angles_make_a_plan_and_the_others_are_held(tendon: Run) -> None:
    """The optimum is inside of the proposed bounds, and as good as that of the paper's scenario with its own spring."""
    assert tendon("init", "--scenario", "vishard4", *SWING, "--springs", "4")[0] == 0
    asked = tomllib.loads(Path("task.toml").read_text())
    assert (asked["moving"], asked["posture"], asked["friction"]) == ([4], [0.0] * 4, True)
    found = planned(tendon)
    (spring,), (sought,) = found["springs"], asked["spring"]
    low, high = sought["stiffness"]
    assert 1.05 * low < spring["stiffness"] < 0.95 * high
    papers = tomllib.loads((Path(__file__).parents[3] / "runtime/study/scenario1.toml").read_text())
    assert papers["points"]["turn"]["q4"] == pytest.approx(asked["points"]["end"]["q4"], abs=1e-6)
    assert tendon("optimize", "scenario1", "--json", "paper.json")[0] == 0
    joint = json.loads(Path("paper.json").read_text())["joints"][3]
    assert found["joints"][3]["cost"] == pytest.approx(joint["cost"], rel=0.02)
    assert found["objective"]["value"] < 0.75 * found["objective"]["without_springs"]
    assert tendon("execute", "vishard4", "plan.json", "--on", "simulation", "--trials", "1")[0] == 0


def test_a_place_of_the_tip_in_space_once_and_a_point_on_the_way(tendon: Run) -> None:
    Path("arms").mkdir()
    assert tendon("init", "--controller", "panda", "--out", "arms/mine.toml")[0] == 0
    task = ("--from", "0,-0.5,0,-2,0,1.5,0", "--via", "tip=0.45,0.1,0.6", "--to", "tip=0.4,0.3,0.4")
    asked = ("--duration", "4", "--springs", "2,4", "--once", "--out", "reach.toml", "--json", "said.json")
    status, out, err = tendon("init", "--scenario", "arms/mine.toml", *task, *asked)
    assert status == 0, err
    assert "tendon optimize reach.toml --out plan.json" in out
    said = json.loads(Path("said.json").read_text())
    jsonschema.Draft202012Validator(verbs.schema("init")).validate(said)
    assert (said["model"], said["springs"], list(said["points"])) == (
        "arms/mine.toml",
        [2, 4],
        ["start", "via_1", "end"],
    )
    assert not tomllib.loads(Path("reach.toml").read_text())["periodic"]
    planned(tendon, "reach.toml")
    # A scenario elsewhere names the model from its own folder.
    Path("tasks").mkdir()
    assert tendon("init", "--scenario", "arms/mine.toml", *task, *asked[:-4], "--out", "tasks/t.toml")[0] == 0
    assert tomllib.loads(Path("tasks/t.toml").read_text())["model"] == "../arms/mine.toml"


def test_a_plate_is_touched_and_pressed(tendon: Run) -> None:
    task = (
        "--from",
        "0.1,-0.5,-1.8,-1",
        "--to",
        "tip=0.205,-0.49",
        "--plate",
        "--duration",
        "1.6",
        "--springs",
        "none",
    )
    assert tendon("init", "--scenario", "vishard4", *task)[0] == 0
    asked = tomllib.loads(Path("task.toml").read_text())
    assert [phase.get("kind", "free") for phase in asked["phase"]] == ["free", "contact", "contact", "free"]
    assert (asked["elbow"], asked["points"]["touch"]["tip"]) == (-1, [0.205, -0.46])
    found = planned(tendon)
    x, y, _ = found["samples"]["tip"]
    assert min(y) == pytest.approx(-0.49, abs=2e-3)
    pressed = [at for at, height in zip(x, y, strict=True) if height < -0.461]
    assert pressed == pytest.approx([0.205] * len(pressed), abs=1e-4)


def test_friction_without_values_is_left_out_of_the_plan(tendon: Run) -> None:
    tendon("init", "--like", "vishard4", "--out", "mine.toml")
    text = Path("mine.toml").read_text().replace("coefficient = 2.53", "# coefficient =")
    Path("mine.toml").write_text(text)
    assert tendon("init", "--scenario", "mine.toml", *SWING, "--springs", "none")[0] == 0
    assert tomllib.loads(Path("task.toml").read_text())["friction"] is False


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--from", "0,0,0,0"], "--to is needed: where it turns or ends"),
        (["--from", "0,0,0", "--to", "0,0,0,1"], "expected 4 numbers, a position for each joint, rad or m; or tip=X,Y"),
        (["--from", "tip=0.1,0.2,0.3"], "expected 2 numbers, x and y of the tip, m"),
        (["--from", "nan,0,0,0"], "expected 4 numbers"),
        (["--from", "__import__('os'),0,0,0"], "expected 4 numbers"),
        (["--from", "tip=3,0"], "the tip comes no nearer than"),
        ([*SWING[:4], "--duration", "-1"], "expected the duration of the whole motion"),
        ([*SWING, "--springs", "9"], "there is no joint 9"),
        ([*SWING, "--springs", "4,4"], "names a joint twice"),
        ([*SWING, "--springs", "2"], "joint 2 does not move; expected some of 4"),
        ([*SWING, "--springs", "none", "--plate"], "--to is pressed into it; expected tip=0.205,Y with Y below -0.46"),
        (["--from", "0,0,0,0", "--to", "0,0,0,0", "--duration", "1", "--springs", "none"], "the points are the same"),
        ([*SWING, "--springs", "4", "--out", "there.toml"], "there.toml: already exists"),
        ([*SWING, "--springs", "4", "--joints", "r"], "leave out the options of a new arm"),
        ([*SWING, "--springs", "4", "--controller", "drive"], "two steps"),
    ],
)
def test_mistakes_are_one_line_and_write_nothing(refused: Refused, arguments: list[str], message: str) -> None:
    Path("there.toml").write_text("as it was")
    assert message in refused("init", "--scenario", "vishard4", *arguments)
    assert [(p.name, p.read_text()) for p in Path().iterdir()] == [("there.toml", "as it was")]


def test_options_of_a_task_need_a_model_and_an_arm_without_inertias_says_what_to_do(tendon: Run) -> None:
    assert tendon("init", "--from", "0")[2] == "the options of a task need --scenario MODEL\n"
    status, _, err = tendon("init", "--scenario", "ur10", "--from", "0,0,0,0,0,0")
    assert (status, err.count("\n")) == (2, 1)
    assert "tendon init --controller MODEL" in err
    assert "belongs to planar arms" not in err
    assert not list(Path().iterdir())
