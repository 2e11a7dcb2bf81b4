"""MJCF in, by MuJoCo; and what is said where that is not there."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from runtime.exchange.bodies import full_regressor
from symbolic.effects import DECLARED
from symbolic.model_file.arm import Frame, Link
from symbolic.model_file.checks import ModelError
from symbolic.model_file.exchange.importing import ImportedArm, imported
from symbolic.model_file.frames import StatedBody, about, angles, composed, parameters, rotation, scaled
from tests.own_time import takes_less_than

ARM = """\
<mujoco model="two arm">
  <compiler angle="radian"/>
  <option gravity="0 0 -9.8"/>
  <default><joint damping="0.5"/></default>
  <worldbody>
    <body name="a" pos="0 0 0.3">
      <joint name="pan" axis="0 0 1" pos="0.1 0 0" armature="0.1" frictionloss="0.2" range="-1 1"/>
      <inertial pos="0 0 0" mass="2" diaginertia="0.1 0.2 0.15"/>
      <body name="b" pos="0 0 0.2" quat="0.7071067811865476 0.7071067811865475 0 0">
        <joint name="lift" axis="0 1 0" stiffness="3" springref="0.2" ref="0.1" damping="0.7"/>
        <joint name="slide" type="slide" axis="1 0 0" damping="0.9"/>
        <geom type="sphere" size="0.1" mass="1"/>
        <site name="tool" pos="0 0 0.2"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="m" joint="pan" gear="50" forcelimited="true" forcerange="-2 2"/></actuator>
</mujoco>
"""


def read(tmp_path: Path, text: str, **asked) -> ImportedArm:
    path = tmp_path / "arm.xml"
    path.write_text(text)
    return imported(path, DECLARED, **asked)


def test_without_mujoco_it_is_asked_for_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ModelError, match=r"arm.xml: MJCF is read by the package mujoco.*pip install mujoco.*`mjcf`"):
        read(tmp_path, ARM)


def test_a_mujoco_that_is_too_old_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", SimpleNamespace(__version__="3.2.0", MjSpec=object))
    with pytest.raises(ModelError, match=r"arm.xml: MJCF needs a newer mujoco than 3\.2\.0: pip install"):
        read(tmp_path, ARM)


def test_an_arm_is_what_the_file_says(tmp_path: Path) -> None:
    arm = read(tmp_path, ARM).arm
    pan, lift, slide = arm.joints
    assert (arm.name, arm.gravity) == ("two_arm", (0.0, 0.0, -9.8))
    assert [joint.type for joint in arm.joints] == ["revolute", "revolute", "prismatic"]
    assert (pan.rotor_inertia, pan.gear_ratio, lift.rotor_inertia) == (0.1, 50.0, None)
    assert (pan.limits.position, pan.limits.torque, lift.limits.position) == ((-1.0, 1.0), 100.0, None)
    # A joint that stands off its body's frame is a frame of its own.
    assert pan.origin == Frame((0.1, 0.0, 0.3))
    assert pan.link == Link(2.0, (-0.1, 0.0, 0.0), (0.1, 0.0, 0.0, 0.2, 0.0, 0.15))
    # The reference is turned away: q = 0 is 0.1 rad before where the file draws the arm.
    assert lift.origin == Frame((-0.1, 0.0, 0.2), (math.pi / 2, 0.0, -0.1))
    assert lift.link.mass == 0.0
    sphere = 0.4 * 0.1**2
    assert slide.link.inertia == pytest.approx((sphere, 0.0, 0.0, sphere, 0.0, sphere))
    assert arm.tip == Frame((0.0, 0.0, 0.2))
    stated = [sorted(value for values in joint.effects.values() for value in values.values()) for joint in arm.joints]
    assert stated == [[0.2, 0.2, 0.5], [0.2, 0.7, 3.0], [0.9]]
    # Friction that differs by direction holds a constant, and so does the rest of a spring.
    assert ["coulomb_asymmetric" in joint.effects for joint in arm.joints] == [True, False, True]
    assert ["coulomb" in joint.effects for joint in arm.joints] == [False, True, False]


RICH = """\
<mujoco model="rich">
  <compiler angle="degree" eulerseq="zyx" inertiafromgeom="{source}" inertiagrouprange="0 2"/>
  <option gravity="1 -2 -9"/>
  <default>
    <joint damping="0.5"/><geom density="800"/>
    <default class="light"><geom density="50"/><joint armature="0.3" stiffness="2" springref="11"/>
      <default class="slid"><joint type="slide" axis="1 1 0" frictionloss="0.3"/></default>
    </default>
  </default>
  <worldbody>
    <frame pos="0.1 0 0.2" euler="90 20 0">
      <body name="a" pos="0 0 0.3" axisangle="1 2 3 40">
        <joint axis="0 3 1" pos="0.1 0 0" ref="10" stiffness="1"/>
        <inertial pos="0 0.1 0" mass="2" fullinertia="0.1 0.2 0.15 0.01 0.02 -0.01" />
        <geom type="capsule" fromto="0 0 0 0.1 0.2 0.3" size="0.03"/>
        <geom type="box" size="0.1 0.2 0.3" group="3"/>
        <body name="b" pos="0 0.2 0.2" quat="1 2 3 4" childclass="light">
          <joint class="slid" ref="0.2"/>
          <joint axis="0 1 0" springref="-20"/>
          <geom type="box" fromto="0 0 0 0.1 0 0.1" size="0.02"/>
          <geom type="sphere" size="0.1" class="main" xyaxes="1 1 0 0 1 1"/>
          <body pos="0.1 0 0" zaxis="1 1 1"><geom type="cylinder" size="0.1 0.05" mass="0.4"/></body>
          <site name="tool" pos="0.1 0.2 0.3" euler="10 20 30"/>
        </body>
      </body>
    </frame>
  </worldbody>
