"""The controller's step as the arm sees it: against a composition in double of the model's own functions."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from math import exp, pi
from pathlib import Path

import numpy as np
import pytest
from compositions import PLATE, POSTURE, Array, Composition, agree, near, run, still, there_and_back, trajectory
from hypothesis import example, given, settings
from hypothesis import strategies as st
from random_arms import MIXED
from stepped import Controller

from codegen.prepare import prepare_arm, prepare_firmware
from runtime.hardware.settings import ControllerError
from runtime.model.loader import Library, Model
from runtime.planning.trajectory import Phase
from symbolic.effects import LIBRARY
from symbolic.model_file import reader
from symbolic.model_file.arm import Arm, Control, Gains, Limits

ARMS = Path(__file__).resolve().parents[2] / "symbolic" / "arms"


@pytest.fixture(scope="session")
def make(vishard4: Arm, model: Model) -> Callable[..., Controller]:
    """A controller of the paper's arm."""
    directory = prepare_firmware(vishard4, LIBRARY)
    return lambda trajectory, **options: Controller(directory, model, trajectory, **options)


seeds = st.integers(0, 2**32 - 1)
quick = settings(max_examples=15, deadline=None)


@quick
@given(seed=seeds)
def test_free_motion(make: Callable[..., Controller], model: Model, seed: int) -> None:
    """Any degree, any number of phases, springs anywhere, friction compensated or not."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform(-1, 1, (4, 1))
    phases = [
        Phase("q", rng.uniform(0.05, 0.3), middle + 0.005 * rng.normal(size=(4, rng.integers(2, 13))))
        for _ in range(rng.integers(1, 4))
    ]
    springs = {
        joint: {"stiffness": rng.uniform(0, 8e3), "radius": 0.06, "offset": rng.normal(), "pretension": 2.0}
        for joint in range(1, 5)
        if rng.random() < 0.5
    }
    plan = trajectory(phases, bool(rng.random() < 0.7), springs=springs)
    friction = bool(rng.random() < 0.5)
    c = make(plan, friction=friction)
    agree(c, Composition(model, plan, friction), near(plan, model, rng, 250))


@quick
@given(seed=seeds)
@example(seed=472)  # near the stretched arm, where torques are limited
def test_contact(make: Callable[..., Controller], model: Model, seed: int) -> None:
    """Coordinates of the contact, and the plate where the end-effector is below it and above it."""
    rng = np.random.default_rng(seed)
    w = model.contact_coordinates(POSTURE)
    points = np.tile(w[:, None], 8) + 0.01 * rng.normal(size=(4, 8)) * [[0], [1], [3], [3]]
    contact = {**PLATE, "plate": {**PLATE["plate"], "position": float(model.tip(POSTURE)[1])}}
    plan = trajectory([Phase("w", 0.2, points)], contact=contact)
    c = make(plan)
    agree(c, Composition(model, plan), near(plan, model, rng, 200))


# --- the trajectory ---


def test_time_does_not_drift(make: Callable[..., Controller], model: Model) -> None:
    """Phases that are no whole number of periods, round and round for twenty seconds."""
    points = POSTURE[:, None] + np.array([0.0, 0.0, 0.1, 0.1])
    plan = trajectory([Phase("q", 0.0507, points), Phase("q", 0.0233, points[:, ::-1].copy())])
    c = make(plan)
    c.reset(c.counts(POSTURE))
    followed = []
    for _ in range(20_000):
        c.step(c.counts(POSTURE))
        followed.append(c.q_desired.copy())
    error = np.array(followed).T - plan.at(model, np.arange(20_000) * c.dt).q
    assert np.abs(error).max() < 1e-5


def test_phases_follow_each_other(make: Callable[..., Controller]) -> None:
    plan = there_and_back()
    c = make(plan)
    c.reset(c.counts([0.0] * 4))
    phases = []
    for _ in range(2400):
        c.step(c.counts([0.0] * 4))
        phases.append(c.phase)
    assert phases == ([0] * 600 + [1] * 600) * 2
    assert not c.finished


def test_phases_shorter_than_a_period_do_not_run_ahead(make: Callable[..., Controller]) -> None:
    """As rounding may make them, here by far: nothing is desired that is not between the control points."""
    points = POSTURE[:, None] + np.array([0.0, 0.1, 0.1, 0.0])
    c = make(trajectory([Phase("q", 0.05, points)]))
    for phase in c._phases:
        phase.duration = 0.4 * c.dt
    c.reset(c.counts(POSTURE))
    for _ in range(200):
        c.step(c.counts(POSTURE))
        assert (np.abs(c.q_desired - POSTURE - 0.05) < 0.0501).all()


def test_rest_at_the_end(make: Callable[..., Controller], model: Model) -> None:
    """A motion that ends with speed: the arm is held where it ends, without speed or acceleration."""
    points = np.tile(POSTURE[:, None], 3) + np.array([0.0, 0.01, 0.04])
    plan = trajectory([Phase("q", 0.05, points)], periodic=False)
    c = make(plan)
    c.reset(c.counts(POSTURE))
    flags = []
    for _ in range(200):
        c.step(c.counts(points[:, -1]))
        flags.append(c.finished)
    assert flags == [False] * 50 + [True] * 150
    assert c.q_desired == pytest.approx(points[:, -1])
    assert c.torque == pytest.approx([j.gains.kp * e for j, e in zip(model.joints, c.q_desired - c.q, strict=True)])


def test_a_straight_line(make: Callable[..., Controller]) -> None:
    """Two control points a coordinate."""
    plan = trajectory([Phase("q", 0.1, np.array([POSTURE, POSTURE + 0.1]).T)], periodic=False)
    c = make(plan)
    c.reset(c.counts(POSTURE))
    for k in range(50):
        c.step(c.counts(POSTURE))
        assert c.q_desired == pytest.approx(POSTURE + k * 1e-3, abs=1e-6)


@pytest.mark.parametrize("degree", [2, 3, 7, 10, 20, 29])
def test_polynomials_of_any_degree(make: Callable[..., Controller], model: Model, degree: int) -> None:
    """Control points that alternate, the worst for any form of a polynomial but Bernstein's."""
    rng = np.random.default_rng(degree)
    points = POSTURE[:, None] + rng.choice([-1.0, 1.0], (4, degree + 1))
    plan = trajectory([Phase("q", 1.0, points)])
    c = make(plan)
    c.reset(c.counts(POSTURE))
    followed = []
    for _ in range(1000):
        c.step(c.counts(POSTURE))
        followed.append(c.q_desired.copy())
    error = np.array(followed).T - plan.at(model, np.arange(1000) * c.dt).q
    assert np.abs(error).max() < 2e-6


