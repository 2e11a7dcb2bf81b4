"""Documents of a fit and of what it leaves: identify and compare, and the entries that diagnose and improve share."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, UnsetType

from runtime.documents.parts import (
    BandEntry,
    DelayEntry,
    Document,
    EstimateEntry,
    Inseparable,
    Interval,
    Interval95,
    JointNumber,
    JointOrArm,
    SkewEntry,
    Unit,
    key,
)
from runtime.documents.provenance import Origin
from runtime.documents.replays import OutputErrorEntry


class InertialEntry(Document, frozen=True, kw_only=True):
    """A base inertial parameter."""

    joint: JointNumber
    name: Annotated[str, key("name of the base parameter")]
    model: Annotated[float | None, key("value in the model file; null where it leaves it open", "`unit`")]
    fit: Annotated[float | None, key("fitted value; null where the data determine none", "`unit`")]
    unit: Unit
    interval: Interval95
    inseparable_from: Inseparable = UNSET


class RotorEntry(Document, frozen=True, kw_only=True):
    """Inertia of a rotor that `tau_rigid` of the recording leaves out."""

    joint: JointNumber
    name: Annotated[str, key("name of the parameter")]
    fit: Annotated[float | None, key("fitted inertia at the motor", "`unit`")]
    unit: Unit
    interval: Interval95
    inseparable_from: Inseparable = UNSET


class FittedParameter(EstimateEntry, frozen=True, kw_only=True):
    """A parameter of an effect, fitted."""

    model: Annotated[float | None, key("value in the model file; null where it leaves it open", "`unit`")]


class FittedEffect(Document, frozen=True, kw_only=True):
    """An effect of the model with its fitted parameters."""

    effect: Annotated[str, key("name of the effect in the library")]
    joint: JointOrArm
    name: Annotated[str, key("its name in the model file, with a number where there are several")]
    parameters: Annotated[dict[str, FittedParameter], key("parameters by name")]


class FitParameters(Document, frozen=True, kw_only=True):
    """All parameters of a fit."""

    inertial: Annotated[list[InertialEntry], key("base inertial parameters")]
    rotors: Annotated[list[RotorEntry], key("rotor inertias missing from tau_rigid; empty without that column")]
    effects: Annotated[list[FittedEffect], key("effects of the model")]


class StatisticsFitDocument(FitParameters, frozen=True, kw_only=True):
    """The parameters by what a board has added up: `tendon identify --statistics`."""

    rows: Annotated[list[int], key("that the board has added, a joint", "1")]
    rms: Annotated[list[float], key("residual of each joint", "N m or N")]
    written: Annotated[list[str], key("parameters and effects that --write put into the model file")] = []  # noqa: RUF012
    provenance: Origin = UNSET


Band = Annotated[BandEntry, key("frequency band of the comparison")]
Skew = Annotated[SkewEntry, key("offset between the clocks of torque and motion")]
Delays = Annotated[list[DelayEntry], key("delay from torque to motion of each joint")]
Uncorrected = Annotated[
    FitParameters | None, key("the same fit without correction of the skew; null where none was estimated")
]
Warnings = Annotated[list[str], key("what to know before trusting the fit")]


class FitDocument(Document, frozen=True, kw_only=True):
    """A fit, without a judgement on it."""

    band: Band
    skew: Skew
    delay: Delays
    inertial: Annotated[list[InertialEntry], key("base inertial parameters")]
    rotors: Annotated[list[RotorEntry], key("rotor inertias missing from tau_rigid; empty without that column")]
    effects: Annotated[list[FittedEffect], key("effects of the model")]
    uncorrected: Uncorrected


class StructureShare(Document, frozen=True, kw_only=True):
    """How far a residual is a function of one signal."""

    signal: Annotated[str, key("position, velocity, direction, acceleration, load, time or temperature")]
    share: Annotated[float, key("share of the residual's power that a curve over the signal explains, 0 to 1", "1")]


class DriveEntry(Document, frozen=True, kw_only=True):
    """A drive whose law makes the joint's torque from its command."""

    law: Annotated[str, key("name of the law in the model file")]
    rms: Annotated[float, key("the joint's residual in the unit of the command", "`unit`")]
    unit: Annotated[str, key("unit of the command")]
    gains: Annotated[dict[str, EstimateEntry], key("identified gains by name; empty where the model file states all")]