</mujoco>
"""


def test_a_file_may_be_called_anything(tmp_path: Path) -> None:
    """MuJoCo reads .xml alone."""
    (tmp_path / "arm.mjcf").write_text(ARM)
    assert imported(tmp_path / "arm.mjcf", DECLARED).arm == read(tmp_path, ARM).arm
    (tmp_path / "part.xml").write_text("<mujoco/>")
    (tmp_path / "whole.mjcf").write_text(ARM.replace("<default>", '<include file="part.xml"/><default>'))
    with pytest.raises(ModelError, match=r"whole\.mjcf line 4: <include> of another file .* ends in \.xml"):
        imported(tmp_path / "whole.mjcf", DECLARED)


@pytest.mark.parametrize("source", ["auto", "true"])
def test_torques_and_tip_are_those_of_mujoco(tmp_path: Path, source: str) -> None:
    """Classes, frames, degrees, every way to write an angle, inertias stated and of shapes: by mj_inverse."""
    mujoco = pytest.importorskip("mujoco")
    arm = read(tmp_path, RICH.format(source=source), tip="tool").arm
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    links = [joint.link for joint in arm.joints]
    bodies = [parameters(StatedBody(link.mass, link.com, link.inertia)) for link in links]
    full = np.concatenate([*bodies, [joint.rotor_inertia or 0.0 for joint in arm.joints]])
    for q, qd, qdd in np.random.default_rng(1).uniform(-1, 1, (5, 3, 3)):
        own = np.einsum("jcN,c->j", full_regressor(arm, q[:, None], qd[:, None], qdd[:, None]), full)
        for k, joint in enumerate(arm.joints):
            spring = joint.effects["linear_spring"]
            own[k] += joint.effects["viscous"]["coefficient"] * qd[k] + spring["stiffness"] * (q[k] - spring["rest"])
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(own, data.qfrc_inverse, atol=1e-10 * np.abs(data.qfrc_inverse).max())
        at = Frame()
        for joint, value in zip(arm.joints, q, strict=True):
            turn = joint.type == "revolute"
            moved = Frame(rpy=angles(about(joint.axis, value))) if turn else Frame(scaled(value, unit(joint.axis)))
            at = composed(composed(at, joint.origin), moved)
        at = composed(at, arm.tip)
        np.testing.assert_allclose(at.xyz, data.site("tool").xpos, atol=1e-10)
        np.testing.assert_allclose(rotation(at.rpy), data.site("tool").xmat.reshape(3, 3), atol=1e-10)


def unit(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    return scaled(1 / math.hypot(*axis), axis)


def test_inertias_of_shapes_that_are_not_there_are_unknown_beside_stated_ones_too(tmp_path: Path) -> None:
    """inertiafromgeom says which of the two counts."""
    mesh = '<asset><mesh name="m" file="nowhere.stl"/></asset><worldbody>'
    text = ARM.replace("<worldbody>", mesh).replace("<inertial", '<geom type="mesh" mesh="m"/><inertial')
    for source, mass in (("auto", 2.0), ("true", None)):
        ruled = text.replace('angle="radian"', f'angle="radian" inertiafromgeom="{source}"')
        assert read(tmp_path, ruled).arm.joints[0].link.mass == mass


def test_a_total_mass_over_unknown_ones_leaves_all_unknown(tmp_path: Path) -> None:
    mesh = '<asset><mesh name="m" file="nowhere.stl"/></asset><worldbody>'
    text = ARM.replace("<worldbody>", mesh).replace('type="sphere" size="0.1" mass="1"', 'type="mesh" mesh="m"')
    made = read(tmp_path, text.replace('angle="radian"', 'angle="radian" settotalmass="5"'))
    assert [joint.link.mass for joint in made.arm.joints] == [None, 0.0, None]


def test_what_stands_on_the_motor_is_brought_to_the_joint(tmp_path: Path) -> None:
    """By the gear's square; a control that is a force limits the torque as a force does."""
    mujoco = pytest.importorskip("mujoco")
    if not hasattr(mujoco.MjModel, "actuator_armature"):
        pytest.skip("a MuJoCo without inertias of actuators")
    motor = '<motor name="m" joint="pan" gear="50" armature="1e-4" damping="2e-4" ctrllimited="true" ctrlrange="-1 2"'
    pan = read(tmp_path, ARM.replace('<motor name="m" joint="pan" gear="50"', motor)).arm.joints[0]
    assert pan.rotor_inertia == pytest.approx(0.1 + 2500e-4)
    assert pan.effects["viscous"]["coefficient"] == pytest.approx(0.5 + 2500 * 2e-4)
    assert pan.limits.torque == 50.0


