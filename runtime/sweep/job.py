"""One optimization of a sweep, and what a worker makes of it."""

from __future__ import annotations

import hashlib
import json
import threading
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any

from runtime.model.loader import Model, load_library, load_model
from runtime.planning.optimize import Infeasible, optimize
from runtime.planning.options import PlanningSettings
from runtime.planning.scenario import Scenario
from runtime.planning.starts import StartError
from runtime.progress import on_cores

Value = float | str
Result = dict[str, Any]
"""Of a job, by column of the table."""

_ONE_AT_A_TIME = threading.Lock()
"""CasADi and IPOPT share state between the threads of a process, and a Dask worker may have several."""


@dataclass(frozen=True)
class Code:
    """Directories with the compiled code of an arm and of the effects, where a worker finds them."""

    model: Path
    library: Path

    def load(self) -> Model:
        return load_model(self.model, load_library(self.library))

    def identity(self) -> str:
        """A hash of the generated sources: the same for one arm wherever it was compiled."""
        return digest(
            {
                f"{part}/{path.name}": hashlib.sha256(path.read_bytes()).hexdigest()
                for part, directory in (("model", self.model), ("library", self.library))
                for path in sorted(directory.iterdir())
                if path.is_file() and path.suffix != ".so" and not path.name.startswith(".")
            }
        )


def digest(content: Any) -> str:
    """A name for content that JSON can write."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:24]


@dataclass(frozen=True)
class Job:
    """A variation of a scenario with one seed. key: a hash of all that decides its result."""

    columns: Mapping[str, Value | None]
    scenario: Scenario
    seed: int
    starts: int | None
    key: str

    @classmethod
    def of(
        cls, columns: Mapping[str, Value | None], scenario: Scenario, seed: int, starts: int | None, arm: str
    ) -> Job:
        """arm: Code.identity()."""
        key = digest([arm, dict(columns), asdict(scenario), seed, starts])
        return cls(columns, scenario, seed, starts, key)


def solve(code: Code, job: Job) -> Result:
    """The best plan of the job's starts, or why there is none."""
    with _ONE_AT_A_TIME:
        started = time.perf_counter()
        try:
            result = _planned(_loaded(code), job)
        except (Infeasible, StartError) as error:
            attempts = error.attempts if isinstance(error, Infeasible) else ()
            iterations = sum(a.iterations for a in attempts)
            result = {"feasible": False, "iterations": iterations, "message": str(error)}
        return {**result, "seconds": time.perf_counter() - started}


def is_result(found: Any) -> bool:
    """Whether something that was read is a result as `solve` and `failed` give it."""
    if not isinstance(found, dict) or not isinstance(found.get("message", ""), str) or "feasible" not in found:
        return False
    numbers = [value for name, value in found.items() if name not in ("feasible", "message")]
    if any(isinstance(x, bool) or not isinstance(x, int | float) or not isfinite(x) for x in numbers):
        return False
    feasible = found["feasible"]
    return feasible is None or feasible is False or (feasible is True and "cost" in found)


def failed(reason: str) -> Result:
    """Of a job that did not come to an end."""
    return {"feasible": None, "message": " ".join(reason.split())}


@cache
def _loaded(code: Code) -> Model:
    return code.load()


def _planned(model: Model, job: Job) -> Result:
    # The other cores have jobs of their own, in threads of this process even, which a fork would cut off.
    with on_cores(1):
        plan = optimize(model, job.scenario, PlanningSettings(job.starts, job.seed))
    springs = plan.trajectory.springs
    return {
        "feasible": True,
        "cost": plan.cost,
        "smooth_cost": plan.smooth_cost,
        **{f"cost_joint{i}": float(cost) for i, cost in enumerate(plan.effort.cost, 1)},
        **{
            f"{p.name}_joint{s.plan.joint}": float(springs[s.plan.joint][p.name])
            for s in plan.springs
            for p in s.sought
        },
        "iterations": sum(a.iterations for a in (*plan.attempts, plan.refined)),
        "message": "",
    }
