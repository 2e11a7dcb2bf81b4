"""Optimal motions that are known without an optimizer: polynomials, oscillations, scaling, symmetry, energy, limits."""

from __future__ import annotations

import os
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET

from runtime.execution.results import PlannedCycle
from runtime.model.loader import Library, Model
from runtime.planning import optimize as optimizer
from runtime.planning import scenario_file
from runtime.planning.evaluate import at_times, effort, objective
from runtime.planning.optimize import Infeasible, Plan, StartError, optimize, without_springs
from runtime.planning.results import document, refusal
from runtime.planning.scenario import Objective, Scenario
from runtime.planning.settings import PlanningSettings
from runtime.progress import on_cores
from runtime.report import motions, terminal
from symbolic.model_file.arm import Limits
from tests.runtime.planning.planning_cases import INERTIA, MASS, and_back, arm, parsed, there

STUDY = Path(__file__).resolve().parents[3] / "runtime" / "study"
FREE: dict[str, Any] = {"stiffness": [0.0, 9000.0], "offset": [-2.0, 0.5], "radius": 0.06}
RUBBING = {"coulomb": {"torque": 1.2}, "viscous": {"coefficient": 0.8}}


@pytest.fixture(scope="module")
def one(library: Library) -> Model:
    """One revolute joint of INERTIA, nothing else."""
    return arm(library, "r")


@pytest.fixture(scope="module")
def two(library: Library) -> Model:
    return arm(library, "rr")


@pytest.fixture(scope="module")
def rubbing(library: Library) -> Model:
    """One joint with dry and viscous friction, a motor and limits."""
    return arm(library, "r", Limits(speed=6.0, torque=20.0), RUBBING, torque_constant=4.0)


@pytest.fixture(scope="module")
def first(model: Model) -> Scenario:
    """The paper's scenario 1, any spring."""
    found = scenario_file.fitted(scenario_file.read(STUDY / "scenario1.toml"), model, "scenario1.toml")
    return replace(found, springs=tuple(replace(spring, catalogue=()) for spring in found.springs))


def along(model: Model, plan: Plan, count: int = 2001) -> Any:
    return at_times(model, plan.trajectory, np.linspace(0.0, plan.trajectory.duration, count))


# --- optima on paper ---


@settings(max_examples=8, deadline=None)
@given(
    turn=st.floats(-2.0, 2.0).filter(lambda q: abs(q) > 0.05), T=st.floats(0.2, 3.0), degree=st.sampled_from([3, 5, 8])
)
def test_from_rest_to_rest_is_the_cubic(one: Model, turn: float, T: float, degree: int) -> None:
    """∫ τ² dt of a free inertia: q = θ (3 s² − 2 s³), which costs 12 J² θ² / T³, whatever degree is allowed."""
    plan = optimize(one, there(one, T, {"q1": 0.0}, {"q1": turn}, degree=degree))
    np.testing.assert_allclose(plan.cost, 12 * INERTIA**2 * turn**2 / T**3, rtol=1e-6)
    s = np.linspace(0, 1, 21)
    np.testing.assert_allclose(plan.trajectory.at(one, s * T).q[0], turn * (3 * s**2 - 2 * s**3), atol=1e-5 * abs(turn))


def test_a_slide_is_no_different(library: Library) -> None:
    slide = arm(library, "p")
    plan = optimize(slide, there(slide, 0.8, {"q1": -0.1}, {"q1": 0.3}))
    np.testing.assert_allclose(plan.cost, 12 * MASS**2 * 0.4**2 / 0.8**3, rtol=1e-6)


def test_with_a_spring_of_its_own_frequency_nothing_is_left_to_do(library: Library) -> None:
    """A pendulum on a linear spring swings by itself: the optimum costs nothing when the cycle is its period."""
    T = 1.3
    stiffness = INERTIA * (2 * np.pi / T) ** 2
    swinging = arm(library, "r", effects={"linear_spring": {"stiffness": stiffness, "rest": 0.2}})
    scenario = and_back(swinging, T, {"q1": -0.3}, {"q1": 0.7})
    own, slower = (optimize(swinging, scenario.at(t)) for t in (T, 1.2 * T))
    # As a polynomial of degree 8 a half cosine leaves 2e-4 of the torque.
    assert own.cost < 1e-7 * slower.cost
    t = np.linspace(0, T, 100)
    np.testing.assert_allclose(own.trajectory.at(swinging, t).q[0], 0.2 - 0.5 * np.cos(2 * np.pi * t / T), atol=1e-4)