def test_gears_of_one_joint_that_differ_are_named_and_none_is_taken(tmp_path: Path) -> None:
    """Their torques add up all the same, at the joint; those that agree, or move nothing, leave no doubt."""
    second = '<motor name="second" joint="pan" gear="{gear}" forcelimited="true" forcerange="-3 3"/></actuator>'
    beside = {gear: read(tmp_path, ARM.replace("</actuator>", second.format(gear=gear))) for gear in ("80", "-50", "0")}
    drives = [(made.arm.joints[0].gear_ratio, made.arm.joints[0].limits.torque) for made in beside.values()]
    assert drives == [(1.0, 100.0 + 240.0), (50.0, 100.0 + 150.0), (50.0, 100.0)]
    said = [[note for note in made.notes if note.startswith("gear_ratio of joint 1:")] for made in beside.values()]
    assert said == [
        [
            "gear_ratio of joint 1: the file states different ones (50 of actuator m, 80 of actuator second): set to "
            "1; ripple, encoders and currents need the true one"
        ],
        [],
        [],
    ]
    assert "unknown: the file states different ones (50 of actuator m, 80 of actuator second)" in beside["80"].text


def test_a_joint_is_limited_where_all_that_move_it_are(tmp_path: Path) -> None:
    free = ARM.replace("</actuator>", '<motor joint="pan" gear="50"/></actuator>')
    assert read(tmp_path, free).arm.joints[0].limits.torque is None
    own = free.replace('name="pan"', 'name="pan" actuatorfrclimited="true" actuatorfrcrange="-70 60"')
    assert read(tmp_path, own).arm.joints[0].limits.torque == 60.0


def test_an_armature_that_is_one_number_everywhere_is_said(tmp_path: Path) -> None:
    """Simulators want one to be stable."""
    made = read(tmp_path, ARM.replace('<joint damping="0.5"/>', '<joint armature="0.1"/>'))
    assert [joint.rotor_inertia for joint in made.arm.joints] == [0.1] * 3
    assert any(note.startswith("rotor_inertia = 0.1 at all joints: looks like a placeholder") for note in made.notes)


def test_gravity_may_be_switched_off(tmp_path: Path) -> None:
    made = read(tmp_path, ARM.replace('"0 0 -9.8"/>', '"0 0 -9.8"><flag gravity="disable"/></option>'))
    assert made.arm.gravity == (0.0, 0.0, 0.0)
    assert any("gravity is disabled" in note for note in made.notes)


