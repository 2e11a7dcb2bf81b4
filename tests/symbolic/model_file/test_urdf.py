"""URDF in: what it says, what it leaves out, and what a person reads where it cannot be an arm."""

from __future__ import annotations

import contextlib
import math
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from symbolic.effects import DECLARED
from symbolic.model_file import reader
from symbolic.model_file.arm import Frame, Limits, Link
from symbolic.model_file.checks import ModelError
from symbolic.model_file.exchange import xml_file
from symbolic.model_file.exchange.importing import ImportedArm, arm_name, imported, is_placeholder, label_of, unique
from symbolic.model_file.frames import StatedBody, about_point, applied, placed, rotation, together, transposed
from tests.own_time import takes_less_than

ROBOTS = Path(__file__).resolve().parents[2] / "robots"
ARMS = Path(reader.__file__).resolve().parents[1] / "arms"

INERTIAL = (
    '<inertial><origin xyz="0.1 0 0"/><mass value="{}"/>'
    '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.015"/></inertial>'
)


def link(name: str, mass: float | None = 1.0) -> str:
    return f'<link name="{name}">{"" if mass is None else INERTIAL.format(mass)}</link>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", inside: str = "") -> str:
    place = "" if "<origin" in inside else '<origin xyz="0 0 0.5" rpy="0 0 0"/>'
    axis = "" if "<axis" in inside or kind == "fixed" else '<axis xyz="0 0 1"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{place}{axis}{inside}</joint>'


def transmission(name: str, joint: str, ratio: int) -> str:
    motor = f'<actuator name="m"><mechanicalReduction>{ratio}</mechanicalReduction></actuator>'
    return f'<transmission name="{name}"><joint name="{joint}"/>{motor}</transmission>'


def robot(*parts: str, name: str = "two") -> str:
    return f'<?xml version="1.0"?>\n<robot name="{name}">\n' + "\n".join(parts) + "\n</robot>\n"


TWO = (link("base"), link("a"), link("b"), joint("j1", "base", "a"), joint("j2", "a", "b"))


def read(tmp_path: Path, text: str, **asked) -> ImportedArm:
    path = tmp_path / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    return imported(path, DECLARED, **asked)


def said(tmp_path: Path, text: str, **asked) -> str:
    """The one line that a person reads, without the folder."""
    with pytest.raises(ModelError) as caught:
        read(tmp_path, text, **asked)
    message = str(caught.value)
    assert "\n" not in message
    assert message.isprintable()
    assert message.startswith(str(tmp_path / "robot.urdf"))
    return message.removeprefix(f"{tmp_path}/robot.urdf")


# --- what it says ---


def test_a_chain_is_what_the_file_says(tmp_path: Path) -> None:
    limit = '<limit lower="-1" upper="2" velocity="3" effort="40"/><dynamics damping="0.3" friction="0.7"/>'
    text = robot(
        link("base"), link("a"), link("b", 2.5), joint("j1", "base", "a"), joint("j2", "a", "b", "prismatic", limit)
    )
    made = read(tmp_path, text)
    first, second = made.arm.joints
    assert (made.arm.name, made.chain.base, made.chain.tip_link) == ("two", "base", "b")
    assert (first.name, second.name, first.type, second.type) == ("j1", "j2", "revolute", "prismatic")
    assert first.origin == Frame((0.0, 0.0, 0.5))
    assert second.link == Link(2.5, (0.1, 0.0, 0.0), (0.01, 0.0, 0.0, 0.02, 0.0, 0.015))
    assert second.limits.position == (-1.0, 2.0)
    assert (second.limits.speed, second.limits.torque) == (3.0, 40.0)
    assert made.arm.gravity == (0.0, 0.0, -9.81)
    assert first.unknown == ("rotor_inertia",)
    stated = {name: values for name, values in second.effects.items() if values}
    assert sorted(value for values in stated.values() for value in values.values()) == [0.3, 0.7, 0.7]
    assert all(values == {} for values in first.effects.values())
    assert len(first.effects) == 2