def test_a_spring_is_found_that_swings(one: Model) -> None:
    """Back and forth below the spring's offset: the best spring takes two thirds off, as published for case B.

    It pulls over half the range only, so it is stiffer than one that would swing the joint alone.
    """
    scenario = and_back(one, 2.0, {"q1": 0.0}, {"q1": -np.pi / 2}, spring=[{"joint": 1, **FREE}])
    bare, sprung = optimize(one, scenario.without_springs()), optimize(one, scenario)
    assert 0.65 < 1 - sprung.cost / bare.cost < 0.67
    without = without_springs(one, sprung)
    assert isinstance(without, Plan)
    assert without.cost == bare.cost
    said = motions.spring_lines(document(one, sprung, without))
    assert said[-1].endswith(f"springs save {100 * (1 - sprung.cost / bare.cost):.0f} %.")
    assert without_springs(one, bare) is UNSET
    assert 1.0 < np.sqrt(0.06**2 * sprung.trajectory.springs[1]["stiffness"] / INERTIA) / (2 * np.pi / 2.0) < 4.0


@pytest.mark.parametrize("spring", [False, True])
def test_costs_fall_with_the_third_power_of_the_time(one: Model, spring: bool) -> None:
    """Without friction T³ cost is a constant; with springs too, where stiffness may follow 1/T²."""
    springs = [{"joint": 1, **FREE, "stiffness": [0.0, 1e5]}] if spring else []
    scenario = and_back(one, 0.5, {"q1": 0.0}, {"q1": -1.0}, spring=springs)
    costs = [optimize(one, scenario.at(T)).cost * T**3 for T in (0.5, 1.0, 1.6)]
    np.testing.assert_allclose(costs, costs[0], rtol=1e-3 if spring else 1e-6)


def test_backwards_in_time_costs_the_same_without_friction(two: Model) -> None:
    ends = {"q1": 0.3, "q2": -0.4}, {"q1": -0.5, "q2": 1.1}
    there_, back = (optimize(two, there(two, 0.9, *e, degree=7)) for e in (ends, ends[::-1]))
    np.testing.assert_allclose(there_.cost, back.cost, rtol=1e-6)
    t = np.linspace(0, 0.9, 50)
    forwards, backwards = there_.trajectory.at(two, t).q, back.trajectory.at(two, 0.9 - t).q
    np.testing.assert_allclose(forwards, backwards, atol=1e-3)


# --- energy ---


def test_work_from_rest_to_rest_comes_back(two: Model) -> None:
    plan = optimize(two, there(two, 0.7, {"q1": 0.0, "q2": 0.5}, {"q1": 1.0, "q2": -0.5}, degree=7))
    e = plan.effort
    power = np.sum(e.tau * e.motion.qd, axis=0)
    assert abs(power @ e.weights) < 1e-9 * (np.abs(power) @ e.weights)


def test_positive_work_is_the_largest_kinetic_energy(one: Model) -> None:
    """A free joint is sped up and braked; the objective evens the speed out, down to θ/T at the least."""
    scenario = there(one, 0.8, {"q1": 0.0}, {"q1": 1.2}, degree=9)
    squared = optimize(one, scenario)
    working = replace(scenario, objective=Objective("positive_work"))
    plan = optimize(one, working)
    top = [0.5 * INERTIA * along(one, p).motion.qd[0].max() ** 2 for p in (plan, squared)]
    # The cubic is sped up once; a polynomial of degree 9 that evens out is so again and again, a little.
    np.testing.assert_allclose(objective(working, squared.effort), top[1], rtol=1e-4)
    assert top[0] < plan.cost < 1.02 * top[0]
    assert 0.5 * INERTIA * (1.2 / 0.8) ** 2 < plan.cost < 0.6 * top[1]


# --- friction ---