class JointEntry(Document, frozen=True, kw_only=True):
    """Residual torque of a joint, measured less predicted, in the band."""

    joint: JointNumber
    name: Annotated[str | UnsetType, key("name in the model file; absent if it has none")] = UNSET
    unit: Annotated[str, key("unit of the joint's torque or force")]
    rms: Annotated[float, key("residual, rms", "`unit`")]
    relative: Annotated[float, key("norm of the residual over that of the torque", "1")]
    floor: Annotated[float, key("noise floor, rms: what a perfect model would leave", "`unit`")]
    floor_source: Annotated[str, key("repeats: from motion that was repeated; spectrum: from the residual's spectrum")]
    repeatable: Annotated[
        bool | None, key("whether the residual repeats with the motion; null where no motion was repeated")
    ]
    drive: Annotated[DriveEntry | UnsetType, key("what makes the torque; absent where it was recorded")] = UNSET


class WrittenError(Document, frozen=True, kw_only=True):
    """Residual of the model with the values of its file."""

    rms: Annotated[float, key("residual, rms", "the joint's `unit`")]
    relative: Annotated[float, key("norm of the residual over that of the torque", "1")]


class ComparedJoint(JointEntry, frozen=True, kw_only=True):
    """Residual torque of a joint and the signals it follows."""

    structure: Annotated[list[StructureShare], key("signals that the residual follows, the largest share first")]
    as_written: Annotated[
        WrittenError | None, key("the same with the values of the model file; null where it leaves values open")
    ]


class CompareDocument(Document, frozen=True, kw_only=True):
    """Where the model fails: `tendon compare --json`."""

    band: Band
    skew: Skew
    joints: Annotated[list[ComparedJoint], key("residual of each joint with the structure of the model file, fitted")]
    warnings: Warnings
    provenance: Origin = UNSET


class RecordingFit(Document, frozen=True, kw_only=True):
    """The common structure fitted to one recording alone."""

    recording: Annotated[str, key("name of the file")]
    parameters: Annotated[list[InertialEntry], key("base inertial parameters")]
    effects: Annotated[list[FittedEffect], key("effects of the model")]


class ContradictionEntry(Document, frozen=True, kw_only=True):
    """A parameter on which two recordings disagree by more than their uncertainty."""

    name: Annotated[str, key("the parameter, after its effect and joint where it belongs to one")]
    unit: Unit
    recordings: Annotated[list[str], key("names of the two files")]
    values: Annotated[list[float], key("value from each", "`unit`")]
    intervals: Annotated[list[Interval | None], key("95 % confidence interval of each", "`unit`")]


EachRecording = Annotated[list[RecordingFit], key("fits to each recording alone; empty with a single recording")]
Inconsistent = Annotated[list[ContradictionEntry], key("parameters on which the recordings disagree")]


class JudgedFitDocument(Document, frozen=True, kw_only=True):
    """The fitted parameters and whether to believe them."""

    verdict: Annotated[Literal["fitted", "refused"], key("refused: the fit is not to be believed")]
    reason: Annotated[str, key("the verdict in one sentence")]
    band: Band
    skew: Skew
    delay: Delays
    inertial: Annotated[list[InertialEntry], key("base inertial parameters")]
    rotors: Annotated[list[RotorEntry], key("rotor inertias missing from tau_rigid; empty without that column")]
    effects: Annotated[list[FittedEffect], key("effects of the model")]
    uncorrected: Uncorrected
    joints: Annotated[list[JointEntry], key("residual of each joint")]
    recordings: EachRecording
    inconsistent: Inconsistent
    warnings: Warnings


class IdentifyDocument(JudgedFitDocument, frozen=True, kw_only=True):
    """The fitted parameters: `tendon identify --json`."""

    written: Annotated[list[str], key("parameters and effects that --write put into the model file")]
    output_error: Annotated[
        OutputErrorEntry | UnsetType,
        key("with --output-error: what the motion says, and --write writes; above are the torque's values"),
    ] = UNSET
    provenance: Origin = UNSET