def test_the_text_is_the_arm_and_the_same_each_time(tmp_path: Path) -> None:
    made, again = (read(tmp_path, robot(*TWO)) for _ in range(2))
    assert made.text == again.text
    assert reader.parse(made.text, "made.toml") == made.arm
    assert "# kg\n" in made.text
    assert "# m/s^2; not stated: z of base is taken to point up" in made.text


def test_without_friction_there_are_no_effects(tmp_path: Path) -> None:
    assert all(not joint.effects for joint in read(tmp_path, robot(*TWO), friction=False).arm.joints)


@pytest.mark.parametrize(
    ("values", "invented"),
    [([0.1, 0.1], True), ([1.0], True), ([10.0, 0.0], True), ([0.3], False), ([0.3, 0.2], False), ([0.0, 0.0], False)],
)
def test_numbers_that_were_typed_to_have_some(values: list[float], invented: bool) -> None:
    assert is_placeholder(values) is invented


def test_placeholders_are_taken_and_said(tmp_path: Path) -> None:
    limit = '<limit lower="-1" upper="2" velocity="1000" effort="{}"/>'
    dynamics = '<dynamics damping="0.5" friction="{}"/>'
    one, two = (limit.format(effort) + dynamics.format(dry) for effort, dry in ((40, 0.2), (30, 0.3)))
    made = read(tmp_path, robot(*TWO[:3], joint("j1", "base", "a", inside=one), joint("j2", "a", "b", inside=two)))
    values = [sorted(v for values in each.effects.values() for v in values.values()) for each in made.arm.joints]
    assert values == [[0.2, 0.2, 0.5], [0.3, 0.3, 0.5]]
    assert [each.limits.speed for each in made.arm.joints] == [1000.0, 1000.0]
    (note,) = (note for note in made.notes if "placeholder" in note)
    assert note.startswith("damping = 0.5 and speed = 1000 at all joints: looks like a placeholder, used as stated")


def test_slides_and_turning_joints_have_placeholders_of_their_own(tmp_path: Path) -> None:
    """As lifts with arms have them: their units differ, and so do the numbers."""
    turning, sliding = ('<dynamics damping="1" friction="0"/>', '<dynamics damping="1000" friction="0"/>')
    links = [link(name) for name in "abc"]
    made = read(
        tmp_path,
        robot(
            link("base"),
            *links,
            joint("j1", "base", "a", "prismatic", sliding),
            joint("j2", "a", "b", inside=turning),
            joint("j3", "b", "c", inside=turning),
        ),
    )
    assert any(note.startswith("damping = 1 at joints 2, 3; damping = 1000 at joint 1: looks") for note in made.notes)


def test_what_no_limit_or_friction_can_be_is_left_out_and_said(tmp_path: Path) -> None:
    wrong = '<limit lower="2" upper="-1" velocity="-3" effort="-40"/><dynamics damping="-0.3" friction="0.2"/>'
    made = read(tmp_path, robot(*TWO[:3], joint("j1", "base", "a"), joint("j2", "a", "b", inside=wrong)))
    second = made.arm.joints[1]
    assert second.limits == Limits()
    assert sorted(v for values in second.effects.values() for v in values.values()) == [0.2, 0.2]
    for said in (
        "joint 2: its lower limit 2 is above the upper one, -1: left out, hence unknown",
        "joint 2: its limit of velocity is -3: left out, hence unknown",
        "joint 2: its limit of effort is -40: left out, hence unknown",
        "damping = -0.3 of joint 2: left out, hence unknown; expected a number above 0",
    ):
        assert said in made.notes


