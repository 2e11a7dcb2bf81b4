"""LeRobot data sets: Parquet with an episode a file (version 2) or several (version 3), and meta/info.json above them.

Source: the documentation of LeRobotDataset.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from runtime.recordings.array_files import ArrayContents, Variable, open_parquet
from runtime.recordings.columns import UNITS, UNTOLD, normal_unit
from runtime.recordings.contents import Contents, RecordedField, Refusal, Samples
from runtime.recordings.settings import LARGEST_RADIANS, MAX_BYTES, MIN_SEGMENT, MOST_EPISODES, NORMALISED

_STATE = "observation.state"
_SIGNATURE = frozenset((_STATE, "episode_index", "frame_index"))
_FEATURES = (
    (r"observation\.(?:state|(?:joint_)?positions?)", "q"),
    (r"action", "q_desired"),
    (r"observation\.(?:state\.|joint_)?(?:velocity|velocities|vel)", "qd"),
    (r"observation\.(?:state\.|joint_)?(?:efforts?|torques?)", "tau"),
    (r"observation\.(?:state\.|joint_|motor_)?currents?", "current"),
    (r"observation\.(?:state\.|joint_|motor_)?loads?", "duty"),
)
"""Names of features -> the signal of all joints."""
_ENDINGS = {"pos": "", "vel": "qd", "torque": "tau", "effort": "tau", "current": "current", "load": "duty"}
"""Endings of a motor's name within a feature -> its signal, if it is not that of the feature."""
_POSES = re.compile(r"(?:delta_|ee_|eef_)?(?:x|y|z|roll|pitch|yaw|r[xyz]|q[xyzw])")
"""Names of the parts of a tool's pose, which are no joints."""
_STEP_OF_LOAD = "0.1 %"
"""Unit of a servo's register of the load, which LeRobot records as it is."""


@dataclass(frozen=True)
class _Entry:
    """A number of a feature: its signal, the name of its motor, and its unit, "" in SI."""

    field: RecordedField
    signal: str | None
    motor: str
    unit: str = ""


@dataclass(frozen=True)
class LeRobotContents:
    """Episodes as runs, observation.state as positions and action as demanded positions; see Contents.

    files   one for each Parquet file, with the same features     info   features -> what meta/info.json says of them
    """

    files: Sequence[ArrayContents]
    info: Mapping[str, Any]
    skipped: int
    refuse: Refusal
    format: str = "LeRobot"
    header: str = ""
    torque: str = ""

    @cached_property
    def fields(self) -> tuple[RecordedField, ...]:
        return tuple(e.field if e.signal is None else self._named(e) for e in self._entries)

    @property
    def times(self) -> Mapping[str, int]:
        return self.files[0].times

    @property
    def notes(self) -> tuple[str, ...]:
        found = []
        units = {e.unit for e in self._entries if e.signal == "q"}
        if units == {"deg"} and not self._stated(_STATE, 0):
            found.append(f"{_STATE} is read in degrees: it leaves ±{NORMALISED:g}, and the data set names no unit")
        if left := [e.field.name for e in self._entries if "gripper" in e.motor.lower()]:
            found.append(f"gripper left out: {', '.join(left)}")
        known = {e.field.name.partition("[")[0] for e in self._entries if e.signal}
        if "action" in self.info and "action" not in known:
            found.append(f"action is left out: its names are not those of the joints in {_STATE}")
        if self.skipped:
            found.append(f"episodes left out, with fewer than {MIN_SEGMENT} frames: {self.skipped}")
        return tuple(found)

    def load(self, wanted: Mapping[str, int]) -> Samples:
        parts = [file.load(wanted) for file in self.files]
        signals = {name: np.concatenate([part.signals[name] for part in parts]) for name in wanted}
        count = sum(len(part.numbers) for part in parts)
        return Samples(signals, np.arange(1, count + 1), parts[0].places)

    def _named(self, entry: _Entry) -> RecordedField:
        field, unit = entry.field, f" [{entry.unit}]" * bool(entry.unit)
        return RecordedField(field.name + unit, field.clock, field.place, entry.signal, entry.motor or None)

    @cached_property
    def _entries(self) -> list[_Entry]:
        """Every field with its meaning; of a gripper none, because its numbers are no angles."""
        found = [
            self._entry(variable, k, field)
            for (variable, k, _), field in zip(self.files[0].columns, self.files[0].fields, strict=True)
        ]
        motors = {e.motor for e in found if e.signal == "q"}
        found = [e if not e.motor or e.motor in motors else replace(e, signal=None) for e in found]
        usual = self._usual_unit([k for k, e in enumerate(found) if e.signal == "q"])
        units = {"q": usual, "q_desired": usual, "qd": "deg/s" if usual == "deg" else "", "duty": _STEP_OF_LOAD}
        return [replace(e, unit=e.unit or units.get(e.signal or "", "")) if e.motor else e for e in found]

    def _entry(self, variable: Variable, k: int, field: RecordedField) -> _Entry:
        if variable.name == "episode_index":
            return _Entry(field, "run", "")
        whole = next((s for pattern, s in _FEATURES if re.fullmatch(pattern, variable.name)), None)
        if len(variable.shape) < 2 and whole is None:
            return _Entry(field, None, "")
        name = (self._names(variable.name) or self._names(_STATE)).get(k, str(k)).removeprefix("main_")
        motor, _, ending = name.rpartition(".")
        if ending not in _ENDINGS:
            motor, ending = name, "pos"
        signal, grips = _ENDINGS[ending] or whole, "gripper" in motor.lower()
        place = f".{name}" if grips else f"[{k}]"
        field = RecordedField(variable.name + place, field.clock, field.place)
        if whole is None or grips or _POSES.fullmatch(motor) or (whole == "q_desired" and signal != whole):
            signal = None
        return _Entry(field, signal, motor, self._stated(variable.name, k))

    def _feature(self, name: str) -> Mapping[str, Any]:
        found = self.info.get(name)
        return found if isinstance(found, dict) else {}

    def _names(self, feature: str) -> dict[int, str]:
        """Place -> name of a motor: a list, a list within a table, or a table of places."""
        names = self._feature(feature).get("names")
        if isinstance(names, dict) and len(names) == 1:
            names = next(iter(names.values()))
        if isinstance(names, dict):
            return {k: str(name) for name, k in names.items() if isinstance(k, int)}
        return dict(enumerate(map(str, names))) if isinstance(names, list) else {}

    def _stated(self, feature: str, k: int) -> str:
        """The unit that a data set states of a feature, for all of its numbers or for each; "" if none."""
        about = self._feature(feature)
        unit = about.get("units", about.get("unit"))
        unit = unit[k] if isinstance(unit, list) and k < len(unit) else unit
        return unit if isinstance(unit, str) and normal_unit(unit) in UNITS else ""

    def _usual_unit(self, positions: Sequence[int]) -> str:
        """The unit of positions, as their size tells it: LeRobot writes rad, degrees, or parts of a range."""
        if not positions:
            return ""
        loaded = self.load({str(k): k for k in positions}).signals.values()
        largest = max(float(np.nanmax(np.abs(values), initial=0.0)) for values in loaded)
        return "" if largest <= LARGEST_RADIANS else "deg" if largest > NORMALISED else UNTOLD


