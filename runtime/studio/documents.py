"""Documents of a session, as JSON: what the page shows of a recording, a step, its diagnosis and further questions.

Names, sentences and numbers with their units are text; nothing in them is HTML.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

import msgspec

from runtime.documents.parts import Document
from runtime.documents.recordings import ClockEntry
from runtime.documents.replays import ReplayStep
from runtime.report.sections import Group, Section
from runtime.studio.history import JointError, PlacedEffect, SessionStep, Verdict
from runtime.studio.session import read
from runtime.studio.settings import MOST_DOCUMENTS

T = TypeVar("T")

Row = dict[str, Any]
"""A row of the report: runtime/report/page has its keys."""


class Cure(Document, frozen=True, kw_only=True):
    """Something that looks wrong with recordings, and its cure.

    said       what looks wrong
    does       what the cure does, as a command to the program; "" where a person has to decide
    readings   recording by its name in `given/` -> entries of `--map` that take the place of earlier ones
    gaps       whether these recordings are to be split at their gaps
    """

    said: str
    does: str = ""
    readings: dict[str, tuple[str, ...]] = msgspec.field(default_factory=dict)
    gaps: bool = False


class ColumnOverview(Document, frozen=True, kw_only=True):
    """A column of a file, in the unit of the file; least and largest are None where it is none of numbers.

    first     its first values
    outline   least and largest value in each of a few parts of the file, in their order
    """

    name: str
    first: list[float]
    least: float | None
    largest: float | None
    outline: list[tuple[float, float]]


class RecordingOverview(Document, frozen=True, kw_only=True):
    """A recording that was read.

    clock     its sampling; None where the file cannot be read
    problem   why it cannot be used as it is; None if it can
    cells     signal -> its column, as entries of `--map` name it
    guesses   the same, as the names of the columns suggest
    ratios    of the gear of each joint whose torque constant is not known, by its number
    needed    signals that a recording must have
    units     every signal of the arm, those that are needed first -> usual units, the one of SI first
    signals   names of the signal sets of its raw signals for /data, one a joint
    """

    clock: ClockEntry | None
    problem: str | None
    cures: list[Cure]
    cells: dict[str, str]
    guesses: dict[str, str]
    ratios: dict[int, float]
    needed: list[str]
    units: dict[str, tuple[str, ...]]
    signals: list[str]


class JointOverview(JointError, frozen=True, kw_only=True):
    """A joint: its residual and the signals that this follows.

    instruments      noise of torque and encoder alone, part of the torque's rms; the floor may hold more than that
    structure        signals, and the share of the residual's variance that each explains
    signals, held    names of its signal sets for /data, fitted (None if it never moves) and held out (None without)
    """

    instruments: float
    at_floor: bool
    structure: list[tuple[str, float]]
    signals: str | None
    held_signals: str | None


class ParameterRange(Document, frozen=True, kw_only=True):
    """The range in which a parameter may be tried; None: not known."""

    name: str
    unit: str
    value: float | None
    low: float | None
    high: float | None

    @property
    def movable(self) -> bool:
        """Whether there is a range of values."""
        return None not in (self.value, self.low, self.high) and (self.high or 0.0) > (self.low or 0.0)


class EffectOverview(Document, frozen=True, kw_only=True):
    """An effect of a model or of a finding.

    values   of its parameters as fitted, in words
    """

    placed: PlacedEffect
    values: str
    ranges: list[ParameterRange]


class StepOverview(Document, frozen=True, kw_only=True):
    """A fitted model.

    sentence   where it fails
    active     the effects in the model
    arm        holes of the report's picture of the arm; None where the model file does not say how the arm looks
    cures      what of the recordings must be put right before a verdict is possible
    """

    sentence: str
    joints: list[JointOverview]
    active: list[EffectOverview]
    arm: Row | None
    cures: list[Cure]


class FindingOverview(EffectOverview, frozen=True, kw_only=True):
    """An effect that a diagnosis names.

    title      effect and joint, in words         card   sections of the report
    shows_at   the joint (1-based) whose residual shows it
    rivals     effects that the data cannot distinguish from it
    """

    title: str
    shows_at: int
    rivals: list[PlacedEffect]
    card: list[Section]


class VerdictOverview(Document, frozen=True, kw_only=True):
    """A diagnosis.

    kind          "effect", "more" (an effect, and a residual above the noise), "clean", "unexplained" or "refused"
    tag           the kind in words
    sentence      the verdict in one sentence; more: a second one, or ""
    unexplained   joints (from 1) whose residual nothing explains
    details       sections of the report, as the detection limits; the page links to those that have a name
    """

    kind: str
    tag: str
    sentence: str
    more: str
    findings: list[FindingOverview]
    unexplained: list[int]
    details: list[Group]


class ValuesFound(Document, frozen=True, kw_only=True):
    """Values of an effect that a diagnosis names: the fit of a model with it starts from them."""

    placed: PlacedEffect
    values: dict[str, float | None]


class JointAnswer(Document, frozen=True, kw_only=True):
    """The error of a joint with other values, and relative with the fitted ones."""

    joint: int
    rms: float
    relative: float
    fitted: float
    signals: str


class ValuesAnswer(Document, frozen=True, kw_only=True):
    """The errors of a step's model with other values of an effect."""

    placed: PlacedEffect
    values: dict[str, float]
    joints: list[JointAnswer]


class HiddenEffectAnswer(Document, frozen=True, kw_only=True):
    """Whether a diagnosis would name an effect of these values in the recorded motion.

    problem   what is wrong with that diagnosis; None where it names the effect and distinguishes it from all others
    noise     of the simulated torque, part of its rms
    """

    placed: PlacedEffect
    values: dict[str, float]
    seen: bool
    problem: str | None
    noise: float


class DesignedMotion(Document, frozen=True, kw_only=True):
    """A motion: its duration, s, and of what it consists, in words."""

    seconds: float
    pieces: list[str]


class MotionAnswer(Document, frozen=True, kw_only=True):
    """The motion that distinguishes effects: of the keys of `tendon experiment --json` those that the page shows."""

    reason: str
    motion: DesignedMotion


class ReplayAnswer(Document, frozen=True, kw_only=True):
    """How far the motion of a step's model is off, beside that of the step before, and the arm in motion."""

    steps: list[ReplayStep]
    arm: Row | None


class EffectOffered(Document, frozen=True, kw_only=True):
    """An effect of the library that may be added, and its places: joints, or the whole arm (None)."""

    effect: str
    title: str
    summary: str
    equation: str
    places: list[int | None]


class PlanOverview(Document, frozen=True, kw_only=True):
    """A trajectory that was opened: the name of its file, and the cost of its motion in one sentence."""

    name: str
    headline: str


class TaskResult(Document, frozen=True, kw_only=True):
    """What a task has written into the session's work folder.

    steps      new steps, whose folders are `work/step5` ...
    answered   the step whose folder takes the files of `work/answer`; verdict: of its diagnosis
    plans      number of plans in `work/plan0` ...
    """

    steps: tuple[SessionStep, ...] = ()
    answered: int | None = None
    verdict: Verdict | None = None
    plans: int = 0


def document(path: Path, kind: type[T]) -> T | None:
    """A document of a session; None where there is none. Raises SessionError where it is not of that kind."""
    return cast(T, _read(path, path.stat().st_mtime_ns, cast(Any, kind))) if path.is_file() else None


@lru_cache(maxsize=MOST_DOCUMENTS)
def _read(path: Path, _changed: int, kind: Any) -> Any:
    return read(path, kind)