# --- compensation ---


def held_and_moved(make: Callable[..., Controller], speed: float, **options: bool) -> Array:
    """The torque after 50 steps at a speed in the rest position of the plan."""
    c = make(still(), **options)
    path = POSTURE[:, None] + speed * 1e-3 * np.arange(-50, 1)
    return run(c, np.array([c.counts(q) for q in path.T]).T)[:, -1]


def test_no_friction_at_rest(make: Callable[..., Controller]) -> None:
    assert (held_and_moved(make, 0.0) == held_and_moved(make, 0.0, friction=False)).all()


@pytest.mark.parametrize("speed", [-2.0, -0.5, -0.05, 0.05, 0.5, 2.0])
def test_friction_is_underestimated(make: Callable[..., Controller], model: Model, speed: float) -> None:
    compensated = held_and_moved(make, speed) - held_and_moved(make, speed, friction=False)
    names = ("coulomb_asymmetric", "viscous", "viscous_cubic")
    for torque, joint in zip(compensated, model.joints, strict=True):
        # The measured speed swings by the encoder's steps about the true one.
        fast = {"qd": np.array([speed * 1.1])}
        friction = sum(float(model.library.torque(name, fast, joint.effects[name])[0]) for name in names)
        assert 0 < torque / friction < 0.95


def test_no_spring_is_a_spring_without_stiffness(make: Callable[..., Controller]) -> None:
    slack = {"stiffness": 0.0, "radius": 0.06, "offset": 5.0, "pretension": 0.0}
    counts = make(still()).counts(POSTURE)[:, None] + np.arange(20)
    with_slack = run(make(still(springs=dict.fromkeys(range(1, 5), slack))), counts)
    assert (run(make(still()), counts) == with_slack).all()


def test_the_spring_of_equation_2(make: Callable[..., Controller]) -> None:
    """What the motor need not do, it does not: minus r^2 k (q_s0 - q) - r F_s0 below the offset."""
    counts = make(still()).counts(POSTURE)[:, None]
    q4 = float(counts[3, 0]) * make(still()).position_per_count[3]
    taut = {"stiffness": 5900.0, "radius": 0.06, "offset": 0.5, "pretension": 3.0}
    change = run(make(still(springs={4: taut})), counts) - run(make(still()), counts)
    assert change[:, 0] == pytest.approx([0, 0, 0, -(0.06**2 * 5900 * (0.5 - q4) + 0.06 * 3)], rel=1e-5)


def test_a_plate_out_of_reach_is_no_plate(make: Callable[..., Controller]) -> None:
    far = {**PLATE, "plate": {**PLATE["plate"], "position": -1e3}}
    counts = make(still()).counts(POSTURE)[:, None] + np.arange(20)
    assert (run(make(still()), counts) == run(make(still(contact=far)), counts)).all()


