"""Recordings from arrays and data frames, read like a file: the same names, units and checks.

A data frame is known by its attribute `columns`, so that neither pandas nor polars is needed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.recordings.columns import IN_SPACE, numbered_signal
from runtime.recordings.contents import Array, RecordedField, Refusal, Samples
from runtime.recordings.recording import Recording, header_cell, measured
from symbolic.model_file.drive_laws import COMMANDS

_SINGLE = ("t", "run")
"""Signals of the whole arm; all others but the force have a column for each joint."""
_INDEX_OF_TIME = "mMf"
"""Kinds of an index that may be the time: durations, dates and floats."""


@dataclass(frozen=True)
class RefusedArrays(Refusal):
    """Refuses arrays, and proposes keyword arguments where a file's refusal proposes options."""

    def __call__(self, message: str, place: str = "") -> NoReturn:
        message = message.replace("pass --allow-gaps", "pass allow_gaps=True")
        message = re.sub(r'--map (\S+?)=("[^"]*"|\S+)', r'columns={"\1": \2}', message)
        super().__call__(re.sub(r"--map (\S+?):", r'columns["\1"]:', message), place)


@dataclass(frozen=True)
class ArraysInMemory:
    """Columns of a data frame or of arrays as the contents of a recording; see Contents.

    values   (N,) of each field     row   what messages call a sample
    """

    format: str
    fields: Sequence[RecordedField]
    values: Sequence[NDArray[Any]]
    row: str
    refuse: Refusal
    header: str = ""
    torque: str = ""
    notes: Sequence[str] = ()

    @property
    def times(self) -> Mapping[str, int]:
        return {}

    def load(self, wanted: Mapping[str, int]) -> Samples:
        """Columns as floats; dates and durations become seconds. Raises RecordingError."""
        signals = {name: self._numbers(self.fields[index].name, self.values[index]) for name, index in wanted.items()}
        numbers = np.arange(len(next(iter(signals.values()))), dtype=np.int64)
        return Samples(signals, numbers, dict.fromkeys(signals, self.row))

    def _numbers(self, name: str, values: NDArray[Any]) -> Array:
        if values.dtype.kind in "mM":
            # Durations from the first sample: dates as floats would lose microseconds.
            return (values - values[:1]).astype("timedelta64[ns]").astype(np.float64) * 1e-9
        try:
            # A copy: what is changed in the given arrays later does not change the recording.
            return np.array(values, dtype=np.float64)
        except (TypeError, ValueError):
            self.refuse(f"{name} is {values.dtype}; expected numbers")


def of_arrays(signals: Mapping[str, ArrayLike], units: Mapping[str, str], refuse: Refusal) -> ArraysInMemory:
    """Signals as the fields of a recording: q (N, n) is q1 to qn. A single joint's may be (N,).

    units   signal -> unit, of those that are not in SI
    Raises RecordingError.
    """
    for name in ("t", "q", "tau"):
        if name not in signals and not (name == "tau" and COMMANDS.keys() & signals.keys()):
            refuse(f"no {name}; expected t (N,), q (N, n) and tau (N, n)")
    for name in units:
        if name not in signals:
            refuse(f"units: no signal {name}; there is {', '.join(signals)}")
    samples = np.size(signals["t"])
    width = _table("q", signals["q"], samples, refuse).shape[1]
    fields, values = [], []
    for signal, given in signals.items():
        table = _table(signal, given, samples, refuse)
        names = _names(signal, table.shape[1], width, refuse)
        unit = f" [{units[signal]}]" if signal in units else ""
        fields += [RecordedField(f"{name}{unit}") for name in names]
        values += list(table.T)
    return ArraysInMemory("arrays in memory", fields, values, "sample", refuse)


def _table(signal: str, given: ArrayLike, samples: int, refuse: Refusal) -> NDArray[Any]:
    """A signal as (N, columns)."""
    table = np.asarray(given)
    table = table[:, None] if table.ndim == 1 else table
    if table.ndim != 2 or len(table) != samples:
        turned = f"; pass {signal}.T" if table.ndim == 2 and table.shape[1] == samples else ""
        shape = f"({samples},)" if signal in _SINGLE else f"({samples}, n)"
        refuse(f"{signal} has shape {np.shape(given)}; expected {shape}, a row for each sample of t{turned}")
    return table


def _names(signal: str, columns: int, joints: int, refuse: Refusal) -> Sequence[str]:
    """Names of a signal's columns."""
    if signal == "force":
        if columns not in (2, len(IN_SPACE)):
            refuse(f"force has {columns} columns; expected 2 (fx, fy) or {len(IN_SPACE)} ({', '.join(IN_SPACE)})")
        return list(IN_SPACE)[:columns]
    expected = 1 if signal in _SINGLE else joints
    if columns != expected:
        refuse(f"{signal} has {columns} columns; expected {expected}" + ", as q" * (signal not in _SINGLE))
    if signal in _SINGLE:
        return [signal]
    return [numbered_signal(signal).format(k) for k in range(1, joints + 1)]


def of_frame(frame: Any, mapping: Mapping[str, str], refuse: Refusal) -> ArraysInMemory:
    """The columns of a data frame or mapping as the fields of a recording. Raises RecordingError.

    mapping   signal -> column; without one for t and without a column t, an index of durations, dates or floats is t
    """
    if not isinstance(frame, Mapping) and not (hasattr(frame, "columns") and hasattr(frame, "__getitem__")):
        what = "a file, a data frame, a dict of columns, or t=, q= and tau="
        refuse(f"is {'nothing' if frame is None else f'a {type(frame).__name__}'}; expected {what}")
    names = list(frame) if isinstance(frame, Mapping) else list(frame.columns)
    fields = [RecordedField(str(name)) for name in names]
    values = [np.asarray(frame[name]) for name in names]
    index = getattr(frame, "index", None)
    timed = mapping.get("t") is not None or any(re.match(r"t\s*(\[|$)", f.name.strip()) for f in fields)
    if index is not None and not timed:
        labels = np.asarray(index)
        if labels.dtype.kind in _INDEX_OF_TIME:
            fields, values = [RecordedField("t"), *fields], [labels, *values]
    for field, column in zip(fields, values, strict=True):
        if column.ndim != 1:
            refuse(f"{field.name} has shape {column.shape}; expected a single column of this name")
    return ArraysInMemory("data frame", fields, values, "row", refuse)


def of_recording(recording: Recording) -> ArraysInMemory:
    """A recording as contents again, in SI."""
    signals = list(measured(recording))
    fields = [RecordedField("t [s]"), *(RecordedField(header_cell(name, unit)) for name, unit, _ in signals)]
    values = [recording.t, *(array for *_, array in signals)]
    return ArraysInMemory("arrays in memory", fields, values, "sample", Refusal(str(recording.path)))
