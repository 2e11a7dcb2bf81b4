"""The results of a sweep on disk as they finish, one JSON line a job, so that an interrupted sweep can continue."""

from __future__ import annotations

import fcntl
import json
import os
import stat
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import BinaryIO

from runtime.planning.scenario import Scenario
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


class JournalError(ValueError):
    """A journal with which this sweep cannot continue."""


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


def run(jobs: Sequence[Job], pool: Pool, journal: Journal, tell: Callable[[JobResult], None]) -> dict[str, JobResult]:
    """The result of every job by key; tell: called with each new one. Finished jobs are not run again, and failed ones
    are not kept, so that the next call tries them again. Raises PoolError."""
    results = {job.key: journal.results[job.key] for job in jobs if job.key in journal.results}
    for job, result in outcomes(pool, [job for job in jobs if job.key not in results]):
        if result.feasible is not None:
            journal.add(job, result)
        results[job.key] = result
        tell(result)
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