def test_gears_come_from_transmissions(tmp_path: Path) -> None:
    gear = (
        '<transmission name="t"><type>x</type><joint name="j2"><hardwareInterface>e</hardwareInterface></joint>'
        '<actuator name="m"><mechanicalReduction>-101</mechanicalReduction></actuator></transmission>'
    )
    made = read(tmp_path, robot(*TWO, gear))
    assert [joint.gear_ratio for joint in made.arm.joints] == [1.0, 101.0]
    assert any(note.startswith("gear_ratio of joint 1: not stated, set to 1") for note in made.notes)


def test_transmissions_of_one_joint_that_differ_leave_its_gear_open(tmp_path: Path) -> None:
    first = transmission("t", "j2", 101)
    made = read(tmp_path, robot(*TWO, first, transmission("u", "j2", 51)))
    assert made.arm.joints[1].gear_ratio == 1.0
    differ = (
        "gear_ratio of joint 2: the file states different ones (101 of transmission t, 51 of transmission u): set to 1"
    )
    assert [note.startswith(differ) for note in made.notes if "joint 2" in note and "gear_ratio" in note] == [True]
    assert read(tmp_path, robot(*TWO, first, transmission("u", "j2", -101))).arm.joints[1].gear_ratio == 101.0


def test_a_gear_of_nothing_is_said_and_not_taken(tmp_path: Path) -> None:
    made = read(tmp_path, robot(*TWO, transmission("t", "j1", 0)))
    assert made.arm.joints[0].gear_ratio == 1
    assert "joint 1: the gear of transmission t, which is 0: left out, hence unknown" in made.notes


def test_a_differential_is_said_and_its_gears_are_not_taken(tmp_path: Path) -> None:
    ends = "".join(f'<joint name="{name}"/>' for name in ("j1", "j2"))
    motors = "".join(f"<actuator><mechanicalReduction>{n}</mechanicalReduction></actuator>" for n in (50, -60))
    made = read(tmp_path, robot(*TWO, f'<transmission name="wrist">{ends}{motors}</transmission>'))
    assert [joint.gear_ratio for joint in made.arm.joints] == [1.0, 1.0]
    for k, other in ((1, "j2"), (2, "j1")):
        said = f"joint {k}: the gear of transmission wrist, whose motors move {other} too: left out, hence unknown"
        assert said in made.notes


def test_a_joint_that_turns_for_ever_has_no_range(tmp_path: Path) -> None:
    endless = '<limit lower="-1e16" upper="1e16" effort="0" velocity="inf"/>'
    made = read(
        tmp_path, robot(*TWO[:3], joint("j1", "base", "a", "continuous"), joint("j2", "a", "b", inside=endless))
    )
    for each in made.arm.joints:
        assert (each.type, each.limits.position, each.limits.speed, each.limits.torque) == (
            "revolute",
            None,
            None,
            None,
        )


def test_names_cannot_write_into_the_model_file(tmp_path: Path) -> None:
    evil = "x&#10;gravity = [0, 0, 0]&#10;#"
    text = robot(*TWO, name=evil).replace('"base"', f'"{evil}"').replace('"j1"', '"j&quot;1&#10;"')
    made = read(tmp_path, text)
    assert made.arm.name == "x_gravity_0_0_0"
    assert made.arm.gravity == (0.0, 0.0, -9.81)
    assert made.arm.joints[0].name == "j_1_"
    assert [line for line in made.text.splitlines() if line.startswith("gravity")] == [made.text.splitlines()[3]]


# --- trees ---


def test_what_is_fixed_is_one_body(tmp_path: Path) -> None:
    """A link split in two, one half turned, is the link."""
    half = link("half").replace('xyz="0.1 0 0"', 'xyz="0 0.1 0"')
    turned = f'<origin xyz="0.3 0 0" rpy="0 0 {math.pi / 2!r}"/>'
    made = read(tmp_path, robot(*TWO, half, joint("weld", "b", "half", "fixed", turned)))
    body = made.arm.joints[1].link
    assert made.chain.joints[1].links == ("b", "half")
    assert body.mass == 2.0
    # The half's centre lies at 0.3 − 0.1 along x; its moments about x and y change places.
    assert body.com == pytest.approx((0.15, 0.0, 0.0))
    spread = 2 * 0.05**2
    assert body.inertia == pytest.approx((0.03, 0.0, 0.0, 0.03 + spread, 0.0, 0.03 + spread), abs=1e-12)
    assert made.arm.tip == Frame((0.3, 0.0, 0.0), (0.0, 0.0, math.pi / 2))


