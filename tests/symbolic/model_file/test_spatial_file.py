"""The model file of an arm in space: what it means, what is snapped, and what a person reads where it is wrong."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from symbolic.effects import DECLARED as LIBRARY
from symbolic.model_file import reader
from symbolic.model_file.arm import Arm, Frame, Link
from symbolic.model_file.editor import ModelText
from symbolic.model_file.frames import (
    Rotation,
    about,
    added,
    angles,
    applied,
    composed,
    principal_moments,
    product,
    rotation,
)
from tests.one_joint import refusal as said

HEAD = 'name = "arm3"\ngravity = [0.0, 0.0, -9.81]\n'
LINK = "mass = 2.0\ncom = [0.02, 0.0, 0.1]\ninertia = [0.03, 0.0, -0.004, 0.035, 0.0001, 0.02]\n"
JOINT = (
    '[[joint]]\nname = "shoulder_pan"\ntype = "revolute"\nrotor_inertia = 0.1\ngear_ratio = 100\n'
    "origin = { xyz = [0.0, 0.0, 0.18], rpy = [1.5707963267948966, 0.0, 0.0] }   # m, rad\naxis = [0.0, 1.0, 0.0]\n"
    f"[joint.link]\n{LINK}"
)
SECOND = JOINT.replace("shoulder_pan", "elbow-1.left/a").replace('"revolute"', '"prismatic"')
TIP = "\n[tip]\norigin = { xyz = [0.0, 0.0, 0.1] }\n"
GOOD = f"{HEAD}\n{JOINT}[joint.effects.viscous]\ncoefficient = 1.5\n\n{SECOND}{TIP}"
PLANAR = (
    'name = "arm2"\ngravity = [0.0, -9.81]\n[[joint]]\nname = "hip"\ntype = "revolute"\ngear_ratio = 1\n'
    "[joint.link]\nlength = 0.3\n"
)


def spatial(text: str) -> Arm:
    arm = reader.parse(text, "arm.toml")
    assert arm.space
    return arm


def test_a_good_file() -> None:
    arm = spatial(GOOD)
    assert arm.gravity == (0.0, 0.0, -9.81)
    first, second = arm.joints
    assert (first.name, second.name) == ("shoulder_pan", "elbow-1.left/a")
    assert first.origin == Frame((0.0, 0.0, 0.18), (math.pi / 2, 0.0, 0.0))
    assert first.axis == (0.0, 1.0, 0.0)
    assert first.link == Link(2.0, (0.02, 0.0, 0.1), (0.03, 0.0, -0.004, 0.035, 0.0001, 0.02))
    assert arm.tip == Frame((0.0, 0.0, 0.1))
    assert arm.contact is None
    assert arm.notes == ()
    assert (first.unknown, second.unknown) == ((), ())


def test_what_is_left_out() -> None:
    (joint,) = spatial(f'{HEAD}[[joint]]\ntype = "revolute"\ngear_ratio = 50\n').joints
    assert (joint.origin, joint.axis, joint.name) == (Frame(), (0.0, 0.0, 1.0), None)
    assert joint.link == Link()
    assert joint.unknown == ("mass", "com", "inertia", "rotor_inertia")


def test_a_planar_file_stays_planar_and_its_joints_may_have_names() -> None:
    arm = reader.parse(PLANAR, "arm.toml")
    assert not arm.space
    assert arm.joints[0].name == "hip"
    assert not reader.is_spatial(PLANAR)
    assert reader.is_spatial(GOOD)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "mass = 2.0",
            "length = 0.3",
            "joint 1: link: length belongs to planar arms; on a spatial arm, use the origin of the next",
        ),
        ("com = [0.02, 0.0, 0.1]", "com = [0.2, 0.0]", "link: com is a list of 2; expected a list of 3 numbers in m"),
        (
            "inertia = [0.03, 0.0, -0.004, 0.035, 0.0001, 0.02]",
            "inertia = 0.03",
            "joint 1: link: inertia is 0.03; expected a list of 6 numbers in kg m^2: ixx, ixy, ixz, iyy, iyz, izz",
        ),
        ("xyz = [0.0, 0.0, 0.18]", "xyz = [0.0, 0.18]", "joint 1: origin: xyz is a list of 2; expected a list of 3"),
        ("xyz = [0.0", "position = [0.0", 'joint 1: origin: unknown key "position"'),
        ("rpy = [1.57", "rpy = [nan, 1.57", "joint 1: origin: rpy is a list of 4; expected a list of 3 numbers in rad"),
        ("rpy = [1.5707963267948966", "rpy = [inf", "rpy[0] is inf; expected a number in rad that is finite"),
        ("axis = [0.0, 1.0, 0.0]", "axis = [0, 0, 0]", "joint 1: axis has the length 0; expected a direction, such as"),
        ("axis = [0.0, 1.0, 0.0]", "axis = [0, 1e-9, 0]", "joint 1: axis has the length 1e-09; expected a direction"),
        ("axis = [0.0, 1.0, 0.0]", 'axis = "z"', 'axis is the text "z"; expected a list of 3 numbers: x, y, z'),
        (
            "gravity = [0.0, 0.0, -9.81]",
            "gravity = [0, 0, 0, 1]",
            "arm.toml: gravity is a list of 4; expected a list of two numbers in m/s^2 for a planar arm",
        ),
        ("gravity = [0.0, 0.0, -9.81]", "gravity = [0.0, -9.81]", "tip belongs to a spatial arm, whose"),
        (TIP, "\n[contact]\nx = 0.2\n", "contact belongs to planar arms: the plate of [contact] moves in the plane"),
        (TIP, "\n[tip]\nxyz = [0, 0, 1]\n", 'tip: unknown key "xyz"'),
        ('name = "shoulder_pan"', 'name = "a*/b"', 'joint 1: name "a*/b": expected letters a-z, digits, spaces and'),
        ('name = "shoulder_pan"', 'name = ""', 'joint 1: name "": expected letters'),
        ('name = "shoulder_pan"', f'name = "{"a" * 61}"', "has 61 letters; expected at most 60"),
        ('name = "shoulder_pan"', "name = 1", "joint 1: name is 1; expected a text"),
        ('name = "shoulder_pan"', 'name = "elbow-1.left/a"', 'joint 2: name "elbow-1.left/a" is already that of'),
        ("mass = 2.0", "mass = -2.0", "joint 1: link: mass is -2; expected a number in kg >= 0"),
        (
            "[0.03, 0.0, -0.004, 0.035, 0.0001, 0.02]",
            "[0.03, 0.0, -0.04, 0.035, 0.0001, 0.02]",
            "joint 1: link: inertia has the principal moments -0.0153, 0.035, 0.0653 kg m^2; expected none below 0",
        ),
        ("effects.viscous]\ncoefficient = 1.5", "effects.plate]", 'effect "plate" acts at the end-effector'),
    ],
)
def test_mistakes(old: str, new: str, expected: str) -> None:
    assert old in GOOD
    assert expected in said(GOOD.replace(old, new, 1))


@pytest.mark.parametrize(("line", "key"), [("axis = [0, 0, 1]", "axis"), ("origin = {}", "origin")])
def test_a_planar_joint_has_no_place_in_space(line: str, key: str) -> None:
    message = said(PLANAR.replace("gear_ratio = 1", f"gear_ratio = 1\n{line}"))
    assert message.startswith(f"arm.toml: joint 1: {key} belongs to a spatial arm, whose gravity has three numbers")
    assert "tip belongs to a spatial arm" in said(f"{PLANAR}[tip]\n")


@pytest.mark.parametrize("off", [4.9e-12, -3.7e-6, 9.9e-6])
def test_angles_next_to_a_quarter_turn_are_snapped_and_reported(off: float) -> None:
    arm = spatial(GOOD.replace("rpy = [1.5707963267948966", f"rpy = [{math.pi / 2 + off!r}"))
    assert [joint.origin.rpy[0] for joint in arm.joints] == [math.pi / 2] * 2
    assert arm.notes == (
        f"arm.toml: taken as exact quarter turns: the angles of joints 1, 2 (off by up to {abs(off):.1g} rad)",
    )
    assert arm == spatial(GOOD)


def test_angles_that_are_meant_stay() -> None:
    arm = spatial(GOOD.replace("rpy = [1.5707963267948966", "rpy = [1.5709"))
    assert arm.joints[0].origin.rpy[0] == 1.5709
    assert arm.notes == ()


def test_axes_next_to_one_of_the_frame_are_snapped_and_reported() -> None:
    arm = spatial(GOOD.replace("axis = [0.0, 1.0, 0.0]", "axis = [4e-6, -0.99999999, 0.0]"))
    assert [joint.axis for joint in arm.joints] == [(0.0, -1.0, 0.0)] * 2
    assert arm.notes == ("arm.toml: taken as exact quarter turns: the axis of joints 1, 2 (off by up to 4e-06)",)
    slanted = spatial(GOOD.replace("axis = [0.0, 1.0, 0.0]", "axis = [3.0, 4.0, 1e-6]", 1))
    assert slanted.joints[0].axis == (3.0, 4.0, 0.0)
    assert len(slanted.notes) == 1


def test_an_inertia_that_no_body_has_is_doubted_and_rounded_ones_are_not() -> None:
    inertia = "[0.03, 0.0, -0.004, 0.035, 0.0001, 0.02]"
    thin = spatial(GOOD.replace(inertia, "[0.01, 0.0, 0.0, 0.01, 0.0, 0.05]", 1))
    assert len(thin.notes) == 1
    assert "joint 1: no rigid body has this inertia: its principal moments 0.01, 0.01, 0.05 kg m^2" in thin.notes[0]
    rod = spatial(GOOD.replace(inertia, "[0.0100, 0.0, 0.0, 0.01001, 0.0, 0.0]", 1))
    assert rod.notes == ()


def test_every_joint_moves_something() -> None:
    joint = (
        '[[joint]]\ntype = "{}"\nrotor_inertia = 0.0\ngear_ratio = 1\n[joint.link]\nmass = {}\ncom = {}\ninertia = {}\n'
    )
    none, point = [0.0] * 6, joint.format("revolute", 1.0, [0.0, 0.0, 0.5], [0.0] * 6)
    assert "joint 1: moves no inertia;" in said(HEAD + point)  # a point mass on the axis
    assert spatial(HEAD + joint.format("prismatic", 1.0, [0.0, 0.0, 0.5], none))
    assert spatial(HEAD + joint.format("revolute", 1.0, [0.0, 0.1, 0.5], none))
    assert spatial(HEAD + joint.format("revolute", 0.0, [0.0] * 3, [0.0, 0.0, 0.0, 0.0, 0.0, 0.1]))
    tilted = point.replace("[0.0, 0.0, 0.5]", "[0.5, 0.0, 0.0]").replace(
        "gear_ratio = 1", "gear_ratio = 1\naxis = [1, 0, 0]"
    )
    assert "joint 1: moves no inertia" in said(HEAD + tilted)
    assert spatial(HEAD + point + tilted.replace("rotor_inertia = 0.0", "rotor_inertia = 0.1"))  # that swings it about


def edited(text: str) -> ModelText:
    return ModelText(Path("arm.toml"), text, LIBRARY)


def test_the_editor_writes_into_a_spatial_file() -> None:
    once = edited(GOOD).add("stribeck", 2, {"torque": 0.5}).text
    assert once == GOOD.replace(TIP, f"[joint.effects.stribeck]\ntorque = 0.5\n{TIP}")
    assert edited(once).remove("stribeck", 2).text == GOOD
    fitted = edited(GOOD).set_values({("viscous", 1): {"coefficient": 2.5}}, {"XX2": 0.25}, {2: 0.7}).text
    assert fitted.startswith(GOOD.replace("coefficient = 1.5", "coefficient = 2.5")[: GOOD.index("elbow")])
    assert fitted.endswith("XX2 = 0.25\n")
    arm = spatial(fitted)
    assert arm.inertial == {"XX2": 0.25}
    assert [joint.rotor_inertia for joint in arm.joints] == [0.1, 0.7]
    assert "origin = { xyz = [0.0, 0.0, 0.18], rpy = [1.5707963267948966, 0.0, 0.0] }   # m, rad" in fitted


def test_unknown_rotors_are_put_in_where_they_stand_in_other_files() -> None:
    text = GOOD.replace("rotor_inertia = 0.1\n", "")
    assert spatial(edited(text).set_values({}, None, {1: 0.3}).text).joints[0].rotor_inertia == 0.3


# --- geometry ---


def close(left: Rotation, right: Rotation, within: float) -> bool:
    entries = zip(sum(left, ()), sum(right, ()), strict=True)
    return all(abs(a - b) < within for a, b in entries)


ANGLE = st.floats(-3.2, 3.2)
TURNS = st.integers(-2, 2).map(lambda k: k * math.pi / 2)


@given(st.tuples(ANGLE | TURNS, ANGLE | TURNS, ANGLE | TURNS))
@settings(max_examples=200, deadline=None)
def test_a_rotation_is_that_of_its_angles(rpy: tuple[float, float, float]) -> None:
    turned = rotation(rpy)
    again = rotation(angles(turned))
    assert close(turned, again, 1e-11)
    roll, pitch, yaw = rpy
    steps = product(about((0, 0, 1), yaw), product(about((0, 2, 0), pitch), about((0.5, 0, 0), roll)))
    assert close(turned, steps, 1e-12)


@given(ANGLE | TURNS, st.sampled_from([-1, 1]), st.integers(-14, -1), ANGLE | TURNS)
@settings(max_examples=200, deadline=None)
def test_where_roll_and_yaw_are_nearly_one_the_rotation_is_kept(roll: float, sign: int, power: int, yaw: float) -> None:
    turned = rotation((roll, sign * (math.pi / 2 - 10.0**power), yaw))
    assert close(turned, rotation(angles(turned)), 1e-11)


@given(st.tuples(TURNS, TURNS, TURNS), st.tuples(TURNS, TURNS, TURNS))
def test_quarter_turns_stay_exact(first: tuple[float, float, float], second: tuple[float, float, float]) -> None:
    made = composed(Frame((0.1, 0.2, 0.3), first), Frame((1.0, 2.0, 3.0), second))
    assert {abs(entry) for row in rotation(made.rpy) for entry in row} == {0.0, 1.0}
    assert made.xyz == added((0.1, 0.2, 0.3), applied(rotation(first), (1.0, 2.0, 3.0)))


@given(st.tuples(*[st.floats(0.0, 5.0)] * 3), st.tuples(ANGLE, ANGLE, ANGLE))
@settings(deadline=None)
def test_principal_moments_do_not_depend_on_the_axes(moments: tuple[float, float, float], rpy) -> None:
    R = rotation(rpy)
    turned = [[sum(R[i][k] * moments[k] * R[j][k] for k in range(3)) for j in range(3)] for i in range(3)]
    found = principal_moments([turned[0][0], turned[0][1], turned[0][2], turned[1][1], turned[1][2], turned[2][2]])
    assert found == pytest.approx(sorted(moments), abs=1e-6)
