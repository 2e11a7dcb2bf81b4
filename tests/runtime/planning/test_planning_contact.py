"""A plan with contact, looked at where no node of the program lies: points, joints between phases, plate, limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from runtime.model.loader import Model
from runtime.planning.evaluate import Effort, at_times
from runtime.planning.optimize import Plan, optimize
from runtime.planning.scenario import Scenario
from runtime.planning.settings import PlanningSettings
from runtime.planning.trajectory import Trajectory

COUNT = 1500
"""Samples a phase; the program looks at some forty."""


@pytest.fixture(scope="module")
def plan(model: Model, pressing: Scenario) -> Plan:
    return optimize(model, pressing.without_springs(), PlanningSettings(starts=1))


def phase(model: Model, plan: Plan, number: int) -> Effort:
    """Within a phase (from 0), without the very ends, which belong to two."""
    begin, end = plan.trajectory.starts[number : number + 2]
    return at_times(model, plan.trajectory, np.linspace(begin, end, COUNT + 2)[1:-1])


def sides(model: Model, trajectory: Trajectory, join: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions and rates (8,) before and after the beginning of a phase."""
    before, after = trajectory.phases[join - 1], trajectory.phases[join]
    alone = [replace(trajectory, phases=(phase,), periodic=False) for phase in (before, after)]
    ends = [alone[0].at(model, [before.duration]), alone[1].at(model, [0.0])]
    first, second = (np.concatenate([m.q[:, 0], m.qd[:, 0]]) for m in ends)
    return first, second


def test_points_are_met(model: Model, plan: Plan) -> None:
    t = plan.trajectory.starts[:4]
    m = plan.trajectory.at(model, t)
    targets = [plan.scenario.points[p.start].tip for p in plan.scenario.phases]
    np.testing.assert_allclose(model.tip(m.q)[:2].T, targets, atol=1e-6)
    rates = np.einsum("ijk,jk->ik", model.tip_jacobian(m.q)[:2], m.qd)
    # Apex and the deepest point are at rest.
    np.testing.assert_allclose(rates[:, [0, 2]], 0.0, atol=1e-5)


@pytest.mark.parametrize("join", range(4))
def test_positions_and_rates_are_continuous(model: Model, plan: Plan, join: int) -> None:
    before, after = sides(model, plan.trajectory, join)
    np.testing.assert_allclose(before, after, atol=1e-5)


@pytest.mark.parametrize(("number", "way"), [(1, -1.0), (2, 1.0)])
def test_in_contact_the_end_effector_follows_the_axis_of_the_plate(
    model: Model, plan: Plan, number: int, way: float
) -> None:
    x, y, _ = phase(model, plan, number).tip
    np.testing.assert_allclose(x, model.contact["x"], atol=1e-9)
    # Asked for at the nodes: between them it turns back by less than a micrometre, if at all.
    assert (way * np.diff(y)).min() > -1e-6 / COUNT
    deepest = plan.scenario.points["pressed"].tip[1]
    assert y.min() == pytest.approx(deepest, abs=1e-5)


@pytest.mark.parametrize("number", [0, 3])
def test_free_phases_stay_above_the_plate(model: Model, plan: Plan, number: int) -> None:
    plate = plan.trajectory.contact["plate"]["position"]
    assert (phase(model, plan, number).tip[1] - plate).min() > -1e-4


def test_speed_limits_hold_between_the_nodes(model: Model, pressing: Scenario) -> None:
    quick = optimize(model, pressing.without_springs().at(1.2), PlanningSettings(starts=1))
    limits = np.array([joint.speed_limit for joint in model.joints])
    peaks = np.max([np.abs(phase(model, quick, k).motion.qd).max(axis=1) for k in range(4)], axis=0)
    assert (peaks / limits < 1.005).all()
    # They are what holds this motion back.
    assert (peaks / limits).max() > 0.99


def test_the_smooth_cost_is_near_the_exact_one(plan: Plan) -> None:
    """Joints that hover at standstill take from the smooth friction what they like: up to two parts in a hundred."""
    assert plan.smooth_cost < plan.cost * (1 + 1e-3)
    np.testing.assert_allclose(plan.smooth_cost, plan.cost, rtol=0.02)


def test_the_plate_pushes_only_where_it_is_touched(model: Model, plan: Plan) -> None:
    """Its force is what the torque of a plan with it has more than one without, and (3) by hand."""
    without = replace(plan.trajectory, contact={})
    for number in range(4):
        e = phase(model, plan, number)
        bare = at_times(model, without, e.motion.t)
        difference = e.tau - bare.tau
        if number in (0, 3):
            np.testing.assert_array_equal(difference, 0.0)
            continue
        p = plan.trajectory.contact["plate"]
        row = model.tip_jacobian(e.motion.q)[1]
        rate = np.sum(row * e.motion.qd, axis=0)
        force = p["pretension"] + p["stiffness"] * (p["position"] - e.tip[1]) - p["friction"] * np.sign(rate)
        np.testing.assert_allclose(difference, -row * force, atol=1e-9)
