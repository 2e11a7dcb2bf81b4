"""Motions: planned, designed and executed, with their results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

from msgspec import UNSET, UnsetType

from runtime.documents.parts import given
from runtime.documents.plans import ExecuteDocument, OptimizeDocument, PredictionEntry
from runtime.execution import targets
from runtime.execution.execute import Execution
from runtime.execution.motions import read_either, slower
from runtime.execution.options import ExecutionSettings
from runtime.notebook.arm import LoadedArm, PathOrText
from runtime.notebook.html import ResultFigures
from runtime.notebook.results import MadeResult, VerbResult, several
from runtime.planning import optimize as optimizer
from runtime.planning import scenario_file
from runtime.planning.optimize import Plan
from runtime.planning.results import document as plan_document
from runtime.planning.settings import PlanningSettings
from runtime.recordings.recording import Recording
from runtime.report import motions, terminal
from runtime.report.page import page_figures
from runtime.report.page.motion_pages import execution_page, plan_page
from runtime.report.plots import motion_plots
from runtime.simulation.simulate import parse_hidden
from runtime.workspace.names import scenario_path
from runtime.workspace.source import scenario_source


@dataclass(frozen=True, repr=False)
class PlanResult(VerbResult[OptimizeDocument]):
    """A planned motion; arm: with the plan's springs and contact in its text; bare: as of
    `optimize.without_springs`."""

    plan: Plan
    arm: LoadedArm
    bare: Plan | optimizer.Infeasible | UnsetType = UNSET

    _sections = staticmethod(motions.plan)

    @staticmethod
    def _in_short(document: OptimizeDocument) -> list[str]:
        return [motions.plan_headline(document), *motions.spring_lines(document)]

    @cached_property
    def document(self) -> OptimizeDocument:
        """As `tendon optimize --json`."""
        return plan_document(self.arm.model, self.plan, self.bare)

    @cached_property
    def figures(self) -> ResultFigures:
        """Positions and torques of one cycle."""
        figure = motion_plots.plan(self.document)
        return ResultFigures([page_figures.drawn(figure, "plan", "Positions and torques of one cycle.")])

    def report(self, directory: PathOrText) -> Path:
        """Write the HTML page into a directory; its path. Raises OSError."""
        return plan_page(self.arm.model, self.plan.trajectory, self.document).write(Path(directory))

    def save(self, path: PathOrText) -> None:
        """Write the trajectory, for `tendon execute`. Raises OSError."""
        self.plan.trajectory.write(Path(path))


@dataclass(frozen=True, repr=False)
class ExecutionResult(MadeResult[ExecuteDocument]):
    """A plan that was executed, on a simulated arm or on a real one."""

    execution: Execution

    _sections = staticmethod(motions.execution)

    @staticmethod
    def _in_short(document: ExecuteDocument) -> list[str]:
        why = [f"{document.status.upper()}: {document.reason}"] if document.reason else []
        return [motions.execution_headline(document), *why]

    @property
    def status(self) -> Literal["done", "stopped", "refused"]:
        """stopped: a safe stop; refused: the plan exceeds limits or a real arm may not move, and nothing moved."""
        return self.made.status

    @property
    def reason(self) -> str | None:
        """Why it was stopped or refused; None if it was not."""
        return self.made.reason

    @property
    def prediction(self) -> PredictionEntry | None:
        """Of a real arm: what the simulated one did: `.joints[0].torque`, `.speed`, `.room`; else None."""
        return given(self.made.prediction)

    @property
    def recording(self) -> Recording | None:
        """All trials, a run each, to compare and diagnose; None if nothing moved."""
        return self.execution.recording

    def report(self, directory: PathOrText) -> Path:
        """Write the HTML page into a directory; its path. Raises OSError."""
        return execution_page(self.execution, self.document).write(Path(directory))


def optimize(
    scenario: PathOrText,
    cycle_time: float | None = None,
    friction: bool | None = None,
    springs: bool = True,
    starts: int | None = PlanningSettings.starts,
    seed: int = PlanningSettings.seed,
    effects: PathOrText | None = None,
) -> PlanResult:
    """Plan motion and springs together; the arm is the one that the scenario names.

    scenario     a file, or the name of one of Tendon's (scenario1, scenario2)
    cycle_time   s, and friction: in place of the file's     springs: with the file's, or bare
    starts       random first guesses; None: few     Raises Infeasible if no motion meets all constraints.
    """
    path = scenario_path(Path(scenario))
    asked = scenario_file.read(path)
    source = scenario_source(asked.model, path, None if effects is None else Path(effects))
    arm = LoadedArm(source)
    case = scenario_file.fitted(asked, arm.model, str(path))
    case = case if springs else case.without_springs()
    case = replace(
        case,
        cycle_time=case.cycle_time if cycle_time is None else cycle_time,
        friction=case.friction if friction is None else friction,
    )
    settings = PlanningSettings(starts, seed)
    plan = optimizer.optimize(arm.model, case, settings)
    bare = optimizer.without_springs(arm.model, plan, settings)
    return PlanResult(plan, arm.with_text(source.edits.mount(plan.trajectory).text), bare)


def execute(
    arm: LoadedArm,
    plan: PlanResult | PathOrText,
    on: str = "simulation",
    hide: str | Sequence[str] = (),
    change: str | Sequence[str] = (),
    trials: int | None = ExecutionSettings.trials,
    cycles: int = ExecutionSettings.cycles,
    seed: int = ExecutionSettings.seed,
    noise: float = ExecutionSettings.noise,
    friction_compensation: bool | None = ExecutionSettings.friction_compensation,
    tracking_limit: float | None = ExecutionSettings.tracking_limit,
    move: bool = False,
    approach: bool = ExecutionSettings.approach,
    speed: float = ExecutionSettings.speed,
) -> ExecutionResult:
    """Execute a plan with the arm's compiled controller; `result.recording` has all trials.

    plan      of `optimize`, or a file that it saved, or a motion: a CSV of t,q1,...; speed: its pace, 1 as planned
    on        "simulation", an emulated processor: "unicorn", "qemu", or a real arm: "serial:///dev/ttyACM0",
              "canopen://can0"
    hide      effects of the simulated arm that the model lacks     change: values that differ from the model's
    tracking_limit   error that causes a safe stop, rad or m; None: 0.5 rad, 0.1 m
    move      a real arm moves only with this, and nobody in its reach; without it the motion is predicted, and the
              board is asked where the arm stands
    approach  first move a real arm slowly to the start
    A real arm's motion is simulated first, and its prediction printed before it moves; interrupting it (Ctrl-C, the
    kernel's stop) is a safe stop. Raises ValueError; LinkError, LinkLost: no such arm, or it does not answer.
    """
    targets.check_options(on, moves=move, approach=approach, hidden=hide, changed=change)
    model = arm.model
    if isinstance(plan, PlanResult):
        trajectory, played = slower(plan.plan.trajectory, speed), None
    else:
        trajectory, played = read_either(Path(plan), model, speed)
    targets.check(on, model)
    settings = ExecutionSettings(
        trials=trials,
        cycles=cycles,
        seed=seed,
        noise=noise,
        friction_compensation=friction_compensation,
        tracking_limit=tracking_limit,
        approach=approach,
        speed=speed,
    )
    order = targets.Order(
        model,
        arm.source.compiled.controller(targets.build_of(on), roomy=targets.is_roomy(on)),
        trajectory,
        settings,
        hidden=[parse_hidden(text, model) for text in several(hide)],
        changed=[parse_hidden(text, model, "--set") for text in several(change)],
        moves=move,
        played=played,
        ready=lambda predicted: terminal.show(motions.prediction(predicted)),
    )
    done, document = order.run(on)
    return ExecutionResult(document, done)
