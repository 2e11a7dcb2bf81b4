"""Plans of arms in space: places, directions, limits, springs, and what only planar arms have."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from codegen.prepare import prepare_arm
from runtime.documents.plans import JointUnitsEntry
from runtime.model.loader import Library, Model
from runtime.planning.optimize import Plan, StartError, optimize
from runtime.planning.physics import rotation, target_frame
from runtime.planning.results import document
from runtime.planning.scenario import Point
from runtime.report import motions, terminal
from symbolic.model_file.checks import ModelError
from tests.runtime.planning.planning_cases import arm, there
from tests.six_joints import START, six_joints

PLACE = [-0.6, 0.35, 0.4]
DOWN = [0.0, 0.0, -2.0]


@pytest.fixture(scope="module")
def six(library: Library) -> Model:
    return Model(prepare_arm(six_joints()), library)


def planned(model: Model, end: dict[str, Any], **other: Any) -> Plan:
    return optimize(model, there(model, 1.5, START, end, degree=7, **other))


def last(model: Model, plan: Plan) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Posture, place and rotation of the tip at the end."""
    q = plan.trajectory.at(model, [plan.trajectory.duration]).q[:, 0]
    return q, model.tip(q), model.call("tip_rotation", {"q": q})


@pytest.fixture(scope="module")
def pointing(six: Model) -> Plan:
    return planned(six, {"tip": PLACE, "pointing": DOWN})


def test_the_tip_arrives_and_points_where_it_was_told(six: Model, pointing: Plan) -> None:
    _, tip, R = last(six, pointing)
    np.testing.assert_allclose(tip, PLACE, atol=1e-4)
    np.testing.assert_allclose(R[:, 2], [0.0, 0.0, -1.0], atol=1e-4)


def test_limits_hold_along_the_motion(six: Model, pointing: Plan) -> None:
    m = pointing.trajectory.at(six, np.linspace(0.0, 1.5, 301))
    assert np.abs(m.qd).max() <= 3.0 * 1.01
    assert np.abs(pointing.effort.tau).max() <= 330.0 * 1.01
    assert np.abs(m.q).max() <= 6.2


def test_a_whole_orientation_costs_no_less_than_a_direction(six: Model) -> None:
    rpy = [3.0, 0.1, 0.5]
    plan = planned(six, {"tip": PLACE, "orientation": rpy})
    _, tip, R = last(six, plan)
    np.testing.assert_allclose(tip, PLACE, atol=1e-4)
    np.testing.assert_allclose(R, rotation(rpy), atol=2e-4)
    asked = planned(six, {"tip": PLACE, "pointing": R[:, 2].tolist()})
    assert asked.cost <= plan.cost * 1.001


def test_a_place_alone_costs_least(six: Model, pointing: Plan) -> None:
    assert planned(six, {"tip": PLACE}).cost <= pointing.cost * 1.001


def test_the_costs_are_those_of_the_generated_equations(six: Model, pointing: Plan) -> None:
    """Another quadrature, the arm's inverse dynamics and friction by hand."""
    t = np.linspace(0.0, 1.5, 20001)
    m = pointing.trajectory.at(six, t)
    tau = six.inverse_dynamics(m.q, m.qd, m.qdd)
    for i, joint in enumerate(six.joints):
        dry, viscous = joint.effects["coulomb_asymmetric"], joint.effects["viscous"]["coefficient"]
        tau[i] += np.where(m.qd[i] > 0, dry["positive"], -dry["negative"]) * (m.qd[i] != 0) + viscous * m.qd[i]
    assert np.trapezoid((tau**2).sum(axis=0), t) == pytest.approx(pointing.cost, rel=0.005)


def test_the_document_has_the_tip_and_its_rotation(six: Model, pointing: Plan) -> None:
    samples = document(six, pointing).samples
    assert np.shape(samples.tip) == (3, 400)
    R = np.moveaxis(np.array(samples.tip_rotation), 2, 0)
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (400, 1, 1)), atol=1e-12)


