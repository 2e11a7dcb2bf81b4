"""The model file: what it means, and what a person reads where it is wrong."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from symbolic.model_file import reader
from symbolic.model_file.arm import Arm, Control, Drive, Gains
from symbolic.model_file.reader import ModelError
from tests.one_joint import refusal as said

CONTROL = "rate = 1000\nvelocity_cutoff = 80\nfriction_scale = 0.9\nfriction_slope = 100\n"
LINK = "length = 0.3\nmass = 2.0\ncom = [0.2, 0.01]\ninertia = 0.05\n"
JOINT = f'[[joint]]\ntype = "revolute"\nrotor_inertia = 0.1\ngear_ratio = 100\n[joint.link]\n{LINK}'
GOOD = f'name = "arm2"\ngravity = [0.0, -9.81]\n\n{JOINT}[joint.effects.viscous]\ncoefficient = 1.5\n\n{JOINT}'


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return said(GOOD.replace(old, new, 1))


def test_a_good_file():
    arm = reader.parse(GOOD, "arm.toml")
    assert arm.name == "arm2"
    assert arm.gravity == (0.0, -9.81, 0.0)
    assert arm.joints[0].effects == {"viscous": {"coefficient": 1.5}}
    assert arm.joints[1].link.com == (0.2, 0.01, 0.0)
    assert arm.joints[1].effects == {}
    assert arm.contact is None
    assert arm.controller is None
    assert (arm.joints[0].gains, arm.joints[0].encoder_counts) == (None, None)


def test_optional_keys():
    text = (
        'name = "a"\ngravity = [0, 0]\n[contact]\nx = 0.4\n[contact.effects.plate]\n[effects.gravity]\ngx = 1\n'
        "[inertial]\nJ1 = 0.25\n"
        "[controller]\nrate = 2000\nvelocity_cutoff = 80\nfriction_scale = 0.9\nfriction_slope = 100\n"
        '[[joint]]\ntype = "prismatic"\nrotor_inertia = 0\ngear_ratio = 1\ntorque_constant = 12.5\n'
        f"[joint.limits]\nposition = [-1, 2]\nspeed = 3\ntorque = 4\n[joint.link]\n{LINK}"
        "[joint.controller]\nkp = 30\nkd = 2.5\n[joint.encoder]\ncounts = 4096\nzero = -17\n"
        "[joint.drive]\nnode = 5\ndirection = -1\nrated_torque = 0.35\n"
    )
    arm = reader.parse(text, "a.toml")
    joint = arm.joints[0]
    assert (joint.torque_constant, joint.limits.position, joint.limits.speed) == (12.5, (-1.0, 2.0), 3.0)
    assert arm.contact is not None
    assert arm.contact.effects == {"plate": {}}
    assert arm.effects == {"gravity": {"gx": 1.0}}
    assert arm.inertial == {"J1": 0.25}
    assert arm.controller == Control(rate=2000.0, velocity_cutoff=80.0, friction_scale=0.9, friction_slope=100.0)
    assert (joint.gains, joint.encoder_counts, joint.encoder_zero) == (Gains(kp=30.0, kd=2.5), 4096, -17)
    assert joint.drive == Drive(node=5, direction=-1, rated_torque=0.35)


def test_every_drive_has_an_id_of_its_own():
    drives = [f"{JOINT}[joint.drive]\nnode = {node}\n" for node in (3, 4, 3)]
    assert said(f'name = "a"\ngravity = [0, 0]\n{"".join(drives)}') == (
        "arm.toml: joint 3: drive: node 3 is already the drive of joint 1; expected another id"
    )


def test_a_byte_order_mark_and_windows_line_ends_are_read():
    assert reader.parse("\ufeff" + GOOD.replace("\n", "\r\n"), "a.toml").name == "arm2"


def test_the_message_of_the_design():
    message = said(GOOD + "[joint.effects.stribek]\n").replace("arm.toml", "vishard4.toml")
    assert message == (
        'vishard4.toml: joint 2: unknown effect "stribek"; did you mean "stribeck"? (tendon effects lists them all)'
    )


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("gravity =", "gravty =", 'arm.toml: unknown key "gravty"; did you mean "gravity"?'),
        ("gear_ratio", "zzz", 'arm.toml: joint 1: unknown key "zzz"; the closest known one is'),
        ("mass = 2.0", "mas = 2.0", 'arm.toml: joint 1: link: unknown key "mas"; did you mean "mass"?'),
        ("gear_ratio = 100\n", "", 'arm.toml: joint 1: missing key "gear_ratio"; needed are'),
        ("length = 0.3\n", "", 'arm.toml: joint 1: link: missing key "length"'),
        ("mass = 2.0", "mass = -2.0", "arm.toml: joint 1: link: mass is -2; expected a number in kg >= 0"),
        ("mass = 2.0", "mass = true", "link: mass is the boolean true; expected a number in kg"),
        ("mass = 2.0", 'mass = "2 kg"', 'link: mass is the text "2 kg"; expected a number in kg'),
        ("mass = 2.0", "mass = nan", "link: mass is nan; expected a number in kg that is finite"),
        ("mass = 2.0", "mass = inf", "link: mass is inf; expected a number in kg that is finite"),
        ("mass = 2.0", "mass = 1979-05-27", "link: mass is the date 1979-05-27; expected a number"),
        ("mass = 2.0", "mass = 1e300", "link: mass is 1e+300; expected 0 or a magnitude between"),
        ("mass = 2.0", "mass = 1e-300", "link: mass is 1e-300; expected 0 or a magnitude between"),
        ("mass = 2.0", f"mass = {'9' * 400}", "link: mass is a huge integer; expected"),
        ("mass = 2.0", f"mass = {'9' * 5000}", "arm.toml: not valid TOML: Exceeds the limit"),
        ("inertia = 0.05", "inertia = -1e-9", "link: inertia is -1e-09; expected a number in kg m^2 >= 0"),
        ("length = 0.3", "length = -0.3", "link: length is -0.3; expected a number in m >= 0"),
        ("com = [0.2, 0.01]", "com = 0.2", "link: com is 0.2; expected a list of 2 numbers in m: along, across"),
        ("com = [0.2, 0.01]", "com = [0.2]", "link: com is a list of 1; expected a list of 2 numbers"),
        ("com = [0.2, 0.01]", 'com = [0.2, "x"]', 'link: com[1] is the text "x"; expected a number in m'),
        ("rotor_inertia = 0.1", "rotor_inertia = -0.1", "joint 1: rotor_inertia is -0.1; expected"),
        ("gear_ratio = 100", "gear_ratio = 0", "joint 1: gear_ratio is 0; expected a number > 0"),
        ("gear_ratio = 100", "gear_ratio = 100\ntorque_constant = 0", "joint 1: torque_constant is 0; expected"),
        ("gear_ratio = 100", "gear_ratio = 100\nlimits = {position = [1, 0]}", "limits: position is [1, 0]; expected"),
        ("gear_ratio = 100", "gear_ratio = 100\nlimits = 3", "joint 1: limits: found 3; expected a table"),
        ('type = "revolute"', 'type = "rotary"', 'type is the text "rotary"; expected "revolute" or "prismatic"'),
        ("gear_ratio = 100", "gear_ratio = 100\nencoder = {}", 'joint 1: encoder: missing key "counts"'),
        ("gear_ratio = 100", "gear_ratio = 100\nencoder = {counts = 0.5}", "counts is 0.5; expected a whole number"),
        ("gear_ratio = 100", "gear_ratio = 100\nencoder = {counts = 5, zero = 0.5}", "zero is 0.5; expected a whole"),
        ("gear_ratio = 100", "gear_ratio = 100\ndrive = {}", 'joint 1: drive: missing key "node"'),
        ("gear_ratio = 100", "gear_ratio = 100\ndrive = {node = 0}", "node is 0; expected the drive's CANopen"),
        ("gear_ratio = 100", "gear_ratio = 100\ndrive = {node = 127}", "node is 127; expected the drive's"),
        ("gear_ratio = 100", "gear_ratio = 100\ndrive = {node = 1.0}", "node is 1; expected the drive's CANopen"),
        ("gear_ratio = 100", "gear_ratio = 100\ndrive = {node = 1, direction = 0}", "direction is 0; expected 1, or"),
        (
            "gear_ratio = 100",
            "gear_ratio = 100\ndrive = {node = 1, rated_torque = 0}",
            "drive: rated_torque is 0; expected a number in N m at the motor > 0",
        ),
        ("gear_ratio = 100", "gear_ratio = 100\ncontroller = {kp = 1}", 'joint 1: controller: missing key "kd"'),
        (
            "gear_ratio = 100",
            "gear_ratio = 100\ncontroller = {kp = -1, kd = 0}",
            "kp is -1; expected a number in N m/rad",
        ),
        ("\n\n[[joint]]", f"\n[controller]\n{CONTROL}gain = 1\n[[joint]]", 'controller: unknown key "gain"'),
        ("\n\n[[joint]]", "\n[controller]\nrate = 1000\n[[joint]]", 'controller: missing key "velocity_cutoff"'),
        (
            "\n\n[[joint]]",
            f"\n[controller]\n{CONTROL.replace('80', '600')}[[joint]]",
            "controller: velocity_cutoff is 600; expected a number in Hz <= 500",
        ),
        (
            "\n\n[[joint]]",
            f"\n[controller]\n{CONTROL.replace('0.9', '1.1')}[[joint]]",
            "controller: friction_scale is 1.1; expected a number <= 1",
        ),
        ('type = "revolute"', "type = 1", 'joint 1: type is 1; expected "revolute" or "prismatic"'),
        ("coefficient", "coeficient", 'viscous: unknown parameter "coeficient"; did you mean "coefficient"?'),
        ("coefficient = 1.5", "coefficient = true", "viscous: coefficient is the boolean true; expected a number"),
        ("coefficient = 1.5", "coefficient = -1", "viscous: coefficient is -1; expected a number in N m s/rad >= 0"),
        ("effects.viscous", "effects.gravity", 'effect "gravity" acts on the whole arm; put it under [effects.grav'),
        ("effects.viscous", "effects.plate", "acts at the end-effector; put it under [contact.effects.plate]"),
        ("[joint.effects.viscous]\ncoefficient = 1.5", "[joint.effects]\nviscous = 1.5", "viscous: found 1.5; exp"),
        ("[joint.effects.viscous]\ncoefficient = 1.5", "[joint]\neffects = 1", "not valid TOML"),
        ("gravity = [0.0, -9.81]", "gravity = [0.0, -9.81]\n[effects.viscous]", "put it under [joint.effects.viscous]"),
        ("gravity = [0.0, -9.81]", "gravity = [0.0, -9.81]\ngravity = 1", "arm.toml line 3: not valid TOML"),
        ("gravity = [0.0, -9.81]", "gravity = [0.0, ", "arm.toml line 4: not valid TOML"),
        ("gravity = [0.0, -9.81]", "gravity = -9.81", "gravity is -9.81; expected a list of two numbers in m/s^2"),
        ("gravity = [0.0, -9.81]", "gravity = [0, 0]\n[inertial]\n'a b' = 1", 'inertial: key "a b" is no C identifier'),
        ("gravity = [0.0, -9.81]", "gravity = [0, 0]\ncontact = {}", 'contact: missing key "x"'),
    ],
)
def test_mistakes(old: str, new: str, expected: str):
    assert expected in changed(old, new)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ('x; system("rm -rf /")', "no C identifier"),
        ("a\nb", "no C identifier"),
        ("a b", "no C identifier"),
        ("", "no C identifier"),
        ("4r", "no C identifier"),
        ("../../etc/passwd", "no C identifier"),
        ("\u0430rm", "no C identifier"),  # Cyrillic a
        ("\uff41rm", "no C identifier"),  # full-width a, which Python would accept as "arm"
        ("arm\u0301", "no C identifier"),
        ("arm*/ int x; /*", "no C identifier"),
        ("\x1b[31mred", "no C identifier"),
        ("class", "word of C"),
        ("double", "word of C"),
        ("lambda", "word of C"),
        ("None", "word of C"),
        ("__arm", "reserved"),
        ("_Arm", "reserved"),
        ("effects", "reserved for the toolkit"),
        ("tendon_lugre", "reserved for the toolkit"),
        ("std", "reserved for the toolkit"),
        ("a" * 41, "41 letters"),
    ],
)
def test_names_that_must_not_reach_c(name: str, why: str):
    message = changed('"arm2"', json.dumps(name))
    assert why in message
    assert message.isascii()


def test_the_first_of_several_mistakes_is_one_line():
    message = said(GOOD.replace("mass = 2.0", "mass = -1").replace("gear_ratio = 100", "gear_ratio = -1"))
    assert message == "arm.toml: joint 1: gear_ratio is -1; expected a number > 0"


@pytest.mark.parametrize("n", [0, 8])
def test_joint_count(n: int):
    text = 'name = "a"\ngravity = [0, 0]\n' + (JOINT * n if n else "joint = []\n")
    assert said(text) == f"arm.toml: found {n} joints; expected 1 to 7 [[joint]] tables"


def test_an_effect_of_two_joints_needs_a_second():
    assert "there is none after this one" in said(GOOD + "[joint.effects.coupled_friction]\n")


def test_every_joint_moves_something():
    still = JOINT.replace("mass = 2.0", "mass = 0").replace("inertia = 0.05", "inertia = 0").replace("0.1", "0.0")
    head = 'name = "a"\ngravity = [0, 0]\n'
    assert "joint 1: moves no inertia;" in said(head + still)
    assert "joint 2: moves no inertia;" in said(head + JOINT + still)
    assert reader.parse(head + still + JOINT, "a").joints[0].rotor_inertia == 0  # the second link moves with it
    point = still.replace("mass = 0", "mass = 1").replace("com = [0.2, 0.01]", "com = [0, 0]")
    assert "moves no inertia" in said(head + point)  # a point mass on the axis
    assert reader.parse(head + point.replace("revolute", "prismatic"), "a").joints[0].link.mass == 1


def test_files_that_are_none(tmp_path):
    cases = {tmp_path / "absent.toml": "no such file", tmp_path: "is a directory"}
    latin = tmp_path / "latin.toml"
    latin.write_bytes(b"# fine\nname = '\xe9'\n")
    cases[latin] = "latin.toml line 2: byte 0xe9 is not UTF-8; save the file as UTF-8"
    huge = tmp_path / "huge.toml"
    huge.write_bytes(b"#" * 1_000_001)
    cases[huge] = "is larger than 1 MB"
    deep = tmp_path / "deep.toml"
    deep.write_text("a = " + "[" * 100_000)
    cases[deep] = "nested too deeply"
    for path, expected in cases.items():
        with pytest.raises(ModelError) as caught:
            reader.load(path)
        assert expected in str(caught.value)
        assert "\n" not in str(caught.value)


VALUES = st.one_of(
    st.floats(), st.integers(), st.booleans(), st.text(max_size=8), st.lists(st.floats(), max_size=3), st.just({})
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.text(max_size=200))
@example("[[joint]]\n[joint]")
@example("name.a = 1\njoint.b = 2\ngravity = 3")
def test_any_text_is_refused_in_one_line(text: str):
    said(text)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_any_change_of_a_good_file_is_an_arm_or_one_line(data: st.DataObject):
    import tomlkit

    document = tomlkit.parse(GOOD).unwrap()
    places = [document]
    for place in places:  # grows while we walk: every table and list of the file
        inner = place.values() if isinstance(place, dict) else place
        places += [item for item in inner if isinstance(item, (dict, list))]
    place = data.draw(st.sampled_from(places))
    known = sorted(place) if isinstance(place, dict) else list(range(len(place)))
    fresh = st.text(min_size=1, max_size=6) if isinstance(place, dict) else st.nothing()
    place[data.draw(st.sampled_from(known) | fresh)] = data.draw(VALUES)
    try:
        text = tomlkit.dumps(document)
    except ValueError:  # what TOML cannot say at all, such as a lone surrogate
        return
    message = ""
    try:
        arm = reader.parse(text, "arm.toml")
    except ModelError as error:
        message = str(error)
    else:
        assert isinstance(arm, Arm)
        assert all(math.isfinite(v) for joint in arm.joints for v in (joint.rotor_inertia, joint.link.mass))
    assert "\n" not in message
    assert message == "" or message.startswith("arm.toml")
