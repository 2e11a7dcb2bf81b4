"""Everything that a file says before anything is concluded from it: its fields, its signals, what looks wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from runtime.diagnosis.credibility import unreliable
from runtime.estimation.compare import series
from runtime.estimation.estimate import Estimate
from runtime.estimation.identify import Identification, identify
from runtime.estimation.suspicions import Suspicion, doubts, suspicions
from runtime.inspection import guesses
from runtime.inspection.settings import WELL_TOLD
from runtime.inspection.shifts import shifts_json
from runtime.inspection.signals import clock_json, joints_json, signals_json
from runtime.inspection.suspected import MISREAD, by_signals, over_turns, rates_in_degrees, without_model
from runtime.model.loader import Model
from runtime.motion import repeats
from runtime.recordings import recording
from runtime.recordings.clocks import BroughtClock
from runtime.recordings.contents import Contents, RecordingError, Refusal, printable
from runtime.recordings.recording import Recording, count_joints, read


@dataclass(frozen=True)
class Inspection:
    """What was found in one file.

    contents     its fields, whether they are understood or not
    recording    None where it cannot be read, even with what is wrong split off or dropped
    problem      why it cannot be used as it is, with the place and the cure; None if it can
    names        of the joints, where the model has some
    """

    path: Path
    contents: Contents
    recording: Recording | None
    problem: str | None
    names: tuple[str | None, ...]
    fitted: Identification | None = None
    unfitted: str | None = None

    @cached_property
    def found(self) -> list[Suspicion]:
        """What looks wrong: by the model where there is one, as every verb says it, else by the signals alone."""
        if self.recording is None:
            return []
        signals = by_signals(self.recording)
        if any(s.kind == MISREAD for s in signals):
            return signals
        if self.fitted is None:
            told, unsure = without_model(self.recording), []
        else:
            told = list(suspicions(self.fitted) or doubts(self.fitted))
            # Where no inertia is stated, no fit tells degrees from radians.
            unsure = [] if self.fitted.model.lumps_known else over_turns(self.recording)
        for further in (signals, unsure):
            told += [s for s in further if s.joint not in {t.joint for t in told}]
        degrees = dict.fromkeys(s.joint for s in told if s.kind == "degrees")
        return [*told, *rates_in_degrees(self.recording, list(degrees))]

    def to_json(self) -> dict[str, Any]:
        """Every figure."""
        recording, fitted = self.recording, self.fitted
        return {
            "file": str(self.path),
            "format": self.contents.format,
            "fields": [{"name": f.name, "clock": f.clock} for f in self.contents.fields],
            "problem": self.problem,
            "suggested": [] if recording else self._suggested(),
            "notes": list(recording.notes) if recording else [],
            "clock": clock_json(recording) if recording else None,
            "clocks": [_clock_json(clock) for clock in recording.clocks] if recording else [],
            "signals": signals_json(recording) if recording else [],
            "joints": joints_json(recording, self.names) if recording else [],
            "shifts": shifts_json(recording) if recording else [],
            "repeats": None if fitted is None else {"seconds": repeats.find(fitted.motion)[0].seconds},
            "delay": [] if fitted is None else fitted.delay_json(),
            "parameters": [] if fitted is None else _parameters(fitted),
            "unfitted": self.unfitted,
            **self._fit_json(),
            "suspicions": [{"joint": s.joint, "kind": s.kind, "found": s.found, "cure": s.cure} for s in self.found],
            "cures": list(dict.fromkeys(option for s in self.found for option in s.maps)),
        }

    def _fit_json(self) -> dict[str, Any]:
        """Where the data do not look wrong: parts of the joints' torques that the best fit misses, why it may not be
        believed, and inertias that nothing in the model file can be held against."""
        if self.fitted is None or self.found:
            return {"misses": [], "unreliable": "", "inertias": []}
        joints = series(self.fitted)
        return {
            "misses": [{"joint": s.joint, "part": s.relative} for s in joints if len(s.t)],
            "unreliable": unreliable(self.fitted, joints),
            "inertias": _inertias(self.fitted),
        }

    def _suggested(self) -> list[str]:
        """Options that may name what was not found."""
        if self.problem is None or "no column" not in self.problem:
            return []
        return guesses.options(self.contents.fields)


def inspect(
    path: Path, joints: Mapping[str, Any] | None, mapping: Mapping[str, str], allow_gaps: bool = False
) -> Inspection:
    """A file, read as far as it goes.

    joints   metadata of the arm, as `recording.read` takes it; None: as many joints as the file names
    Raises RecordingError where it is no recording at all.
    """
    refuse = Refusal(printable(path))
    contents = recording.opened(path, refuse)
    names = tuple(joint.get("name") for joint in joints["joints"]) if joints else ()
    problem: str | None = None
    try:
        arm = joints if joints is not None else count_joints(path, mapping)
        return Inspection(path, contents, read(path, arm, mapping, allow_gaps), None, names)
    except RecordingError as error:
        problem = str(error)
    try:
        arm = joints if joints is not None else count_joints(path, mapping)
        return Inspection(path, contents, read(path, arm, mapping, True), problem, names)
    except RecordingError:
        return Inspection(path, contents, None, problem, names)


def with_model(inspection: Inspection, model: Model) -> Inspection:
    """The same with what a fit of the model's structure tells of it."""
    if inspection.recording is None:
        return inspection
    try:
        return replace(inspection, fitted=identify(model, [inspection.recording]))
    except RecordingError as error:
        return replace(inspection, unfitted=str(error))


def _clock_json(clock: BroughtClock) -> dict[str, Any]:
    """Signals of another clock than the positions', and by how much its stamps are later, s."""
    shift = None if clock.shift is None else {"value": clock.shift.value, "error": clock.shift.error}
    return {
        "clock": clock.name,
        "signals": clock.signals,
        "rate_hz": clock.rate,
        "shift": shift,
        "corrected": clock.corrected,
    }


def _inertias(fitted: Identification) -> list[dict[str, Any]]:
    """Of joints that move what each moves at q = 0, as fitted; none where the model file says it."""
    model, motion = fitted.model, fitted.motion
    if model.lumps_known or motion.rigid_given:
        return []
    lumps = fitted.fit.coefficients[fitted.problem.layout.lumps]
    moved = np.diagonal(model.inertia(np.zeros((model.n, 1)), lumps)[:, :, 0])
    units = ["kg" if joint.type == "prismatic" else "kg m^2" for joint in model.joints]
    able = [i for i in range(model.n) if motion.moving(i).any()]
    return [{"joint": i + 1, "value": float(moved[i]), "unit": units[i]} for i in able]


def _parameters(fitted: Identification) -> list[dict[str, Any]]:
    """Which parameters this recording can tell: "well", "together" with others, "hardly", or "no"."""
    inference = fitted.inference
    lumps = zip(fitted.model.lumps, inference.lumps, strict=True)
    rows: list[tuple[str, int | None, Estimate]] = [(lump.name, None, e) for lump, e in lumps]
    for term, values in inference.values.items():
        rows += [(f"{term} {name}", term.joint, e) for name, e in values.items()]
    return [{"name": name, "joint": joint, "told": _told(e), **e.to_json()} for name, joint, e in rows]


def _told(e: Estimate) -> str:
    if e.with_others:
        return "together"
    if e.interval is None or not np.all(np.isfinite(e.interval)):
        return "no"
    half = (e.interval[1] - e.interval[0]) / 2
    return "well" if half < WELL_TOLD * abs(e.value) else "hardly"
