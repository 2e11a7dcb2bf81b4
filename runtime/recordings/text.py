"""Text with a line a sample: CSV, plain or gzip, also with decimal commas, between blanks, and without a header."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path

import numpy as np

from runtime.recordings import checks, lines
from runtime.recordings.contents import Array, Numbers, RecordedField, Samples
from runtime.recordings.errors import Refusal
from runtime.recordings.lines import TextBlock
from runtime.recordings.nameless import NUMBERED
from runtime.recordings.settings import HEAD, MOST_FIELDS
from runtime.recordings.units import UNITS, normal
from symbolic.model_file.checks import quote

_ABSENT = frozenset(("", "nan", "na", "n/a", "null", "none"))
_REMARK = re.compile(r"\s*[#%]+\s*")
_BLANK = " "


@dataclass(frozen=True)
class TextContents:
    """A text whose header and dress are known.

    names        cells of the header, or numbers where there is none
    first_line   of the samples
    """

    path: Path
    format: str
    header: str
    names: tuple[str, ...]
    first_line: int
    delimiter: str
    decimal_comma: bool
    refuse: Refusal

    @cached_property
    def fields(self) -> tuple[RecordedField, ...]:
        return tuple(RecordedField(name) for name in self.names)

    @property
    def times(self) -> Mapping[str, int]:
        return {}

    def load(self, wanted: Mapping[str, int]) -> Samples:
        tables, numbers, samples = [], [], 0
        for block in lines.blocks(self.path, self.refuse):
            body, line = self._after_header(block)
            if not body or body.isspace():
                continue
            table, places = self._numbers(body, line, wanted)
            tables.append(table)
            numbers.append(places)
            samples += len(table)
            checks.not_too_many(samples, self.refuse)
        table = np.concatenate(tables) if tables else np.empty((0, len(wanted)))
        signals = {name: np.ascontiguousarray(table[:, k]) for k, name in enumerate(wanted)}
        places = np.concatenate(numbers) if numbers else np.empty(0, np.int64)
        return Samples(signals, places, dict.fromkeys(wanted, "line"))

    def _after_header(self, block: TextBlock) -> tuple[str, int]:
        """The samples of a block, and the line of the first."""
        body, line = block.text, block.line
        for _ in range(line, min(self.first_line, line + body.count("\n") + 1)):
            body, line = body.partition("\n")[2], line + 1
        return body.rstrip("\n"), line

    def _numbers(self, body: str, line: int, wanted: Mapping[str, int]) -> tuple[Array, Numbers]:
        """The wanted columns (N, k) and the line of each row."""
        delimiter = self.delimiter
        if delimiter == _BLANK:
            body, delimiter = re.sub(r"[ \t]+", ";", re.sub(r"(?m)^[ \t]+|[ \t]+$", "", body)), ";"
        quick = body.replace(",", ".") if self.decimal_comma and "." not in body else body
        if (
            '"' not in quick
            and (delimiter == "," or "," not in quick)
            and _is_regular(quick, len(self.names), delimiter)
        ):
            try:
                cells = list(wanted.values())
                table = np.loadtxt(io.StringIO(quick), delimiter=delimiter, comments=None, usecols=cells, ndmin=2)
                return table, line + np.arange(len(table))
            except ValueError:
                pass  # the careful way below finds the cell
        return self._careful(body, line, delimiter, wanted)

    def _careful(self, body: str, first: int, delimiter: str, wanted: Mapping[str, int]) -> tuple[Array, Numbers]:
        """Cell by cell; says which one is none."""
        rows, numbers, width = [], [], len(self.names)
        like = "in the header" if self.header else "in the first line"
        for line, text in enumerate(body.split("\n"), first):
            if not text.strip():
                continue
            try:
                row = next(csv.reader([text], delimiter=delimiter))
            except csv.Error as error:
                self.refuse(f"is no CSV: {error}", f"line {line}")
            if len(row) != width:
                self.refuse(f"has {len(row)} cells; expected {width} as {like}", f"line {line}")
            rows.append([self._number(row[index], name, line) for name, index in wanted.items()])
            numbers.append(line)
        return np.array(rows, dtype=float).reshape(-1, len(wanted)), np.array(numbers, dtype=np.int64)

    def _number(self, cell: str, name: str, line: int) -> float:
        cell = cell.strip()
        if cell.lower() in _ABSENT:
            return math.nan
        try:
            return _float(cell.replace(",", ".") if self.decimal_comma and "." not in cell else cell)
        except ValueError:
            if name == "t" and (stamp := _stamp(cell)) is not None:
                return stamp
            hint = " with a decimal point" if "," in cell else ""
            self.refuse(f"{name} is {quote(cell)}; expected a number{hint}", f"line {line}")


def opened(path: Path, refuse: Refusal) -> TextContents:
    """The text at a path, whatever its ending. Raises RecordingError."""
    found = _beginning(path, refuse)
    if found is None:
        refuse("is empty; expected a header such as t [s],q1 [rad],tau1 [N m] and one line a sample")
    remark, ((header, line), *following) = found
    named = _REMARK.sub("", remark)
    if named and (not header or (_is_nameless(header) and _fits(named, header))):
        header, following, line = named, [(header, line)] if header else [], line - 1
    if not header.strip():
        refuse("is empty; expected a header such as t [s],q1 [rad],tau1 [N m] and one line a sample")
    return _contents(path, header, line, following, refuse)


def _beginning(path: Path, refuse: Refusal) -> tuple[str, list[tuple[str, int]]] | None:
    """The last remark before the first line that is none, and with their numbers that line and two more that are not
    blank; None where there are remarks alone, and no word in them."""
    remark, at, found = "", 1, list[tuple[str, int]]()
    for block in lines.blocks(path, refuse, HEAD):
        if block.text.isspace():
            continue
        for number, line in enumerate(block.text.removesuffix("\n").split("\n"), block.line):
            if not line.strip():
                continue
            if not found and _REMARK.match(line):
                remark, at = line.strip(), number
                continue
            found.append((line, number))
            if len(found) > 2:
                return remark, found
    if not found and not remark:
        return None
    return remark, found or [("", at + 1)]


def _contents(
    path: Path, header: str, line: int, following: Sequence[tuple[str, int]], refuse: Refusal
) -> TextContents:
    """What follows a header in `line`, or begins with it where it is a sample; following: lines after it, numbered."""
    nameless = _is_nameless(header)
    sample = header if nameless else following[0][0] if following else ""
    delimiter = _delimiter(header, sample)
    cells = _cells(header, delimiter)
    if len(cells) > MOST_FIELDS:
        refuse(f"has {len(cells)} columns; expected at most {MOST_FIELDS}", f"line {line}")
    below = line
    if not nameless and following and (units := _units(_cells(sample, delimiter), cells)):
        cells, (_, below), following = units, following[0], following[1:]
        sample = following[0][0] if following else ""
    if cells[-1].strip() == "" and len(_cells(sample, delimiter)) == len(cells) - 1:
        cells = cells[:-1]  # a delimiter behind the last name
    comma = delimiter != "," and any("," in cell and _is_number(cell) for cell in _cells(sample, delimiter))
    kind = "text" if delimiter == _BLANK else "CSV"
    if nameless:
        names = tuple(NUMBERED.format(k) for k in range(1, len(cells) + 1))
        return TextContents(path, kind, "", names, line, delimiter, comma, refuse)
    if not following:
        refuse("has a header but no samples")
    return TextContents(path, kind, f"line {line}", tuple(cells), below + 1, delimiter, comma, refuse)


def _is_nameless(line: str) -> bool:
    """Whether a line is a sample: numbers alone."""
    return all(_is_number(cell) for cell in re.split(r"[;\t ]+|,", line.strip()))


def _delimiter(header: str, first: str) -> str:
    """What stands between the cells of a header and of the first sample."""
    if _is_nameless(header):
        return next(
            (mark for mark in ";\t," if mark in header and not (mark == "," and _between_blanks(header))), _BLANK
        )
    mark = max(",;\t", key=header.count)
    if mark in header:
        return mark
    other = any(mark in first for mark in ",;\t") and len(first.split()) < 2
    return "," if other or len(header.split()) < 2 else _BLANK


def _between_blanks(line: str) -> bool:
    """Whether the commas of a sample are decimal ones: blanks stand where none does."""
    return bool(re.search(r"[^,\s]\s+[^,\s]", line))


def _units(second: list[str], header: list[str]) -> list[str] | None:
    """The cells of a header with the units that stand in the line below it; None where no units stand there."""
    units = [normal(cell.strip().strip("[]()")) for cell in second]
    if len(units) != len(header) or not any(units) or any(unit not in UNITS for unit in units if unit.strip("-")):
        return None
    return [f"{cell} [{unit}]" if unit.strip("-") else cell for cell, unit in zip(header, units, strict=True)]


def _stamp(cell: str) -> float | None:
    """s since 1970 of a date and time, of UTC where it names no zone; None of anything else."""
    try:
        stamp = datetime.fromisoformat(cell)
    except ValueError:
        return None
    return (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()


def _fits(header: str, first: str) -> bool:
    """Whether a header has as many cells as a sample."""
    return len(_cells(header, _delimiter(header, first))) == len(_cells(first, _delimiter(first, first)))


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == _BLANK:
        return re.findall(r"(?:[^\s\[\]]+(?:\s*\[[^\]]*\])?|\[[^\]]*\])", line)
    try:
        return next(csv.reader([line], delimiter=delimiter))
    except csv.Error:
        return line.split(delimiter)


def _is_number(cell: str) -> bool:
    try:
        _float(cell.strip().replace(",", "."))
    except ValueError:
        return False
    return True


def _float(cell: str) -> float:
    if "_" in cell or not cell.isascii():
        raise ValueError
    return float(cell)


def _is_regular(body: str, width: int, delimiter: str) -> bool:
    """Whether every line has `width` cells; np.loadtxt looks at the used columns only."""
    text = np.frombuffer(body.encode("utf-8"), np.uint8)
    ends = np.append(np.flatnonzero(text == ord("\n")), len(text))
    marks = np.flatnonzero(text == ord(delimiter))
    return bool(np.all(np.diff(np.searchsorted(marks, ends), prepend=0) == width - 1))