def test_a_locked_joint_is_fixed_where_it_is_held(tmp_path: Path) -> None:
    text = robot(*TWO, link("c"), joint("j3", "b", "c", inside='<axis xyz="0 1 0"/>'))
    held = read(tmp_path, text, locked={"j2": 0.4}).arm
    assert [joint.name for joint in held.joints] == ["j1", "j3"]
    assert held.joints[1].origin == Frame((0.0, 0.0, 1.0), (0.0, 0.0, 0.4))
    sliding = text.replace('name="j2" type="revolute"', 'name="j2" type="prismatic"')
    assert read(tmp_path, sliding, locked={"j2": 0.25}).arm.joints[1].origin.xyz == (0.0, 0.0, 1.25)


def test_a_joint_that_is_held_where_it_cannot_come_is_said(tmp_path: Path) -> None:
    ends = '<limit lower="-1" upper="0.5" effort="10" velocity="1"/>'
    text = robot(*TWO[:4], joint("j2", "a", "b", inside=ends))
    assert "j2 is locked at 2, outside its range of -1 to 0.5" in read(tmp_path, text, locked={"j2": 2.0}).notes
    assert not any("outside its range" in note for note in read(tmp_path, text, locked={"j2": 0.5}).notes)


def test_what_moves_off_the_way_is_held_and_said(tmp_path: Path) -> None:
    text = robot(*TWO, link("finger", 0.5), joint("grip", "a", "finger", "prismatic", '<mimic joint="j1"/>'))
    made = read(tmp_path, text, tip="b")
    assert made.chain.held == ("grip",)
    assert made.arm.joints[0].link.mass == 1.5
    assert any(note.startswith("grip is not between base and tip: locked at 0") for note in made.notes)


def test_the_way_may_begin_and_end_anywhere(tmp_path: Path) -> None:
    text = robot(*TWO, link("c"), link("d"), joint("j3", "b", "c"), joint("j4", "b", "d"))
    made = read(tmp_path, text, base="a", tip="c")
    assert [joint.name for joint in made.arm.joints] == ["j2", "j3"]
    assert '2 links end the chains from "base": c, d; choose one: --tip LINK' in said(tmp_path, text)
    # Of a robot with many ends only some are named: those of arms rather than a camera's.
    longer = text.replace("</robot>", '<link name="e"/>' + joint("j5", "d", "e") + "</robot>")
    assert '2 links end the chains from "base": e, c; choose one: --tip LINK' in said(tmp_path, longer)


@pytest.mark.parametrize("place", [0.0, 0.7])
def test_gravity_is_that_of_the_root_wherever_the_arm_begins(tmp_path: Path, place: float) -> None:
    """The whole way with its first joint held is a second route to how the base is turned."""
    turned = '<origin xyz="0 0 0.5" rpy="0.3 -0.2 1.1"/><axis xyz="1 2 0"/>'
    text = robot(*TWO[:3], joint("j1", "base", "a", inside=turned), TWO[4])
    whole = read(tmp_path, text, locked={"j1": place})
    begun = read(tmp_path, text, base="a", locked={"j1": place} if place else {})
    down = applied(transposed(rotation(whole.arm.joints[0].origin.rpy)), whole.arm.gravity)
    assert begun.arm.gravity == pytest.approx(down)
    hangs = "a is moved by j1: gravity is taken with it at 0 (--lock JOINT=VALUE for another position)"
    assert (hangs in begun.notes) is (place == 0)
    assert "not stated: z of base is taken to point up" in begun.text
    assert begun.chain.joints[0].joint.name == "j2"


