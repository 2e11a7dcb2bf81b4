"""A model file begun from nothing: by options, out of a URDF; it loads, and nothing in it is invented."""

from __future__ import annotations

import json
import re
import tomllib
from functools import partial
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from runtime.cli import output
from runtime.cli import schema as schemas
from runtime.cli.main import app
from runtime.workspace.names import ARMS
from symbolic.model_file import reader
from tests.runtime.conftest import Refused, Run

ROBOTS = Path(__file__).resolve().parents[2] / "robots"


@pytest.fixture
def init(tendon: Run) -> Run:
    """`tendon init` with these options."""
    return partial(tendon, "init")


def test_options_make_a_planar_arm(init: Run) -> None:
    """The motors' values are carried to the joints' output."""
    options = ("--joints", "r,p", "--plane", "--gravity", "0,0", "--length", "0.3, 0.25", "--gear-ratio", "100, 500")
    options += ("--torque-constant", "0.05, ?", "--torque", "command", "--mass", "2,?")
    status, out, err = init("--out", "bench.toml", *options)
    assert (status, err) == (0, "")
    assert out.splitlines() == [
        "bench.toml: bench, 2 joints",
        "joint 1: com, inertia, rotor_inertia unknown",
        "joint 2: mass, com, inertia, rotor_inertia unknown",
    ]
    arm = reader.load(Path("bench.toml"))
    assert not arm.space
    assert arm.torque == "command"
    one, two = arm.joints
    assert (arm.name, arm.gravity, one.type, two.type) == ("bench", (0.0, 0.0, 0.0), "revolute", "prismatic")
    assert (one.gear_ratio, one.torque_constant, one.rotor_inertia) == (100.0, 5.0, None)
    assert (arm.lengths, one.link.mass) == ((0.3, 0.25), 2.0)
    assert (two.gear_ratio, two.torque_constant, two.rotor_inertia, two.link.mass) == (500.0, None, None, None)
    assert all(set(j.effects) == {"coulomb_asymmetric", "viscous"} and not any(j.effects.values()) for j in arm.joints)


def test_a_number_of_joints_is_enough(init: Run) -> None:
    assert init("--joints", "2", "--out", "wrist.toml", "--json", "said.json")[0] == 0
    arm = reader.load(Path("wrist.toml"))
    assert arm.space
    assert (arm.name, arm.gravity, [j.type for j in arm.joints]) == ("wrist", (0.0, 0.0, -9.81), ["revolute"] * 2)
    assert arm.joints[0].gear_ratio == 1.0
    said = json.loads(Path("said.json").read_text())
    assert said["unknown"] == [["mass", "com", "inertia", "rotor_inertia"]] * 2


@pytest.mark.parametrize("options", [("--joints", "r,p", "--space"), ("--joints", "p,r", "--plane", "--length", "0.2")])
def test_commented_keys_are_keys_of_the_model_file(init: Run, options: tuple[str, ...]) -> None:
    """Each can be filled in where it stands."""
    assert init(*options, "--out", "new.toml")[0] == 0
    text = Path("new.toml").read_text()
    values = {
        **dict.fromkeys(("mass", "rotor_inertia", "torque_constant", "speed", "torque"), "2.0"),
        "position": "[-1.0, 1.0]",
        "com": "[0.0, 0.0, 0.1]" if "--space" in options else "[0.1, 0.0]",
        "inertia": "[1.0, 0.0, 0.0, 1.0, 0.0, 1.0]" if "--space" in options else "1.0",
    }
    text = re.sub(r"^# (\w+) = *#", lambda key: f"{key[1]} = {values[key[1]]}   #", text, flags=re.MULTILINE)
    Path("new.toml").write_text(text.replace("# [joint.limits]", "[joint.limits]"))
    joints = reader.load(Path("new.toml")).joints
    assert not any(joint.unknown for joint in joints)
    assert all((j.torque_constant, j.limits.position, j.limits.torque) == (2.0, (-1.0, 1.0), 2.0) for j in joints)


def test_one_number_is_for_all_joints_and_friction_can_be_left_out(init: Run) -> None:
    options = ("--joints", "r,r", "--plane", "--gear-ratio", "100,80", "--length", "0.3,0.2", "--mass", "2,?")
    status, out, err = init(*options, "--torque-constant", "0.05", "--name", "two", "--no-friction")
    assert (status, err) == (0, "")
    assert out.startswith("two.toml: two, 2 joints")
    arm = reader.load(Path("two.toml"))
    assert [j.torque_constant for j in arm.joints] == [5.0, 4.0]
    assert [j.link.mass for j in arm.joints] == [2.0, None]
    assert all(not j.effects for j in arm.joints)


def test_the_last_link_of_an_arm_in_a_plane_may_have_no_length(init: Run) -> None:
    """It places the tip alone; what moves the next joint is needed."""
    assert init("--joints", "r", "--plane", "--out", "motor.toml")[0] == 0
    assert init("--joints", "r,r", "--plane", "--length", "0.3,?", "--out", "two.toml")[0] == 0
    assert reader.load(Path("two.toml")).lengths == (0.3, 0.0)
    assert reader.load(Path("motor.toml")).lengths == (0.0,)
    status, _, err = init("--joints", "r,r", "--plane", "--length", "?,0.2", "--out", "no.toml")
    assert status == 2
    assert err.startswith("Joint 1: the length of a planar link cannot be left out")