def test_the_plate_of_equation_3(make: Callable[..., Controller], model: Model) -> None:
    """At rest 2 cm below the plate: minus the lever times its force."""
    y = float(model.tip(POSTURE)[1])
    pressed = {"plate": {"stiffness": 686.0, "pretension": 24.0, "friction": 2.0, "position": y + 0.02}}
    counts = make(still()).counts(POSTURE)[:, None]
    change = run(make(still(contact=pressed)), counts) - run(make(still()), counts)
    force = 24.0 + 686.0 * 0.02
    assert change[:, 0] == pytest.approx(-model.tip_jacobian(POSTURE)[1] * force, rel=1e-3, abs=1e-3)


def test_every_effect_that_can_be(vishard4: Arm, library: Library) -> None:
    """All static effects at once at every joint, against the library's torques."""
    joint_effects = {
        "offset": {"torque": 0.3},
        "linear_spring": {"stiffness": 2.0, "rest": 0.1},
        "cable": {"c1": 0.3, "c2": -0.2, "c3": 0.1, "c4": 0.05},
        "end_stop": {"position": 0.35, "stiffness": 50.0, "damping": 1.0, "side": 1.0},
        "torque_ripple": {"order": 2.0, "amplitude": 0.4, "phase": 0.5},
        "torque_ripple_2": {"order": 18.0, "amplitude": 0.2, "phase": -1.0},
        "stribeck": {"torque": 0.7, "speed": 0.2},
        "viscous_power": {"torque": 0.5, "exponent": 0.6},
        "lugre": {"stiffness": 100.0, "damping": 0.1},
    }
    joints = [replace(joint, effects=joint_effects) for joint in vishard4.joints]
    joints[1] = replace(joints[1], effects={**joint_effects, "coupled_friction": {"torque": 0.8}})
    arm = replace(vishard4, joints=tuple(joints), effects={"gravity": {"gx": 0.3, "gy": -9.0}})
    model = Model(prepare_arm(arm), library)
    c = Controller(prepare_firmware(arm, LIBRARY), model, still())
    bare = Controller(prepare_firmware(vishard4, LIBRARY), Model(prepare_arm(vishard4), library), still(), False)
    counts = c.counts(POSTURE)[:, None] + np.array([[7], [-5], [9], [3]]) * np.arange(30)
    found = (run(c, counts) - run(bare, counts))[:, -1]
    q, qd = c.q.astype(float), c.qd.astype(float)
    factor = 0.92 * (1 - np.exp(-150 * np.abs(qd)))
    expected = np.array([0.3, -9.0]) @ -model.call("moment_jacobian", {"q": q})
    for i in range(4):
        signals = {"q": q[i], "qd": qd[i], "ratio": 100.0}
        for name, values in joint_effects.items():
            if name != "lugre":
                scale = factor[i] if name in ("stribeck", "viscous_power") else 1.0
                effect = name.removesuffix("_2")
                read = {s: np.array([signals[s]]) for s in library[effect].signals}
                expected[i] += scale * library.torque(effect, read, values)[0] if read else scale * values["torque"]
    both = 0.8 * np.sign(qd[1] + qd[2])
    expected += [0, both * factor[1], both * factor[2], 0]
    assert found == pytest.approx(expected, abs=2e-4)
    assert c.uncompensated == ("lugre@1", "lugre@2", "lugre@3", "lugre@4")


def test_joints_that_slide(library: Library) -> None:
    """An arm of both kinds of joints under gravity: inverse dynamics and gains."""
    settings = Control(rate=2000.0, velocity_cutoff=200.0, friction_scale=0.9, friction_slope=100.0)
    base = MIXED["rp"]
    joints = tuple(replace(joint, gains=Gains(300.0, 20.0), encoder_counts=4096) for joint in base.joints)
    arm = replace(base, joints=joints, controller=settings)
    model = Model(prepare_arm(arm), library)
    q = np.array([0.3, 0.2])
    plan = replace(still(), arm=arm.name, phases=(Phase("q", 1.0, np.tile(q[:, None], 3)),))
    c = Controller(prepare_firmware(arm, LIBRARY), model, plan)
    assert c.dt == 5e-4
    torque = run(c, c.counts(q)[:, None])[:, 0]
    assert torque == pytest.approx(model.inverse_dynamics(q, 0 * q, 0 * q) + 300.0 * (q - c.q), rel=1e-4)


# --- limits and faults ---


def test_torques_are_limited(vishard4: Arm, library: Library) -> None:
    joints = tuple(replace(joint, limits=Limits(torque=2.0)) for joint in vishard4.joints)
    arm = replace(vishard4, joints=joints)
    c = Controller(prepare_firmware(arm, LIBRARY), Model(prepare_arm(arm), library), still())
    off = POSTURE + np.array([0.5, -0.5, 0.001, 0.0])
    c.reset(c.counts(off))
    torque = c.step(c.counts(off))
    assert torque[:2].tolist() == [-2.0, 2.0]
    assert (np.abs(torque[2:]) < 2.0).all()
    assert c.saturated
    c.reset(c.counts(POSTURE))
    c.step(c.counts(POSTURE))
    assert not c.saturated