@pytest.mark.parametrize(
    ("put", "note"),
    [
        (("<option ", '<option density="1.2" '), "the drag of air or water"),
        (('damping="0.5"', 'damping="0.5 0.1"'), "damping is a polynomial: its linear coefficient is used"),
        (('stiffness="3"', 'stiffness="3 1"'), "stiffness is a polynomial"),
    ],
)
def test_what_an_arm_has_not_is_said(tmp_path: Path, put: tuple[str, str], note: str) -> None:
    try:
        made = read(tmp_path, ARM.replace(*put))
    except ModelError:
        pytest.skip("a MuJoCo without such")
    assert any(said.startswith(note) for said in made.notes)


@pytest.mark.parametrize(
    ("stated", "instead"),
    [
        ("<worldbody>", '<size nuserdata="2000000000"/><worldbody>'),
        ("<worldbody>", '<size nkey="2000000000"/><worldbody>'),
        ("<worldbody>", '<size nuser_body="2000000000" nuser_jnt="2000000000"/><worldbody>'),
        ("<worldbody>", '<size njmax="2000000000" nconmax="2000000000"/><worldbody>'),
        ("<worldbody>", '<size memory="900G"/><worldbody>'),
        ("<motor ", '<general dyntype="user" actdim="2000000000" '),
    ],
)
def test_room_that_a_file_asks_for_is_not_taken(tmp_path: Path, stated: str, instead: str) -> None:
    with takes_less_than(2):
        made = read(tmp_path, ARM.replace(stated, instead, 1))
    assert made.arm == read(tmp_path, ARM).arm


BODY = '<body name="a"><joint name="j"/><geom size="0.1"/></body>'


@pytest.mark.parametrize(
    ("inside", "expected"),
    [
        ('<replicate count="1000000"><geom size="0.1"/></replicate>', "unfolds into more than 10,000 elements"),
        (
            '<replicate count="1000"><replicate count="1000"><geom size="0.1"/></replicate></replicate>',
            "unfolds into more than 10,000 elements",
        ),
        ('<flexcomp name="f" type="grid" count="1000 1000 1000" spacing="1 1 1"/>', "unfolds into more than"),
        ('<geom size="0.1"/>' * 20_000, "unfolds into more than 10,000 elements"),
        ("</worldbody><include file='large.xml'/><worldbody>", "unfolds into more than 10,000 elements"),
        ("</worldbody><include file='arm.xml'/><worldbody>", "already included"),
        ("</worldbody><include file='laughs.xml'/><worldbody>", "declares an entity"),
        (
            '</worldbody><asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset><worldbody>',
            "<hfield> has more numbers than a robot needs",
        ),
        ('</worldbody><option gravity="0 0 nan"/><worldbody>', 'line 1: <option> gravity is "0 0 nan"; expected'),
        ('<geom size="0.1" mass="NaN"/>', 'line 1: <geom> mass is "NaN"; expected numbers that are finite'),
        ("</worldbody><include file='nobody.xml'/><worldbody>", "includes has a NaN; expected numbers that are finite"),
    ],
)
def test_hostile_files_are_one_line_in_bounded_time(tmp_path: Path, inside: str, expected: str) -> None:
    large = '<replicate count="20000"><geom size="0.1"/></replicate>'
    (tmp_path / "large.xml").write_text(f"<mujoco><worldbody>{large}</worldbody></mujoco>")
    (tmp_path / "nobody.xml").write_text('<mujoco><option gravity="0 0 nan"/></mujoco>')
    (tmp_path / "laughs.xml").write_text('<!DOCTYPE m [<!ENTITY l "ha">]><mujoco>&l;</mujoco>')
    with takes_less_than(2), pytest.raises(ModelError) as caught:
        read(tmp_path, f"<mujoco><worldbody>{BODY}{inside}</worldbody></mujoco>")
    message = str(caught.value)
    assert expected in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("stated", "instead", "expected"),
    [
        ('gear="50"', 'gear="50" armature="nan"', 'line 17: <motor> armature is "nan"; expected'),
        ('gear="50"', 'gear="50" armature="inf"', "actuator_armature is inf; expected"),
        ('gear="50"', 'gear="50" damping="nan"', 'line 17: <motor> damping is "nan"; expected'),
        ('gear="50"', 'gear="1e200"', r"actuator_gear is 1e\+200; expected"),
        ('gear="50"', 'gear="1e9" armature="1"', r"joint 1: rotor_inertia is 1e\+18; expected"),
        ('"-2 2"', '"-2 nan"', 'line 17: <motor> forcerange is "-2 nan"; expected'),
        ('range="-1 1"', 'range="-1 nan"', 'line 7: <joint> range is "-1 nan"; expected'),
    ],
)
def test_what_an_actuator_or_a_range_cannot_be_is_one_line(
    tmp_path: Path, stated: str, instead: str, expected: str
) -> None:
    with pytest.raises(ModelError, match=expected):
        read(tmp_path, ARM.replace(stated, instead, 1))


