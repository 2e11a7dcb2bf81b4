"""The table of a sweep read again: its rows, and of each variation the best plan."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

from runtime.sweep import grid
from runtime.sweep.job import Value
from runtime.sweep.table import FIXED, TableError, check
from symbolic.model_file.checks import quote


@dataclass(frozen=True)
class SweepRow:
    """A job. at: what varies, None where the case leaves out what it is about.

    feasible   None: it did not come to an end      cost   of a plan, None without one      message   why there is none
    figures    everything else that was found, by column
    """

    at: Mapping[str, Value | None]
    seed: int
    feasible: bool | None
    cost: float | None
    message: str
    figures: Mapping[str, float]


@dataclass(frozen=True)
class SweepVariation:
    """All jobs that differ in their seed alone. best: the cheapest plan, else the first job; costs: of the plans."""

    best: SweepRow
    jobs: int
    costs: tuple[float, ...]


def read(path: Path, most: int) -> list[SweepRow]:
    """The rows of a table as `tendon sweep` writes it, at most so many of them. Raises TableError, OSError."""
    check(path)
    names, lines = (_parquet if path.suffix == ".parquet" else _csv)(path, most)
    axes = _axes(path, names)
    if not lines:
        raise TableError(f"{path}: has no rows; expected one a job, as tendon sweep writes them")
    return [_row(f"{path} row {k}", dict(zip(names, line, strict=True)), axes) for k, line in enumerate(lines, 1)]


def variations(rows: Sequence[SweepRow]) -> list[SweepVariation]:
    """In the order of the table."""
    groups: dict[tuple[Any, ...], list[SweepRow]] = {}
    for row in rows:
        groups.setdefault(tuple(row.at.items()), []).append(row)
    found = []
    for group in groups.values():
        planned = sorted((row.cost, k) for k, row in enumerate(group) if row.cost is not None)
        best = group[planned[0][1]] if planned else group[0]
        found.append(SweepVariation(best, len(group), tuple(cost for cost, _ in planned)))
    return found


def _axes(path: Path, names: Sequence[str]) -> list[str]:
    """What varies: the columns before the seed."""
    wrong = len(set(names)) < len(names) or any(name not in names for name in FIXED)
    axes = [] if wrong else list(names[: names.index("seed")])
    if wrong or any(name in FIXED or not grid.is_axis(name) for name in axes):
        raise TableError(f"{path}: is no table of a sweep; expected columns as tendon sweep --table writes them")
    return axes


def _csv(path: Path, most: int) -> tuple[list[str], list[list[Any]]]:
    try:
        reader = csv.reader(io.StringIO(path.read_text(encoding="utf-8")), strict=True)
        names, lines = next(reader, []), []
        for line in reader:
            lines.append([cell if cell else None for cell in line])
            if len(line) != len(names):
                raise TableError(f"{path} row {len(lines)}: {len(line)} cells; expected {len(names)}, one a column")
            if len(lines) > most:
                raise _too_many(path, most)
    except (csv.Error, UnicodeDecodeError) as error:
        raise TableError(f"{path}: is no CSV: {error}; expected the table of a sweep") from error
    return names, lines


def _parquet(path: Path, most: int) -> tuple[list[str], list[list[Any]]]:
    import pyarrow as pa
    from pyarrow import parquet

    try:
        file = parquet.ParquetFile(path)
        if file.metadata.num_rows > most:
            raise _too_many(path, most)
        names = list(file.schema_arrow.names)
        _axes(path, names)
        columns = [file.read([name]).column(0).to_pylist() for name in names]
    except pa.ArrowException as error:
        raise TableError(
            f"{path}: is no Parquet: {str(error).splitlines()[0]}; expected the table of a sweep"
        ) from error
    return names, [list(line) for line in zip(*columns, strict=True)]


def _too_many(path: Path, most: int) -> TableError:
    return TableError(f"{path}: has more than {most} rows; expected fewer: sweep in several tables")


def _row(where: str, cells: Mapping[str, Any], axes: Sequence[str]) -> SweepRow:
    feasible = {"True": True, "False": False, True: True, False: False, None: None}.get(cells["feasible"], "")
    if feasible == "":
        raise TableError(f"{where}: feasible is {quote(str(cells['feasible']))}; expected True, False or nothing")
    cost = _number(where, "cost", cells["cost"])
    if (cost is None) is (feasible is True):
        raise TableError(f"{where}: cost and feasible contradict each other; expected a cost where there is a plan")
    seed = _number(where, "seed", cells["seed"])
    if seed is None or seed < 0 or seed != int(seed):
        raise TableError(f"{where}: seed: expected a whole number from 0 on")
    at: dict[str, Value | None] = {
        name: (None if cells[name] is None else _case(where, cells[name]))
        if name == "case"
        else _number(where, name, cells[name])
        for name in axes
    }
    others = {name: _number(where, name, cells[name]) for name in cells if name not in (*axes, *FIXED)}
    figures = {name: value for name, value in others.items() if value is not None}
    return SweepRow(at, int(seed), feasible, cost, str(cells["message"] or ""), figures)  # type: ignore[arg-type]


def _case(where: str, cell: object) -> str:
    if cell not in grid.CASES:
        raise TableError(f"{where}: there is no case {quote(str(cell))}; expected one of {', '.join(grid.CASES)}")
    return str(cell)


def _number(where: str, name: str, cell: Any) -> float | None:
    if cell is None:
        return None
    try:
        value = float(cell)
    except (TypeError, ValueError):
        value = float("nan")
    if not isfinite(value):
        raise TableError(f"{where}: {quote(name)} is {quote(str(cell))}; expected a finite number")
    return value