def test_frames_at_one_joint_are_no_ends_to_choose_from(tmp_path: Path) -> None:
    frames = [link(name, None) for name in ("camera", "flange", "tool0")]
    welds = [
        joint(f"f{k}", parent, child, "fixed")
        for k, (parent, child) in enumerate([("a", "camera"), ("b", "flange"), ("b", "tool0")])
    ]
    made = read(tmp_path, robot(*TWO, *frames, *welds))
    assert made.chain.tip_link == "tool0"
    assert "the arm ends at tool0; flange ends at the same joint (--tip LINK for another)" in made.notes


def test_links_that_are_drawn_but_weigh_nothing_are_unknown(tmp_path: Path) -> None:
    drawn = '<link name="b"><visual/></link>'
    made = read(tmp_path, robot(*TWO[:2], drawn, *TWO[3:]))
    assert made.arm.joints[1].link == Link()
    assert any(note.startswith("mass, centre and inertia of joint 2: not stated") for note in made.notes)


def test_an_inertia_that_no_body_has_is_left_out_and_said(tmp_path: Path) -> None:
    wrong = link("b").replace('ixx="0.01"', 'ixx="-0.05"')
    made = read(tmp_path, robot(*TWO[:2], wrong, *TWO[3:]))
    assert made.arm.joints[1].link == Link(1.0, (0.1, 0.0, 0.0), None)
    assert any("negative principal moment -0.05 kg m^2" in note for note in made.notes)


def test_a_point_with_rounding_for_an_inertia_is_a_point(tmp_path: Path) -> None:
    """As programs write it: 0 came out as −5e-20."""
    point = link("b").replace('ixx="0.01"', 'ixx="-5.4e-20"').replace('iyy="0.02"', 'iyy="1e-18"')
    made = read(tmp_path, robot(*TWO[:2], point.replace('izz="0.015"', 'izz="0"'), *TWO[3:]))
    assert made.arm.joints[1].link == Link(1.0, (0.1, 0.0, 0.0), (0.0,) * 6)
    assert not any("body" in note for note in made.notes)


def test_quarter_turns_are_exact_before_anything_is_computed_from_them(tmp_path: Path) -> None:
    near = '<origin xyz="0 0 0.1" rpy="0 1.57079632679 0"/>'
    text = robot(
        *TWO[:3],
        joint("j1", "base", "a", inside=near),
        link("m"),
        joint("weld", "a", "m", "fixed", near),
        joint("j2", "m", "b", inside=near),
    )
    made = read(tmp_path, text)
    assert made.arm.joints[1].origin == Frame((0.1, 0.0, 0.1), (0.0, math.pi, 0.0)) or {
        abs(x) for row in rotation(made.arm.joints[1].origin.rpy) for x in row
    } == {0.0, 1.0}
    assert "taken as exact quarter turns: the angles of joints j1, weld, j2 (off by up to 5e-12 rad)" in made.notes


# --- what a person reads ---


