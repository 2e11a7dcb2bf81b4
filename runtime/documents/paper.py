"""The document of the paper's study: Tables I to III and Figure 5, beside what is computed here."""

from __future__ import annotations

from typing import Annotated

from msgspec import UNSET, UnsetType

from runtime.documents.parts import BandEntry, Document, Interval, JointNumber, SkewEntry, key
from runtime.documents.plans import ArmEffectEntry, CycleEntry


class ClaimEntry(Document, frozen=True, kw_only=True):
    """A statement of the paper."""

    text: Annotated[str, key("the statement")]
    paper: Annotated[str, key("its figures in the paper")]
    ours: Annotated[str, key("its figures here")]
    holds: Annotated[bool, key("whether it holds here")]
    unclaimed: Annotated[str, key("why it is not expected to hold here; empty if it is")]


class RecoveredEntry(Document, frozen=True, kw_only=True):
    """A parameter of Table I."""

    joint: JointNumber
    name: Annotated[str, key("column of the table")]
    unit: Annotated[str, key("unit of the values")]
    paper: Annotated[float, key("printed value", "`unit`")]
    ours: Annotated[float | None, key("identified value", "`unit`")]
    interval: Annotated[Interval | None, key("95 % confidence interval", "`unit`")]
    difference: Annotated[float | None, key("relative to the printed value", "1")]
    within_precision: Annotated[bool, key("whether they are equal to the printed precision")]
    within_interval: Annotated[bool, key("whether the interval contains the printed value")]
    met: Annotated[bool, key("whether either holds")]


class CosineEntry(Document, frozen=True, kw_only=True):
    """A motion of the identification experiment, (5)."""

    speed: Annotated[float, key("largest desired speed", "rad/s")]
    omega: Annotated[float, key("angular frequency", "rad/s")]
    reached: Annotated[float, key("largest speed reached", "rad/s")]
    trials: Annotated[int, key("number of trials", "1")]


class Table1JointEntry(Document, frozen=True, kw_only=True):
    """Friction of a joint."""

    joint: JointNumber
    cosines: Annotated[list[CosineEntry], key("its motions")]
    band: Annotated[BandEntry, key("frequency band of the fit")]
    skew: Annotated[SkewEntry, key("offset between the clocks of torque and motion")]
    parameters: Annotated[list[RecoveredEntry], key("its parameters")]


class Table1Published(Document, frozen=True, kw_only=True):
    """What the paper prints of the experiment."""

    speeds: Annotated[list[list[float]], key("largest speeds of the cosines, by joint", "rad/s")]
    precision: Annotated[float, key("half a unit of the last printed digit", "1")]


class Table1Assumed(Document, frozen=True, kw_only=True):
    """What the paper does not print of the experiment."""

    amplitude: Annotated[float, key("amplitude of the cosines", "rad")]
    start: Annotated[float, key("their lowest position", "rad")]


class Table1Entry(Document, frozen=True, kw_only=True):
    """Table I: friction that is identified."""

    published: Annotated[Table1Published, key("what is printed")]
    assumed: Annotated[Table1Assumed, key("what is assumed")]
    joints: Annotated[list[Table1JointEntry], key("each joint")]
    claims: Annotated[list[ClaimEntry], key("the paper's statements")]


class BesideEntry(Document, frozen=True, kw_only=True):
    """A cost beside the paper's."""

    ours: Annotated[float, key("cost here", "N^2 m^2 s")]
    paper: Annotated[float, key("printed cost", "N^2 m^2 s")]
    difference: Annotated[float, key("relative to the printed cost", "1")]


class StiffnessEntry(Document, frozen=True, kw_only=True):
    """Stiffness of the spring beside the paper's; null without one."""

    ours: Annotated[float | None, key("stiffness here", "N/m")]
    paper: Annotated[float | None, key("printed stiffness", "N/m")]


class CaseExecution(Document, frozen=True, kw_only=True):
    """A case on the simulated arm."""

    status: Annotated[str, key("done or stopped")]
    reason: Annotated[str | None, key("why it was stopped; null if done")]
    friction_compensation: Annotated[bool, key("whether the controller compensates friction")]
    effects: Annotated[list[ArmEffectEntry], key("effects of the arm that moved")]
    mean: Annotated[CycleEntry | None, key("mean over all cycles of all trials")]
    spread: Annotated[CycleEntry | None, key("standard deviation over them")]


class CaseEntry(Document, frozen=True, kw_only=True):
    """A row of Table II or III."""

    case: Annotated[str, key("letter of the case: A, B without friction, C, D with it; B, D with a spring")]
    cycle_time: Annotated[float, key("cycle time", "s")]
    plate: Annotated[float | None, key("stiffness of the plate; null in scenario 1", "N/m")]
    simulation: Annotated[BesideEntry, key("cost of the plan")]
    experiment: Annotated[BesideEntry | None, key("mean cost on the simulated arm; null if not executed")]
    stiffness: Annotated[StiffnessEntry, key("stiffness of the spring")]
    joints: Annotated[list[float], key("cost of the plan by joint", "N^2 m^2 s")]
    executed: Annotated[CaseExecution | None, key("the execution; null if there is none")]


class CasesEntry(Document, frozen=True, kw_only=True):
    """Table II or III: planned and executed costs."""

    rows: Annotated[list[CaseEntry], key("rows of the table")]
    claims: Annotated[list[ClaimEntry], key("the paper's statements")]


class PaperDocument(Document, frozen=True, kw_only=True):
    """The paper's study: `tendon paper --json`."""

    table1: Annotated[Table1Entry | UnsetType, key("Table I; absent if not asked for")] = UNSET
    table2: Annotated[CasesEntry | UnsetType, key("Table II; absent if not asked for")] = UNSET
    table3: Annotated[CasesEntry | UnsetType, key("Table III; absent if not asked for")] = UNSET
    spread: Annotated[
        dict[str, float] | UnsetType,
        key("Figure 5: by cycle time, difference of the spring's savings with and without friction", "N^2 m^2 s"),
    ] = UNSET
    figures: Annotated[list[str], key("paths of the figures")]
    kept: Annotated[list[str], key("paths without ending of the executed cases that were kept")]
    holds: Annotated[bool, key("whether all statements hold that should")]
