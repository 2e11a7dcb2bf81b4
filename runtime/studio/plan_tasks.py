"""The work of a session with plans: open them, plan a scenario or a sweep's point, execute a plan in simulation."""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from runtime.execution.execute import Execution
from runtime.execution.execute import execute as executed_on_simulation
from runtime.plain_json import plain
from runtime.planning import results, scenario_file, trajectory
from runtime.planning.optimize import Infeasible, optimize
from runtime.planning.options import PlanningSettings
from runtime.planning.scenario import Scenario
from runtime.planning.trajectory import Trajectory
from runtime.recordings import recording
from runtime.report.page import executed_page, planned_page
from runtime.report.page.executed_page import ExecutedCycles
from runtime.report.plots.plan_plots import moving_joints
from runtime.report.signals.plan_signals import of_execution, of_plan
from runtime.studio.bench import Bench, Found, Opened, Tell, empty, write
from runtime.studio.plan_shown import ExecutedShown, PlanShown, PointShown, SweepShown, SweptAt
from runtime.studio.session import SessionError
from runtime.studio.settings import MOST_JOBS, MOST_POINTS, MOST_REASON
from runtime.sweep import grid
from runtime.sweep.job import Code
from runtime.sweep.reading import SweepVariation, read, variations
from runtime.wording import numbered, quantity
from runtime.workspace import ARMS, Source, scenario_path
from symbolic.model_file.checks import quote

ON = "simulation"


def open_plans(bench: Bench, tell: Tell, files: Sequence[Mapping[str, str]]) -> Found:
    """Open trajectories, scenarios, which are planned, and tables of sweeps."""
    opened, found = bench.opened(), []
    tell.parts(
        ["deriving and compiling the model", "evaluating the plan", "optimizing the motion", "reading the table"]
    )
    for k, entry in enumerate(files):
        path, name = opened.session.folder / "given" / entry["file"], entry["name"]
        work, kind = opened.session.scratch / f"opened{k}", path.suffix.lower()
        if kind == ".json":
            _open_trajectory(opened, tell, path, name, work)
        elif kind == ".toml":
            _plan_scenario(opened, tell, path, name, work)
        else:
            tell.part("reading the table")
            write(empty(work) / "sweep.json", _sweep(name, variations(read(path, MOST_JOBS))))
        found.append({"shelf": "plans" if kind in (".json", ".toml") else "sweeps", "made": work.name})
    return {"opened": found}


def _open_trajectory(opened: Opened, tell: Tell, path: Path, name: str, work: Path) -> None:
    source = _source(opened, trajectory.arm_of(path))
    tell.part("deriving and compiling the model")
    model = source.model()
    planned = trajectory.read(path, model)
    tell.part("evaluating the plan")
    _keep(empty(work), name, source, planned, plain(results.stated(model, planned)), None)


def _plan_scenario(opened: Opened, tell: Tell, path: Path, name: str, work: Path) -> None:
    asked = scenario_file.read(path)
    source = _source(opened, Path(asked.model).name.removesuffix(".toml"))
    tell.part("deriving and compiling the model")
    case = scenario_file.fitted(asked, source.model(), name)
    _optimized(tell, source, case, PlanningSettings(), empty(work), name, None)
    shutil.copyfile(path, work / "scenario.toml")


def plan_point(bench: Bench, tell: Tell, sweep: int, point: int, scenario: str) -> Found:
    """Plan a sweep's point again, with the first guesses that the sweep had for its best one."""
    opened = bench.opened()
    tell.parts(["deriving and compiling the model", "optimizing the motion"])
    shown = opened.session.document(opened.session.folder / "sweeps" / str(int(sweep)) / "sweep.json")
    asked_for: PointShown = shown["points"][int(point)]
    if asked_for["cost"] is None:
        raise SessionError(f"this point of the sweep has no plan: {asked_for['reason']}")
    home = opened.session.folder / "plans" / scenario
    path = home / "scenario.toml" if scenario.isdecimal() else scenario_path(Path(scenario))
    asked = scenario_file.read(path)
    source = Source.read(home / "model.toml", opened.effects) if scenario.isdecimal() else Source.shipped(asked.model)
    tell.part("deriving and compiling the model")
    model = source.model()
    code = Code(model.directory, model.library.directory)
    case = scenario_file.fitted(asked, model, path.name)
    job = grid.job_at(case, asked_for["at"], asked_for["seed"], model, code, source.described)
    work = empty(opened.session.scratch / "opened0")
    at = ", ".join(f"{name} {_short(value)}" for name, value in asked_for["at"].items() if value is not None)
    swept = SweptAt(sweep=sweep, point=point, swept_cost=asked_for["cost"], cost=0.0)
    _optimized(tell, source, job.scenario, PlanningSettings(job.starts, job.seed), work, f"{case.name}, {at}", swept)
    return {"opened": [{"shelf": "plans", "made": work.name}]}


