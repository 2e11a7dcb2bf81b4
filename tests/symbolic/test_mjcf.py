"""MJCF in, by MuJoCo; and what is said where that is not there."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from symbolic.effects import DECLARED
from symbolic.model_file.arm import Frame, SpatialLink
from symbolic.model_file.checks import ModelError
from symbolic.model_file.exchange.importing import ImportedArm, imported

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
    assert pan.link == SpatialLink(2.0, (-0.1, 0.0, 0.0), (0.1, 0.0, 0.0, 0.2, 0.0, 0.15))
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


def test_bodies_whose_shape_is_not_there_are_unknown(tmp_path: Path) -> None:
    mesh = '<asset><mesh name="m" file="nowhere.stl"/></asset><worldbody>'
    text = ARM.replace("<worldbody>", mesh).replace('type="sphere" size="0.1" mass="1"', 'type="mesh" mesh="m"')
    made = read(tmp_path, text)
    assert made.arm.joints[2].link == SpatialLink()
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