def test_a_urdf_takes_what_is_stated_of_its_motors(init: Run) -> None:
    motors = ("--gear-ratio", "101,101,?,?,?,?", "--torque-constant", "0.1", "--rotor-inertia", "6e-5,6e-5,?,?,?,?")
    motors += ("--torque", "gravity_compensated", "--out", "mine.toml")
    status, out, _ = init("--urdf", str(ROBOTS / "ur10_robot.urdf"), *motors)
    assert status == 0
    assert out.startswith("mine.toml: ur10, 6 joints")
    arm = reader.load(Path("mine.toml"))
    assert [j.gear_ratio for j in arm.joints] == [101.0, 101.0, 1.0, 1.0, 1.0, 1.0]
    assert arm.joints[0].rotor_inertia == pytest.approx(6e-5 * 101**2, rel=1e-12)
    assert arm.joints[1].torque_constant == pytest.approx(10.1, rel=1e-12)
    assert arm.joints[2].rotor_inertia is None
    assert arm.torque == "gravity_compensated"
    plain = reader.load(ARMS / "ur10.toml")
    assert [j.link for j in arm.joints] == [j.link for j in plain.joints]


@pytest.mark.parametrize(
    "options",
    [
        ("--joints", "r", "--plane", "--length", "0.3", "--mass", "2", "--rotor-inertia", "1e-5"),
        ("--joints", "p", "--plane", "--length", "0"),
        ("--joints", "r,p", "--space"),
    ],
)
def test_what_is_begun_can_be_verified(init: Run, options: tuple[str, ...]) -> None:
    assert init(*options, "--out", "new.toml")[0] == 0
    assert output.run(app, ["verify", "new.toml", "--samples", "1"]) == 0


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ((), "--joints is needed"),
        (("--joints", "8"), "expected 1 to 7 letters r or p"),
        (("--joints", "r,x"), "expected 1 to 7 letters r or p"),
        (("--joints", "r,r", "--plane"), "the length of a planar link cannot be left out"),
        (("--joints", "rr", "--gear-ratio", "1,2,3"), "3 numbers; expected one for all joints, or 2, one each"),
        (("--joints", "r", "--gear-ratio", "fast"), "--gear-ratio fast: expected a number"),
        (("--joints", "r", "--space", "--gravity", "0,0"), "--gravity 0,0: 2 numbers; expected 3 numbers"),
        (("--joints", "r", "--torque", "force"), "--torque force: expected one of motor, link, command"),
        (("--joints", "r", "--name", "for"), "is a word of C, C++ or Python"),
        (("--joints", "r", "--space", "--mass", "-1"), "mass is -1; expected a number in kg >= 0"),
        (("--tip", "hand", "--joints", "r"), "--base, --tip and --lock need --urdf"),
        (("--like", "drive", "--joints", "r"), "--like copies a model as it is"),
        (("--urdf", "absent.urdf"), "absent.urdf"),
        (("--urdf", "absent.urdf", "--length", "1"), "only options of motors and --torque can stand beside it"),
    ],
)
def test_mistakes_are_refused_in_one_line(
    refused: Refused, tmp_path: Path, options: tuple[str, ...], expected: str
) -> None:
    assert expected in refused("init", *options)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(init: Run) -> None:
    Path("arm.toml").write_text("mine")
    assert init("--joints", "r", "--space")[::2] == (2, "arm.toml: already exists; choose another name\n")
    Path(schemas.MODEL).write_text("mine")
    status, _, err = init("--joints", "r", "--space", "--out", "new.toml", "--schema")
    assert status == 2
    assert "already exists with other content" in err
    assert not Path("new.toml").exists()
    assert Path("arm.toml").read_text() == Path(schemas.MODEL).read_text() == "mine"


def test_schemas_stand_beside_it_and_fit(init: Run) -> None:
    assert init("--joints", "r,p", "--space", "--out", "new.toml", "--schema")[0] == 0
    text = Path("new.toml").read_text()
    assert text.startswith(f"#:schema ./{schemas.MODEL}\n")
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.validate(tomllib.loads(text), json.loads(Path(schemas.MODEL).read_text()))
    assert (
        init("--urdf", str(ROBOTS / "panda.urdf"), "--tip", "panda_hand_tcp", "--out", "panda.toml", "--schema")[0] == 0
    )
    jsonschema.validate(tomllib.loads(Path("panda.toml").read_text()), json.loads(Path(schemas.MODEL).read_text()))


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.sampled_from("rp"), min_size=1, max_size=7), st.booleans(), st.data())
def test_whatever_is_known_the_file_says_it_and_no_more(
    init: Run, kinds: list[str], space: bool, data: st.DataObject
) -> None:
    gears = [data.draw(st.sampled_from(["1", "50"])) for _ in kinds]
    known = {
        option: [data.draw(st.sampled_from(["?", "0.5", "2"])) for _ in kinds]
        for option in ("--mass", "--rotor-inertia", "--torque-constant")
    }
    options = ["--joints", ",".join(kinds), "--gear-ratio", ",".join(gears)]
    options += ["--space"] if space else ["--plane", "--length", "0.3"]
    for option, values in known.items():
        options += [option, ",".join(values)]
    Path("new.toml").unlink(missing_ok=True)
    assert init(*options, "--out", "new.toml")[0] == 0
    arm = reader.load(Path("new.toml"))
    for k, joint in enumerate(arm.joints):
        ratio = float(gears[k])
        stated = {o: None if values[k] == "?" else float(values[k]) for o, values in known.items()}
        assert joint.link.mass == stated["--mass"]
        for value, option, power in (
            (joint.torque_constant, "--torque-constant", 1),
            (joint.rotor_inertia, "--rotor-inertia", 2),
        ):
            expected = stated[option]
            assert value == (None if expected is None else pytest.approx(expected * ratio**power, rel=1e-12))
