"""All of the study: each part is computed once, when a table or a figure first asks for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from runtime.model.loader import Model
from runtime.planning.optimize import optimize
from runtime.planning.scenario import Scenario
from runtime.progress import each
from runtime.study import identification, tables
from runtime.study.cases import Plans, StudyCase
from runtime.study.experiment import StudyBench
from runtime.study.identification import Table1
from runtime.study.tables import Claim, Row

TABLES = ("table1", "table2", "table3")
FIGURES = ("figure4", "figure5", "figure6", "figure7", "figure8")
EXECUTED = ("table1", "figure4", "figure6", "figure7", "figure8")
"""What is nothing without the experiment."""
_TIMES = np.round(np.arange(1.0, 3.01, 0.2), 2)
"""s, of Figure 5."""


def _any_spring(scenario: Scenario) -> Scenario:
    """Without catalogues."""
    return replace(scenario, springs=tuple(replace(spring, catalogue=()) for spring in scenario.springs))


@dataclass
class Study:
    """trials: of each case on the simulated arm, 0 for none; say: a line of progress."""

    model: Model
    controller: Path
    trials: int
    say: Callable[[str], None]

    @cached_property
    def plans(self) -> Plans:
        return Plans(self.model)

    @cached_property
    def _bench(self) -> StudyBench | None:
        if not self.trials:
            return None
        return StudyBench(self.model, self.controller, self.trials, lambda case: self.say(f"executed {case}"))

    @cached_property
    def table1(self) -> Table1:
        recordings = identification.record(
            self.model, self.controller, trials=self.trials, done=lambda cosine: self.say(f"executed {cosine}")
        )
        return identification.table1(self.model, recordings)

    @cached_property
    def table2(self) -> list[Row]:
        return tables.table2(self.plans, self._bench)

    @cached_property
    def table3(self) -> list[Row]:
        return tables.table3(self.plans, self._bench)

    @cached_property
    def curves(self) -> dict[StudyCase, float]:
        """Costs of scenario 1 over the cycle time, with springs as they are sought: what can be bought comes later."""
        cases = [StudyCase(letter, float(T)) for T in _TIMES for letter in "ABCD"]
        return {
            case: optimize(self.model, _any_spring(case.scenario(self.model))).cost for case in each("plans", cases)
        }

    @cached_property
    def spread(self) -> dict[float, float]:
        """By cycle time: how far the savings with and without friction are apart, N²m²s."""
        cost = {(case.cycle_time, case.letter): value for case, value in self.curves.items()}
        times = [float(T) for T in _TIMES]
        return {T: abs((cost[T, "A"] - cost[T, "B"]) - (cost[T, "C"] - cost[T, "D"])) for T in times}

    def claims(self, table: str) -> list[Claim]:
        return tables.claims2(self.table2) if table == "table2" else tables.claims3(self.table3)

    def table(self, name: str) -> dict[str, Any]:
        """A table and its claims, as JSON has them."""
        if name == "table1":
            return {**self.table1.to_json(), "claims": [vars(claim) for claim in tables.claims1(self.table1)]}
        rows = self.table2 if name == "table2" else self.table3
        return {"rows": [row.to_json() for row in rows], "claims": [vars(claim) for claim in self.claims(name)]}
