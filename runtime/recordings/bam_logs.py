"""Logs of BAM (Better Actuator Models): a servo with a pendulum, one JSON file a motion, in SI.

Source: Rhoban/bam, the recorders of its servos.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from runtime.recordings.contents import Array, RecordedField, Refusal, Samples
from runtime.recordings.settings import MOST_FIELDS, MOST_JSON

JSON = b"{"
_ENTRIES = "entries"
_SIGNALS = {
    "timestamp": ("t", "s"),
    "position": ("q", "rad"),
    "speed": ("qd", "rad/s"),
    "goal_position": ("q_desired", "rad"),
    "duty": ("duty", ""),
    "load": ("duty", ""),
    "input_volts": ("bus_voltage", "V"),
    "present_current": ("current", "mA"),
    "temp": ("temperature", "degC"),
}
"""A number of an entry -> the signal, and its unit."""
_STEP_OF_LOAD = "0.1 %"
"""Unit of the register of the load, where a recorder writes it as it is."""
_ENABLED = "torque_enable"
_LENGTHS = {"mass": "kg", "arm_mass": "kg", "length": "m", "vin": "V", "kp": "", "damping": ""}
"""Numbers about the whole log -> their unit."""


@dataclass(frozen=True)
class BamContents:
    """Entries as samples of one joint; see Contents.

    about   what the file says of motor, gains and pendulum     values   (N,) of each number of an entry
    """

    about: Mapping[str, Any]
    values: Mapping[str, Array]
    refuse: Refusal
    format: str = "BAM"
    header: str = ""
    torque: str = ""

    @cached_property
    def fields(self) -> tuple[RecordedField, ...]:
        found, seen = [], set[str]()
        for name in self.values:
            signal, unit = self._meaning(name)
            signal = None if signal in seen else signal
            seen |= {signal} if signal else set()
            label = f"{name} [{unit}]" if unit and signal else name
            found.append(RecordedField(label, "", "entry", signal, "1" if signal else None))
        return tuple(found)

    def _meaning(self, name: str) -> tuple[str | None, str]:
        """The signal of a number of an entry and its unit; a load that never changes was not recorded."""
        signal, unit = _SIGNALS.get(name, (None, ""))
        if signal == "duty":
            values = np.abs(self.values[name][np.isfinite(self.values[name])])
            if not values.any():
                return None, ""
            return signal, unit if values.max() <= 1.0 else _STEP_OF_LOAD
        return signal, unit

    @property
    def times(self) -> Mapping[str, int]:
        return {"": list(self.values).index("timestamp")}

    @property
    def notes(self) -> Sequence[str]:
        said = [
            f"{key} {self.about[key]:g}{f' {unit}' * bool(unit)}" for key, unit in _LENGTHS.items() if self._is(key)
        ]
        motor = self.about.get("motor")
        named = [f"motor {motor}"] * isinstance(motor, str)
        told = [f"a log of BAM: {', '.join([*named, *said])}"] if named or said else []
        notes = [f"{line}; mass and length are the model's, where q = 0 hangs down" for line in told]
        if many := int(np.count_nonzero(self._off)):
            notes.append(f"the motor is off in {many} entries; q_desired is the position there")
        return notes

    def _is(self, key: str) -> bool:
        value = self.about.get(key)
        return isinstance(value, int | float) and not isinstance(value, bool)

    @cached_property
    def _off(self) -> Any:
        """(N,) entries in which the motor is off."""
        return self.values.get(_ENABLED, np.ones(len(self.values["timestamp"]))) == 0

    def load(self, wanted: Mapping[str, int]) -> Samples:
        """A servo that is off makes no torque, as if it were where it was told to be."""
        names = list(self.values)
        signals = {signal: self.values[names[index]] for signal, index in wanted.items()}
        for signal, index in wanted.items():
            if names[index] == "goal_position":
                signals[signal] = np.where(self._off, self.values["position"], signals[signal])
        count = len(self.values["timestamp"])
        return Samples(dict(signals), np.arange(1, count + 1), dict.fromkeys(wanted, "entry"))


def open_bam(path: Path, refuse: Refusal) -> BamContents:
    """A log in JSON. Raises RecordingError."""
    if path.stat().st_size > MOST_JSON:
        refuse(f"is JSON of more than {MOST_JSON // 10**6} MB; split it into several recordings")
    errors = (ValueError, OSError, RecursionError, MemoryError)
    with refuse.on(errors, "the JSON file is damaged or cut off", "copy it again"):
        about = json.loads(path.read_text(encoding="utf-8"))
    entries = about.get(_ENTRIES)
    first = entries[0] if isinstance(entries, list) and entries else None
    if not isinstance(first, dict) or not {"timestamp", "position"} <= first.keys():
        refuse('is JSON, but no log of BAM, which has "entries" with timestamp and position; write other logs as CSV')
    if len(first) > MOST_FIELDS:
        refuse(f"has {len(first)} numbers an entry; expected at most {MOST_FIELDS}")
    for number, entry in enumerate(entries, 1):
        if not isinstance(entry, dict):
            refuse("is no table of numbers; drop the entry", f"entry {number}")
    values = {name: np.array([_number(entry.get(name)) for entry in entries]) for name in first}
    return BamContents({k: v for k, v in about.items() if k != _ENTRIES}, values, refuse)


def _number(value: Any) -> float:
    try:
        return float(value) if isinstance(value, int | float) else np.nan
    except OverflowError:
        return np.inf