@pytest.mark.parametrize(
    ("parts", "asked", "expected"),
    [
        ((*TWO, link("a")), {}, ' line 8: a second <link> is named "a"; expected unique names'),
        ((*TWO, joint("j1", "b", "a")), {}, ' line 8: a second <joint> is named "j1"; expected unique names'),
        ((*TWO, joint("j3", "b", "nowhere")), {}, ': joint "j3": its child "nowhere" is not a link of the file'),
        (
            (*TWO, joint("j3", "base", "b")),
            {},
            ': link "b" has two parent joints, "j2" and "j3"; expected a tree: remove one',
        ),
        ((*TWO, joint("j3", "b", "base")), {}, ': link "base" is its own ancestor, through joint'),
        ((*TWO, link("c")), {}, ": 2 links have no parent: base, c; say where the arm begins: --base LINK"),
        (TWO, {"base": "bas"}, ': --base bas: no such link; did you mean "base"?'),
        (TWO, {"tip": "zzz"}, ": --tip zzz: no such link; it has base, a, b"),
        (TWO, {"base": "b", "tip": "a"}, ': "a" is not a descendant of "b"; expected a --tip that is connected'),
        (TWO, {"locked": {"j3": 0.0}}, ": --lock j3: no such joint; it has j1, j2"),
        (
            TWO,
            {"locked": {"j1": 0.0, "j2": 0.0}},
            ': no joint moves beyond "base"; say where the arm begins: --base LINK',
        ),
        (
            (*TWO[:4], joint("j2", "a", "b", inside='<mimic joint="j1"/>')),
            {},
            ': joint "j2" follows "j1" (mimic), which an arm\'s joint cannot; lock it: --lock j2=VALUE, or end',
        ),
        (
            (*TWO[:4], joint("j2", "a", "b", "floating")),
            {},
            ': joint "j2" is floating; an arm has revolute, continuous or prismatic joints: begin behind it: --base b',
        ),
        ((*TWO[:4], joint("j2", "a", "b", "fixed")), {"locked": {"j2": 0.0}}, ": --lock j2: the joint is fixed; only"),
        (
            (*TWO[:4], joint("j2", "a", "b", "revolut")),
            {},
            ': joint "j2" is revolut (did you mean "revolute"?); an arm has revolute, continuous or prismatic joints',
        ),
        ((TWO[0].replace('iyy="0.02" ', ""), *TWO[1:]), {}, ' line 3: <inertia> has no iyy; expected iyy="..."'),
        (
            (*TWO[:3], joint("j1", "base", "a", inside='<origin xyz="0 nan 0"/>'), TWO[4]),
            {},
            ' line 6: <origin> xyz is "0 nan 0"; expected numbers that are finite',
        ),
        ((link("base", 1e400), *TWO[1:]), {}, ' line 3: <mass> value is "inf"; expected numbers that are finite'),
        ((link("base", -1.0), *TWO[1:]), {}, " line 3: <mass> value is -1; expected a mass of 0 kg or more"),
        (
            (*TWO[:3], joint("j1", "base", "a", inside='<origin xyz="1e400 0 0"/>'), TWO[4]),
            {},
            ' line 6: <origin> xyz is "1e400 0 0"; expected numbers that are finite',
        ),
        (
            (*TWO[:3], joint("j1", "base", "a", inside='<origin xyz="0 0"/>'), TWO[4]),
            {},
            ' line 6: <origin> xyz is "0 0"; expected 3 numbers',
        ),
        (
            (*TWO[:3], joint("j1", "base", "a", inside='<axis xyz="0 0 0"/>'), TWO[4]),
            {},
            ": joint j1: axis has the length 0; expected a direction",
        ),
        (
            (*TWO[:3], TWO[3].replace('<parent link="base"/>', ""), TWO[4]),
            {},
            " line 6: <joint> has no <parent>; expected",
        ),
        ((), {}, " line 2: the robot has no <link>; expected links and joints"),
        ((*TWO, "<xacro:macro name='x'/>"), {}, " line 2: is a xacro template, not a URDF; expand it first"),
    ],
)
def test_mistakes(tmp_path: Path, parts: tuple[str, ...], asked: dict, expected: str) -> None:
    assert said(tmp_path, robot(*parts), **asked).startswith(expected)


def test_too_many_joints_are_named_and_the_ways_to_have_fewer(tmp_path: Path) -> None:
    names = [f"l{k}" for k in range(10)]
    text = robot(*map(link, names), *(joint(f"j{k}", names[k], names[k + 1]) for k in range(9)))
    message = said(tmp_path, text)
    assert message.startswith(
        ': 9 joints move between "l0" and "l9": j0, j1, j2, j3, j4, j5, j6, j7 and 1 more; expected at'
    )
    assert "--lock JOINT=VALUE" in message
    assert len(read(tmp_path, text, tip="l7").arm.joints) == 7