def test_without_friction_there_is_none(rubbing: Model) -> None:
    scenario = there(rubbing, 0.9, {"q1": 0.0}, {"q1": 1.0})
    smooth, real = optimize(rubbing, replace(scenario, friction=False)), optimize(rubbing, scenario)
    np.testing.assert_allclose(smooth.effort.tau, INERTIA * smooth.effort.motion.qdd, atol=1e-12)
    assert real.cost > smooth.cost
    # Asked to count it after all, the frictionless plan costs no less than the one that knew.
    assert effort(rubbing, smooth.trajectory, friction=True).cost.sum() >= real.cost * (1 - 1e-4)


@pytest.mark.parametrize("friction", [False, True])
def test_the_smooth_cost_is_the_exact_one(model: Model, first: Scenario, friction: bool) -> None:
    """Within the switches' width, and where a spring takes hold between two nodes, no torque to speak of is hidden."""
    plan = optimize(model, replace(first, friction=friction))
    np.testing.assert_allclose(plan.smooth_cost, plan.cost, rtol=1e-3)


# --- springs ---


def test_springs_at_two_joints_do_better_than_either(two: Model) -> None:
    ends = {"q1": 0.2, "q2": 0.3}, {"q1": -0.8, "q2": -0.7}
    springs = [{"joint": joint, **FREE} for joint in (1, 2)]
    both = optimize(two, and_back(two, 1.0, *ends, spring=springs))
    costs = [optimize(two, and_back(two, 1.0, *ends, spring=[s])).cost for s in springs]
    bare = optimize(two, and_back(two, 1.0, *ends)).cost
    assert both.cost < 0.9 * min(costs)
    assert max(costs) < bare
    assert set(both.trajectory.springs) == {1, 2}


def test_a_spring_is_from_a_catalogue_only_where_it_has_one(two: Model, capsys: pytest.CaptureFixture[str]) -> None:
    springs = [{"joint": 1, **FREE}, {"joint": 2, **FREE, "catalogue": [500.0, 12500.0]}]
    scenario = and_back(two, 1.0, {"q1": 0.2, "q2": 0.3}, {"q1": -0.8, "q2": -0.7}, spring=springs)
    terminal.show(motions.plan(document(two, optimize(two, scenario))))
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("Spring at joint")]
    assert ["from the catalogue" in line for line in lines] == [False, True]


def test_the_better_neighbour_in_the_catalogue_is_chosen(one: Model) -> None:
    """The paper takes the nearest; here both neighbours of the best stiffness are tried."""
    catalogue = [1000.0, 2000.0, 3000.0, 4000.0, 5000.0, 6000.0, 8000.0]
    spring = {"joint": 1, **FREE}
    ends = {"q1": 0.0}, {"q1": -np.pi / 2}
    scenario = and_back(one, 2.5, *ends, spring=[{**spring, "catalogue": catalogue}])
    plan = optimize(one, scenario)
    sought = plan.free[1]
    bought = [choice.sizes[1] for choice in plan.choices]
    assert sorted(bought) == [max(k for k in catalogue if k <= sought), min(k for k in catalogue if k > sought)]
    assert plan.trajectory.springs[1]["stiffness"] == bought[0]
    alone = [optimize(one, and_back(one, 2.5, *ends, spring=[{**spring, "stiffness": k}])).cost for k in bought]
    np.testing.assert_allclose(plan.cost, min(alone), rtol=1e-4)


def test_a_spring_that_may_hang_loose_never_costs(model: Model, first: Scenario) -> None:
    loose = replace(
        first, springs=tuple(s.within("offset", -3.0, -2.0).within("stiffness", 8000.0, 8000.0) for s in first.springs)
    )
    np.testing.assert_allclose(optimize(model, loose).cost, optimize(model, first.without_springs()).cost, rtol=1e-6)


# --- other objectives ---


