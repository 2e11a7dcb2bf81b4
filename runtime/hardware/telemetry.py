"""The telemetry of a run: checked for gaps, kept in arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.hardware.frames import Codec

_BLOCK = 4096
_LOOK, _RATE = 0.1, 0.05
"""s of a run after which its control periods are compared with what they should be; part by which they may differ."""
_MICROSECONDS = 1e6
_TYPES = {"u8": "<u1", "u16": "<u2", "u32": "<u4", "i32": "<i4", "float": "<f4"}


class Log:
    """The telemetry of a run as long as it is whole.

    last   period of its last record, None before the first
    gap    words for the first record that was missing, after which nothing is added; None
    over   whether the board has said that it runs no more
    It ends with the record of the step that stopped the arm, whatever its period; a step that found the run done is
    none of it.
    """

    def __init__(self, every: int, codec: Codec) -> None:
        self.every = every
        self.last: int | None = None
        self._type = _record_type(codec)
        self._states, self._reasons = codec.names("states"), codec.names("reasons")
        self._whole: list[NDArray[Any]] = []
        self._recent: list[tuple[Any, ...]] = []
        self._expected = 0
        self.gap: str | None = None
        self.over = False
        self._running = -1
        self._begun: int | None = None
        self._elapsed = self._stamp = 0

    def rows(self) -> NDArray[Any]:
        """(N,) with the fields of the message."""
        return np.concatenate([*self._whole, np.array(self._recent, dtype=self._type)])

    def take(self, rows: list[dict[str, Any]]) -> None:
        """Add and clear `rows`."""
        for row in rows:
            if self.gap is None and not self.over:
                self._add(row)
        rows.clear()

    def missing(self, periods: int) -> str | None:
        """What a run that went through so many periods should have left, and has not; None if it is whole."""
        if self.gap is None and self._expected < periods:
            return f"the telemetry of period {self._expected} is missing, and what came after it"
        return self.gap

    def beyond(self, periods: int) -> bool:
        """Whether the board says that it runs, after as many periods as a run was to have."""
        return self._running >= periods

    def off(self, dt: float, late: float) -> str | None:
        """Words for a board that keeps another control period than dt; late: s that a single one may be longer."""
        if self._begun is None or self.last is None or self.last == self._begun:
            return None
        periods, seconds = self.last - self._begun, self._elapsed / _MICROSECONDS
        nominal = dt * periods
        if max(nominal, seconds) < _LOOK or abs(seconds - nominal) <= _RATE * nominal + late:
            return None
        return (
            f"its control periods take {1e3 * seconds / periods:.3g} ms, by the model file {1e3 * dt:.3g} ms; "
            "set its timer to the rate in [controller], or the rate to the timer's"
        )

    def _add(self, row: dict[str, Any]) -> None:
        if self._states[row["state"]] == "running":
            self._running = max(self._running, row["period"])
        if row["period"] > self._expected:
            self.gap = f"the telemetry of period {self._expected} is missing, that of {row['period']} is there"
        elif self._states[row["state"]] == "running":
            if row["period"] == self._expected:
                self._append(row)
                self._expected += self.every
        else:
            self.over = True
            if self._reasons[row["reason"]] != "done":
                self._append(row)

    def _append(self, row: dict[str, Any]) -> None:
        self.last = row["period"]
        if self._begun is None:
            self._begun = row["period"]
        else:
            # The board's clock wraps, and so does the difference.
            self._elapsed += (row["time_us"] - self._stamp) & 0xFFFFFFFF
        self._stamp = row["time_us"]
        self._recent.append(tuple(row.values()))
        # Of an hour at 1 kHz, arrays are a tenth as large as what they are made of.
        if len(self._recent) >= _BLOCK:
            self._whole.append(np.array(self._recent, dtype=self._type))
            self._recent.clear()


def _record_type(codec: Codec) -> np.dtype[Any]:
    """Of a telemetry message."""
    message = next(item for item in codec.document["messages"] if item["name"] == "telemetry")
    return np.dtype([(field["name"], _TYPES[field["type"]], field["count"] or ()) for field in message["fields"]])