def test_not_a_number_gives_no_torque(make: Callable[..., Controller]) -> None:
    """One bad control point of one joint; and a point of the plate that cannot be reached."""
    points = np.tile(POSTURE[:, None], 4)
    points[2, 1] = np.nan
    for phase in (Phase("q", 1.0, points), Phase("w", 1.0, np.full((4, 4), 5.0))):
        c = make(trajectory([phase]))
        c.reset(c.counts(POSTURE))
        torque = c.step(c.counts(POSTURE))
        assert torque.tolist() == [0.0] * 4
        assert c.invalid
        assert not c.saturated


def test_a_counter_that_overflows(make: Callable[..., Controller]) -> None:
    """The rate is that of the few counts between, not of four thousand million."""
    c = make(still())
    top = np.full(4, 2**31 - 1, dtype=np.int32)
    c.reset(top)
    c.step(np.full(4, -(2**31) + 1, dtype=np.int32))
    assert c.qd == pytest.approx((1 - exp(-2 * pi * 0.1)) * 2 * c.position_per_count / c.dt, rel=1e-5)


def test_what_does_not_fit_is_refused(make: Callable[..., Controller]) -> None:
    with pytest.raises(ControllerError, match="phase 1 has polynomials of degree 30; the controller has at most 29"):
        make(trajectory([Phase("q", 1.0, np.zeros((4, 31)))]))
    with pytest.raises(ControllerError, match=r"phase 2 lasts 0\.0005 s, less than the control period of 0\.001 s"):
        make(trajectory([Phase("q", 1.0, np.zeros((4, 3))), Phase("q", 5e-4, np.zeros((4, 3)))]))
    with pytest.raises(ControllerError, match='the trajectory of "other"; expected the same arm'):
        make(still(arm="other"))
    with pytest.raises(ControllerError, match="own: the controller has no own_pull"):
        make(still(contact={**PLATE, "own": {"pull": 1.0}}))


def test_a_description_that_does_not_match(make: Callable[..., Controller], tmp_path: Path, model: Model) -> None:
    directory = make(still()).directory
    shutil.copytree(directory, tmp_path / "copy")
    page = tmp_path / "copy" / "controller.json"
    data = json.loads(page.read_text())
    data["records"][1]["fields"].pop()
    page.write_text(json.dumps(data))
    with pytest.raises(ControllerError, match=r"vishard4_effects_f32 has 72 bytes in C and 68 in its description"):
        Controller(tmp_path / "copy", model, still())


def test_what_all_joints_lack_is_said_once(model: Model, vishard4: Arm) -> None:
    told = prepare_firmware(vishard4, LIBRARY)
    bare = copy(model)
    bare.joints = tuple(replace(joint, gains=None, encoder_counts=None) for joint in model.joints)
    with pytest.raises(ControllerError) as caught:
        Controller(told, bare, still())
    said = str(caught.value)
    assert [said.count(part) for part in ("[joint.controller]", "[joint.encoder]")] == [1, 1]
    assert "[joint.encoder] at joints 1, 2, 3, 4" in said
    assert "tendon init --controller" in said


def test_what_the_model_file_lacks_is_proposed(library: Library) -> None:
    text = (ARMS / "drive.toml").read_text()
    bare = reader.parse(text[: text.index("[controller]")] + text[text.index("[[joint]]") :], "drive.toml")
    bare = replace(bare, joints=tuple(replace(joint, gains=None, encoder_counts=None) for joint in bare.joints))
    plan = replace(still(), arm="drive", phases=(Phase("q", 1.0, np.zeros((1, 3))),))
    model = Model(prepare_arm(bare), library)
    with pytest.raises(ControllerError) as caught:
        Controller(prepare_firmware(bare, LIBRARY), model, plan)
    for key in ("[controller]", "[joint.controller] at joint 1", "[joint.encoder] at joint 1", "init --controller"):
        assert key in str(caught.value)
    arm = reader.parse(text, "drive.toml")
    with pytest.raises(ControllerError, match=r"no value of joint1_coulomb_asymmetric_positive, .*tendon identify"):
        Controller(prepare_firmware(arm, LIBRARY), Model(prepare_arm(arm), library), plan)


def test_a_step_costs_little(make: Callable[..., Controller]) -> None:
    c = make(there_and_back())
    counts = c.counts([0.0] * 4)
    c.reset(counts)
    times = []
    for _ in range(20):
        start = time.perf_counter()
        for _ in range(100):
            c.step(counts)
        times.append((time.perf_counter() - start) / 100)
    # Other work on the machine only adds time.
    assert min(times) < 15e-6