# --- hostile files ---

LAUGHS = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 10))
HOSTILE = {
    "entities": (f'<!DOCTYPE r [<!ENTITY l0 "ha">{LAUGHS}]><robot name="x">&l9;</robot>', "line 1: declares an entity"),
    "a file": (
        '<!DOCTYPE r [<!ENTITY f SYSTEM "file:///etc/passwd">]><robot>&f;</robot>',
        "line 1: declares an entity",
    ),
    "elements": (robot("<link/>" * 1_000_000), "more than 50,000 elements"),
    "depth": ("<a>" * 100_000, "line 1: elements within more than 64 others"),
    "bytes": (robot(" " * 17_000_000), "is larger than 16 MB"),
    "an attribute": (robot(f'<link name="{"x" * 5_000_000}"/>' + link("b")), "2 links have no parent"),
    "not closed": ("<robot><link name='a'>", "line 1: not valid XML"),
    "nothing": ("", "line 1: not valid XML: no element found"),
    "binary": ("\x00\x01", "line 1: not valid XML"),
    "something else": ("<html/>", "line 1: its root is <html>; expected <robot> (URDF) or <mujoco> (MJCF)"),
    "encoding": ('<?xml version="1.0" encoding="no-such"?><robot/>', "not valid XML"),
    "a name": (robot(*TWO, link("\u202eevil\u0007".replace("\u0007", ""))), "2 links have no parent"),
    "many": (
        robot(
            *(link(f"l{k}", None) for k in range(20_000)),
            *(joint(f"j{k}", f"l{k}", f"l{k + 1}") for k in range(19_999)),
        ),
        "elements",
    ),
    "long": (
        robot(
            *(f'<link name="l{k}"/>' for k in range(7_000)),
            *(joint(f"j{k}", f"l{k}", f"l{k + 1}", "fixed") for k in range(6_999)),
        ),
        "no joint moves beyond",
    ),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_files_are_one_line_in_bounded_time(tmp_path: Path, kind: str) -> None:
    text, expected = HOSTILE[kind]
    path = tmp_path / "robot.urdf"
    # What a first import loads is not the file's doing.
    path.write_text(robot(), encoding="utf-8")
    with suppress(ModelError):
        imported(path, DECLARED)
    path.write_text(text, encoding="utf-8")
    with takes_less_than(2), pytest.raises(ModelError) as caught:
        imported(path, DECLARED)
    message = str(caught.value)
    assert expected in message
    assert "\n" not in message
    assert message.isprintable()
    assert len(message) < 1000


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (robot(*TWO).replace("j2", "jé").encode("latin-1"), " line 7: not valid XML: byte 0xe9 is not UTF-8; save"),
        (b"\x1f\x8b\x08\x00robot", " line 1: not valid XML: the file is compressed (gzip); decompress it first"),
        (b"PK\x03\x04robot", " line 1: not valid XML: the file is compressed (zip); decompress it first"),
    ],
)
def test_what_is_no_text_is_said_so(tmp_path: Path, data: bytes, expected: str) -> None:
    path = tmp_path / "robot.urdf"
    path.write_bytes(data)
    with pytest.raises(ModelError) as caught:
        imported(path, DECLARED)
    assert str(caught.value).startswith(f"{path}{expected}")


@given(st.binary(max_size=300) | st.text(max_size=200).map(lambda text: robot(text).encode()))
@settings(deadline=None, max_examples=200)
def test_whatever_the_bytes_it_is_a_robot_or_an_error(data: bytes) -> None:
    with contextlib.suppress(ModelError):
        assert xml_file.parsed(data, "robot.urdf").tag


