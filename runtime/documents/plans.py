"""Documents of motions: optimize, execute and sweep."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, UnsetType

from runtime.documents.diagnosis import CommandEntry
from runtime.documents.parts import (
    Document,
    EffectAt,
    Interval,
    IterationsEntry,
    JointName,
    JointNumber,
    key,
)
from runtime.documents.provenance import Origin

ArmName = Annotated[str, key("name of the arm's model")]
ScenarioName = Annotated[str, key("name of the scenario")]
Goal = Annotated[str, key("torque_squared, peak_torque, electrical_energy or positive_work")]
Friction = Annotated[bool, key("whether the motion was planned with friction")]
PositionUnit = Annotated[str, key("rad or m")]
ForceUnit = Annotated[str, key("N m or N")]
Series = list[list[float | None]]
EachCost = Annotated[list[float], key("integral of the squared torque of each joint", "(N m)^2 s or N^2 s")]
Total = Annotated[float, key("sum over the joints", "(N m)^2 s or N^2 s")]
SpringValues = dict[str, float | int | str]
"""Of a spring: `joint`, values of its parameters by name (SI), and further keys."""


# --- optimize ---


class ObjectiveEntry(Document, frozen=True, kw_only=True):
    """The objective of a plan."""

    goal: Goal
    joints: Annotated[list[int], key("numbers of the joints whose torque counts")]
    unit: Annotated[str, key("unit of the values")]
    value: Annotated[float, key("objective by the exact laws", "`unit`")]
    smooth: Annotated[float, key("objective of the program, smooth at standstill", "`unit`")]
    without_springs: Annotated[
        float | UnsetType | None,
        key("of the best motion without the springs, where springs are planned; null: there is none", "`unit`"),
    ] = UNSET


class PlanLimitsEntry(Document, frozen=True, kw_only=True):
    """Limits of a joint; null where there are none."""

    position: Annotated[Interval | None, key("smallest and largest position", "rad or m")]
    speed: Annotated[float | None, key("largest speed", "rad/s or m/s")]
    torque: Annotated[float | None, key("largest torque or force", "N m or N")]


class JointUnitsEntry(Document, frozen=True, kw_only=True):
    """Units of a joint."""

    position: PositionUnit
    force: ForceUnit


class PlannedJointEntry(Document, frozen=True, kw_only=True):
    """A joint in a plan, and its limits."""

    joint: JointNumber
    name: JointName
    cost: Annotated[float, key("integral of the squared torque", "(N m)^2 s or N^2 s")]
    peak_torque: Annotated[float, key("largest torque or force", "N m or N")]
    peak_speed: Annotated[float, key("largest speed", "rad/s or m/s")]
    range: Annotated[Interval, key("smallest and largest position", "rad or m")]
    limits: Annotated[PlanLimitsEntry, key("limits of the model file, and the scenario's range of positions")]
    units: Annotated[JointUnitsEntry, key("units of the joint")]


class PhaseEntry(Document, frozen=True, kw_only=True, rename={"start": "from", "end": "to"}):
    """A phase of a motion."""

    start: Annotated[str | UnsetType, key("point where it begins; absent if the scenario is unknown")] = UNSET
    end: Annotated[str | UnsetType, key("point where it ends; absent if the scenario is unknown")] = UNSET
    kind: Annotated[str, key("free or contact")]
    duration: Annotated[float, key("its duration", "s")]


class PolynomialEntry(Document, frozen=True, kw_only=True):
    """A phase of a trajectory file: Bezier polynomials, (9)."""

    coordinates: Annotated[Literal["q", "w"], key("q: joint positions; w: coordinates of the contact")]
    duration: Annotated[float, key("its duration", "s")]
    points: Annotated[list[list[float]], key("control points, a row per coordinate", "rad or m")]


class TrajectoryDocument(Document, frozen=True, kw_only=True):
    """A trajectory file."""

    format: Annotated[str, key("name and version of the format")]
    arm: ArmName
    scenario: ScenarioName
    periodic: Annotated[bool, key("whether the end is the beginning")]
    elbow: Annotated[float, key("sign of sin q_2 in contact", "1")]
    friction: Friction
    springs: Annotated[list[SpringValues], key("joint and parameters of each spring by name", "SI")]
    contact: Annotated[dict[str, dict[str, float]], key("parameters of the contact's effects by name", "SI")]
    phases: Annotated[list[PolynomialEntry], key("phases in their order")]


class SamplesEntry(Document, frozen=True, kw_only=True):
    """One cycle in even samples, a row per joint."""

    t: Annotated[list[float], key("time", "s")]
    q: Annotated[Series, key("position", "rad or m")]
    qd: Annotated[Series, key("speed", "rad/s or m/s")]
    qdd: Annotated[Series, key("acceleration", "rad/s^2 or m/s^2")]
    tau: Annotated[Series, key("motor torque or force", "N m or N")]
    spring: Annotated[Series, key("torque with which springs push the joint forward", "N m or N")]
    tip: Annotated[Series, key("place of the end-effector: x, y and its angle; in space x, y, z", "m, rad")]
    tip_rotation: Annotated[
        list[Series] | UnsetType, key("spatial arms: rotation matrix of the tip's frame, row by row", "1")
    ] = UNSET


class AttemptEntry(Document, frozen=True, kw_only=True):
    """A solution of the search."""

    cost: Annotated[float | None, key("objective of the smooth program", "unit of the objective")]
    met: Annotated[bool, key("whether all constraints are met")]
    status: Annotated[str, key("status of the solver")]
    iterations: Annotated[int, key("number of iterations", "1")]
    seconds: Annotated[float, key("time of computation", "s")]
    missed: Annotated[str | None, key("the constraint that is violated most; null if all are met")]


class FailedSearchEntry(Document, frozen=True, kw_only=True):
    """A search that found no plan."""

    attempts: Annotated[list[AttemptEntry], key("coarse solutions, the best first")]


class SolverEntry(FailedSearchEntry, frozen=True, kw_only=True):
    """The search for a plan."""

    refined: Annotated[AttemptEntry, key("the best one on the fine program")]
    setup_seconds: Annotated[float, key("time to derive the programs", "s")]
    seconds: Annotated[float, key("time in total", "s")]


class ViolationEntry(Document, frozen=True, kw_only=True):
    """The constraint that is violated most."""

    where: Annotated[str, key("place in the motion")]
    what: Annotated[str, key("what it constrains")]
    amount: Annotated[float | None, key("violation", "`unit`")]
    unit: Annotated[str, key("unit of the violation")]


class MotionDocument(Document, frozen=True, kw_only=True):
    """A planned motion as its trajectory file has it."""

    scenario: ScenarioName
    arm: ArmName
    cycle_time: Annotated[float, key("duration of the motion", "s")]
    friction: Friction
    joints: Annotated[list[PlannedJointEntry], key("each joint")]
    phases: Annotated[list[PhaseEntry], key("phases in their order")]
    springs: Annotated[
        list[SpringValues],
        key("joint, effect and parameters (SI) of each spring; sought: size before one was chosen, in `unit`; text"),
    ]
    samples: Annotated[SamplesEntry, key("one cycle in samples")]


class OptimizeDocument(MotionDocument, frozen=True, kw_only=True):
    """A planned motion: `tendon optimize --json`."""

    feasible: Annotated[Literal[True], key("whether there is a plan")] = True
    objective: Annotated[ObjectiveEntry, key("what is minimal")]
    catalogue: Annotated[
        list[dict[str, dict[str, float] | float | None]],
        key("springs compared, the best first: sizes by joint under the name of the parameter, and cost"),
    ]
    trajectory: Annotated[TrajectoryDocument, key("the motion as --out writes it")]
    solver: Annotated[SolverEntry, key("the search")]
    search: Annotated[IterationsEntry, key("how many of its solver's iterations it took, with and without springs")]
    left_out: Annotated[dict[str, str], key("effects that a plan cannot hold, and why")]
    warnings: Annotated[list[str], key("what to know before the plan is used")]
    provenance: Origin = UNSET


class InfeasibleDocument(Document, frozen=True, kw_only=True):
    """Why there is no plan: `tendon optimize --json`, with exit status 1."""

    scenario: ScenarioName
    arm: ArmName
    feasible: Annotated[Literal[False], key("whether there is a plan")] = False
    reason: Annotated[str, key("why there is no plan")]
    missed: Annotated[ViolationEntry, key("what the best attempt violates")]
    solver: Annotated[FailedSearchEntry, key("the search")]
    search: Annotated[IterationsEntry, key("how many of its solver's iterations it took")]
    provenance: Origin = UNSET


# --- execute ---


class ArmEffectEntry(EffectAt, frozen=True, kw_only=True):
    """An effect of the arm that moved."""

    hidden: Annotated[bool, key("whether the model does not have it")]
    changed: Annotated[bool, key("whether the model has other values")]
    values: Annotated[dict[str, float], key("its parameters by name", "SI")]


class ExcessEntry(Document, frozen=True, kw_only=True):
    """A limit that the plan exceeds."""

    what: Annotated[str, key("position, speed or torque")]
    joint: JointNumber
    t: Annotated[float, key("time of the largest excess", "s")]
    value: Annotated[float, key("value then", "`unit`")]
    limit: Annotated[float, key("limit", "`unit`")]
    unit: Annotated[str, key("unit of the values")]
    text: Annotated[str, key("the same in a sentence")]


class ExecutedJointEntry(Document, frozen=True, kw_only=True):
    """A joint of the arm."""

    joint: JointNumber
    name: JointName
    position_unit: PositionUnit
    force_unit: ForceUnit


class ModelledCostEntry(Document, frozen=True, kw_only=True):
    """Cost of the plan with all that the model contains."""

    cost: EachCost
    total: Total


class CycleOfPlanEntry(Document, frozen=True, kw_only=True):
    """One cycle as planned; lists have a number per joint."""

    scenario: ScenarioName
    duration: Annotated[float, key("duration of a cycle", "s")]
    periodic: Annotated[bool, key("whether the motion is periodic")]
    friction: Friction
    cost: EachCost
    total: Total
    modelled: Annotated[ModelledCostEntry, key("cost with all that the model contains")]
    peak_torque: Annotated[list[float], key("largest torque or force", "N m or N")]
    q_min: Annotated[list[float], key("smallest position", "rad or m")]
    q_max: Annotated[list[float], key("largest position", "rad or m")]
    tip_y: Annotated[float, key("smallest y of the end-effector", "m")]
    compression: Annotated[float | None, key("largest compression of the plate; null without one", "m")]


class CycleEntry(Document, frozen=True, kw_only=True):
    """One executed cycle, or a mean or standard deviation of cycles; lists have a number per joint."""

    cost: EachCost
    tracking_rms: Annotated[list[float], key("rms of the tracking error", "rad or m")]
    tracking_max: Annotated[list[float], key("largest tracking error", "rad or m")]
    q_min: Annotated[list[float], key("smallest position", "rad or m")]
    q_max: Annotated[list[float], key("largest position", "rad or m")]
    peak_torque: Annotated[list[float], key("largest commanded torque or force", "N m or N")]
    tip_y: Annotated[float, key("smallest y of the end-effector", "m")]
    saturated: Annotated[float, key("part of the time at a torque limit", "1")]
    total: Total
    compression: Annotated[float | None, key("largest compression of the plate; null without one", "m")]


class StopEntry(Document, frozen=True, kw_only=True):
    """A safe stop."""

    t: Annotated[float, key("time since the trial began", "s")]
    joint: Annotated[int | None, key("number of the joint, from 1; null for the whole arm")]
    reason: Annotated[str, key("why, with the measured value and the limit")]
    name: Annotated[str, key("name of the reason")]


class WatchedEntry(Document, frozen=True, kw_only=True):
    """What the board's monitor says of a joint's model at the end of a trial."""

    joint: Annotated[int, key("its number, from 1")]
    verdict: Annotated[str, key("holds, drifts or broken")]
    signal: Annotated[str, key("which the residual follows: velocity, position, acceleration, load or none")]
    since: Annotated[float | None, key("time from which on the model did not hold; null if it holds", "s")]


class TrialEntry(Document, frozen=True, kw_only=True):
    """One execution from rest."""

    trial: Annotated[int, key("its number, from 1")]
    seconds: Annotated[float, key("its duration", "s")]
    stop: Annotated[StopEntry | None, key("what stopped it; null if it was completed")]
    cycles: Annotated[list[CycleEntry], key("cycles after the run-in")]
    watched: Annotated[list[WatchedEntry] | UnsetType, key("with [monitor]: what the board says of each joint")] = UNSET


class ImageEntry(Document, frozen=True, kw_only=True):
    """The firmware image of an emulated board."""

    target: Annotated[str, key("its processor")]
    compiler: Annotated[str, key("its compiler")]
    text: Annotated[int, key("size of code and constants", "bytes")]


class PredictedJointEntry(Document, frozen=True, kw_only=True):
    """A joint of the simulated arm in the same motion, beside its limits."""

    joint: JointNumber
    name: JointName
    torque: Annotated[float, key("largest torque or force", "N m or N")]
    torque_limit: Annotated[float, key("limit", "N m or N")]
    force_unit: ForceUnit
    speed: Annotated[float, key("largest speed", "rad/s or m/s")]
    speed_limit: Annotated[float, key("limit", "rad/s or m/s")]
    room: Annotated[float, key("smallest distance to an end of its range", "rad or m")]
    position_unit: PositionUnit


class PredictionEntry(Document, frozen=True, kw_only=True):
    """The same motion on the simulated arm, before a real arm moves."""

    joints: Annotated[list[PredictedJointEntry], key("each joint")]
    plate: Annotated[
        float | None, key("smallest height of the end-effector above the plate; negative if pressed; null without", "m")
    ]


class StandingEntry(Document, frozen=True, kw_only=True):
    """Where a joint stands."""

    joint: JointNumber
    name: JointName
    position: Annotated[float, key("its position", "rad or m")]
    start: Annotated[float, key("where the trajectory starts", "rad or m")]
    position_unit: PositionUnit


class BoardEntry(Document, frozen=True, kw_only=True):
    """What the board reports before anything moves."""

    standing: Annotated[list[StandingEntry] | None, key("each joint; null if that is unknown")]
    text: Annotated[str | None, key("why that is unknown")]


class LinkEntry(Document, frozen=True, kw_only=True):
    """Frames of the link to the board."""

    damaged: Annotated[dict[str, int], key("damaged frames that arrived here, by kind", "1")]
    board: Annotated[dict[str, int] | None, key("the board's own counts by kind; null if it sent none", "1")]


class DrivesEntry(Document, frozen=True, kw_only=True):
    """Drives on a CAN bus; lists have a number per joint."""

    channel: Annotated[str, key("name of the bus")]
    bitrate: Annotated[int, key("bit rate", "bit/s")]
    load: Annotated[float, key("part of the bus that the frames fill", "1")]
    late_rms: Annotated[float, key("rms delay of the control periods", "s")]
    late_worst: Annotated[float, key("largest delay", "s")]
    overruns: Annotated[int, key("number of periods left out", "1")]
    missed_answers: Annotated[int, key("number of answers late or missing", "1")]
    resolution: Annotated[list[float], key("step of the commanded torque", "N m or N")]
    largest_torque: Annotated[list[float], key("largest torque that can be commanded", "N m or N")]
    limited_by_drive: Annotated[list[int], key("number of periods in which the drive limited the torque", "1")]
    real_time: Annotated[bool, key("whether this process has real-time priority")]


class PlayedEntry(Document, frozen=True, kw_only=True):
    """A motion's file as it was executed."""

    samples: Annotated[int, key("number of samples", "1")]
    rate: Annotated[float, key("rate of the samples as they were played", "Hz")]
    controller_rate: Annotated[float, key("rate of the controller", "Hz")]
    seconds: Annotated[float, key("length as it was played", "s")]
    phases: Annotated[int, key("polynomials a joint", "1")]


