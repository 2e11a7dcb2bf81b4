"""Pinocchio and MuJoCo as referees: imported arms have torques, inertias and tips of the URDFs of example-robot-data,
and exported ones have the torques of the model."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness import show, sized

from runtime.arrays import Array
from runtime.model.loader import Model
from runtime.workspace.exporting import export
from runtime.workspace.source import Source
from symbolic.effects import DECLARED
from symbolic.model_file.exchange.importing import ImportedArm, imported

pin = pytest.importorskip("pinocchio", reason="the extra `benchmark` is not installed")

TOLERANCE = 1e-10
"""Of the largest torque, inertia or coordinate."""
STATES = 10
ARMS: list[tuple[str, str | None, str | None]] = [
    ("ur_description/urdf/ur10_robot.urdf", None, None),
    ("panda_description/urdf/panda.urdf", None, "panda_hand_tcp"),
    ("kinova_description/robots/kinova.urdf", None, "j2s6s200_end_effector"),
    ("xarm_description/urdf/xarm7.urdf", None, None),
    ("borinot_description/urdf/borinot_flying_arm_2.urdf", None, None),
    ("ur_description/urdf/ur5_robot.urdf", None, None),
    ("ur_description/urdf/ur3_robot.urdf", None, None),
    ("pr2_description/urdf/pr2.urdf", "torso_lift_link", "r_gripper_palm_link"),
    ("baxter_description/urdf/baxter.urdf", "torso", "left_gripper"),
    ("tiago_description/robots/tiago_no_hand.urdf", "torso_lift_link", "wrist_ft_tool_link"),
    ("talos_data/robots/talos_reduced.urdf", "torso_2_link", "arm_left_7_link"),
    ("talos_data/robots/talos_reduced.urdf", "base_link", "leg_right_6_link"),
    ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "pelvis", "left_ankle_roll_link"),
    ("romeo_description/urdf/romeo.urdf", "torso", "l_wrist"),
    ("a1_description/urdf/a1.urdf", "trunk", "FR_foot"),
    ("hyq_description/robots/hyq_no_sensors.urdf", "trunk", "lf_foot"),
    ("solo_description/robots/solo12.urdf", "base_link", "FL_FOOT"),
    ("finger_edu_description/robots/finger_edu.urdf", None, None),
    ("hextilt_description/urdf/hextilt_flying_arm_5.urdf", None, None),
    ("asr_twodof_description/urdf/TwoDofs.urdf", None, None),
]
"""URDF, base and tip link."""


def robots() -> Path:
    """Where example-robot-data has its robots."""
    try:
        files = distribution("example-robot-data").files or ()
    except PackageNotFoundError:
        pytest.skip("the extra `benchmark` is not installed")
    (one,) = (file for file in files if file.name == "ur10_robot.urdf")
    return Path(str(one.locate())).parents[2]


def snapped(urdf: str) -> str:
    """The text with exact quarter turns, as a reader of its own makes them."""

    def turned(match: re.Match[str]) -> str:
        quarters = [float(angle) / (math.pi / 2) for angle in match[1].split()]
        exact = (round(k) if abs(k - round(k)) < 1e-5 / (math.pi / 2) else k for k in quarters)
        return f'rpy="{" ".join(repr(k * math.pi / 2) for k in exact)}"'

    return re.sub(r'rpy="([-+.\deE\s]+)"', turned, urdf)


class Referee:
    """Pinocchio's model of the same chain: other joints held at 0, gravity along the base link's axes."""

    def __init__(self, urdf: str, joints: list[str], base: str, tip: str, gravity: Array) -> None:
        whole = pin.buildModelFromXML(urdf)
        own = [whole.getJointId(name) for name in joints]
        others = [k for k in range(1, whole.njoints) if k not in own]
        self.model = pin.buildReducedModel(whole, others, pin.neutral(whole))
        self.joints = [self.model.joints[self.model.getJointId(name)] for name in joints]
        self.data = self.model.createData()
        frame = self.model.frames[self._frame(base)]
        assert frame.parentJoint == 0, f"{base} moves"
        self.base = frame.placement
        self.tip = self._frame(tip)
        self.model.gravity.linear = self.base.rotation @ gravity
        self.order = [joint.idx_v for joint in self.joints]

    def _frame(self, name: str) -> int:
        return int(self.model.getFrameId(name, pin.FrameType.BODY))

    def _q(self, q: Array) -> Array:
        full = pin.neutral(self.model)
        for joint, value in zip(self.joints, q, strict=True):
            full[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        return np.asarray(full)

    def _v(self, values: Array) -> Array:
        full = np.zeros(self.model.nv)
        full[self.order] = values
        return full

    def torques(self, q: Array, qd: Array, qdd: Array) -> Array:
        return np.asarray(pin.rnea(self.model, self.data, self._q(q), self._v(qd), self._v(qdd)))[self.order]

    def inertia(self, q: Array) -> Array:
        D = np.triu(pin.crba(self.model, self.data, self._q(q)))
        return (D + np.triu(D, 1).T)[np.ix_(self.order, self.order)]

    def place(self, q: Array) -> Array:
        pin.framesForwardKinematics(self.model, self.data, self._q(q))
        return np.asarray((self.base.inverse() * self.data.oMf[self.tip]).translation)


def without_rotors(made: ImportedArm) -> Model:
    """The generated code of an imported arm whose rotors, of which no URDF knows, are nothing."""
    text = re.sub(r"^gear_ratio", "rotor_inertia = 0.0\ngear_ratio", made.text, flags=re.MULTILINE)
    return Source(Path(f"{made.arm.name}.toml"), text, DECLARED).compiled.model()


def states(n: int) -> Array:
    return np.random.default_rng(n).uniform(-1.5, 1.5, (STATES, 3, n))


def off(own: Callable[[Any], Array], there: Callable[[Any], Array], at: Array) -> float:
    """The largest difference, as a part of the largest value."""
    pairs = [(np.asarray(own(state)), np.asarray(there(state))) for state in at]
    return max(float(np.abs(a - b).max()) for a, b in pairs) / max(float(np.abs(b).max()) for _, b in pairs)


def differences(model: Model, referee: Referee) -> tuple[float, float, float]:
    """Of torques, inertia matrix and tip."""
    at = states(model.n)
    return (
        off(lambda s: model.inverse_dynamics(*s), lambda s: referee.torques(*s), at),
        off(lambda s: model.inertia(s[0]), lambda s: referee.inertia(s[0]), at),
        off(lambda s: model.tip(s[0])[:3], lambda s: referee.place(s[0]), at),
    )


def test_imported_arms_are_those_of_pinocchio() -> None:
    rows, worst = [], 0.0
    for file, base, tip in sized(ARMS, ARMS[:3]):
        path = robots() / file
        made = imported(path, DECLARED, base, tip)
        names = [joint.joint.name for joint in made.chain.joints]
        referee = Referee(
            snapped(path.read_text()), names, made.chain.base, made.chain.tip_link, np.array(made.arm.gravity)
        )
        model = without_rotors(made)
        found = differences(model, referee)
        worst = max(worst, *found)
        rows.append([f"{made.arm.name} to {made.chain.tip_link}", str(model.n), *(f"{value:.1e}" for value in found)])
    show("Imported arms and Pinocchio", ("arm", "joints", "torques", "D", "tip"), rows)
    assert worst < TOLERANCE


@pytest.mark.parametrize("number", sized([0, 1, 3], [0]))
def test_exported_arms_have_the_torques_of_the_model(number: int, tmp_path: Path) -> None:
    """Identified base parameters, here 3 % off the file's at random, as bodies in Pinocchio and in MuJoCo."""
    mujoco = pytest.importorskip("mujoco")
    file, base, tip = ARMS[number]
    made = imported(robots() / file, DECLARED, base, tip, friction=False)
    text = re.sub(r"^gear_ratio", "rotor_inertia = 0.4\ngear_ratio", made.text, flags=re.MULTILINE)
    source = Source(Path("arm.toml"), text, DECLARED)
    model = source.compiled.model()
    lumps = model.lump_values * np.random.default_rng(1).normal(1.0, 0.03, len(model.lumps))
    values = "".join(f"{lump.name} = {float(v)!r}\n" for lump, v in zip(model.lumps, lumps, strict=True))
    fitted = Source(source.path, f"{text}\n[inertial]\n{values}", DECLARED)
    document = export(fitted.compiled, "urdf", tmp_path / "arm.urdf")
    urdf = (tmp_path / "arm.urdf").read_bytes()
    referee = Referee(urdf.decode(), [joint.name for joint in document.joints], "base", "tip", np.array(model.gravity))
    for joint, written in zip(referee.joints, document.joints, strict=True):
        referee.model.armature[joint.idx_v] = written.rotor_inertia
    export(fitted.compiled, "mjcf", tmp_path / "arm.xml")
    there = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    there.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(there)

    def in_mujoco(state: Array) -> Array:
        data.qpos[:], data.qvel[:], data.qacc[:] = state
        mujoco.mj_inverse(there, data)
        return np.array(data.qfrc_inverse)

    at = states(model.n)
    own = lambda s: model.inverse_dynamics(*s, lumps=lumps)  # noqa: E731
    missed = off(lambda s: referee.torques(*s), own, at), off(in_mujoco, own, at)
    show(
        f"{model.name}, exported with base parameters 3 % off",
        ("missing, as export says", "Pinocchio", "MuJoCo"),
        [[f"{document.missing:.1e}", *(f"{value:.1e}" for value in missed)]],
    )
    assert max(missed) < TOLERANCE + 10 * document.missing


@pytest.mark.parametrize(("name", "number"), [("ur10", 0), ("panda", 1)])
def test_the_arms_that_ship_are_what_import_makes_of_the_whole_urdf(name: str, number: int) -> None:
    file, base, tip = ARMS[number]
    assert imported(robots() / file, DECLARED, base, tip).text == Source.shipped(name).text
