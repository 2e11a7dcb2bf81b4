"""The Experiment rows: each optimized trajectory executed on a simulated arm that is not quite the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.execution.execute import Execution, execute
from runtime.execution.options import ExecutionSettings
from runtime.model.loader import Model
from runtime.planning.optimize import Plan
from runtime.simulation.simulate import Hidden, parse_hidden
from runtime.study.cases import StudyCase

_CYCLES = 2
HIDDEN: Sequence[str] = ("plate_damping:coefficient=40",)
"""What the simulated arm has and the model has not; assumed. The paper suspects viscous friction at the plate."""


@dataclass(frozen=True)
class CaseRun:
    """Trials of a case. cost in N²m²s, of the joints whose torque counts; reversal: of joint 4, rad;
    compression: of the plate, m."""

    execution: Execution
    document: dict[str, Any]
    joints: tuple[int, ...]

    @property
    def cost(self) -> float:
        """N² m² s a cycle, of the joints that count."""
        return float(sum(self.document["mean"]["cost"][j - 1] for j in self.joints))

    @property
    def reversal(self) -> float:
        """rad, where joint 4 turns."""
        return float(self.document["mean"]["q_min"][3])

    @property
    def compression(self) -> float | None:
        """m, by which the plate is pressed down; None without one."""
        return self.document["mean"]["compression"]

    def to_json(self) -> dict[str, Any]:
        """Without the single cycles."""
        kept = ("status", "reason", "friction_compensation", "effects", "mean", "spread")
        return {name: self.document[name] for name in kept}


@dataclass(frozen=True)
class StudyBench:
    """The arm with its controller; trials of each case. done: called after each case."""

    model: Model
    controller: Path
    trials: int
    done: Callable[[StudyCase], None]

    def run(self, case: StudyCase, plan: Plan) -> CaseRun:
        """Friction compensation is off in cases A and B; the plate's damper is there where the plate is."""
        hidden = self._hidden() if case.plate is not None else []
        settings = ExecutionSettings(self.trials, _CYCLES, friction_compensation=case.friction)
        execution = execute(self.model, self.controller, plan.trajectory, settings, hidden=hidden)
        self.done(case)
        joints = plan.scenario.objective.joints or plan.scenario.moving
        return CaseRun(execution, execution.to_json(), tuple(joints))

    def _hidden(self) -> list[Hidden]:
        return [parse_hidden(text, self.model) for text in HIDDEN]
