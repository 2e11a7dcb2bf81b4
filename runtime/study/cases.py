"""The cases of the study: A and B without friction, C and D with it; A and C bare, B and D with a spring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from runtime.model.loader import Model
from runtime.planning import scenario_file
from runtime.planning.optimize import Plan, optimize
from runtime.planning.scenario import Scenario

FREE, CONTACT = "scenario1", "scenario2"


def scenario(name: str, model: Model) -> Scenario:
    """A scenario of the paper, fitted to its arm."""
    path = Path(__file__).parent / f"{name}.toml"
    return scenario_file.fitted(scenario_file.read(path), model, path.name)


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
        """The paper's scenario as this case has it."""
        base = scenario(FREE if self.plate is None else CONTACT, model)
        contact: Mapping[str, dict[str, float]] = base.contact
        if self.plate is not None:
            contact = {**contact, "plate": {**contact.get("plate", {}), **PLATE[self.plate]}}
        case = replace(base, cycle_time=self.cycle_time, friction=self.friction, contact=contact)
        return case if self.sprung else case.without_springs()


PLATE: Mapping[float, dict[str, float]] = {
    600.0: {"stiffness": 600.0, "pretension": 24.0},
    1300.0: {"stiffness": 1300.0, "pretension": 10.0},
}
"""Of the environment by its stiffness: the softer plate's pretension is published, the stiffer one's calibrated."""


@dataclass
class Plans:
    """Optimized cases of one arm, each once."""

    model: Model

    @cached_property
    def _made(self) -> dict[StudyCase, Plan]:
        return {}

    def of(self, case: StudyCase) -> Plan:
        if case not in self._made:
            self._made[case] = optimize(self.model, case.scenario(self.model))
        return self._made[case]
