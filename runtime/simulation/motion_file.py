"""Motions as text: a CSV of times and positions of all joints, with comments at its top."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from runtime.arrays import Array
from runtime.recordings.contents import RecordingError, Refusal
from runtime.recordings.settings import MOST_SAMPLES
from runtime.recordings.text import blocks, check_file
from runtime.simulation.settings import LEAST_DIGIT, LONGEST, PATH_DEGREE, RATE
from runtime.simulation.simulate import SimulationError


@dataclass(frozen=True)
class MotionFile:
    """A motion as its file has it.

    comments   lines at its top that begin with #, without it
    first      line of the first sample, from 1
    t          (N,) s, increasing      q   (n, N) rad or m
    """

    path: Path
    comments: tuple[str, ...]
    first: int
    t: Array
    q: Array

    @property
    def seconds(self) -> float:
        """From the first sample to the last."""
        return float(self.t[-1] - self.t[0])

    @cached_property
    def spline(self) -> BSpline:
        """Through all samples: (n,) positions over the time since the first one."""
        return make_interp_spline(self.t - self.t[0], self.q.T, k=PATH_DEGREE)


def without_dust(values: Array) -> Array:
    """(n, N), and 0 where a number is rounding beside the largest of its row: a motion's files have ten digits."""
    largest = np.abs(values).max(axis=1, initial=0.0, keepdims=True)
    return np.where(np.abs(values) <= LEAST_DIGIT * largest, 0.0, values)


def is_motion(path: Path) -> bool:
    """Whether a file looks like a motion: its first line begins with t, or is a comment."""
    try:
        line = next(_lines(path, "a motion"), "")
    except SimulationError:
        return False
    return line.startswith("#") or _names(line)[:1] == ["t"]


def read_motion_file(path: Path, n: int) -> MotionFile:
    """A motion of n joints from a CSV with the header t,q1,... in s and rad or m; gzip, too.

    Raises SimulationError with the file and the line.
    """
    names = ["t", *(f"q{i}" for i in range(1, n + 1))]
    lines, comments, first, title = _lines(path, f"a motion: a CSV of {','.join(names)}"), [], 1, ""
    for first, title in enumerate(lines, 1):  # noqa: B007 (the header and its line)
        if not title.startswith("#"):
            break
        comments.append(title[1:].strip())
    header = _names(title)
    missing = [name for name in names if name not in header]
    if missing:
        raise SimulationError(
            f"{path} line {first}: no column {missing[0]}; expected {','.join(names)} in s and rad or m"
        )
    rows: list[list[float]] = []
    for number, cells in enumerate(csv.reader(lines), first + 1):
        try:
            rows.append([float(cells[header.index(name)]) for name in names])
        except (ValueError, IndexError) as error:
            raise SimulationError(f"{path} line {number}: expected {len(header)} numbers, one a column") from error
        if not np.isfinite(rows[-1]).all() or (len(rows) > 1 and rows[-1][0] <= rows[-2][0]):
            raise SimulationError(f"{path} line {number}: expected finite numbers and a time that increases")
        if len(rows) > MOST_SAMPLES:
            raise SimulationError(f"{path}: has more than {MOST_SAMPLES} samples; reduce its rate")
    if len(rows) <= PATH_DEGREE:
        raise SimulationError(f"{path}: only {len(rows)} samples; a motion needs at least {PATH_DEGREE + 1}")
    table = np.array(rows)
    found = MotionFile(path, tuple(comments), first + 1, table[:, 0], np.ascontiguousarray(table[:, 1:].T))
    if found.seconds > LONGEST:
        raise SimulationError(
            f"{path}: lasts {found.seconds:.4g} s; expected at most {LONGEST:g} s; is its time in seconds?"
        )
    return found


def read_motion(path: Path, n: int) -> Array:
    """Positions (n, N) at 1 kHz of a motion's file, smooth as a planned motion. Raises SimulationError."""
    found = read_motion_file(path, n)
    return np.ascontiguousarray(found.spline(np.arange(0.0, found.seconds, 1 / RATE)).T)


def _names(line: str) -> list[str]:
    return [cell.partition("[")[0].strip() for cell in next(csv.reader([line]), [])]


def _lines(path: Path, expected: str) -> Iterator[str]:
    """The lines of a text, read block by block. Raises SimulationError."""
    refuse = Refusal(str(path))
    try:
        check_file(path, expected, refuse)
        for text, _ in blocks(path, refuse):
            yield from text.splitlines()
    except RecordingError as error:
        raise SimulationError(str(error)) from error
