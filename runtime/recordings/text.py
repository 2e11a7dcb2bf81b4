"""Recordings as text, plain or gzip: CSV and other delimiters, read in blocks so that memory holds only one."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import math
import re
import stat
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import IO

import numpy as np

from runtime.recordings.columns import NUMBERED, UNITS, normal_unit
from runtime.recordings.contents import Array, Numbers, RecordedField, RecordingError, Refusal, Samples, check_count
from runtime.recordings.settings import BLOCK, HEAD, LONGEST_LINE, MAX_BYTES, MOST_FIELDS
from symbolic.model_file.checks import quote

GZIP = b"\x1f\x8b"
_BOM = codecs.BOM_UTF8
_WIDE = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def check_file(path: Path, expected: str, refuse: Refusal) -> None:
    """Refuses what is not a regular file: a pipe can be read only once. Raises RecordingError."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        refuse(f"no such file; expected {expected}")
    except (OSError, ValueError) as error:
        refuse(f"cannot be read: {getattr(error, 'strerror', None) or error}")
    if stat.S_ISDIR(mode):
        refuse(f"is a directory; expected {expected}")
    if not stat.S_ISREG(mode):
        refuse("is a pipe or a device, which can be read only once; save it to a file first")


def blocks(path: Path, refuse: Refusal, size: int = BLOCK) -> Iterator[tuple[str, int]]:
    """Whole lines in blocks of about `size` bytes, and the number of the first, from 1. Raises RecordingError.

    Every line ends with "\\n".
    """
    with _bytes_of(path, refuse) as file:
        left, line, total = b"", 1, 0
        while data := file.read(size):
            if not total:
                if isinstance(file, gzip.GzipFile) and b"\0" in data[:HEAD]:
                    # Before it is decompressed whole.
                    expected = "expected a recording in CSV; decompress recordings in other formats"
                    refuse(f"the gzip file contains no text; {expected}")
                data = data.removeprefix(_BOM)
            total += len(data)
            if total > MAX_BYTES:
                refuse(f"is larger than {MAX_BYTES // 10**9} GB; split it into several recordings")
            data = left + data
            if b"\r" in data:
                if data.endswith(b"\r"):  # "\n" may follow
                    data += file.read(1)
                data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
            end = data.rfind(b"\n") + 1
            left = data[end:]
            if len(left) > LONGEST_LINE:
                line += data.count(b"\n")
                what = "expected a sample or the names of columns"
                refuse(f"is longer than {LONGEST_LINE} bytes; {what}", f"line {line}")
            if end:
                yield _decoded(data[:end], line, refuse), line
                line += data.count(b"\n", 0, end)
        if left:
            yield _decoded(left, line, refuse), line


@contextmanager
def _bytes_of(path: Path, refuse: Refusal) -> Iterator[IO[bytes]]:
    """The file's bytes in UTF-8, decompressed as they are read."""
    try:
        with open(path, "rb") as file:
            packed = file.read(len(GZIP)) == GZIP
            file.seek(0)
            if not packed:
                yield _in_utf_8(file)
                return
            with gzip.open(file) as unpacked:
                yield _in_utf_8(unpacked)  # type: ignore[arg-type]
    except RecordingError:
        raise
    except EOFError:
        refuse("the gzip file is cut off; copy it again")
    except (zlib.error, gzip.BadGzipFile) as error:
        refuse(f"the gzip file is damaged ({error}); copy it again")
    except (OSError, ValueError) as error:
        refuse(f"cannot be read: {getattr(error, 'strerror', None) or error}")


def _in_utf_8(file: IO[bytes]) -> IO[bytes]:
    wide = file.read(len(_WIDE[0])) in _WIDE
    file.seek(0)
    return codecs.EncodedFile(file, "utf-8", "utf-16") if wide else file


def _decoded(data: bytes, line: int, refuse: Refusal) -> str:
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line += data.count(b"\n", 0, error.start)
        refuse(f"byte 0x{data[error.start]:02x} is not UTF-8; save the file in UTF-8", f"line {line}")


_ABSENT = frozenset(("", "nan", "na", "n/a", "null", "none"))
_REMARK = re.compile(r"\s*[#%]+\s*")
_TORQUE = re.compile(r"""\s*[#%]+\s*torque\s*[=:]\s*["']?([^"'#]*?)["']?\s*""")
_BLANK = " "