def test_each_objective_is_best_at_its_own(rubbing: Model) -> None:
    scenario = there(rubbing, 0.5, {"q1": 0.0}, {"q1": 1.0})
    goals = [
        Objective("torque_squared"),
        Objective("peak_torque"),
        Objective("positive_work"),
    ]
    plans = [optimize(rubbing, replace(scenario, objective=goal)) for goal in goals]
    for goal, own in zip(goals, plans, strict=True):
        judged = [objective(replace(scenario, objective=goal), plan.effort) for plan in plans]
        assert own.cost == judged[goals.index(goal)]
        # Other plans may tie, up to what the smooth switches are worth.
        assert own.cost <= min(judged) * (1 + 2e-3)
    torque, peak, work = plans
    assert np.abs(peak.effort.tau).max() < 0.95 * np.abs(torque.effort.tau).max()
    assert work.cost < objective(replace(scenario, objective=goals[2]), peak.effort)


def test_the_motors_heat_is_the_squared_torque(rubbing: Model) -> None:
    """R τ²/k² of one joint: the same motion is best, and its cost is in proportion."""
    scenario = and_back(rubbing, 1.0, {"q1": 0.0}, {"q1": 1.0})
    heat = replace(scenario, objective=Objective("electrical_energy", resistance={1: 1.7}))
    np.testing.assert_allclose(optimize(rubbing, heat).cost, 1.7 / 4.0**2 * optimize(rubbing, scenario).cost, rtol=1e-5)


# --- limits, and what cannot be done ---


def test_limits_hold_between_the_nodes(rubbing: Model) -> None:
    """Asked for at nodes: between them, by less than one part in a thousand."""
    scenario = there(rubbing, 0.45, {"q1": 0.0}, {"q1": 2.0}, degree=12)
    e = along(rubbing, optimize(rubbing, scenario))
    assert 0.98 * 6.0 < np.abs(e.motion.qd).max() < 1.001 * 6.0
    assert np.abs(e.tau).max() < 1.01 * 20.0


@pytest.mark.parametrize("T", [0.35, 0.45])
def test_limits_hold_where_the_arm_need_not_rest(library: Library, T: float) -> None:
    """The end-effector stands still at both ends, and the joints go on: a program has no node there."""
    limits = Limits(position=(-1.6, 1.6), speed=3.0, torque=200.0)
    swinging = arm(library, "rrr", limits)
    points = {"start": {"tip": [0.45, 0.3], "tip_rest": True}, "end": {"tip": [0.1, 0.6], "tip_rest": True}}
    table = {
        "name": "swinging",
        "model": swinging.name,
        "cycle_time": T,
        "periodic": False,
        "points": points,
        "phase": [{"from": "start", "to": "end", "part": 1.0, "degree": 9}],
    }
    plan = optimize(swinging, parsed(swinging, table))
    m = plan.trajectory.at(swinging, [0.0, T])
    assert np.abs(m.qd).max() > 0.9 * 3.0
    assert list(PlannedCycle(swinging, plan.trajectory).exceeded()) == []
    begins, ends = document(swinging, plan).warnings
    assert re.fullmatch(
        r"the motion begins with joints that move \([123, ]+\); .* rest = true in \[points.start\]", begins
    )
    assert re.fullmatch(r"the motion ends with joints that move \([123, ]+\); .* rest = true in \[points.end\]", ends)
    rested = {**table, "points": {name: {"tip": point["tip"], "rest": True} for name, point in points.items()}}
    assert document(swinging, optimize(swinging, parsed(swinging, {**rested, "cycle_time": 0.6}))).warnings == []