def test_the_terminal_names_the_joints_and_their_units(
    six: Model, pointing: Plan, capsys: pytest.CaptureFixture[str]
) -> None:
    made = document(six, pointing)
    lift = structs.replace(made.joints[1], name="lift", units=JointUnitsEntry(position="m", force="N"))
    terminal.show(motions.plan(structs.replace(made, joints=[made.joints[0], lift])))
    rows = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    (row,) = (row for row in rows if row.startswith("2 lift"))
    assert row.startswith(f"2 lift {lift.cost:.4g} (N)^2 s {lift.peak_torque:.4g} N ")
    assert f" {lift.peak_speed:.4g} m/s " in row
    assert row.endswith(" m")


def test_a_spring_at_the_second_joint_takes_torque_off(six: Model) -> None:
    """It holds a part of the weight of an arm that leans to its side."""
    start = {**START, "q2": -1.74, "q3": -1.6}
    spring = {"joint": 2, "stiffness": [100.0, 40000.0], "offset": [-4.0, 3.0], "radius": 0.06}
    sprung = there(six, 1.5, start, {**start, "q2": -2.1}, degree=7, spring=[spring])
    bare = optimize(six, sprung.without_springs())
    plan = optimize(six, sprung)
    assert plan.effort.cost[1] < 0.5 * bare.effort.cost[1]
    assert plan.cost < bare.cost


def test_no_posture_reaches_too_far(six: Model) -> None:
    with pytest.raises(StartError, match=r'point "end": no posture .* reaches \(3, 0, 0\) m in that direction'):
        planned(six, {"tip": [3.0, 0.0, 0.0], "pointing": DOWN})


def test_no_posture_is_sought_where_every_joint_is_given(six: Model) -> None:
    with pytest.raises(StartError, match=r'point "end": no posture .* reaches \('):
        planned(six, {**START, "tip": PLACE})


@pytest.mark.parametrize(
    ("end", "told"),
    [
        ({"tip": [0.5, 0.2]}, "tip has 2 numbers; six is spatial: expected x, y and z"),
        ({"tip": PLACE, "pointing": [0.0, 1.0]}, "pointing has 2 numbers; expected three: x, y and z"),
        ({"tip": PLACE, "pointing": [0.0, 0.0, 0.0]}, "pointing is zero; expected a direction"),
        ({"tip": PLACE, "orientation": [0.0]}, "orientation has 1 numbers; expected three: roll, pitch and yaw"),
        ({"tip": PLACE, "pointing": DOWN, "orientation": [0.0] * 3}, "say the same thing twice"),
        ({"tip": PLACE, "pointed": DOWN}, 'unknown key "pointed"'),
    ],
)
def test_what_a_point_cannot_say(six: Model, end: dict[str, Any], told: str) -> None:
    with pytest.raises(ModelError, match=r"points\.end") as error:
        there(six, 1.5, START, end)
    assert told in str(error.value)


def test_directions_are_for_arms_in_space(library: Library) -> None:
    with pytest.raises(ModelError, match="pointing is for spatial arms; arm_rr is planar, leave it out"):
        there(arm(library, "rr"), 1.0, {"q1": 0.0, "q2": 0.0}, {"tip": [0.3, 0.2], "pointing": DOWN})


def test_contact_is_for_planar_arms(six: Model) -> None:
    phase = [{"from": "start", "to": "end", "part": 1.0, "degree": 5, "kind": "contact"}]
    with pytest.raises(ModelError, match="phase 1: a contact phase needs a planar arm of four revolute joints"):
        there(six, 1.5, START, {"tip": PLACE}, phase=phase)
    with pytest.raises(ModelError, match=r"contact\.plate: contact is for planar arms; six is spatial, leave"):
        there(six, 1.5, START, {"tip": PLACE}, contact={"plate": {"stiffness": 600.0}})


@pytest.mark.parametrize("seed", range(5))
def test_frames_of_directions_are_rotations(seed: int) -> None:
    d = np.random.default_rng(seed).standard_normal(3)
    frame = target_frame(replace(Point(), pointing=tuple(d)))
    assert frame is not None
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    np.testing.assert_allclose(frame[:, 2], d / np.linalg.norm(d))