@dataclass(frozen=True)
class TextContents:
    """A text with its header and layout.

    names        cells of the header, or "#1", "#2", … without a header
    first_line   number of the first line with a sample
    """

    path: Path
    format: str
    header: str
    names: tuple[str, ...]
    first_line: int
    delimiter: str
    decimal_comma: bool
    refuse: Refusal
    times: Mapping[str, int] = field(default_factory=dict)
    torque: str = ""
    notes: Sequence[str] = ()

    @cached_property
    def fields(self) -> tuple[RecordedField, ...]:
        return tuple(RecordedField(name) for name in self.names)

    def load(self, wanted: Mapping[str, int]) -> Samples:
        tables, numbers, samples = [], [], 0
        for body, line in blocks(self.path, self.refuse):
            for _ in range(line, min(self.first_line, line + body.count("\n") + 1)):
                body, line = body.partition("\n")[2], line + 1
            body = body.rstrip("\n")
            if not body or body.isspace():
                continue
            table, places = self._numbers(body, line, wanted)
            tables.append(table)
            numbers.append(places)
            samples += len(table)
            check_count(samples, self.refuse)
        table = np.concatenate(tables) if tables else np.empty((0, len(wanted)))
        signals = {name: np.ascontiguousarray(table[:, k]) for k, name in enumerate(wanted)}
        places = np.concatenate(numbers) if numbers else np.empty(0, np.int64)
        return Samples(signals, places, dict.fromkeys(wanted, "line"))

    def _numbers(self, body: str, line: int, wanted: Mapping[str, int]) -> tuple[Array, Numbers]:
        """The wanted columns (N, k) and the line of each row; fast where the text is regular."""
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
                pass  # _careful names the cell
        return self._careful(body, line, delimiter, wanted)

    def _careful(self, body: str, first: int, delimiter: str, wanted: Mapping[str, int]) -> tuple[Array, Numbers]:
        """The same, cell by cell; refuses the first cell that is not a number."""
        rows, numbers, width = [], [], len(self.names)
        like = "in the header" if self.header else "in the first line"
        for line, text in enumerate(body.split("\n"), first):
            if not text.strip():
                continue
            try:
                row = next(csv.reader([text], delimiter=delimiter))
            except csv.Error as error:
                self.refuse(f"is not CSV: {error}", f"line {line}")
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


def open_text(path: Path, refuse: Refusal) -> TextContents:
    """The text at a path; its layout is found from its first lines. Raises RecordingError."""
    found = _beginning(path, refuse)
    if found is None:
        refuse("is empty; expected a header such as t [s],q1 [rad],tau1 [N m] and one line a sample")
    remark, ((header, line), *following) = found
    named = _REMARK.sub("", remark)
    as_many = len(_cells(named, _delimiter(named, header))) == len(_cells(header, _delimiter(header, header)))
    if named and (not header or (_is_nameless(header) and as_many)):
        header, following, line = named, [(header, line)] if header else [], line - 1
    if not header.strip():
        refuse("is empty; expected a header such as t [s],q1 [rad],tau1 [N m] and one line a sample")
    return _contents(path, header, line, following=following, refuse=refuse)


def _beginning(path: Path, refuse: Refusal) -> tuple[str, list[tuple[str, int]]] | None:
    """The last comment before the data, and the first three lines after it that are not blank, with their numbers.

    None if the file is empty. A comment may hold the header.
    """
    remark, at, found = "", 1, list[tuple[str, int]]()
    for text, first in blocks(path, refuse, HEAD):
        if text.isspace():
            continue
        for number, line in enumerate(text.removesuffix("\n").split("\n"), first):
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
    """The layout of a text, from its header (or first sample) in `line` and the numbered lines after it."""
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
        cells = cells[:-1]  # the header ends with a delimiter
    comma = delimiter != "," and any("," in cell and _is_number(cell) for cell in _cells(sample, delimiter))
    kind = "text" if delimiter == _BLANK else "CSV"
    if nameless:
        cells = [NUMBERED.format(k) for k in range(1, len(cells) + 1)]
    elif not following:
        refuse("has a header but no samples")
    return TextContents(
        path,
        kind,
        "" if nameless else f"line {line}",
        names=tuple(cells),
        first_line=line if nameless else below + 1,
        delimiter=delimiter,
        decimal_comma=comma,
        refuse=refuse,
        torque=_stated_torque(path, refuse),
    )


def _stated_torque(path: Path, refuse: Refusal) -> str:
    """What a comment above the header says that torques are: `# torque = "link"`."""
    for body, _ in blocks(path, refuse, HEAD):
        for line in body.split("\n"):
            if line.strip() and not _REMARK.match(line):
                return ""
            if stated := _TORQUE.fullmatch(line):
                return stated[1]
    return ""


def _is_nameless(line: str) -> bool:
    return all(_is_number(cell) for cell in re.split(r"[;\t ]+|,", line.strip()))


def _delimiter(header: str, first: str) -> str:
    """The delimiter between cells, from the header and the first sample."""
    if _is_nameless(header):
        # Commas are decimal commas where blanks separate the numbers.
        decimal = re.search(r"[^,\s]\s+[^,\s]", header)
        return next((mark for mark in (";\t" if decimal else ";\t,") if mark in header), _BLANK)
    mark = max(",;\t", key=header.count)
    if mark in header:
        return mark
    other = any(mark in first for mark in ",;\t") and len(first.split()) < 2
    return "," if other or len(header.split()) < 2 else _BLANK


def _units(second: list[str], header: list[str]) -> list[str] | None:
    """The cells of a header with the units of the line below it; None if that line has no units."""
    units = [normal_unit(cell.strip().strip("[]()")) for cell in second]
    if len(units) != len(header) or not any(units) or any(unit not in UNITS for unit in units if unit.strip("-")):
        return None
    return [f"{cell} [{unit}]" if unit.strip("-") else cell for cell, unit in zip(header, units, strict=True)]


def _stamp(cell: str) -> float | None:
    """A date and time in s since 1970, UTC unless it states a zone; None for other text."""
    try:
        stamp = datetime.fromisoformat(cell)
    except ValueError:
        return None
    return (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()


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
    """Whether every line has `width` cells; np.loadtxt checks only the columns it reads."""
    text = np.frombuffer(body.encode("utf-8"), np.uint8)
    ends = np.append(np.flatnonzero(text == ord("\n")), len(text))
    marks = np.flatnonzero(text == ord(delimiter))
    return bool(np.all(np.diff(np.searchsorted(marks, ends), prepend=0) == width - 1))
