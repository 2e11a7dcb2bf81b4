"""Documents of recordings: inspect, simulate, and the motion that experiment proposes."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, UnsetType

from runtime.documents.parts import (
    BandEntry,
    DelayEntry,
    Document,
    EffectAt,
    Inseparable,
    Interval,
    Interval95,
    IterationsEntry,
    JointName,
    JointNumber,
    JointOrArm,
    Unit,
    key,
)
from runtime.documents.provenance import Origin


class FieldEntry(Document, frozen=True, kw_only=True):
    """A field of a file."""

    name: Annotated[str, key("its name in the file")]
    clock: Annotated[str, key("clock by which it is stamped; empty where the file has one clock")]


class ClockEntry(Document, frozen=True, kw_only=True):
    """Sampling of a recording."""

    samples: Annotated[int, key("number of samples", "1")]
    seconds: Annotated[float, key("duration without gaps", "s")]
    rate_hz: Annotated[float, key("median sample rate", "Hz")]
    jitter: Annotated[float, key("standard deviation of the steps; 0 if it is only rounding", "s")]
    longest_step: Annotated[float, key("longest step", "s")]
    gaps: Annotated[int, key("number of gaps", "1")]
    runs: Annotated[int, key("number of runs", "1")]
    period: Annotated[float, key("period of the even grid on which the recording is read", "s")]


class ClockShiftEntry(Document, frozen=True, kw_only=True):
    """Offset between two clocks."""

    value: Annotated[float, key("by how much the stamps are later than those of the positions", "s")]
    error: Annotated[float | None, key("its standard deviation; null if unknown", "s")]


class OtherClock(Document, frozen=True, kw_only=True):
    """Signals that are stamped by another clock than the positions."""

    clock: Annotated[str, key("name of the clock")]
    signals: Annotated[list[str], key("its signals")]
    rate_hz: Annotated[float, key("sample rate", "Hz")]
    shift: Annotated[ClockShiftEntry | None, key("offset from the clock of the positions; null if unknown")]
    corrected: Annotated[bool, key("whether the offset was removed")]


class SignalEntry(Document, frozen=True, kw_only=True):
    """A signal in SI."""

    signal: Annotated[str, key("name of the signal")]
    field: Annotated[str, key("field of the file from which it is read")]
    unit: Unit
    least: Annotated[float, key("smallest value", "`unit`")]
    largest: Annotated[float, key("largest value", "`unit`")]
    resolution: Annotated[float, key("step of which the differences are multiples; 0 if there is none", "`unit`")]
    noise: Annotated[float, key("standard deviation of its white noise", "`unit`")]


class RecordedJoint(Document, frozen=True, kw_only=True):
    """Motion of a joint in a recording."""

    joint: JointNumber
    name: JointName
    moves: Annotated[bool, key("whether its position changes by more than resolution and noise")]
    unit: Annotated[str, key("unit of its position")]
    range: Annotated[float, key("range of positions", "`unit`")]
    top_speed: Annotated[float, key("upper quantile of its speed", "`unit`/s")]
    powered: Annotated[bool, key("whether its torque ever changes")]


class ShiftEntry(Document, frozen=True, kw_only=True):
    """Lag of a signal behind its joint's position at the motor."""

    signal: Annotated[str, key("name of the signal")]
    value: Annotated[float, key("time by which it is later", "s")]
    unit: Annotated[str, key("s")]


class RepeatsEntry(Document, frozen=True, kw_only=True):
    """Motion that is repeated, from which the noise floor is found."""

    seconds: Annotated[float, key("duration of the repeated motion", "s")]


class DeterminedParameter(Document, frozen=True, kw_only=True):
    """How well these data determine a parameter."""

    name: Annotated[str, key("base parameter, or effect@joint and parameter")]
    joint: Annotated[int | None, key("joint of the effect; null for base parameters and effects of the arm")]
    told: Annotated[
        Literal["well", "hardly", "together", "no"],
        key("well or hardly determined; together: only in combination with others; no: not determined"),
    ]
    value: Annotated[float | None, key("estimate; null where it has none", "`unit`")]
    unit: Unit
    interval: Interval95
    inseparable_from: Inseparable = UNSET


class PromiseEntry(Document, frozen=True, kw_only=True):
    """How well a motion was to tell a parameter, and how well its recording does."""

    name: Annotated[str, key("base parameter, or effect@joint and parameter")]
    promised: Annotated[Literal["well", "hardly", "together", "no"], key("predicted, when the motion was designed")]
    told: Annotated[Literal["well", "hardly", "together", "no"], key("in this recording")]
    promised_width: Annotated[float | None, key("predicted width of the interval; null without one", "`unit`")]
    width: Annotated[float | None, key("width of the interval; null without one", "`unit`")]
    unit: Unit


class MissEntry(Document, frozen=True, kw_only=True):
    """Residual of a joint in the best fit."""

    joint: JointNumber
    part: Annotated[float, key("norm of the residual over that of the torque", "1")]