def test_a_limit_that_few_nodes_do_not_see_is_kept_or_said(rubbing: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = there(rubbing, 0.45, {"q1": 0.0}, {"q1": 2.0}, degree=8)
    seen_everywhere = optimize(rubbing, scenario)
    monkeypatch.setattr(optimizer, "_many", lambda degree: degree)
    plan = optimize(rubbing, scenario)
    assert list(PlannedCycle(rubbing, plan.trajectory).exceeded()) == []
    np.testing.assert_allclose(plan.cost, seen_everywhere.cost, rtol=0.01)
    monkeypatch.setattr(optimizer, "MOST_TIGHTENINGS", 0)
    with pytest.raises(Infeasible, match=r"t = 0\.\d+ s: speed of joint 1 is missed by 0\.0\d+ rad/s"):
        optimize(rubbing, scenario)


@pytest.mark.parametrize(
    ("limits", "enough", "unit"),
    [
        # 1 rad in 0.5 s: the cubic has a top speed of 3 rad/s and a largest torque of 6 J θ / T² = 5.68 N m.
        (Limits(speed=1.5), Limits(speed=3.0), "rad/s"),
        (Limits(torque=1.0), Limits(torque=5.7), "N m"),
    ],
)
def test_what_stands_in_the_way_is_said(library: Library, limits: Limits, enough: Limits, unit: str) -> None:
    limited, able = (arm(library, "r", given) for given in (limits, enough))
    with pytest.raises(Infeasible) as told:
        optimize(limited, there(limited, 0.5, {"q1": 0.0}, {"q1": 1.0}))
    said = re.fullmatch(
        r"there: no motion meets all constraints; in the best of 1, (.+): (\w+) of joint 1 is missed by ([\d.]+) (.+)",
        str(told.value),
    )
    assert said
    # Either the limit or, as what is missed is shared out, the end that it does not allow to reach in time.
    assert said[4] == {"position": "rad"}.get(said[2], unit)
    assert 0.1 < float(said[3]) < 2.0
    assert optimize(able, there(able, 0.5, {"q1": 0.0}, {"q1": 1.0})).cost > 0


def test_too_far_is_said_with_the_point(two: Model) -> None:
    scenario = there(two, 1.0, {"tip": [0.4, 0.1]}, {"tip": [0.7, 0.1]})
    message = 'there: point "end": no posture within the limits found that reaches (0.7, 0.1) m; check the target, '
    with pytest.raises(StartError) as told:
        optimize(two, scenario)
    assert str(told.value).startswith(message)


@pytest.mark.skipif(sys.platform != "linux", reason="one process there")
def test_cores_only_save_time(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    """Starts, ways of refining and neighbours in the catalogue, each in another process, and all the same here."""
    scenario = scenario_file.fitted(scenario_file.read(STUDY / "scenario2.toml"), model, "scenario2.toml")
    # With one on either side of what is sought.
    scenario = replace(scenario, springs=tuple(replace(s, catalogue=(7000.0, 8500.0)) for s in scenario.springs))
    forked, plans = [], []
    fork = os.fork
    monkeypatch.setattr(os, "fork", lambda: forked.append(fork()) or forked[-1])
    for count in (1, 2):
        forked.clear()
        with on_cores(count):
            plans.append(optimize(model, scenario))
        # Two for each of: motions that springs are chosen for, springs, ways, neighbours.
        assert len(forked) == (0 if count == 1 else 8)
    one, two = plans
    assert one.trajectory.document() == two.trajectory.document()
    assert (one.cost, one.choices, one.free) == (two.cost, two.choices, two.free)
    assert [(a.cost, a.iterations, a.missed) for a in one.attempts] == [
        (a.cost, a.iterations, a.missed) for a in two.attempts
    ]
    assert len(one.choices) == 2


@pytest.mark.parametrize(
    ("allowed", "ended"), [({"budget": 8}, "budget"), ({"time_limit": 0.1, "starts": 200}, "time")]
)
def test_a_search_that_is_cut_says_so(
    two: Model, allowed: dict[str, float], ended: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """It has made no more iterations than it might, and what it has is a motion that meets the constraints or none."""
    scenario = there(two, 0.8, {"tip": [0.4, 0.1]}, {"tip": [0.1, 0.4]})
    try:
        said = document(two, optimize(two, scenario, PlanningSettings(**allowed)))
    except Infeasible as error:
        said = refusal(two, scenario, error)
    assert said.search.ended == ended
    assert said.search.iterations <= said.search.budget
    terminal.show(motions.plan(said))
    assert "The search was cut after" in capsys.readouterr().out.splitlines()[1]


def test_one_seed_gives_one_plan(two: Model) -> None:
    scenario = there(two, 0.8, {"tip": [0.4, 0.1]}, {"tip": [0.1, 0.4]})
    a, b = (optimize(two, scenario, PlanningSettings(seed=3)) for _ in range(2))
    assert a.trajectory.document() == b.trajectory.document()
    np.testing.assert_allclose(two.tip(a.trajectory.at(two, [0.0, 0.8]).q)[:2].T, [[0.4, 0.1], [0.1, 0.4]], atol=1e-6)
