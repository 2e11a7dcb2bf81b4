"""`tendon import`, as it is typed: what it writes, what it says, and what it refuses without writing anything."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from runtime.notebook import exchanged
from symbolic.model_file import reader
from tests.runtime.conftest import Refused, Run

ROBOTS = Path(__file__).resolve().parents[2] / "robots"
UR10, PANDA = ROBOTS / "ur10_robot.urdf", ROBOTS / "panda.urdf"


def test_a_ur10_is_one_line_away(tendon: Run) -> None:
    status, out, err = tendon("import", UR10, "--out", "ur10.toml")
    assert (status, err) == (0, "")
    assert out.startswith("ur10.toml: ur10, 6 joints from world to tool0\n")
    assert "shoulder_pan_joint" in out
    assert "the arm ends at tool0; ee_link ends at the same joint (--tip LINK for another)\n" in out
    assert "  tendon improve ur10.toml RECORDING --held-out ANOTHER\n" in out
    arm = reader.load("ur10.toml")
    assert arm.space
    assert len(arm.joints) == 6


def test_no_equation_is_needed(tmp_path: Path) -> None:
    """A fresh process, as its imports are what is asked about, with nothing prepared."""
    script = (
        "import sys; from runtime.cli import output; from runtime.cli.main import app; "
        f"status = output.run(app, ['import', {str(UR10)!r}, '--out', 'ur10.toml']); "
        "sys.exit(status or 3 * ('sympy' in sys.modules))"
    )
    environment = os.environ | {"TENDON_CACHE": str(tmp_path / "cache")}
    subprocess.run([sys.executable, "-c", script], cwd=tmp_path, env=environment, check=True, capture_output=True)


def test_figures_are_in_the_json_alone(tendon: Run) -> None:
    status, out, _ = tendon("import", PANDA, "--tip", "panda_hand_tcp", "--out", "panda.toml", "--json", "-")
    document = json.loads(out)
    assert status == 0
    assert (document["base"], document["tip"], document["language"]) == ("panda_link0", "panda_hand_tcp", "URDF")
    assert document["held"] == ["panda_finger_joint1", "panda_finger_joint2"]
    assert [joint["unknown"] for joint in document["joints"]] == [["rotor_inertia"]] * 7
    assert any("placeholder" in note for note in document["notes"])


def test_nothing_is_written_over(tendon: Run, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("precious")
    status, out, err = tendon("import", UR10, "--out", "mine.toml")
    assert (status, out, err) == (2, "", "mine.toml: already exists; choose another name\n")
    copy = tmp_path / "copy.urdf"
    copy.write_bytes(UR10.read_bytes())
    assert tendon("import", copy, "--out", copy)[0] == 2
    assert copy.read_bytes() == UR10.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            (PANDA,),
            '3 links end the chains from "panda_link0": panda_hand_tcp, panda_leftfinger, panda_rightfinger; choose',
        ),
        ((UR10, "--lock", "elbow_joint"), "--lock elbow_joint: expected JOINT=VALUE with a number in rad or m"),
        ((UR10, "--lock", "elbow_joint=inf"), "--lock elbow_joint=inf: expected JOINT=VALUE with a number"),
        ((UR10, "--lock", "elbow_joint=1", "--lock", "elbow_joint=2"), "--lock elbow_joint: given twice"),
        ((UR10, "--lock", "elbow=1"), '--lock elbow: no such joint; did you mean "elbow_joint"?'),
        ((UR10, "--tip", "tool"), '--tip tool: no such link; did you mean "tool0"?'),
        (("absent.urdf",), "absent.urdf: no such file; expected a URDF or MJCF file"),
        ((ROBOTS,), "is a directory; expected a URDF or MJCF file"),
    ],
)
def test_mistakes_are_one_line_and_nothing_is_written(refused: Refused, arguments: tuple, message: str) -> None:
    assert message in refused("import", *arguments, "--out", "new.toml")
    assert not Path("new.toml").exists()


def test_an_arm_without_friction_and_with_a_held_joint(tendon: Run) -> None:
    asked = ("--no-friction", "--lock", "elbow_joint=0.5", "--base", "base_link", "--tip", "wrist_2_link")
    assert tendon("import", UR10, *asked, "--out", "short.toml")[0] == 0
    arm = reader.load("short.toml")
    assert [joint.name for joint in arm.joints] == [
        *("shoulder_pan_joint", "shoulder_lift_joint", "wrist_1_joint", "wrist_2_joint")
    ]
    assert not any(joint.effects for joint in arm.joints)


def test_what_was_snapped_is_said_by_every_verb_that_opens_the_file(tendon: Run, tmp_path: Path) -> None:
    tendon("import", UR10, "--out", "ur10.toml")
    text = (tmp_path / "ur10.toml").read_text().replace("1.5707963267948966", "1.5708")
    (tmp_path / "rounded.toml").write_text(text)
    status, out, err = tendon("init", "--like", "rounded.toml", "--out", "like.toml", "--json", "-")
    assert (status, json.loads(out)["joints"]) == (0, 6)
    assert err.startswith("rounded.toml: taken as exact quarter turns: the angles of joints 2, 4")
    assert err.count("\n") == 1


def test_in_a_notebook(tendon: Run) -> None:  # noqa: ARG001 - an empty folder
    arm = exchanged.import_(UR10, tip="tool0", lock={"wrist_3_joint": 0.1})
    assert any(note.startswith("the rotor's inertia of all joints") for note in arm.notes)
    arm.save("five.toml")
    assert len(reader.load("five.toml").joints) == 5
    with pytest.raises(ValueError, match="no such link"):
        exchanged.import_(UR10, tip="tool7")