class InertiaEntry(Document, frozen=True, kw_only=True):
    """Inertia that a joint moves, on the average of the motion, where the model file leaves it open."""

    joint: JointNumber
    value: Annotated[float, key("fitted inertia", "`unit`")]
    unit: Unit


class TorqueEntry(Document, frozen=True, kw_only=True):
    """What recorded torques are: times the gear ratio, of the motor; at the link; commanded; without gravity."""

    kind: Annotated[Literal["motor", "link", "command", "gravity_compensated"], key("what they are taken for")]
    by: Annotated[str | None, key("who says so: --map, the file, a known log, the model file; null if nobody does")]


class DriveLawEntry(Document, frozen=True, kw_only=True):
    """A law of a joint's drive for which a recording has the columns."""

    joint: JointNumber
    law: Annotated[str, key("torque, where it is recorded, else `law` of [joint.drive]: current, voltage, pwm ...")]
    columns: Annotated[list[str], key("signals from which it makes the torque")]
    needs: Annotated[
        list[list[str]], key("keys of [joint.drive] that scale it, one list or the other; unknown gains are fitted")
    ]


class SuspicionEntry(Document, frozen=True, kw_only=True):
    """Something that looks wrong with the data."""

    joint: Annotated[int, key("number of the joint, from 1")]
    kind: Annotated[str, key("degrees, unit, sign, order, exchanged, field ...")]
    found: Annotated[str, key("what was found")]
    cure: Annotated[str, key("what was expected and what to do")]


class InspectDocument(Document, frozen=True, kw_only=True):
    """What is in a file and what looks wrong with it: `tendon inspect --json`."""

    file: Annotated[str, key("path of the file")]
    format: Annotated[str, key("its format, found by content")]
    fields: Annotated[list[FieldEntry], key("all fields of the file")]
    problem: Annotated[str | None, key("why it cannot be used as it is; null if it can")]
    suggested: Annotated[list[str], key("options that may read it")]
    notes: Annotated[list[str], key("what to know about how it was read")]
    clock: Annotated[ClockEntry | None, key("sampling; null where the file cannot be read")]
    clocks: Annotated[list[OtherClock], key("signals of other clocks")]
    signals: Annotated[list[SignalEntry], key("signals that were recorded throughout")]
    joints: Annotated[list[RecordedJoint], key("motion of each joint")]
    shifts: Annotated[list[ShiftEntry], key("signals that lag their position")]
    repeats: Annotated[RepeatsEntry | None, key("repeated motion; null without MODEL")]
    delay: Annotated[list[DelayEntry], key("delay from torque to motion of each joint; empty without MODEL")]
    parameters: Annotated[list[DeterminedParameter], key("parameters of MODEL and how well they are determined")]
    unfitted: Annotated[str | None, key("why the model could not be fitted; null if it was, or without MODEL")]
    misses: Annotated[list[MissEntry], key("residuals of the best fit; empty where the data look wrong")]
    unreliable: Annotated[str, key("why the fit is not to be believed; empty if it is")]
    inertias: Annotated[list[InertiaEntry], key("fitted inertias that the model file leaves open")]
    torque: Annotated[TorqueEntry | None, key("what the torques are taken for; null where the file cannot be read")]
    drive_laws: Annotated[list[DriveLawEntry], key("how its columns say what the torque is")]
    suspicions: Annotated[list[SuspicionEntry], key("what looks wrong")]
    cures: Annotated[list[str], key("all options that put it right")]
    promises: Annotated[
        list[PromiseEntry] | UnsetType, key("what the motion was to tell, with --promised; absent without")
    ] = UNSET
    provenance: Origin = UNSET


class SimulatedEffect(Document, frozen=True, kw_only=True):
    """An effect of the simulated arm."""

    effect: Annotated[str, key("name of the effect")]
    joint: JointOrArm
    hidden: Annotated[bool, key("whether the model file lacks it")]
    values: Annotated[dict[str, float], key("values of its parameters", "SI")]
    assumed: Annotated[list[str], key("parameters that the model file leaves open and that got moderate values")]


class AssumedNumber(Document, frozen=True, kw_only=True):
    """A number that the model file leaves out, and what was assumed for it."""

    joint: JointNumber
    name: JointName
    parameter: Annotated[str, key("key of the model file")]
    value: Annotated[float | None, key("the assumed value, at the joint's output; null: of several numbers", "`unit`")]
    unit: Annotated[str, key("unit of the value")]
    reason: Annotated[str, key("where it comes from")]


class SimulatedDrive(Document, frozen=True, kw_only=True):
    """A drive of which the command is recorded, and no torque."""

    joint: JointNumber
    law: Annotated[str, key("name of the law in the model file")]
    command: Annotated[str, key("the column at which the drive makes the joint's torque exactly")]


class SimulateDocument(Document, frozen=True, kw_only=True):
    """What a simulated recording holds: `tendon simulate --json`."""

    out: Annotated[str, key("path of the recording")]
    samples: Annotated[int, key("number of samples", "1")]
    seconds: Annotated[float, key("duration", "s")]
    seed: Annotated[int, key("seed of the noise")]
    effects: Annotated[list[SimulatedEffect], key("effects of the simulated arm")]
    drives: Annotated[list[SimulatedDrive], key("drives whose command is recorded in place of a torque")]
    assumed: Annotated[list[AssumedNumber], key("inertias that the model file leaves out")]
    provenance: Origin = UNSET


