"""The results of a sweep on disk.

The journal has one JSON line per job, written as it finishes, so that an interrupted sweep can continue; the table has
one row per job, as CSV or Parquet.
"""

from __future__ import annotations

import csv
import fcntl
import io
import json
import os
import stat
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any, BinaryIO

from runtime import files
from runtime.documents.plans import SpringValues, VariationEntry
from runtime.model.loader import Model
from runtime.planning.scenario import Scenario, sought
from runtime.sweep.job import Code, Job, JobResult, Pool, digest, outcomes

FORMAT = "tendon-sweep-1"
MAX_BYTES = 1_000_000_000
"""Twice a million jobs of some 500 bytes."""
_DIFFERENT = {
    "format": "was written by another version of the toolkit",
    "scenario": "is of another scenario, or the scenario file has changed since",
    "arm": "is of another arm, or its model file or effects have changed since",
    "starts": "was made with another number of --starts",
    "over": "varies something else with --over",
}


CLOSE = 0.01
"""Part of the best cost within which starts count as having found the same minimum."""
_TYPES = {"case": "string", "seed": "int64", "feasible": "bool", "iterations": "int64", "message": "string"}
"""Of the table's columns that are not floats."""


class JournalError(ValueError):
    """A journal with which this sweep cannot continue."""


class TableError(ValueError):
    """A table that cannot be written."""


# --- the journal ---


def beside(table: Path) -> Path:
    """The path of a table's journal."""
    return table.with_name(table.name + ".journal")


def heading(scenario: Scenario, code: Code, starts: int | None, axes: Sequence[str]) -> dict[str, object]:
    """The first line: the identity of a sweep. The values of an axis are not part of it, so that some can be added."""
    return {
        "format": FORMAT,
        "scenario": digest(asdict(scenario)),
        "arm": code.identity(),
        "starts": starts,
        "over": sorted(axes),
    }


@dataclass(frozen=True)
class Journal:
    """results: of finished jobs by key, of this call and of earlier ones."""

    path: Path
    file: BinaryIO
    results: dict[str, JobResult]

    def finished(self, jobs: Sequence[Job]) -> int:
        """The number of these jobs whose results are here."""
        return sum(job.key in self.results for job in jobs)

    def add(self, job: Job, result: JobResult) -> None:
        """Written to disk before this returns."""
        _append(self.file, {"key": job.key, "at": {**job.columns, "seed": job.seed}, "result": result.columns()})
        self.results[job.key] = result


@contextmanager
def opened(path: Path, expected: Mapping[str, object]) -> Iterator[Journal]:
    """The journal at `path`, new or with what it holds, locked; expected: heading(). Raises JournalError."""
    # "a" creates the file if necessary and truncates nothing.
    try:
        file = open(path, "a+b")  # noqa: SIM115
    except OSError as error:
        raise JournalError(f"{path}: cannot be opened: {error.strerror}") from error
    with file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise JournalError(f"{path}: is not a regular file; choose another --table")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise JournalError(
                f"{path}: another sweep is writing to it; wait for it to finish, or choose another --table"
            ) from error
        yield Journal(path, file, _read(path, file, expected))


def run(jobs: Sequence[Job], pool: Pool, journal: Journal, ended: Callable[[], None]) -> dict[str, JobResult]:
    """The result of every job by key; ended: called after each new one.

    Finished jobs are not run again; failed ones are not kept, so that the next call tries them again. Raises PoolError.
    """
    results = {job.key: journal.results[job.key] for job in jobs if job.key in journal.results}
    for job, result in outcomes(pool, [job for job in jobs if job.key not in results]):
        if result.feasible is not None:
            journal.add(job, result)
        results[job.key] = result
        ended()
    return results


def _read(path: Path, file: BinaryIO, expected: Mapping[str, object]) -> dict[str, JobResult]:
    """Results by key. An incomplete last line, of a sweep that was killed, is cut off."""

    def damaged(number: int) -> JournalError:
        remedy = "delete the journal to start again" if number == 1 else "delete the line to run that job again"
        return JournalError(f"{path} line {number}: not a line that a sweep writes; {remedy}")

    file.seek(0)
    content = file.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        raise JournalError(f"{path}: is larger than {MAX_BYTES // 10**9} GB; choose another --table")
    lines = content.splitlines(keepends=True)
    if lines and not lines[-1].endswith(b"\n"):
        cut = lines.pop()
        if not lines and not _line(expected).startswith(cut):
            raise damaged(1)
        file.truncate(len(content) - len(cut))
    if not lines:
        _append(file, expected)
    results: dict[str, JobResult] = {}
    for number, line in enumerate(lines, 1):
        try:
            item = json.loads(line)
            if number > 1:
                results.setdefault(item["key"], JobResult.parse(item["result"]))
                continue
            different = next((why for name, why in _DIFFERENT.items() if item.get(name) != expected[name]), None)
        except (ValueError, RecursionError, KeyError, TypeError, AttributeError) as error:
            raise damaged(number) from error
        if different:
            raise JournalError(f"{path}: {different}; choose another --table, or delete the journal to start again")
    return results


