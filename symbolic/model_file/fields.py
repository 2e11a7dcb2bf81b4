"""Keys of a user's file, declared: the type of each value, its unit, range, meaning and default.

A file's reader declares its tables as tuples of fields and reads them with `read`; an undeclared key is an error.
`rows` lists the same declarations for guides. Model, scenario and trajectory files are read this way.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, Literal

from symbolic.model_file.checks import (
    MAX_LABEL,
    MAX_NAME,
    Place,
    found,
    identifier,
    label,
    number,
    pair,
    quote,
    real,
    table_at,
    unknown,
    vector,
)

JointType = Literal["revolute", "prismatic"]
Table = Mapping[str, Any]
Schema = dict[str, Any]


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

    def schema(self) -> Schema:
        """JSON schema of the value under this key."""
        raise TypeError(f"{type(self).__name__} has no schema of its own")

    def rows(self, prefix: str) -> Iterator[FieldRow]:
        """The rows of this key in a guide; prefix: the keys of the tables around it, each with a dot."""
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

    def schema(self) -> Schema:
        low = "exclusiveMinimum" if self.positive else "minimum"
        limits = {low: 0 if self.positive else self.low, "maximum": self.high}
        return {"type": "number", **{key: x for key, x in limits.items() if math.isfinite(x)}}


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

    def schema(self) -> Schema:
        return {**super().schema(), "type": "integer"}


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

    def schema(self) -> Schema:
        return {"type": "integer", "minimum": self.low, "maximum": self.high}


@dataclass(frozen=True)
class Choice(SingleField):
    """One of some values; expected: in words, for messages."""

    values: tuple[Any, ...]
    expected: str

    def read(self, place: Place, value: Any, _: JointType) -> Any:
        if isinstance(value, bool) or value not in self.values:
            place.fail(f"{self.key} is {found(value)}; expected {self.expected}")
        return self.values[self.values.index(value)]

    def schema(self) -> Schema:
        return {"enum": list(self.values)}


@dataclass(frozen=True)
class Flag(SingleField):
    def read(self, place: Place, value: Any, _: JointType) -> bool:
        if not isinstance(value, bool):
            place.fail(f"{self.key} is {found(value)}; expected true or false")
        return value

    def schema(self) -> Schema:
        return {"type": "boolean"}


@dataclass(frozen=True)
class Text(SingleField):
    def read(self, place: Place, value: Any, _: JointType) -> str:
        if not isinstance(value, str):
            place.fail(f"{self.key} is {found(value)}; expected a text")
        return value

    def schema(self) -> Schema:
        return {"type": "string"}


@dataclass(frozen=True)
class Name(SingleField):
    """A name that C, C++ and Python accept."""

    def read(self, place: Place, value: Any, _: JointType) -> str:
        return identifier(place, self.key, value)

    def schema(self) -> Schema:
        return NAME_SCHEMA


@dataclass(frozen=True)
class Label(SingleField):
    """A name that people read, and no language."""

    def read(self, place: Place, value: Any, _: JointType) -> str:
        return label(place, self.key, value)

    def schema(self) -> Schema:
        return {"type": "string", "pattern": r"^[A-Za-z0-9_][A-Za-z0-9_ .:/()-]*$", "maxLength": MAX_LABEL}


# --- several numbers ---


@dataclass(frozen=True)
class Pair(SingleField):
    """Two numbers."""

    def read(self, place: Place, value: Any, joint: JointType) -> tuple[float, float]:
        return pair(place, self.key, value, self.unit_of(joint))

    def schema(self) -> Schema:
        return _row_schema(2)


@dataclass(frozen=True)
class NumberRow(SingleField):
    """As many numbers as there are names; tiny: what rounding leaves of a zero is a number, too."""

    names: tuple[str, ...]
    tiny: bool = False

    def read(self, place: Place, value: Any, joint: JointType) -> tuple[float, ...]:
        return vector(place, self.key, value, self.unit_of(joint), self.names, real if self.tiny else number)

    def schema(self) -> Schema:
        return _row_schema(len(self.names))


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

    def schema(self) -> Schema:
        return {"anyOf": [{"type": "number"}, _row_schema(2)]}


@dataclass(frozen=True)
class Numbers(Number):
    """A list of numbers."""

    def read(self, place: Place, value: Any, joint: JointType) -> Any:
        read_one = super().read
        return tuple(read_one(place, item, joint) for item in list_at(place, self.key, value))

    def schema(self) -> Schema:
        return {"type": "array", "items": super().schema()}


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

    def schema(self) -> Schema:
        return {"type": "array", "items": {"type": "integer", "minimum": 1}, "uniqueItems": True}


def list_at(place: Place, key: str, value: Any) -> list[Any]:
    """The value where it is a list. Raises ModelError."""
    if not isinstance(value, list):
        place.fail(f"{key} is {found(value)}; expected a list")
    return value


# --- JSON schemas, for editors ---

NAME_SCHEMA: Schema = {"type": "string", "pattern": "^[A-Za-z_][A-Za-z0-9_]*$", "maxLength": MAX_NAME}
NUMBERS_SCHEMA: Schema = {"type": "object", "additionalProperties": {"type": "number"}}


def _row_schema(count: int) -> Schema:
    return {"type": "array", "items": {"type": "number"}, "minItems": count, "maxItems": count}


def table_schema(fields: Sequence[Field]) -> Schema:
    """JSON schema of a table that has these keys and no others."""
    own = [field for field in fields if not isinstance(field, Misplaced)]
    made: Schema = {
        "type": "object",
        "properties": {},
        "additionalProperties": False,
        "required": [field.key for field in own if field.default is REQUIRED],
    }
    for field in own:
        if isinstance(field, PerJoint):
            made["patternProperties"] = {
                r"^q[1-9]\d?$": _described(field, field.kind(field.key, field.meaning).schema())
            }
        elif isinstance(field, Others):
            made["additionalProperties"] = _described(field, field.kind(field.key, field.meaning).schema())
        else:
            made["properties"][field.key] = _described(field, field.schema())
    return made


def _described(field: Field, schema: Schema) -> Schema:
    """The schema with the description that an editor shows beside the key."""
    row = next(iter(field.rows("")), None)
    unit = field.unit if isinstance(field.unit, str) else f"{field.unit[0]} ({field.unit[1]})"
    default = row.default if row is not None and field.default not in (REQUIRED, None, {}) else ""
    parts = [field.meaning, *([unit] if unit else []), *([f"default: {default}"] if default else [])]
    return {**schema, "description": "; ".join(parts)}


@dataclass(frozen=True)
class OpenTable(SingleField):
    """A table into which its reader looks; inside: what a guide calls its keys; example: for messages."""

    inside: str
    example: str

    def read(self, place: Place, value: Any, _: JointType) -> dict[str, Any]:
        return table_at(place.inside(self.key), value, self.example)

    def schema(self) -> Schema:
        return {"type": "object", "additionalProperties": dict(NUMBERS_SCHEMA)}

    def rows(self, prefix: str) -> Iterator[FieldRow]:
        yield self._row(f"{prefix}{self.key}.{self.inside}")


@dataclass(frozen=True)
class NamedNumbers(SingleField):
    """A table of numbers under names that are not known here; each a C identifier."""

    def read(self, place: Place, value: Any, joint: JointType) -> dict[str, float]:
        place, unit = place.inside(self.key), self.unit_of(joint)
        table = table_at(place, value, f"[{self.key}] of numbers")
        return {identifier(place, "key", key): number(place, key, entry, unit) for key, entry in table.items()}

    def rows(self, prefix: str) -> Iterator[FieldRow]:
        yield self._row(f"{prefix}{self.key}.NAME")

    def schema(self) -> Schema:
        return {**NUMBERS_SCHEMA, "propertyNames": dict(NAME_SCHEMA)}


@dataclass(frozen=True)
class PerJoint(Field):
    """Keys of joints, `q1`, `q2`, ...: what each says, read as a field of that kind, by joint, counted from 1."""

    kind: type[Field]

    def takes(self, key: str) -> bool:
        return re.fullmatch(r"q[1-9]\d?", key) is not None

    def of(self, place: Place, table: Table, joint: JointType) -> dict[int, Any]:
        own = [self.kind(key, self.meaning, unit=self.unit) for key in table if self.takes(key)]
        return {int(field.key[1:]): field.of(place, table, joint) for field in own}


@dataclass(frozen=True)
class Others(Field):
    """All keys beside the declared ones, parameters whose names a library gives: what each says, read as a field of
    that kind, by its name."""

    kind: type[Field]
    besides: tuple[str, ...]

    def takes(self, key: str) -> bool:
        return key not in self.besides

    def of(self, place: Place, table: Table, joint: JointType) -> dict[str, Any]:
        own = [self.kind(key, self.meaning, unit=self.unit) for key in table if self.takes(key)]
        return {field.key: field.of(place, table, joint) for field in own}


@dataclass(frozen=True)
class Inner(SingleField):
    """A table within this one; where it is left out and the default is {}, as if it were there and empty."""

    fields: tuple[Field, ...]

    def of(self, place: Place, table: Table, joint: JointType) -> Any:
        return super().of(place, {self.key: {}, **table} if self.default == {} else table, joint)

    def read(self, place: Place, value: Any, joint: JointType) -> Any:
        place = place.inside(self.key)
        return read(place, table_at(place, value, _with(self.key, self.fields)), self.fields, joint)

    def rows(self, prefix: str) -> Iterator[FieldRow]:
        yield from rows(self.fields, f"{prefix}{self.key}.")

    def schema(self) -> Schema:
        return table_schema(self.fields)


@dataclass(frozen=True)
class Named(Inner):
    """Tables within this one under names of the user's, each a C identifier."""

    def read(self, place: Place, value: Any, joint: JointType) -> dict[str, Any]:
        made = {}
        for name, item in table_at(place.inside(self.key), value, f"[{self.key}.NAME], one each").items():
            identifier(place.inside(self.key), "name", name)
            here = place.inside(f"{self.key}.{name}")
            made[name] = read(here, table_at(here, item, _with(name, self.fields)), self.fields, joint)
        return made

    def rows(self, prefix: str) -> Iterator[FieldRow]:
        yield from rows(self.fields, f"{prefix}{self.key}.NAME.")

    def schema(self) -> Schema:
        return {"type": "object", "additionalProperties": super().schema(), "propertyNames": dict(NAME_SCHEMA)}


@dataclass(frozen=True)
class Several(Inner):
    """[[key]] tables, one after another; one: what each is called in messages, the key if not said."""

    one: str = ""

    def read(self, place: Place, value: Any, joint: JointType) -> Any:
        made = []
        for k, item in enumerate(list_at(place, self.key, value), 1):
            here = place.inside(f"{self.one or self.key} {k}")
            made.append(read(here, table_at(here, item, _with(self.key, self.fields)), self.fields, joint))
        return tuple(made)

    def schema(self) -> Schema:
        return {"type": "array", "items": super().schema()}


def _with(key: str, fields: Sequence[Field]) -> str:
    return f"{quote(key)} with {', '.join(field.key for field in fields)}"
