"""The cases of the study, planned and executed: A and B without friction, C and D with it; B and D with a spring."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from runtime.documents.plans import CaseExecution, CycleEntry, ExecuteDocument
from runtime.execution.execute import Execution, execute
from runtime.execution.options import ExecutionSettings
from runtime.model.loader import Model
from runtime.planning import scenario_file
from runtime.planning.optimize import Plan, optimize
from runtime.planning.scenario import Scenario
from runtime.simulation.simulate import parse_hidden

FREE, CONTACT = "scenario1", "scenario2"
PLATE: Mapping[float, dict[str, float]] = {
    600.0: {"stiffness": 600.0, "pretension": 24.0},
    1300.0: {"stiffness": 1300.0, "pretension": 10.0},
}
"""Plates by stiffness: the softer plate's pretension is published, the stiffer one's calibrated."""
HIDDEN: Sequence[str] = ("plate_damping:coefficient=40",)
"""Effects of the simulated arm that the model does not have; assumed. The paper suspects viscous friction there."""
_CYCLES = 2


@dataclass(frozen=True)
class StudyCase:
    """letter: A to D; cycle_time in s; plate: its stiffness in N/m, None in scenario 1."""

    letter: str
    cycle_time: float
    plate: float | None = None

    @property
    def friction(self) -> bool:
        """Whether the motion is planned with friction."""
        return self.letter in "CD"

    @property
    def sprung(self) -> bool:
        """Whether springs are sought."""
        return self.letter in "BD"

    def __str__(self) -> str:
        number = 1 if self.plate is None else 2
        plate = "" if self.plate is None else f", plate {self.plate / 1000:g} kN/m"
        return f"{number}{self.letter} at {self.cycle_time:g} s{plate}"

    def scenario(self, model: Model) -> Scenario:
        """The paper's scenario for this case and its arm."""
        path = Path(__file__).parent / f"{FREE if self.plate is None else CONTACT}.toml"
        base = scenario_file.fitted(scenario_file.read(path), model, path.name)
        contact: Mapping[str, dict[str, float]] = base.contact
        if self.plate is not None:
            contact = {**contact, "plate": {**contact.get("plate", {}), **PLATE[self.plate]}}
        case = replace(base, cycle_time=self.cycle_time, friction=self.friction, contact=contact)
        return case if self.sprung else case.without_springs()


@dataclass
class Plans:
    """Optimized cases of one arm, each computed once."""

    model: Model
    _made: dict[StudyCase, Plan] = field(default_factory=dict)

    def of(self, case: StudyCase) -> Plan:
        if case not in self._made:
            self._made[case] = optimize(self.model, case.scenario(self.model))
        return self._made[case]


@dataclass(frozen=True)
class CaseRun:
    """Trials of a case; joints: whose torque counts (1-based)."""

    execution: Execution
    joints: tuple[int, ...]

    @cached_property
    def document(self) -> ExecuteDocument:
        return self.execution.document()

    @property
    def mean(self) -> CycleEntry:
        """Over all cycles."""
        assert self.document.mean is not None
        return self.document.mean

    @property
    def cost(self) -> float:
        """N² m² s per cycle, of the joints that count."""
        return float(sum(self.mean.cost[j - 1] for j in self.joints))

    @property
    def reversal(self) -> float:
        """rad, where joint 4 turns back."""
        return self.mean.q_min[3]

    def entry(self) -> CaseExecution:
        """The document without the single cycles."""
        return CaseExecution(**{name: getattr(self.document, name) for name in CaseExecution.__struct_fields__})


@dataclass(frozen=True)
class StudyExperiment:
    """Each case on a simulated arm that differs from the model; done: called after each case."""

    model: Model
    controller: Path
    trials: int
    done: Callable[[StudyCase], None]

    def run(self, case: StudyCase, plan: Plan) -> CaseRun:
        """Without friction compensation in cases A and B; with the plate's damper in scenario 2."""
        hidden = [] if case.plate is None else [parse_hidden(text, self.model) for text in HIDDEN]
        settings = ExecutionSettings(self.trials, _CYCLES, friction_compensation=case.friction)
        execution = execute(self.model, self.controller, plan.trajectory, settings, hidden=hidden)
        self.done(case)
        return CaseRun(execution, plan.scenario.counted)