def open_any_parquet(path: Path, refuse: Refusal) -> Contents:
    """A Parquet file; one of a LeRobot data set with what the data set says of it. Raises RecordingError."""
    contents = open_parquet(path, refuse)
    if not {variable.name for variable in contents.variables} >= _SIGNATURE:
        return contents
    root = next((folder for folder in path.absolute().parents[:3] if (folder / _INFO).is_file()), None)
    return LeRobotContents([contents], _features(root / _INFO) if root else {}, 0, refuse)


_INFO = Path("meta", "info.json")


def is_data_set(folder: Path) -> bool:
    """Whether a folder is a LeRobot data set."""
    return (folder / _INFO).is_file()


def open_data_set(folder: Path, refuse: Refusal) -> LeRobotContents:
    """All episodes of a data set. Raises RecordingError."""
    paths = sorted((folder / "data").rglob("*.parquet"))
    if not paths:
        refuse("is a LeRobot data set without Parquet files in its folder data; download them as well")
    if len(paths) > MOST_EPISODES:
        refuse(f"has {len(paths)} files of episodes; expected at most {MOST_EPISODES}; pass one, or a copy with fewer")
    files = [open_parquet(path, refuse) for path in paths]
    long = [file for file in files if max(v.samples for v in file.variables) >= MIN_SEGMENT]
    if not long:
        refuse(f"none of its episodes has {MIN_SEGMENT} frames; record longer ones")
    for file in long:
        if [c[2] for c in file.columns] != [c[2] for c in long[0].columns]:
            refuse("its files have different features; pass one of them")
    if not {variable.name for variable in long[0].variables} >= _SIGNATURE:
        refuse(f"its files lack one of {', '.join(sorted(_SIGNATURE))}; record with LeRobot 2 or later")
    return LeRobotContents(long, _features(folder / _INFO), len(files) - len(long), refuse)


def _features(info: Path) -> Mapping[str, Any]:
    """What a data set says of its features; nothing where the file is no such description."""
    try:
        text = info.read_text(encoding="utf-8") if info.stat().st_size < MAX_BYTES else "{}"
        features = json.loads(text)["features"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return {}
    return features if isinstance(features, dict) else {}