@pytest.mark.parametrize("behind", [False, True])
def test_a_model_that_is_attached_again_and_again_is_counted_so(tmp_path: Path, behind: bool) -> None:
    geoms = '<geom size="0.1"/>' * 1000
    (tmp_path / "part.xml").write_text(f"<mujoco><worldbody><body name='x'>{geoms}</body></worldbody></mujoco>")
    asset = '<asset><model name="part" file="part.xml"/></asset>'

    def file(often: int) -> str:
        body = "".join(f'<attach model="part" body="x" prefix="p{k}_"/>' for k in range(often))
        world = f"<worldbody>{BODY.replace('</body>', body)}</body></worldbody>"
        return f"<mujoco>{world + asset if behind else asset + world}</mujoco>"

    assert len(read(tmp_path, file(2)).arm.joints) == 1
    with pytest.raises(ModelError, match="unfolds into more than 10,000 elements"):
        read(tmp_path, file(20))


def test_thousands_of_shapes_take_no_minutes(tmp_path: Path) -> None:
    mesh = '<asset><mesh name="m" file="nowhere.stl"/></asset>'
    geoms = '<geom type="mesh" mesh="m" mass="0"/>' * 4000
    with takes_less_than(2):
        read(tmp_path, f"<mujoco>{mesh}<worldbody>{geoms}{BODY}</worldbody></mujoco>")


def test_bodies_whose_shape_is_not_there_are_unknown(tmp_path: Path) -> None:
    mesh = '<asset><mesh name="m" file="nowhere.stl"/></asset><worldbody>'
    text = ARM.replace("<worldbody>", mesh).replace('type="sphere" size="0.1" mass="1"', 'type="mesh" mesh="m"')
    made = read(tmp_path, text)
    assert made.arm.joints[2].link == Link()
    assert any(note.startswith("mass, centre and inertia of joint 3: not stated") for note in made.notes)


def test_what_is_only_drawn_needs_no_file(tmp_path: Path) -> None:
    """As in collections of simulated arms: meshes and materials beside the shapes that weigh."""
    assets = (
        '<asset><texture name="wood" file="nowhere.png" type="2d"/><material name="m" texture="wood"/>'
        '<mesh name="fine" file="nowhere.stl"/></asset><worldbody>'
    )
    fine = '<geom type="mesh" mesh="fine" mass="0"/><geom type="sphere" material="m"'
    text = ARM.replace("<worldbody>", assets).replace('<geom type="sphere"', fine)
    text = text.replace('<site name="tool"', '<site name="tool" material="m"')
    assert read(tmp_path, text).arm == read(tmp_path, ARM).arm


def test_weightless_bodies_are_said(tmp_path: Path) -> None:
    made = read(tmp_path, ARM.replace('<body name="b"', '<body name="b" gravcomp="1"'))
    assert any(note.startswith("gravcomp") for note in made.notes)


def test_what_mujoco_warns_of_is_heard_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ModelError):
        read(tmp_path, ARM.replace('mass="2"', 'mass="nan"'))
    assert [path.name for path in tmp_path.iterdir()] == ["arm.xml"]
    assert capfd.readouterr() == ("", "")


def test_what_mujoco_refuses_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ModelError) as caught:
        read(tmp_path, ARM.replace("<worldbody>", "<nonsense/><worldbody>"))
    assert "arm.xml: MuJoCo says: XML Error: Schema violation" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_body_that_floats_is_no_arm(tmp_path: Path) -> None:
    text = ARM.replace('<joint name="pan"', '<freejoint name="float"/>\n<!--').replace('range="-1 1"/>', "-->")
    with pytest.raises(ModelError, match='joint "float" is free; an arm has revolute, continuous or prismatic joints'):
        read(tmp_path, text.replace('<motor name="m" joint="pan"', '<motor name="m" joint="lift"'))
