"""What all documents are made of: the base of every struct, and the entries that several families share.

A key that may be absent defaults to UNSET; a number that is not finite is null in JSON.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal, Self, TypeVar

import msgspec
from msgspec import UNSET, UnsetType

from runtime.plain_json import plain

T = TypeVar("T")
D = TypeVar("D", bound="Document")


def key(meaning: str, unit: str | None = None) -> msgspec.Meta:
    """Annotation of a key: its meaning, and its unit where it is a number with one."""
    return msgspec.Meta(description=meaning, extra_json_schema=None if unit is None else {"unit": unit})


def given(value: T | UnsetType) -> T | None:
    """The value of a key that may be absent; None where it is."""
    return None if isinstance(value, UnsetType) else value


class Document(msgspec.Struct, frozen=True, kw_only=True, repr_omit_defaults=True):
    """A JSON object with fixed keys, in the order in which they are declared."""

    def to_json(self) -> Any:
        """As plain dicts, lists and numbers, without absent keys."""
        return plain(self)

    def as_part_of(self, kind: type[D], **further: Any) -> D:
        """A document of a kind that has all of these keys and further ones."""
        own = {name: getattr(self, name) for name in self.__struct_fields__}
        return kind(**{**own, **further})


Interval = tuple[float, float]
OpenInterval = tuple[float | None, float | None]
JointNumber = Annotated[int, key("number of the joint, from 1")]
JointName = Annotated[str | None, key("name in the model file; null if it has none")]
JointOrArm = Annotated[int | None, key("number of the joint, from 1; null for an effect of the whole arm")]
Unit = Annotated[str, key("unit of the values; 1 for a number without one")]
Interval95 = Annotated[Interval | None, key("95 % confidence interval; null where the data determine none", "`unit`")]
Inseparable = Annotated[
    list[str] | UnsetType, key("parameters from which the data cannot separate this one; absent if there are none")
]


SearchEnd = Literal["complete", "budget", "time"]


class IterationsEntry(Document, frozen=True, kw_only=True):
    """How far a search came that counts its iterations."""

    iterations: Annotated[int, key("iterations made", "1")]
    budget: Annotated[int, key("iterations that it might make", "1")]
    ended: Annotated[SearchEnd, key("complete; budget or time: what cut it")]

    @classmethod
    def of(cls, iterations: int, budget: int, ends: Iterable[SearchEnd]) -> Self:
        """Of a search with parts: time cut it if it cut one of them, else the budget likewise."""
        ended: SearchEnd = max(ends, key=("complete", "budget", "time").index, default="complete")
        return cls(iterations=iterations, budget=budget, ended=ended)


class EffectAt(Document, frozen=True, kw_only=True):
    """An effect and where it acts."""

    effect: Annotated[str, key("name of the effect")]
    joint: JointOrArm


class EstimateEntry(Document, frozen=True, kw_only=True):
    """An estimated value with its uncertainty."""

    value: Annotated[float | None, key("estimate; null where it has none", "`unit`")]
    unit: Unit
    interval: Interval95
    inseparable_from: Inseparable = UNSET

    def __repr__(self) -> str:
        between = "" if self.interval is None else f" in [{self.interval[0]:.4g}, {self.interval[1]:.4g}]"
        value = "unknown" if self.value is None else f"{self.value:.4g}"
        return f"<{value} {self.unit}{between}>"


class EncoderSkewEntry(Document, frozen=True, kw_only=True):
    """Offset between the clocks of a joint's two encoders."""

    joint: JointNumber
    value: Annotated[float | None, key("time by which the link-side encoder is read after the motor's", "s")]
    unit: Annotated[str, key("s")]
    interval: Interval95
    inseparable_from: Inseparable = UNSET


class DelayEntry(Document, frozen=True, kw_only=True):
    """Delay from a joint's torque to its motion, or from the command of its drive to its torque."""

    joint: JointNumber
    value: Annotated[float, key("whole delay", "s")]
    unit: Annotated[str, key("s")]
    interval: Annotated[OpenInterval | None, key("95 % confidence interval; null if nothing was estimated", "s")]
    assumed: Annotated[float, key("part of it that is assumed: half a sample of a hold", "s")]
    estimated: Annotated[float, key("part of it that is estimated", "s")]
    hold: Annotated[
        float | UnsetType,
        key("only where a drive's law makes the torque: for how long it holds a command, half of which is delay", "s"),
    ] = UNSET


class BandEntry(Document, frozen=True, kw_only=True):
    """Frequency band in which model and data are compared."""

    cutoff_hz: Annotated[float, key("lowest cut-off of all joints", "Hz")]
    cutoffs_hz: Annotated[list[float], key("cut-off of each joint", "Hz")]
    reason: Annotated[str, key("why the band ends there")]


class SkewEntry(Document, frozen=True, kw_only=True):
    """Offset between the clocks of torque and motion."""

    value: Annotated[float, key("samples by which the torque lags the motion", "samples")]
    unit: Annotated[str, key("samples")]
    interval: Annotated[OpenInterval | None, key("95 % confidence interval; null if not estimated", "samples")]
    estimated: Annotated[bool, key("whether it was estimated")]
    given: Annotated[bool | UnsetType, key("identify only: whether --skew gave it")] = UNSET
