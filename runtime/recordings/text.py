"""Text with a line a sample: CSV, plain or gzip, also with decimal commas, between blanks, and without a header."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import math
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.recordings.contents import Array, RecordedField, Samples
from runtime.recordings.errors import RecordingError, Refusal
from runtime.recordings.nameless import NUMBERED
from runtime.recordings.settings import MAX_BYTES
from runtime.recordings.units import UNITS, normal
from symbolic.model_file.checks import quote

GZIP = b"\x1f\x8b"
_ABSENT = frozenset(("", "nan", "na", "n/a", "null", "none"))
_REMARK = re.compile(r"\s*[#%]+\s*")
_BLANK = " "
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@dataclass(frozen=True)
class TextContents:
    """A text whose header and dress are known.

    names      cells of the header, or numbers where there is none
    body       what follows, its lines from `first_line` on
    """

    format: str
    header: str
    names: tuple[str, ...]
    body: str
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
        table, lines = self._numbers(wanted)
        signals = {name: table[:, k] for k, name in enumerate(wanted)}
        return Samples(signals, lines, dict.fromkeys(wanted, "line"))

    def _numbers(self, wanted: Mapping[str, int]) -> tuple[Array, NDArray[np.int64]]:
        """The wanted columns (N, k) and the line of each row."""
        body, delimiter = self.body, self.delimiter
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
                return table, self.first_line + np.arange(len(table))
            except ValueError:
                pass  # the careful way below finds the cell
        return self._careful(body, delimiter, wanted)

    def _careful(self, body: str, delimiter: str, wanted: Mapping[str, int]) -> tuple[Array, NDArray[np.int64]]:
        """Cell by cell; says which one is none."""
        rows, lines, width = [], [], len(self.names)
        like = "in the header" if self.header else "in the first line"
        for line, text in enumerate(body.split("\n"), self.first_line):
            if not text.strip():
                continue
            try:
                row = next(csv.reader([text], delimiter=delimiter))
            except csv.Error as error:
                self.refuse(f"is no CSV: {error}", f"line {line}")
            if len(row) != width:
                self.refuse(f"has {len(row)} cells; expected {width} as {like}", f"line {line}")
            rows.append([self._number(row[index], name, line) for name, index in wanted.items()])
            lines.append(line)
        return np.array(rows, dtype=float).reshape(-1, len(wanted)), np.array(lines)

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
    text = _decoded(_bytes(path, refuse), refuse)
    at, line, remark = 0, 1, ""
    while at < len(text):
        first = text[at : _end(text, at)]
        if first.strip() and not _REMARK.match(first):
            break
        remark = first.strip() or remark
        at, line = at + len(first) + 1, line + 1
    end = _end(text, at)
    header, body = text[at:end], text[end + 1 :]
    named = _REMARK.sub("", remark)
    if named and (not header or (_is_nameless(header) and _fits(named, header))):
        header, body, line = named, text[at:], line - 1
    if not header.strip():
        refuse("is empty; expected a header such as t [s],q1 [rad],tau1 [N m] and one line a sample")
    return _contents(header, body, line, refuse)


def _end(text: str, at: int) -> int:
    end = text.find("\n", at)
    return len(text) if end < 0 else end


def _contents(header: str, body: str, line: int, refuse: Refusal) -> TextContents:
    """What follows a header in `line`, or begins with it where it is a sample."""
    nameless = _is_nameless(header)
    first = header if nameless else body.lstrip("\n").partition("\n")[0]
    delimiter = _delimiter(header, first)
    cells = _cells(header, delimiter)
    if not nameless and (units := _units(_cells(first, delimiter), cells)):
        after = body.lstrip("\n")
        cells, line, body = units, line + len(body) - len(after) + 1, after.partition("\n")[2]
        first = body.lstrip("\n").partition("\n")[0]
    if cells[-1].strip() == "" and len(_cells(first, delimiter)) == len(cells) - 1:
        cells = cells[:-1]  # a delimiter behind the last name
    comma = delimiter != "," and any("," in cell and _is_number(cell) for cell in _cells(first, delimiter))
    kind = "text" if delimiter == _BLANK else "CSV"
    if nameless:
        names = tuple(NUMBERED.format(k) for k in range(1, len(cells) + 1))
        return TextContents(kind, "", names, f"{header}\n{body}".rstrip("\n"), line, delimiter, comma, refuse)
    if not body.strip():
        refuse("has a header but no samples")
    return TextContents(kind, f"line {line}", tuple(cells), body.rstrip("\n"), line + 1, delimiter, comma, refuse)


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


def _bytes(path: Path, refuse: Refusal) -> bytes:
    """The file's bytes, decompressed."""
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_BYTES + 1)
        if data[:2] == GZIP:
            with gzip.open(io.BytesIO(data)) as unpacked:
                data = unpacked.read(MAX_BYTES + 1) if _is_text(unpacked, refuse) else b""
    except RecordingError:
        raise
    except EOFError:
        refuse("the gzip file is cut off; copy it again")
    except (zlib.error, gzip.BadGzipFile) as error:
        refuse(f"the gzip file is damaged ({error}); copy it again")
    except (OSError, ValueError) as error:
        refuse(f"cannot be read: {getattr(error, 'strerror', None) or error}")
    if len(data) > MAX_BYTES:
        refuse(f"is larger than {MAX_BYTES // 10**9} GB; split it into several recordings")
    return data


def _is_text(unpacked: gzip.GzipFile, refuse: Refusal) -> bool:
    """Refuses what unpacks to something else than text before it is unpacked whole, however large it may become."""
    head = unpacked.read(1 << 16)
    unpacked.seek(0)
    if b"\0" in head:
        refuse("the gzip file holds no text; expected a recording in CSV, or another format without gzip")
    return True


def _decoded(data: bytes, refuse: Refusal) -> str:
    try:
        text = data.decode("utf-16" if data.startswith(_UTF_16) else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        refuse(f"byte 0x{data[error.start]:02x} is not UTF-8; save the recording as UTF-8", f"line {line}")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def _is_regular(body: str, width: int, delimiter: str) -> bool:
    """Whether every line has `width` cells; np.loadtxt looks at the used columns only."""
    text = np.frombuffer(body.encode("utf-8"), np.uint8)
    ends = np.append(np.flatnonzero(text == ord("\n")), len(text))
    marks = np.flatnonzero(text == ord(delimiter))
    return bool(np.all(np.diff(np.searchsorted(marks, ends), prepend=0) == width - 1))
