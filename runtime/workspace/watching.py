"""The monitor of a model on its board: floors from recordings for the model file, and what the firmware promises."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from runtime.documents.generated import MissedEntry, MonitoredJointEntry, MonitorEntry
from runtime.hardware.floors import HIGHEST_CUTOFF, MeasuredFloor, measured_floors
from runtime.hardware.settings import check_controllable
from runtime.identification.compare import compare
from runtime.identification.identify import prepared
from runtime.model.loader import Model
from runtime.motion.settings import MORE_THAN_NOISE
from runtime.recordings.recording import Recording
from runtime.wording import times_floor
from runtime.workspace.source import Source
from symbolic.model_file.arm import ArmMonitor, JointMonitor, ProposedValue
from symbolic.model_file.checks import check_stated

if TYPE_CHECKING:
    from runtime.workspace.edits import ModelEdits

_RATE_OVER_CUTOFF = 4.0
"""The least ratio of control rate and cut-off that a model file may have."""


def propose_monitor(source: Source, model: Model, recordings: Sequence[Recording]) -> ModelEdits:
    """Edits of the model file: [monitor] in the recordings' band, and each joint's floor in it.

    Raises ControllerError where the model file lacks what a controller needs or a joint moves too little, and
    RecordingError.
    """
    from codegen.prepare import prepare_residuals

    arm = source.arm()
    check_controllable(model, {})
    check_stated(arm.name, [p.name for p in model.lumps if p.value is None], [joint.unknown for joint in arm.joints])
    assert arm.controller is not None
    motion = prepared(model, recordings)
    cutoff = float(f"{min(motion.band.cutoff, HIGHEST_CUTOFF, arm.controller.rate / _RATE_OVER_CUTOFF):.3g}")
    none = JointMonitor(floor=1.0, load_floor=0.0, slowest=0.0, freedom=None)
    false_alarms = arm.monitor.false_alarms if arm.monitor else 1.0
    watched = replace(arm, monitor=ArmMonitor(cutoff, false_alarms, (none,) * model.n))
    directory = prepare_residuals(watched, source.compiled.library)
    floors = measured_floors(model, directory, recordings, motion.standstill)
    of = ", ".join(recording.path.name for recording in recordings)
    band = ProposedValue(None, ("monitor",), "cutoff", cutoff, f"the band of {of}")
    return source.edits.propose([band, *_values(floors, of)])


def missed_joints(model: Model, recordings: Sequence[Recording]) -> list[MissedEntry]:
    """The joints of which the model file's values leave more than noise; their floors would call that normal.

    Raises RecordingError.
    """
    compared = compare(model, recordings)
    if compared.written is None:
        return []
    return [
        MissedEntry(joint=series.joint, unit=series.force_unit, rms=rms, floor=series.floor.value)
        for series, (rms, _) in zip(compared.joints, compared.written, strict=True)
        if times_floor(rms, series.floor.value) > MORE_THAN_NOISE
    ]


def _values(floors: Sequence[MeasuredFloor], of: str) -> Iterator[ProposedValue]:
    for joint, found in enumerate(floors, 1):
        for key, value in vars(found).items():
            yield ProposedValue(joint, ("monitor",), key, float(f"{value:.3g}"), f"measured on {of}")


def monitor_entry(source: Source) -> MonitorEntry | None:
    """What the firmware of a model file promises; None without a monitor."""
    from codegen.c.monitor import ModelMonitor
    from symbolic.model import derive

    found = ModelMonitor.of(derive(source.arm()), source.compiled.library)
    if found is None:
        return None
    joints = [
        MonitoredJointEntry(joint=k, floor=own.floor, load_floor=own.load_floor, hours=alarm.hours)
        for k, (own, alarm) in enumerate(zip(found.settings.joints, found.alarms, strict=True), 1)
    ]
    return MonitorEntry(cutoff=found.settings.cutoff, false_alarms=found.settings.false_alarms, joints=joints)
