"""Keys of a user's file, declared: what stands under each, its unit and range, its meaning, what holds without it.

A file's reader declares its tables as tuples of fields and reads them with `read`, strictly: what is not declared is
an error. The same declarations are listed by `rows`, for guides. Model, scenario and trajectory files are read so.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, Literal

from symbolic.model_file.checks import Place, found, identifier, label, number, pair, real, unknown, vector

JointType = Literal["revolute", "prismatic"]
Table = Mapping[str, Any]


class _Required:
    """Of a key that must be there."""

    def __repr__(self) -> str:
        return "required"


REQUIRED = _Required()


@dataclass(frozen=True)
class FieldRow:
    """A key as a guide shows it: `joint.link.mass`; unit, of a revolute (prismatic) joint; default as text."""

    key: str
    unit: str
    meaning: str
    default: str


@dataclass(frozen=True)
class Field(ABC):
    """One key of a table.

    meaning   for a person, with the side of the gear where there are two
    unit      as text, or of a revolute and of a prismatic joint
    default   of a key that may be left out
    """

    key: str
    meaning: str
    _: KW_ONLY
    unit: str | tuple[str, str] = ""
    default: Any = REQUIRED

    def unit_of(self, joint: JointType) -> str:
        """Its unit at a joint of this type."""
        return self.unit if isinstance(self.unit, str) else self.unit[joint == "prismatic"]

    def takes(self, key: str) -> bool:
        """Whether a key of a table is this field's."""
        return key == self.key

    @abstractmethod
    def of(self, place: Place, table: Table, joint: JointType) -> Any:
        """What the table says of this field, checked, or the default. Raises ModelError."""

    def rows(self, prefix: str) -> Iterator[FieldRow]:
        """What the tables of keys in the guides and the schema say of it; prefix: the keys of the tables around it."""
        yield self._row(prefix + self.key)

    def _row(self, key: str) -> FieldRow:
        unit = self.unit if isinstance(self.unit, str) else f"{self.unit[0]} ({self.unit[1]})"
        return FieldRow(key, unit, self.meaning, _default(self.default))


@dataclass(frozen=True)
class SingleField(Field):
    """What stands under one key."""

    def of(self, place: Place, table: Table, joint: JointType) -> Any:
        """The field's value in a table, or its default where the key is not there. Raises ModelError."""
        return self.read(place, table[self.key], joint) if self.key in table else self.default

    @abstractmethod
    def read(self, place: Place, value: Any, joint: JointType) -> Any:
        """The value checked. Raises ModelError."""


@dataclass(frozen=True)
class Misplaced(Field):
    """A key that belongs to another kind of file; meaning: what it belongs to and what to do, after its name."""

    default: Any = None

    def of(self, place: Place, table: Table, joint: JointType) -> None:
        """Nothing is ever read from it."""

    def rows(self, _: str) -> Iterator[FieldRow]:
        yield from ()


def _default(value: Any) -> str:
    """As it would stand in the file; empty for nothing."""
    if value is None or value in ({}, ()):
        return ""
    if isinstance(value, tuple):
        return f"[{', '.join(map(str, value))}]"
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)


def read(place: Place, table: Table, fields: Sequence[Field], joint: JointType = "revolute") -> dict[str, Any]:
    """Every field of the table by its key, those left out by default.

    joint   type of the joint that the table is about, for units
    Raises ModelError: an unknown key, a missing one, or the first value that is none.
    """
    own = [field for field in fields if not isinstance(field, Misplaced)]
    for field in fields:
        if isinstance(field, Misplaced) and field.key in table:
            place.fail(f"{field.key} {field.meaning}")
    for key in table:
        if not any(field.takes(key) for field in own):
            unknown(place, "key", key, tuple(field.key for field in own))
    needed = [field.key for field in own if field.default is REQUIRED]
    for key in needed:
        if key not in table:
            place.fail(f'missing key "{key}"; needed are {", ".join(needed)}')
    return {field.key: field.of(place, table, joint) for field in own}


def rows(fields: Sequence[Field], prefix: str = "") -> list[FieldRow]:
    """All keys, those of tables within tables included, in the order of declaration."""
    return [row for field in fields for row in field.rows(prefix)]


# --- single values ---


@dataclass(frozen=True)
class Real(SingleField):
    """A finite number within [low, high], above 0 if `positive`."""

    low: float = -math.inf
    high: float = math.inf
    positive: bool = False

    def read(self, place: Place, value: Any, joint: JointType) -> float:
        return real(place, self.key, value, self.unit_of(joint), self.low, self.high, self.positive)


@dataclass(frozen=True)
class Number(Real):
    """The same of a magnitude that a float in the controller can hold."""

    def read(self, place: Place, value: Any, joint: JointType) -> float:
        return number(place, self.key, value, self.unit_of(joint), self.low, self.high, self.positive)