def _append(file: BinaryIO, item: Mapping[str, object]) -> None:
    file.write(_line(item))
    file.flush()
    os.fsync(file.fileno())


def _line(item: Mapping[str, object]) -> bytes:
    return json.dumps(item).encode() + b"\n"


# --- the table ---


def check(path: Path) -> None:
    """Raise TableError, before any work, if the table could not be written."""
    if path.suffix not in (".csv", ".parquet"):
        raise TableError(f"{path}: expected a name that ends in .csv or .parquet")
    if path.suffix == ".parquet" and find_spec("pyarrow") is None:
        raise TableError(
            f"{path}: Parquet needs pyarrow, the extra `parquet`; run: {sys.executable} -m pip install pyarrow"
        )


def columns(scenario: Scenario, n: int, axes: Sequence[str]) -> list[str]:
    """Names of the columns: what varies, then the result; the same whether or not every job has a plan."""
    return [
        *(axis for axis in axes if axis != "seed"),
        *("seed", "feasible", "cost", "smooth_cost"),
        *(f"cost_joint{i}" for i in range(1, n + 1)),
        *(f"{what}_joint{spring.joint}" for spring in scenario.springs for what in spring.sought),
        *("iterations", "seconds", "message"),
    ]


def write(path: Path, names: Sequence[str], jobs: Sequence[Job], results: Mapping[str, JobResult]) -> None:
    """One row per job, in their order; results: by key."""
    rows = [{**results[job.key].columns(), **job.columns, "seed": job.seed} for job in jobs]
    found: dict[str, list[Any]] = {}
    for name in names:
        values = [row.get(name) for row in rows]
        found[name] = [x if x is None or name in _TYPES else float(x) for x in values]
    if path.suffix == ".parquet":
        import pyarrow as pa
        from pyarrow import parquet

        buffer = io.BytesIO()
        schema = pa.schema([(name, _TYPES.get(name, "float64")) for name in found])
        parquet.write_table(pa.table(found, schema=schema), buffer)
        files.replace(path, buffer.getvalue())
        return
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(found)
    writer.writerows(zip(*found.values(), strict=True))
    files.replace(path, text.getvalue().encode())


def summary(jobs: Sequence[Job], results: Mapping[str, JobResult], model: Model) -> list[VariationEntry]:
    """By variation: its best plan, the spread of the costs over its seeds, and what failed."""
    groups: dict[tuple[Any, ...], list[Job]] = {}
    for job in jobs:
        groups.setdefault(tuple(job.columns.items()), []).append(job)
    return [_variation(group, [results[job.key] for job in group], model) for group in groups.values()]


def _variation(group: Sequence[Job], results: Sequence[JobResult], model: Model) -> VariationEntry:
    planned = [(r.cost, job, r) for job, r in zip(group, results, strict=True) if r.cost is not None]
    costs = [cost for cost, _, _ in planned]
    best = min(planned, key=lambda item: item[0], default=None)
    springs: list[SpringValues] = []
    if best is not None:
        for s in sought(model, best[1].scenario):
            values = {p.name: best[2].at_joints[f"{p.name}_joint{s.plan.joint}"] for p in s.sought}
            unit = s.size.unit.text(model.joints[s.plan.joint - 1].type)
            springs.append({"joint": s.plan.joint, **values, "unit": unit})
    messages = Counter(r.message for r in results if not r.feasible)
    return VariationEntry(
        at=dict(group[0].columns),
        jobs=len(group),
        feasible=len(planned),
        infeasible=sum(r.feasible is False for r in results),
        failed=sum(r.feasible is None for r in results),
        best=best and best[0],
        median=median(costs) if costs else None,
        worst=max(costs, default=None),
        close=best and sum(cost <= best[0] + CLOSE * abs(best[0]) for cost in costs) / len(group),
        seed=best and best[1].seed,
        springs=springs,
        reason=messages.most_common(1)[0][0] if messages else None,
    )
