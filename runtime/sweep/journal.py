"""Results of a sweep on disk as soon as they are there: one JSON line a job, read again when the sweep goes on."""

from __future__ import annotations

import fcntl
import json
import os
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from runtime.planning.scenario import Scenario
from runtime.sweep.job import Code, Job, Result, digest, is_result

FORMAT = "tendon-sweep-1"
MAX_BYTES = 1_000_000_000
"""Of a journal: a million jobs of some 500 bytes, twice."""
_DIFFERENT = {
    "format": "was written by another version of the toolkit",
    "scenario": "is of another scenario, or the scenario file has changed since",
    "arm": "is of another arm, or its model file or effects have changed since",
    "starts": "was made with another number of --starts",
    "over": "varies something else with --over",
}


class JournalError(ValueError):
    """A journal that this sweep cannot go on with."""


def beside(table: Path) -> Path:
    """Where the journal of a table stands."""
    return table.with_name(table.name + ".journal")


def heading(scenario: Scenario, code: Code, starts: int | None, axes: Sequence[str]) -> dict[str, Any]:
    """What makes two sweeps the same one. Values may be added to an axis later: finished jobs stay finished."""
    return {
        "format": FORMAT,
        "scenario": digest(asdict(scenario)),
        "arm": code.identity(),
        "starts": starts,
        "over": sorted(axes),
    }


@dataclass
class Journal:
    """results: by key of the job, of this call and of those before it."""

    path: Path
    file: BinaryIO
    results: dict[str, Result] = field(default_factory=dict)

    def finished(self, jobs: Sequence[Job]) -> int:
        """How many of them are here."""
        return sum(job.key in self.results for job in jobs)

    def add(self, job: Job, result: Result) -> None:
        """On disk when this returns."""
        self._write({"key": job.key, "at": {**job.columns, "seed": job.seed}, "result": result})
        self.results[job.key] = result

    def _write(self, item: Mapping[str, Any]) -> None:
        self.file.write(_line(item))
        self.file.flush()
        os.fsync(self.file.fileno())

    def _read(self, expected: Mapping[str, Any]) -> None:
        """What is there; a last line that was cut off in the middle goes."""
        self.file.seek(0)
        content = self.file.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise JournalError(f"{self.path}: is larger than {MAX_BYTES // 10**9} GB; choose another --table")
        whole = content[: content.rfind(b"\n") + 1]
        lines = whole.splitlines()
        if not lines and not _line(expected).startswith(content):
            raise self._damaged(1)
        if lines:
            self._check(self._parsed(lines[0], 1), expected)
        for number, line in enumerate(lines[1:], 2):
            item = self._parsed(line, number)
            if not isinstance(item.get("key"), str) or not is_result(item.get("result")):
                raise self._damaged(number)
            self.results.setdefault(item["key"], item["result"])
        self.file.truncate(len(whole))
        if not lines:
            self._write(expected)

    def _check(self, found: Mapping[str, Any], expected: Mapping[str, Any]) -> None:
        for name, why in _DIFFERENT.items():
            if found.get(name) != expected[name]:
                raise JournalError(f"{self.path}: {why}; choose another --table, or delete the journal to begin anew")

    def _parsed(self, line: bytes, number: int) -> dict[str, Any]:
        try:
            item = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise self._damaged(number) from error
        if not isinstance(item, dict):
            raise self._damaged(number)
        return item

    def _damaged(self, number: int) -> JournalError:
        remedy = "delete the journal to begin anew" if number == 1 else "delete the line to run that job again"
        return JournalError(f"{self.path} line {number}: not as a sweep writes it; {remedy}")


def _line(item: Mapping[str, Any]) -> bytes:
    return json.dumps(item).encode() + b"\n"


def _appending(path: Path) -> BinaryIO:
    try:
        return open(path, "a+b")
    except OSError as error:
        raise JournalError(f"{path}: cannot be opened: {error.strerror}") from error


@contextmanager
def opened(path: Path, expected: Mapping[str, Any]) -> Iterator[Journal]:
    """The journal at `path`, made if it is not there; expected: heading(). Raises JournalError."""
    # Opened to append, as that makes a file that is not there and empties none.
    with _appending(path) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise JournalError(f"{path}: is no file; choose another --table")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise JournalError(
                f"{path}: another sweep writes there now; wait for it, or choose another --table"
            ) from error
        journal = Journal(path, file)
        journal._read(expected)
        yield journal
