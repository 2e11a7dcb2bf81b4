"""Pages of plans and executions: what they draw is the plan and what was recorded; they need nothing beside them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from bench_arm import BENCH, SPRING, THERE_AND_BACK, trajectory
from msgspec.structs import replace

from runtime.documents.plans import ArmEffectEntry, PlanLimitsEntry
from runtime.execution.execute import Execution, execute
from runtime.execution.options import ExecutionSettings
from runtime.model.loader import Library, Model
from runtime.plain_json import plain
from runtime.planning import results
from runtime.planning.optimize import optimize
from runtime.planning.settings import PlanningSettings
from runtime.report import motions, terminal
from runtime.report.page.motion_pages import execution_page, plan_page
from runtime.report.page.moving import ExecutedCycles
from runtime.report.plots import motion_plots
from runtime.workspace.source import Source
from symbolic.model_file.arm import Limits
from tests.runtime.conftest import Run
from tests.runtime.planning.planning_cases import arm, there


@pytest.fixture(scope="module")
def executed(bench: Source) -> Execution:
    plan = trajectory(THERE_AND_BACK, springs={1: SPRING})
    return execute(bench.compiled.model(), bench.compiled.controller(), plan, ExecutionSettings(trials=2, cycles=2))


@pytest.fixture(scope="module")
def planned(library):
    """A joint that turns and one that slides, with limits: model, plan and document."""
    model: Model = arm(library, "rp", Limits(position=(-2.0, 2.0), speed=4.0))
    found = optimize(
        model, there(model, 1.0, {"q1": 0.0, "q2": 0.0}, {"q1": 1.0, "q2": 0.2}), PlanningSettings(starts=1)
    )
    return model, found, results.document(model, found)


def scripts(page: str) -> list[dict]:
    return [json.loads(text) for text in re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', page, re.S)]


def alone(page: str) -> None:
    """Nothing is asked from outside."""
    assert not re.search(r"(?:https?:)?//\w", page)
    assert not re.search(r"<(?:link|iframe|img|object|embed)\b", page)
    assert not re.search(r"\ssrc=", page)


def angles(data: dict, body: int) -> np.ndarray:
    corners = np.array(data["bodies"][body], dtype=float).reshape(len(data["t"]), -1, 2)
    x, y = (corners[:, -1] - corners[:, 0]).T
    return np.arctan2(-y, x)


def test_a_plan_is_drawn_as_it_is(planned) -> None:
    model, plan, document = planned
    page = plan_page(model, plan.trajectory, document).html()
    alone(page)
    data, whole = scripts(page)
    assert whole == plain(document)
    t = np.array(data["t"]) / 1000
    assert t[-1] == pytest.approx(plan.trajectory.duration)
    q = plan.trajectory.at(model, t).q
    np.testing.assert_allclose(angles(data, 0), q[0], atol=0.004)
    assert "4 rad/s" in page
    assert page == plan_page(model, plan.trajectory, document).html()


def test_figures_of_a_plan_show_speeds_limits_and_phases(planned) -> None:
    _, _, document = planned
    figure = motion_plots.plan_of_joint(document, 1)
    position, speed, torque = figure.axes
    np.testing.assert_allclose(speed.lines[0].get_ydata(), document.samples.qd[0])
    drawn = {float(line.get_ydata()[0]) for line in speed.lines[1:]}
    assert {-4.0, 4.0} <= drawn or any("limits ±4" in text.get_text() for text in speed.texts)
    assert any("no limit stated" in text.get_text() for text in torque.texts)
    said = " ".join(text.get_text() for text in position.texts)
    assert all(point in said for phase in document.phases for point in (phase.start, phase.end))
    assert len(motion_plots.plan(document).axes) == 3 * 2


def test_a_spring_does_not_look_like_a_limit(planned) -> None:
    """Nor as what was planned or executed: each line of a panel has a colour and a dash of its own."""
    _, _, document = planned
    near = replace(document.joints[0].limits, torque=1.05 * max(map(abs, document.samples.tau[0])))
    joint = replace(document.joints[0], limits=near)
    sprung = replace(document, joints=[joint, *document.joints[1:]], springs=[{"joint": 1}])
    torque = motion_plots.plan_of_joint(sprung, 1).axes[2]
    spring = next(line for line in torque.lines if line.get_label() == "spring")
    limits = [line for line in torque.lines if len(set(line.get_ydata())) == 1 and line.get_ydata()[0]]
    assert len(limits) == 2
    assert all(line.get_color() != spring.get_color() for line in limits)
    assert (spring.get_linestyle(), {line.get_linestyle() for line in limits}) == ("-", {"--"})


@pytest.mark.parametrize("ends", [-1.0, 1.0])
def test_what_is_said_of_a_limit_stands_off_the_curve(planned, ends: float) -> None:
    """Over a curve that ends low, under one that ends high."""
    *_, document = planned
    q = np.linspace(-ends, ends, len(document.samples.t))
    joint = replace(document.joints[0], limits=PlanLimitsEntry(position=(-50.0, 50.0), speed=None, torque=None))
    samples = replace(document.samples, q=[q.tolist()] * 2)
    drawn = motion_plots.plan_of_joint(replace(document, joints=[joint], samples=samples), 1)
    position = drawn.axes[0]
    (note,) = (text for text in position.texts if "limits ±50" in text.get_text())
    drawn.draw_without_rendering()
    box = note.get_window_extent().transformed(position.transData.inverted())
    late = q[len(q) // 2 :]
    assert box.y0 > late.max() if ends < 0 else box.y1 < late.min()


def test_a_spring_that_is_there_for_nothing_is_said(library: Library, capsys: pytest.CaptureFixture[str]) -> None:
    model = arm(library, "r")
    spring = [{"joint": 1, "stiffness": 20046.0, "offset": -4.0, "radius": 0.06}]
    scenario = there(model, 1.0, {"q1": 0.0}, {"q1": 1.0}, spring=spring)
    document = results.document(model, optimize(model, scenario, PlanningSettings(starts=1)))
    assert "the spring at joint 1 is slack during the whole motion and saves nothing" in document.warnings
    terminal.show(motions.plan(document))
    assert "Spring at joint 1: 20050 N/m, taut below -4 rad" in capsys.readouterr().out


def test_all_joints_go_by_one_word(planned, capsys: pytest.CaptureFixture[str]) -> None:
    *_, document = planned
    terminal.show(motions.plan(document))
    assert "the squared torque over a cycle of all joints is " in capsys.readouterr().out
    assert " of all joints is " in motions.plan_headline(document)
    one = replace(document, objective=replace(document.objective, joints=[2]))
    assert " of joint 2 is " in motions.plan_headline(one)


def test_what_is_hidden_in_the_simulated_arm_stands_on_its_page(executed: Execution) -> None:
    document = replace(executed.document(), on="simulation")
    assert motions.differences(document) == []
    name = document.joints[0].name
    hidden = ArmEffectEntry(effect="offset", joint=1, hidden=True, changed=False, values={"torque": -2.5})
    called = "joint 1" if name is None else f"joint 1 ({name})"
    said = f"hidden: offset at {called}: torque −2.5"
    assert motions.differences(replace(document, effects=[hidden])) == [said]


def test_an_execution_is_drawn_beside_its_plan(executed: Execution) -> None:
    document = replace(executed.document(), on="simulation")
    page = execution_page(executed, document).html()
    alone(page)
    data, _ = scripts(page)
    cycles, trial = ExecutedCycles(executed), executed.trials[0]
    period = executed.plan.trajectory.duration
    assert data["begins"] == pytest.approx(period, abs=executed.dt)
    at = np.rint((data["begins"] + np.array(data["t"]) / 1000) / executed.dt).astype(int)
    np.testing.assert_allclose(angles(data, 1), trial.q[0, at], atol=0.004)
    wanted = executed.plan.trajectory.at(executed.plan.model, at * executed.dt).q[0]
    np.testing.assert_allclose(angles(data, 0), wanted, atol=0.004)
    assert len(cycles.whole) == 4
    assert cycles.over_each_other("q").shape == (1, 4, len(at))
    assert np.ptp(cycles.over_each_other("q"), axis=1).max() < 0.02
    assert page == execution_page(executed, document).html()


def test_a_safe_stop_is_drawn_up_to_it(bench: Source) -> None:
    plan = trajectory(THERE_AND_BACK)
    stopped = execute(
        bench.compiled.model(), bench.compiled.controller(), plan, ExecutionSettings(trials=1, tracking_limit=0.001)
    )
    assert not stopped.completed
    document = replace(stopped.document(), on="simulation")
    page = execution_page(stopped, document).html()
    assert "safe stop" in page
    data, _ = scripts(page)
    assert data["begins"] * 1000 + data["t"][-1] <= 1000 * len(stopped.trials[0].t) * stopped.dt
    assert not data["loop"]


def test_the_verb_writes_its_page(tendon: Run) -> None:
    Path("bench.toml").write_text(BENCH)
    trajectory(THERE_AND_BACK).write(Path("plan.json"))
    asked = ("--on", "simulation", "--trials", "1", "--report", "page")
    status, out, _ = tendon("execute", "bench.toml", "plan.json", *asked)
    assert status == 0
    assert "Report: page/report.html" in out
    assert "<title>" in Path("page/report.html").read_text(encoding="utf-8")
