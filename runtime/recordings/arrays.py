"""Files of arrays: variables of one or two dimensions, a column for each joint; HDF5, MATLAB, NumPy and Parquet."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.recordings.contents import Array, RecordedField, Samples
from runtime.recordings.errors import Refusal
from runtime.recordings.settings import LARGEST_MATRIX, LEAST_SIGNAL, MAX_BYTES, MOST_FIELDS

_TIMES = re.compile(r"(t|time|timestamp|stamp)s?(\d?|_.*)", re.IGNORECASE)
"""The last part of the name of a variable that holds instants."""
_WHOLE_IN_FLOAT = 2**53


@dataclass(frozen=True)
class Variable:
    """An array in a file, before it is read.

    name    with the names of what it lies in before it, "." or "/" between
    shape   as the file states it
    load    reads it whole
    """

    name: str
    shape: tuple[int, ...]
    load: Callable[[], NDArray[Any]]

    @property
    def along(self) -> int:
        """The axis of the samples: the longer one."""
        return int(np.argmax(self.shape))

    @property
    def samples(self) -> int:
        return max(self.shape)

    @property
    def width(self) -> int:
        """Its columns."""
        return min(self.shape) if len(self.shape) == 2 else 1

    @property
    def is_signal(self) -> bool:
        """Whether it can hold samples of some joints."""
        return len(self.shape) in (1, 2) and self.samples >= LEAST_SIGNAL and 0 < self.width <= LARGEST_MATRIX

    @property
    def place(self) -> str:
        """What stands before the number of a sample."""
        return f"{self.name} {'column' if self.along else 'row' if len(self.shape) == 2 else 'sample'}"

    @property
    def home(self) -> str:
        """What it lies in."""
        return re.match(r"(.*?)[^./]*$", self.name, re.DOTALL)[1].rstrip("./")  # type: ignore[index]


@dataclass(frozen=True)
class ArrayContents:
    """Variables whose columns are fields: q (N, 6) is q1 to q6, and what is called time is the clock beside it."""

    format: str
    variables: Sequence[Variable]
    refuse: Refusal

    @property
    def header(self) -> str:
        return ""

    @cached_property
    def _columns(self) -> list[tuple[Variable, int, str]]:
        """Variable, column and name of every field."""
        found = []
        for variable in self.variables:
            if variable.is_signal:
                between = "_" if variable.name[-1:].isdigit() else ""
                many = range(1, variable.width + 1) if variable.width > 1 else ()
                names = [f"{variable.name}{between}{k}" for k in many] or [variable.name]
                found += [(variable, k, name) for k, name in enumerate(names)]
        if len(found) > MOST_FIELDS:
            self.refuse(f"has {len(found)} columns; expected at most {MOST_FIELDS}")
        if not found:
            named = ", ".join(f"{v.name} {v.shape}" for v in self.variables[:8])
            self.refuse(f"holds no variables with samples of one or two dimensions; it has {named or 'none'}")
        return found

    @cached_property
    def _timed(self) -> dict[tuple[str, int], Variable]:
        """By what variables lie in and their number of samples, the one with the instants."""
        found: dict[tuple[str, int], Variable] = {}
        for variable in self.variables:
            last = variable.name[len(variable.home) :].lstrip("./")
            if variable.is_signal and variable.width == 1 and _TIMES.fullmatch(last):
                found.setdefault((variable.home, variable.samples), variable)
        return found

    def _clock(self, variable: Variable) -> str:
        """The nearest time around a variable that has as many samples, else its number of samples."""
        home = variable.home
        while True:
            if time := self._timed.get((home, variable.samples)):
                return time.name
            if not home:
                return f"{variable.samples} samples"
            home = re.sub(r"[./]?[^./]*$", "", home)

    @cached_property
    def fields(self) -> tuple[RecordedField, ...]:
        return tuple(RecordedField(name, self._clock(v), v.place) for v, _, name in self._columns)

    @cached_property
    def times(self) -> Mapping[str, int]:
        places = {name: index for index, (_, _, name) in enumerate(self._columns)}
        return {time.name: places[time.name] for time in self._timed.values()}

    def load(self, wanted: Mapping[str, int]) -> Samples:
        read: dict[str, Array] = {}
        signals: dict[str, Array] = {}
        for name, index in wanted.items():
            variable, column, _ = self._columns[index]
            if variable.name not in read:
                read[variable.name] = self._read(variable, sum(x.nbytes for x in read.values()))
            signals[name] = np.ascontiguousarray(read[variable.name][column])
        length = max(len(x) for x in signals.values())
        places = {name: self.fields[index].place for name, index in wanted.items()}
        return Samples(signals, np.arange(1, length + 1), places)

    def _read(self, variable: Variable, beside: int) -> Array:
        """(columns, N) of a variable; whole numbers too long for a float less the first."""
        size = 8 * int(np.prod([float(n) for n in variable.shape])) + beside
        if size > MAX_BYTES:
            self.refuse(f"{variable.name} has {variable.shape} numbers; expected at most {MAX_BYTES // 10**9} GB")
        values = variable.load()
        if values.shape != variable.shape:
            self.refuse(f"{variable.name} has {values.shape} numbers where the file states {variable.shape}")
        if values.dtype.kind in "mM":
            values = values.astype("datetime64[ns]" if values.dtype.kind == "M" else "timedelta64[ns]")
            return (values.reshape(1, -1) - values.flat[0]).astype(np.int64) * 1e-9
        if values.dtype.kind in "iu" and np.abs(values.astype(np.float64)).max() > _WHOLE_IN_FLOAT:
            values = values - values.flat[0]
        rows = values.reshape(variable.samples, -1).T if variable.along == 0 else values.reshape(-1, variable.samples)
        return np.asarray(rows, dtype=np.float64)


def is_numeric(dtype: np.dtype[Any]) -> bool:
    """Whether an array's entries can be readings."""
    return dtype.kind in "biuf" or dtype.kind in "mM"