class ValuedEffect(EffectAt, frozen=True, kw_only=True):
    """An effect with the values at which it was simulated."""

    values: Annotated[dict[str, float], key("values of its parameters", "SI")]


class MovedJoint(Document, frozen=True, kw_only=True):
    """What a motion asks of a joint, and its limits."""

    joint: JointNumber
    name: JointName
    position: Annotated[Interval, key("smallest and largest position", "`position_unit`")]
    position_limits: Annotated[Interval, key("limits of the position", "`position_unit`")]
    position_stated: Annotated[bool, key("whether the model file states them; otherwise they are assumed")]
    position_unit: Annotated[str, key("unit of positions")]
    speed: Annotated[float, key("largest speed", "`position_unit`/s")]
    speed_limit: Annotated[float, key("limit of the speed", "`position_unit`/s")]
    speed_stated: Annotated[bool, key("whether the model file states it; otherwise it is assumed")]
    torque: Annotated[float, key("largest torque of the model", "`force_unit`")]
    torque_with_rivals: Annotated[float, key("largest torque with any of the rivals", "`force_unit`")]
    torque_limit: Annotated[float, key("limit of the torque", "`force_unit`")]
    torque_stated: Annotated[bool, key("whether the model file states it; otherwise it is assumed")]
    force_unit: Annotated[str, key("unit of torques")]


class ProposedMotion(Document, frozen=True, kw_only=True):
    """A motion and what it asks of the joints."""

    pieces: Annotated[list[str], key("what it consists of, in words")]
    times: Annotated[int, key("how often it is repeated", "1")]
    seconds: Annotated[float, key("duration", "s")]
    joints: Annotated[list[MovedJoint], key("what it asks of each joint")]


class AssumedNoise(Document, frozen=True, kw_only=True):
    """Noise of a joint in the simulated recordings."""

    joint: JointNumber
    torque: Annotated[float, key("standard deviation of the torque's noise", "N m or N")]
    floor: Annotated[float, key("noise floor in the band, rms", "N m or N")]


class SeparationEntry(Document, frozen=True, kw_only=True):
    """How far the torque of one rival is from what another one, or the model as it is, can explain."""

    hidden: Annotated[EffectAt, key("effect that acts")]
    explained_by: Annotated[EffectAt | None, key("effect that is fitted instead; null for the model as it is")]
    before: Annotated[float, key("unexplained torque in the ordinary excitation, rms", "noise floors")]
    after: Annotated[float, key("unexplained torque in this motion, rms", "noise floors")]
    sigmas_before: Annotated[float, key("the same in standard deviations, in the ordinary excitation", "1")]
    sigmas_after: Annotated[float, key("the same in standard deviations, in this motion", "1")]


class TrialDiagnosis(Document, frozen=True, kw_only=True):
    """Diagnosis of a simulated recording."""

    hidden: Annotated[EffectAt | None, key("effect that was simulated; null for none")]
    seed: Annotated[int, key("seed of the noise")]
    verdict: Annotated[str, key("verdict of the diagnosis")]
    named: Annotated[list[EffectAt], key("findings")]
    rivals: Annotated[list[EffectAt], key("rivals of the first finding")]
    right: Annotated[bool, key("whether the simulated effect was named and separated from its rivals")]
    problem: Annotated[str | None, key("what is wrong with the answer; null if it is right")]


class ReliefEntry(Document, frozen=True, kw_only=True):
    """A change that could separate the rivals where no motion does."""

    change: Annotated[str, key("a sensor, or wider limits")]
    sigmas: Annotated[float, key("smallest separation with it, in standard deviations", "1")]
    enough: Annotated[bool, key("whether that is enough")]


class ProposalDocument(Document, frozen=True, kw_only=True):
    """A motion that separates effects."""

    separated: Annotated[bool, key("whether every simulated diagnosis is right")]
    reason: Annotated[str, key("the answer in one sentence")]
    rivals: Annotated[list[ValuedEffect], key("effects to separate")]
    motion: Annotated[ProposedMotion, key("the motion")]
    noise: Annotated[list[AssumedNoise], key("noise of each joint")]
    band: Annotated[BandEntry, key("frequency band of the comparison")]
    separations: Annotated[list[SeparationEntry], key("separation of each pair")]
    trials: Annotated[list[TrialDiagnosis], key("diagnoses of this motion")]
    ordinary_trials: Annotated[list[TrialDiagnosis], key("diagnoses of the ordinary excitation")]
    relief: Annotated[list[ReliefEntry], key("changes that could separate the rivals; empty if they are separated")]
    search: Annotated[IterationsEntry, key("how far the search came: simulated diagnoses, and wider limits judged")]


class ExperimentDocument(ProposalDocument, frozen=True, kw_only=True):
    """The motion that separates effects: `tendon experiment --json`."""

    out: Annotated[str | None, key("file of the motion; null if none was written")]