def _optimized(
    tell: Tell,
    source: Source,
    case: Scenario,
    settings: PlanningSettings,
    work: Path,
    name: str,
    swept: SweptAt | None,
) -> None:
    """A scenario planned, into a folder. Raises SessionError where no motion meets all constraints."""
    tell.part("optimizing the motion")
    model = source.model()
    try:
        plan = optimize(model, case, settings)
    except Infeasible as error:
        raise SessionError(str(error)) from error
    if swept is not None:
        swept = {**swept, "cost": plan.cost}
    _keep(work, name, source, plan.trajectory, plain(results.document(model, plan)), swept)


def execute_plan(bench: Bench, tell: Tell, plan: int) -> Found:
    """Execute a plan on the simulated arm, as `tendon execute --on simulation` does."""
    opened = bench.opened()
    tell.parts(["deriving and compiling the model and its controller", "executing the trials", "drawing what happened"])
    home = opened.session.folder / "plans" / str(int(plan))
    source = Source.read(home / "model.toml", opened.effects)
    tell.part("deriving and compiling the model and its controller")
    model, controller = source.model(), source.controller()
    planned = trajectory.read(home / "trajectory.json", model)
    tell.part("executing the trials")
    result = executed_on_simulation(model, controller, planned)
    tell.part("drawing what happened")
    work = empty(opened.session.scratch / "executed")
    if result.recording is not None:
        recording.write(work / "recording.csv.gz", result.recording)
    write(work / "executed.json", _executed(work, result))
    return {"executed": plan}


# --- what they have in common ---


def _source(opened: Opened, arm: str) -> Source:
    """The model file of an arm: the session's, or one that comes with the toolkit. Raises SessionError."""
    given = opened.inputs.model
    if given is not None and arm in (opened.source.arm().name, given.name.removesuffix(".toml")):
        return opened.source
    if arm in {path.stem for path in ARMS.glob("*.toml")}:
        return Source.shipped(arm, opened.effects)
    raise SessionError(f"it is for the arm {quote(arm)}, which is not the session's; give its model file first")


def _keep(
    work: Path, name: str, source: Source, planned: Trajectory, document: Mapping[str, Any], swept: SweptAt | None
) -> None:
    """A plan in its folder."""
    model, joints = source.model(), moving_joints(document)
    (work / "model.toml").write_text(source.text, encoding="utf-8")
    planned.write(work / "trajectory.json")
    for joint in joints:
        of_plan(document, joint).save(work / f"joint{joint}.npz")
    shown = PlanShown(
        name=name,
        headline=planned_page.headline(document),
        springs=planned_page.spring_lines(document),
        phases=[_phase(phase) for phase in document["phases"]],
        facts=[{"name": "cycle time", "value": quantity(planned.duration, "s")}],
        table=planned_page.table(document),
        joints=joints,
        called=[numbered(joint["joint"], joint["name"]) for joint in document["joints"]],
        arm=_picture(planned_page.moving(model, planned)),
        notes=planned_page.notes(document),
        command=shlex.join(["tendon", "execute", source.path.name, "trajectory.json", "--on", ON]),
        swept=swept,
    )
    write(work / "plan.json", shown)


def _phase(phase: Mapping[str, Any]) -> str:
    way = f"{phase['from']} to {phase['to']}, " if "from" in phase else ""
    where = "in contact" if phase["kind"] == "contact" else "free"
    return f"{way}{where}, {quantity(phase['duration'], 's', 3)}"


def _executed(work: Path, result: Execution) -> ExecutedShown:
    """What an execution came to; of one that moved the signals are put into the folder."""
    document = plain({"on": ON, **result.to_json()})
    moved = result.recording is not None and not result.excess
    arm = None
    if moved:
        cycles = ExecutedCycles(result)
        arm = _picture(cycles.picture())
        for k, (joint, shown) in enumerate(zip(result.plan.model.joints, cycles.joints, strict=True), 1):
            of_execution(numbered(k, joint.name), shown).save(work / f"executed{k}.npz")
    kind, tag = executed_page.TAGS[document["status"]]
    return ExecutedShown(
        kind=kind,
        tag=tag,
        headline=executed_page.headline(document),
        reason=document["reason"] or "",
        facts=executed_page.facts(document),
        table=executed_page.table(document),
        arm=arm,
        notes=executed_page.notes(document),
    )


def _picture(picture: Mapping[str, Any]) -> dict[str, Any]:
    """For a document: its data as an object and not as text for a page."""
    return {**picture, "data": json.loads(picture["data"])}


def _sweep(name: str, found: Sequence[SweepVariation]) -> SweepShown:
    points = [
        PointShown(
            at=dict(variation.best.at),
            cost=variation.best.cost,
            jobs=variation.jobs,
            plans=len(variation.costs),
            seed=variation.best.seed,
            figures=dict(variation.best.figures),
            reason="" if variation.costs else variation.best.message[:MOST_REASON],
        )
        for variation in found[:MOST_POINTS]
    ]
    jobs = sum(variation.jobs for variation in found)
    return SweepShown(name=name, axes=list(found[0].best.at), points=points, more=len(found) - len(points), jobs=jobs)


def _short(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


TASKS: dict[str, Callable[..., Found]] = {
    "open_plans": open_plans,
    "plan_point": plan_point,
    "execute_plan": execute_plan,
}