@dataclass(frozen=True)
class WholeNumber(Number):
    """A number that is whole, as 7 or 7.0."""

    def read(self, place: Place, value: Any, joint: JointType) -> int:
        x = super().read(place, value, joint)
        if x != int(x):
            unit = self.unit_of(joint)
            place.fail(f"{self.key} is {x:.6g}; expected a whole number{f', {unit}' if unit else ''}")
        return int(x)


@dataclass(frozen=True)
class Whole(SingleField):
    """A whole number from low to high, which is no float; expected: in words, for messages."""

    low: int
    high: int
    expected: str

    def read(self, place: Place, value: Any, _: JointType) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not self.low <= value <= self.high:
            place.fail(f"{self.key} is {found(value)}; expected {self.expected}")
        return value


@dataclass(frozen=True)
class Choice(SingleField):
    """One of some values; expected: in words, for messages."""

    values: tuple[Any, ...]
    expected: str

    def read(self, place: Place, value: Any, _: JointType) -> Any:
        if isinstance(value, bool) or value not in self.values:
            place.fail(f"{self.key} is {found(value)}; expected {self.expected}")
        return self.values[self.values.index(value)]


@dataclass(frozen=True)
class Flag(SingleField):
    def read(self, place: Place, value: Any, _: JointType) -> bool:
        if not isinstance(value, bool):
            place.fail(f"{self.key} is {found(value)}; expected true or false")
        return value


@dataclass(frozen=True)
class Text(SingleField):
    def read(self, place: Place, value: Any, _: JointType) -> str:
        if not isinstance(value, str):
            place.fail(f"{self.key} is {found(value)}; expected a text")
        return value


@dataclass(frozen=True)
class Name(SingleField):
    """A name that C, C++ and Python accept."""

    def read(self, place: Place, value: Any, _: JointType) -> str:
        return identifier(place, self.key, value)


@dataclass(frozen=True)
class Label(SingleField):
    """A name that people read, and no language."""

    def read(self, place: Place, value: Any, _: JointType) -> str:
        return label(place, self.key, value)


# --- several numbers ---


@dataclass(frozen=True)
class Pair(SingleField):
    """Two numbers."""

    def read(self, place: Place, value: Any, joint: JointType) -> tuple[float, float]:
        return pair(place, self.key, value, self.unit_of(joint))


@dataclass(frozen=True)
class NumberRow(SingleField):
    """As many numbers as there are names; tiny: what rounding leaves of a zero is a number, too."""

    names: tuple[str, ...]
    tiny: bool = False

    def read(self, place: Place, value: Any, joint: JointType) -> tuple[float, ...]:
        return vector(place, self.key, value, self.unit_of(joint), self.names, real if self.tiny else number)


@dataclass(frozen=True)
class Interval(Pair):
    """Two numbers, the smaller first."""

    def read(self, place: Place, value: Any, joint: JointType) -> tuple[float, float]:
        low, high = super().read(place, value, joint)
        if low >= high:
            place.fail(f"{self.key} is [{low:g}, {high:g}]; expected the smaller end first")
        return low, high


@dataclass(frozen=True)
class Bounds(Pair):
    """Two bounds from `low` on, or one number that is both."""

    low: float = -math.inf

    def read(self, place: Place, value: Any, joint: JointType) -> tuple[float, float]:
        unit = self.unit_of(joint)
        if not isinstance(value, list):
            value = [number(place, self.key, value, unit)] * 2
        low, high = pair(place, self.key, value, unit)
        if low > high:
            place.fail(f"{self.key} is [{low:g}, {high:g}]; expected the smaller bound first")
        if low < self.low:
            place.fail(f"{self.key} is {low:g}; expected {self.low:g} {unit} or more")
        return low, high


@dataclass(frozen=True)
class Numbers(Number):
    """A list of numbers."""

    def read(self, place: Place, value: Any, joint: JointType) -> Any:
        read_one = super().read
        return tuple(read_one(place, item, joint) for item in list_at(place, self.key, value))


@dataclass(frozen=True)
class JointNumbers(SingleField):
    """Joints, counted from 1, each once; sorted."""

    def read(self, place: Place, value: Any, _: JointType) -> tuple[int, ...]:
        items = list_at(place, self.key, value)
        for item in items:
            if isinstance(item, bool) or not isinstance(item, int) or item < 1:
                place.fail(f"{self.key} holds {found(item)}; expected joints, counted from 1")
        if len(set(items)) < len(items):
            place.fail(f"{self.key} names a joint twice")
        return tuple(sorted(items))


def list_at(place: Place, key: str, value: Any) -> list[Any]:
    """The value where it is a list. Raises ModelError."""
    if not isinstance(value, list):
        place.fail(f"{key} is {found(value)}; expected a list")
    return value
