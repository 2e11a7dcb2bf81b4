"""Motions: planned, designed and executed, with their results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from runtime.documents.plans import ExecuteDocument, OptimizeDocument
from runtime.documents.recordings import ExperimentDocument
from runtime.execution import execute as execution
from runtime.execution.options import ExecutionSettings
from runtime.experiments import design
from runtime.experiments.options import ExperimentSettings
from runtime.notebook.arm import LoadedArm, PathOrText
from runtime.notebook.figures import ResultFigures
from runtime.notebook.results import VerbResult
from runtime.planning import optimize as optimizer
from runtime.planning import scenario_file
from runtime.planning import trajectory as trajectories
from runtime.planning.optimize import Plan
from runtime.planning.results import document as plan_document
from runtime.planning.settings import PlanningSettings
from runtime.recordings.recording import Recording
from runtime.report import motions, recordings
from runtime.report.page import page_figures
from runtime.report.page.motion_pages import execution_page, plan_page
from runtime.report.plots import motion_plots
from runtime.simulation.simulate import parse_hidden
from runtime.wording import sentence
from runtime.workspace.names import UsageError, scenario_path
from runtime.workspace.source import scenario_source


@dataclass(frozen=True, repr=False)
class PlanResult(VerbResult):
    """A planned motion; arm: with the plan's springs and contact in its text; without_springs: as
    `cost_without_springs`."""

    plan: Plan
    arm: LoadedArm
    without_springs: float | UnsetType | None = UNSET

    _sections = staticmethod(motions.plan)

    @cached_property
    def document(self) -> OptimizeDocument:
        """As `tendon optimize --json`."""
        return plan_document(self.arm.model, self.plan, self.without_springs)

    def __repr__(self) -> str:
        return "\n".join([motions.plan_headline(self.document), *motions.spring_lines(self.document)])

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
class ExperimentResult(VerbResult):
    """A motion that separates effects, or why there is none."""

    proposal: design.Proposal
    arm: LoadedArm

    _sections = staticmethod(recordings.experiment)

    @cached_property
    def document(self) -> ExperimentDocument:
        """As `tendon experiment --json`."""
        return self.proposal.document().as_part_of(ExperimentDocument, out=None)

    @property
    def separated(self) -> bool:
        """Whether the diagnosis tells the effects apart on this motion, in simulation."""
        return self.document.separated

    @property
    def reason(self) -> str:
        """The answer in one sentence."""
        return self.document.reason

    @property
    def motion(self) -> NDArray[np.float64]:
        """(N, n) positions at 1 kHz, rad or m, for your arm or for `simulate(motion=...)`."""
        return self.proposal.motion.T

    def save(self, path: PathOrText) -> None:
        """Write the motion as CSV. Raises OSError."""
        design.write_motion(Path(path), self.arm.model, self.proposal.motion)

    def __repr__(self) -> str:
        return sentence(self.reason)


@dataclass(frozen=True, repr=False)
class ExecutionResult(VerbResult):
    """A plan that was executed on the simulated arm."""

    execution: execution.Execution
    target: str

    _sections = staticmethod(motions.execution)

    @cached_property
    def document(self) -> ExecuteDocument:
        """As `tendon execute --json`."""
        return msgspec.structs.replace(self.execution.document(), on=self.target)

    @property
    def status(self) -> Literal["done", "stopped", "refused"]:
        """stopped: a safe stop; refused: the plan exceeds limits, and nothing moved."""
        return self.execution.status

    @property
    def reason(self) -> str | None:
        """Why it was stopped or refused; None if it was not."""
        return self.execution.reason

    @property
    def recording(self) -> Recording | None:
        """All trials, a run each, to compare and diagnose; None if nothing moved."""
        return self.execution.recording

    def report(self, directory: PathOrText) -> Path:
        """Write the HTML page into a directory; its path. Raises OSError."""
        return execution_page(self.execution, self.document).write(Path(directory))

    def __repr__(self) -> str:
        why = [f"{self.status.upper()}: {self.reason}"] if self.reason else []
        return "\n".join([motions.execution_headline(self.document), *why])


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
    without = optimizer.cost_without_springs(arm.model, case, settings)
    return PlanResult(plan, arm.with_text(source.edits.mount(plan.trajectory).text), without)


def experiment(
    arm: LoadedArm,
    between: str | Sequence[str],
    seed: int = ExperimentSettings.seed,
    noise: float = ExperimentSettings.noise,
) -> ExperimentResult:
    """Design a motion that separates rival effects, within the joints' limits; `result.save` writes it.

    between   "linear_spring@1", "gravity", …, with values if you like; a single one is separated from the model
    noise     part of the ordinary excitation's torque
    """
    texts = ",".join([between] if isinstance(between, str) else between)
    rivals = design.parse_rivals(texts, arm.model)
    return ExperimentResult(design.propose(arm.model, rivals, ExperimentSettings(seed, noise)), arm)


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
) -> ExecutionResult:
    """Execute a plan with the arm's compiled controller on the simulated arm; `result.recording` has all trials.

    plan    of `optimize`, or a file that it saved
    on      "simulation", or an emulated processor: "unicorn", "qemu"
    hide    effects of the simulated arm that the model lacks     change: values that differ from the model's
    A real arm moves only from the command line, `tendon execute`. Raises ValueError.
    """
    if on not in execution.SIMULATED:
        raise UsageError(
            f"on={on!r}: expected one of {', '.join(execution.SIMULATED)}; a real arm moves from the command line: "
            "tendon execute MODEL TRAJECTORY --on TARGET --arm"
        )
    model, target = arm.model, execution.SIMULATED[on]
    trajectory = plan.plan.trajectory if isinstance(plan, PlanResult) else trajectories.read(Path(plan), model)
    settings = ExecutionSettings(
        trials=trials, cycles=cycles, seed=seed, noise=noise, friction_compensation=friction_compensation
    )
    done = execution.execute(
        model,
        arm.source.compiled.controller(target.build),
        trajectory,
        settings,
        hidden=[parse_hidden(text, model) for text in ([hide] if isinstance(hide, str) else hide)],
        changed=[parse_hidden(text, model, "--set") for text in ([change] if isinstance(change, str) else change)],
        board=target.board,
    )
    return ExecutionResult(done, on)