def test_names_become_names(tmp_path: Path) -> None:
    path = tmp_path / "my robot.urdf"
    assert arm_name("UR-10 (e-Series)", path) == "UR_10_e_Series"
    assert arm_name("", path) == "my_robot"
    assert arm_name("7bot", path) == "arm_7bot"
    assert arm_name("effects", path) == "arm_effects"
    assert arm_name("日本", path) == "my_robot"
    assert arm_name("double", path) == "arm_double"
    assert label_of('a"b\\c\n') == "a_b_c_"
    assert unique(["x" * 60, "x" * 60]) == ["x" * 60, "x" * 56 + "_2"]


# --- bodies ---

NUMBER = st.floats(-1.0, 1.0)
POINT = st.tuples(NUMBER, NUMBER, NUMBER)
BODY = st.builds(
    lambda mass, com, a, b, c: StatedBody(mass, com, (b + c, 0.0, 0.0, a + c, 0.0, a + b)),
    st.floats(0.1, 5.0),
    POINT,
    *[st.floats(0.001, 0.1)] * 3,
)


def energy(body: StatedBody, at: Frame, v: tuple[float, float, float], w: tuple[float, float, float]) -> float:
    """Kinetic energy (twice) of a body in a frame whose origin moves with v and w, in the outer frame's axes."""
    moved = placed(body, at)
    x, y, z = moved.com
    speed = (v[0] + w[1] * z - w[2] * y, v[1] + w[2] * x - w[0] * z, v[2] + w[0] * y - w[1] * x)
    xx, xy, xz, yy, yz, zz = moved.inertia
    spin = w[0] * (xx * w[0] + xy * w[1] + xz * w[2]) + w[1] * (xy * w[0] + yy * w[1] + yz * w[2])
    return moved.mass * sum(s * s for s in speed) + spin + w[2] * (xz * w[0] + yz * w[1] + zz * w[2])


@given(BODY, BODY, POINT, POINT, POINT, POINT)
@settings(deadline=None)
def test_bodies_together_have_their_energies_sum(a, b, xyz, rpy, v, w) -> None:
    place = Frame(xyz, rpy)
    whole = together([a, placed(b, place)])
    apart = energy(a, Frame(), v, w) + energy(b, place, v, w)
    assert energy(whole, Frame(), v, w) == pytest.approx(apart, rel=1e-9, abs=1e-9)


@given(BODY, POINT, POINT)
@settings(deadline=None)
def test_a_turned_body_turns_its_momentum(body: StatedBody, rpy, w) -> None:
    """I(R b) R w = R (I(b) w): written in axes of its own."""

    def momentum(inertia, w):
        xx, xy, xz, yy, yz, zz = inertia
        return (xx * w[0] + xy * w[1] + xz * w[2], xy * w[0] + yy * w[1] + yz * w[2], xz * w[0] + yz * w[1] + zz * w[2])

    R = rotation(rpy)
    moved = placed(body, Frame((0.0, 0.0, 0.0), rpy))
    left, right = momentum(moved.inertia, applied(R, w)), applied(R, momentum(body.inertia, w))
    assert left == pytest.approx(right, abs=1e-9)
    assert sum(about_point(body, body.com)) == pytest.approx(sum(body.inertia), abs=1e-9)


# --- the arms that ship ---

SHIPPED = {"ur10": ("ur10_robot.urdf", None), "panda": ("panda.urdf", "panda_hand_tcp")}


@pytest.mark.parametrize("name", SHIPPED)
def test_an_arm_that_ships_is_what_import_makes(name: str) -> None:
    file, tip = SHIPPED[name]
    made = imported(ROBOTS / file, DECLARED, tip=tip)
    assert made.text == (ARMS / f"{name}.toml").read_text(encoding="utf-8")
    assert (ARMS / f"{name}.LICENSE").exists()
    assert made.arm.space
    assert replace(made.arm, notes=()).name == name