class ExecuteDocument(Document, frozen=True, kw_only=True):
    """An executed motion: `tendon execute --json`. Keys of the target are absent where they do not apply."""

    on: Annotated[str | UnsetType, key("the target of --on")] = UNSET
    provenance: Origin = UNSET
    arm: ArmName
    speed: Annotated[float, key("pace at which the motion was executed; 1: as planned", "1")] = 1.0
    unchecked: Annotated[list[str], key("motion file: what nothing keeps the arm from, sentences")] = []  # noqa: RUF012
    played: Annotated[PlayedEntry | UnsetType, key("motion file: its samples and the polynomials through them")] = UNSET
    period: Annotated[float, key("time between records, by the model file", "s")]
    period_measured: Annotated[float | None, key("the same by the board's clock; null without records", "s")]
    friction_compensation: Annotated[bool, key("whether the controller compensates friction")]
    uncompensated: Annotated[list[str], key("effects of the model that the controller does not compensate")]
    run_in: Annotated[int, key("cycles before those that count", "1")]
    seed: Annotated[int, key("seed of the noise")]
    noise: Annotated[float, key("noise of the torque sensor, as a part of each joint's rms torque", "1")]
    effects: Annotated[list[ArmEffectEntry], key("effects of the arm that moved")]
    exceeded: Annotated[list[ExcessEntry], key("limits that the plan exceeds")]
    status: Annotated[Literal["done", "stopped", "refused"], key("done, stopped, or refused before any motion")]
    reason: Annotated[str | None, key("why it was stopped or refused; null if done")]
    joints: Annotated[list[ExecutedJointEntry], key("each joint")]
    plan: Annotated[CycleOfPlanEntry, key("one cycle as planned")]
    trials: Annotated[list[TrialEntry], key("executions from rest")]
    mean: Annotated[CycleEntry | None, key("mean over all cycles of all trials; null without any")]
    spread: Annotated[CycleEntry | None, key("standard deviation over them; null for fewer than two")]
    image: Annotated[ImageEntry | UnsetType | None, key("simulated arm: firmware image; null on this computer")] = UNSET
    prediction: Annotated[PredictionEntry | UnsetType, key("real arm: the same motion, simulated")] = UNSET
    board: Annotated[BoardEntry | UnsetType, key("real arm without --arm: what the board reports")] = UNSET
    every: Annotated[int | UnsetType, key("real arm: control periods per record", "1")] = UNSET
    link: Annotated[LinkEntry | UnsetType, key("real arm: frames of the link")] = UNSET
    drives: Annotated[DrivesEntry | UnsetType, key("CANopen: the drives")] = UNSET
    recording: Annotated[str | UnsetType | None, key("path of the recording; null if none was written")] = UNSET
    model_out: Annotated[str | UnsetType | None, key("path of the model file; null if none was written")] = UNSET
    statistics: Annotated[str | UnsetType | None, key("path of what the board added up; null if it sent none")] = UNSET
    next: Annotated[list[CommandEntry] | UnsetType, key("commands that follow")] = UNSET


