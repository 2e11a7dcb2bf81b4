"""What the page shows of a step and of its diagnosis: documents that are written as JSON as they stand.

Names, sentences and numbers with their units are text; nothing in them is HTML.
"""

from __future__ import annotations

from typing import Any, TypedDict

Row = dict[str, Any]
"""A row of the report: see runtime/report/page/page_findings.py for its keys."""


class Cure(TypedDict):
    """Something that looks wrong with a recording, and what puts it right: entries of `--map`, or splitting at gaps.

    Without either, a person must decide.
    """

    said: str
    maps: list[str]
    gaps: bool


class JointShown(TypedDict):
    """A joint: what is left of its torque, and over which signals that is structured, with their shares.

    instruments      the noise of torque and encoder alone, part of the torque; the floor may hold more than that
    signals, held    names of its signal sets for /data: of what was fitted, None where it never moves, and of what was
                     held out, None where nothing was
    """

    joint: int
    called: str
    unit: str
    position_unit: str
    rms: float
    relative: float
    floor: float
    instruments: float
    floor_source: str
    floors: float | None
    at_floor: bool
    repeatable: bool | None
    structure: list[tuple[str, float]]
    signals: str | None
    held: str | None


class ParameterRange(TypedDict):
    """Between which values a parameter may be tried; None: not known."""

    name: str
    value: float | None
    low: float | None
    high: float | None


class StepShown(TypedDict):
    """A fitted model.

    sentence   where it fails
    active     effects in the model, each with joint and what its fit says: {effect, joint, parameters: rows, ranges:
               of ParameterRange, for Studio.try_values}
    inertial   rows of page_parameters.inertial
    arm        picture of arm_motion, its data as an object; None where the model file does not say how the arm looks
    cures      what of the recordings must be put right before anything can be said
    warnings   what a user should know before trusting the fit
    band, skew in words
    """

    number: int
    sentence: str
    joints: list[JointShown]
    active: list[Row]
    inertial: list[Row]
    arm: Row | None
    cures: list[Cure]
    warnings: list[str]
    band: str
    skew: str


class VerdictShown(TypedDict):
    """A diagnosis.

    kind        "effect", "more" (an effect, and more is left), "clean", "unexplained" or "refused"; tag: in words
    sentence    the verdict in one sentence; more: what is to be added to it, or ""
    findings    cards: rows of page_findings.card, with effect, joint, shows_at (a joint, 1-based), ranges as of an
                active effect, and rival_terms, each {effect, joint}, for Studio.add and the like
    ruled_out, limits, left_over, to_record, experiments   as in the report
    sensors     sentences
    commands    [{what, command}] that go on from here in a terminal
    """

    kind: str
    tag: str
    sentence: str
    more: str
    findings: list[Row]
    ruled_out: Row
    limits: list[Row]
    left_over: list[Row]
    to_record: list[Row]
    experiments: list[Row]
    sensors: list[str]
    warnings: list[str]
    commands: list[Row]


class RecordingShown(TypedDict):
    """A recording that was given: what `tendon inspect --json` says of it, and its raw signals' sets, one a joint.

    problem     why it cannot be used as it is; None if it can
    """

    name: str
    held_out: bool
    inspection: Row
    problem: str | None
    cures: list[Cure]
    signals: list[str]


class PlanShown(TypedDict):
    """A plan that was opened: the name of its file, and in one sentence what the motion costs."""

    name: str
    headline: str


class JointTried(TypedDict):
    """What is left of a joint's torque with other values, and relative with those that were fitted."""

    joint: int
    rms: float
    relative: float
    fitted: float
    signals: str


class TriedShown(TypedDict):
    """What a step's model would leave with other values of an effect."""

    effect: str
    joint: int | None
    values: dict[str, float]
    joints: list[JointTried]


class HiddenShown(TypedDict):
    """Whether an effect of these values would be seen in the motion that was recorded.

    problem   what is wrong with the answer, in words; None where the effect is named and told from all others
    noise     of the torque that was added, part of its rms; reason: what the diagnosis said
    """

    effect: str
    joint: int | None
    values: dict[str, float]
    seen: bool
    problem: str | None
    noise: float
    reason: str


class EffectOffered(TypedDict):
    """An effect of the library that may be added: at which joints, or to the whole arm (None)."""

    effect: str
    family: str
    summary: str
    equation: str
    places: list[int | None]
