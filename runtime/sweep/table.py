"""The table of a sweep: one row a job, as CSV or Parquet, and what it says of each variation."""

from __future__ import annotations

import csv
import io
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

from runtime import files
from runtime.model.loader import Model
from runtime.planning.scenario import Scenario, sought
from runtime.sweep.job import Job, JobResult

CLOSE = 0.01
"""Of the best cost: starts that come this near have found the same."""
_TYPES = {"case": "string", "seed": "int64", "feasible": "bool", "iterations": "int64", "message": "string"}
"""Of columns that are no floats."""


class TableError(ValueError):
    """A table that cannot be written."""


def check(path: Path) -> None:
    """Refuse before any work what could not be written after it. Raises TableError."""
    if path.suffix not in (".csv", ".parquet"):
        raise TableError(f"{path}: expected a name that ends in .csv or .parquet")
    if path.suffix == ".parquet" and find_spec("pyarrow") is None:
        raise TableError(
            f"{path}: Parquet needs pyarrow, the extra `parquet`; run: {sys.executable} -m pip install pyarrow"
        )


def columns(scenario: Scenario, n: int, axes: Sequence[str]) -> list[str]:
    """Of the table: the variation, then the result; the same whether or not every job has a plan."""
    return [
        *(axis for axis in axes if axis != "seed"),
        *("seed", "feasible", "cost", "smooth_cost"),
        *(f"cost_joint{i}" for i in range(1, n + 1)),
        *(f"{what}_joint{spring.joint}" for spring in scenario.springs for what in spring.sought),
        *("iterations", "seconds", "message"),
    ]


def write(path: Path, names: Sequence[str], jobs: Sequence[Job], results: Mapping[str, JobResult]) -> None:
    """One row a job, in their order; results: by key."""
    rows = [{**results[job.key].columns(), **job.columns, "seed": job.seed} for job in jobs]
    found = {name: [_cell(name, row.get(name)) for row in rows] for name in names}
    files.replace(path, _parquet(found) if path.suffix == ".parquet" else _csv(found))


def _cell(name: str, value: Any) -> Any:
    """A value as its column holds it: numbers are floats where it has no type of its own; None: nothing."""
    return value if value is None or name in _TYPES else float(value)


def _csv(found: Mapping[str, Sequence[Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(found)
    writer.writerows(zip(*found.values(), strict=True))
    return text.getvalue().encode()


def _parquet(found: Mapping[str, Sequence[Any]]) -> bytes:
    import pyarrow as pa
    from pyarrow import parquet

    schema = pa.schema([(name, _TYPES.get(name, "float64")) for name in found])
    buffer = io.BytesIO()
    parquet.write_table(pa.table(dict(found), schema=schema), buffer)
    return buffer.getvalue()


def summary(jobs: Sequence[Job], results: Mapping[str, JobResult], model: Model) -> list[dict[str, Any]]:
    """By variation: its best plan, how the costs of its seeds spread, and what did not work."""
    groups: dict[tuple[Any, ...], list[Job]] = {}
    for job in jobs:
        groups.setdefault(tuple(job.columns.items()), []).append(job)
    return [_variation(group, [results[job.key] for job in group], model) for group in groups.values()]


def _variation(group: Sequence[Job], results: Sequence[JobResult], model: Model) -> dict[str, Any]:
    planned = [(r.cost, job, r) for job, r in zip(group, results, strict=True) if r.cost is not None]
    costs = [cost for cost, _, _ in planned]
    messages = Counter(r.message for r in results if not r.feasible)
    found: dict[str, Any] = {
        "at": dict(group[0].columns),
        "jobs": len(group),
        "feasible": len(planned),
        "infeasible": sum(r.feasible is False for r in results),
        "failed": sum(r.feasible is None for r in results),
        "best": None,
        "median": None,
        "worst": None,
        "close": None,
        "seed": None,
        "springs": [],
        "reason": messages.most_common(1)[0][0] if messages else None,
    }
    if not planned:
        return found
    best, job, result = min(planned, key=lambda item: item[0])
    near = sum(cost <= best + CLOSE * abs(best) for cost in costs)
    return found | {
        "best": best,
        "median": median(costs),
        "worst": max(costs),
        "close": near / len(group),
        "seed": job.seed,
        "springs": [
            {
                "joint": s.plan.joint,
                **{p.name: result.at_joints[f"{p.name}_joint{s.plan.joint}"] for p in s.sought},
                "unit": s.size.unit.text(model.joints[s.plan.joint - 1].type),
            }
            for s in sought(model, job.scenario)
        ],
    }