# --- sweep ---


class VariationEntry(Document, frozen=True, kw_only=True):
    """A variation of the scenario over all its seeds. Costs are null without a plan."""

    at: Annotated[dict[str, float | str | None], key("what varies, by name; null where it does not apply")]
    jobs: Annotated[int, key("number of jobs", "1")]
    feasible: Annotated[int, key("jobs with a plan", "1")]
    infeasible: Annotated[int, key("jobs without a plan", "1")]
    failed: Annotated[int, key("jobs that failed", "1")]
    best: Annotated[float | None, key("lowest cost", "unit of the objective")]
    median: Annotated[float | None, key("median cost", "unit of the objective")]
    worst: Annotated[float | None, key("highest cost", "unit of the objective")]
    close: Annotated[float | None, key("part of the jobs within 1 % of the best cost", "1")]
    seed: Annotated[int | None, key("seed of the best plan")]
    springs: Annotated[
        list[SpringValues], key("joint, sought parameters and unit of the size of the best plan's springs")
    ]
    reason: Annotated[str | None, key("most frequent reason for no plan; null if all have one")]


class SweepDocument(Document, frozen=True, kw_only=True):
    """Variations of a scenario: `tendon sweep --json`."""

    scenario: ScenarioName
    arm: ArmName
    goal: Goal
    over: Annotated[dict[str, list[float | str]], key("values of what varies, by name")]
    jobs: Annotated[int, key("number of jobs", "1")]
    found_finished: Annotated[int, key("jobs finished by an earlier call", "1")]
    seconds: Annotated[float, key("time of this call", "s")]
    table: Annotated[str, key("path of the table")]
    journal: Annotated[str, key("path of the journal")]
    variations: Annotated[list[VariationEntry], key("each variation")]
