"""Keys of a user's file, declared: the type of each value, its unit, range, meaning and default.

A file's reader declares its tables as tuples of fields and reads them with `read`; an undeclared key is an error.
`rows` lists the same declarations for guides. Model, scenario and trajectory files are read this way.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, Final, Literal

from symbolic.model_file.checks import (
    LABEL,
    MAX_LABEL,
    MAX_NAME,
    Place,
    found,
    identifier,
    number,
    quote,
    real,
    table_at,
    unknown,
)

JointType = Literal["revolute", "prismatic"]
Table = Mapping[str, Any]
Schema = dict[str, Any]


REQUIRED: Final = object()
"""The default of a key that must be present."""


@dataclass(frozen=True)
class FieldRow:
    """A key as guides show it: `joint.link.mass`; the unit of a revolute (prismatic) joint; the default as text."""

    key: str
    unit: str
    meaning: str
    default: str


@dataclass(frozen=True)
class Field:
    """One key of a table.

    meaning   for guides; says which side of the gear, where that matters
    unit      as text, or one for revolute and one for prismatic joints
    default   of an optional key
    """

    key: str
    meaning: str
    _: KW_ONLY
    unit: str | tuple[str, str] = ""
    default: Any = REQUIRED

    def unit_of(self, joint: JointType) -> str:
        """The unit at a joint of this type."""
        return self.unit if isinstance(self.unit, str) else self.unit[joint == "prismatic"]

    def takes(self, key: str) -> bool:
        """Whether a key of a table belongs to this field."""
        return key == self.key

    def of(self, place: Place, table: Table, joint: JointType) -> Any:
        """The checked value of this field in a table, or the default. Raises ModelError."""
        return self.read(place, table[self.key], joint) if self.key in table else self.default

    def read(self, place: Place, value: Any, joint: JointType) -> Any:  # noqa: ARG002
        """Check and convert the value under this key. Raises ModelError."""
        raise TypeError(f"{type(self).__name__} has no value of its own")

    def schema(self) -> Schema:
        """JSON schema of the value under this key."""
        raise TypeError(f"{type(self).__name__} has no schema of its own")

    def rows(self, prefix: str) -> Iterator[FieldRow]:
        """The rows of this key in a guide; prefix: the keys of the tables around it, each with a dot."""
        yield self._row(prefix + self.key)

    def _row(self, key: str) -> FieldRow:
        unit = self.unit if isinstance(self.unit, str) else f"{self.unit[0]} ({self.unit[1]})"
        default = self.default
        if isinstance(default, tuple):
            default = f"[{', '.join(map(str, default))}]" if default else ""
        elif isinstance(default, float):
            default = f"{default:g}"
        elif isinstance(default, bool):
            default = str(default).lower()
        elif default is REQUIRED or default is None or default == {}:
            default = "required" if default is REQUIRED else ""
        return FieldRow(key, unit, self.meaning, str(default))


@dataclass(frozen=True)
class Misplaced(Field):
    """A key of another kind of file. meaning: where it belongs and what to do, to follow the key's name."""

    default: Any = None

    def of(self, place: Place, table: Table, joint: JointType) -> None:
        """Nothing: such a key is an error."""

    def rows(self, _: str) -> Iterator[FieldRow]:
        yield from ()


def read(place: Place, table: Table, fields: Sequence[Field], joint: JointType = "revolute") -> dict[str, Any]:
    """All fields of a table by key, with defaults for omitted keys.

    joint   type of the joint that the table describes, for units
    Raises ModelError: unknown key, missing key, or the first invalid value.
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
    """All keys, including those of nested tables, in the order of declaration."""
    return [row for field in fields for row in field.rows(prefix)]


# --- single values ---


@dataclass(frozen=True)
class Real(Field):
    """A finite number within [low, high], above 0 if `positive`."""

    low: float = -math.inf
    high: float = math.inf
    positive: bool = False

    def read(self, place: Place, value: Any, joint: JointType) -> float:
        return real(
            place, self.key, value, unit=self.unit_of(joint), low=self.low, high=self.high, positive=self.positive
        )

    def schema(self) -> Schema:
        low = "exclusiveMinimum" if self.positive else "minimum"
        limits = {low: 0 if self.positive else self.low, "maximum": self.high}
        return {"type": "number", **{key: x for key, x in limits.items() if math.isfinite(x)}}


@dataclass(frozen=True)
class Number(Real):
    """As Real, within the magnitudes that the controller's floats can represent."""

    def read(self, place: Place, value: Any, joint: JointType) -> float:
        return number(
            place, self.key, value, unit=self.unit_of(joint), low=self.low, high=self.high, positive=self.positive
        )


@dataclass(frozen=True)
class WholeNumber(Number):
    """A whole number, written as 7 or 7.0."""

    def read(self, place: Place, value: Any, joint: JointType) -> int:
        x = super().read(place, value, joint)
        if x != int(x):
            unit = self.unit_of(joint)
            place.fail(f"{self.key} is {x:.6g}; expected a whole number{f', {unit}' if unit else ''}")
        return int(x)

    def schema(self) -> Schema:
        return {**super().schema(), "type": "integer"}


@dataclass(frozen=True)
class Whole(Field):
    """An integer from low to high. expected: in words, for messages."""

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
class Choice(Field):
    """One of the listed values. expected: in words, for messages."""

    values: tuple[Any, ...]
    expected: str

    def read(self, place: Place, value: Any, _: JointType) -> Any:
        if isinstance(value, bool) or value not in self.values:
            place.fail(f"{self.key} is {found(value)}; expected {self.expected}")
        return self.values[self.values.index(value)]

    def schema(self) -> Schema:
        return {"enum": list(self.values)}


@dataclass(frozen=True)
class Flag(Field):
    def read(self, place: Place, value: Any, _: JointType) -> bool:
        if not isinstance(value, bool):
            place.fail(f"{self.key} is {found(value)}; expected true or false")
        return value

    def schema(self) -> Schema:
        return {"type": "boolean"}


@dataclass(frozen=True)
class Text(Field):
    def read(self, place: Place, value: Any, _: JointType) -> str:
        if not isinstance(value, str):
            place.fail(f"{self.key} is {found(value)}; expected a text")
        return value

    def schema(self) -> Schema:
        return {"type": "string"}


@dataclass(frozen=True)
class Name(Field):
    """A name that is valid in C, C++ and Python."""

    def read(self, place: Place, value: Any, _: JointType) -> str:
        return identifier(place, self.key, value)

    def schema(self) -> Schema:
        return NAME_SCHEMA


@dataclass(frozen=True)
class Label(Field):
    """A display name: printable, without characters that could end a C comment or string."""

    def read(self, place: Place, value: Any, _: JointType) -> str:
        if not isinstance(value, str):
            place.fail(f"{self.key} is {found(value)}; expected a text")
        if not LABEL.fullmatch(value):
            place.fail(
                f"{self.key} {quote(value)}: expected letters a-z, digits, spaces and _ - . : / ( ), a letter or digit "
                "first"
            )
        if len(value) > MAX_LABEL:
            place.fail(f"{self.key} {quote(value)} has {len(value)} letters; expected at most {MAX_LABEL}")
        return value

    def schema(self) -> Schema:
        return {"type": "string", "pattern": f"^{LABEL.pattern}$", "maxLength": MAX_LABEL}


# --- several numbers ---


@dataclass(frozen=True)
class NumberRow(Field):
    """A list with one number for each name. tiny: rounding errors of a zero are accepted."""

    names: tuple[str, ...]
    tiny: bool = False

    def read(self, place: Place, value: Any, joint: JointType) -> tuple[float, ...]:
        unit, one = self.unit_of(joint), real if self.tiny else number
        if not isinstance(value, list) or len(value) != len(self.names):
            inside = f" in {unit}" if unit else ""
            place.fail(
                f"{self.key} is {found(value)}; expected a list of {len(self.names)} numbers{inside}: "
                f"{', '.join(self.names)}"
            )
        return tuple(one(place, f"{self.key}[{k}]", entry, unit) for k, entry in enumerate(value))

    def schema(self) -> Schema:
        return _row_schema(len(self.names))


@dataclass(frozen=True)
class Interval(NumberRow):
    """Two numbers, the smaller one first."""

    names: tuple[str, ...] = ("smallest", "largest")

    def read(self, place: Place, value: Any, joint: JointType) -> tuple[float, ...]:
        low, high = super().read(place, value, joint)
        if low >= high:
            place.fail(f"{self.key} is [{low:g}, {high:g}]; expected the smaller end first")
        return low, high


@dataclass(frozen=True)
class Bounds(NumberRow):
    """Two bounds of at least `low`, or one number for both."""

    names: tuple[str, ...] = ("lower", "upper")
    low: float = -math.inf

    def read(self, place: Place, value: Any, joint: JointType) -> tuple[float, ...]:
        one = value if isinstance(value, list) else [number(place, self.key, value, self.unit_of(joint))] * 2
        low, high = super().read(place, one, joint)
        if low > high:
            place.fail(f"{self.key} is [{low:g}, {high:g}]; expected the smaller bound first")
        if low < self.low:
            place.fail(f"{self.key} is {low:g}; expected {self.low:g} {self.unit_of(joint)} or more")
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
class JointNumbers(Field):
    """Joint numbers from 1, without duplicates; sorted."""

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
    """The value, if it is a list. Raises ModelError otherwise."""
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
class OpenTable(Field):
    """A table that its reader checks. inside: what guides call its keys; example: for messages."""

    inside: str
    example: str

    def read(self, place: Place, value: Any, _: JointType) -> dict[str, Any]:
        return table_at(place.inside(self.key), value, self.example)

    def schema(self) -> Schema:
        return {"type": "object", "additionalProperties": dict(NUMBERS_SCHEMA)}

    def rows(self, prefix: str) -> Iterator[FieldRow]:
        yield self._row(f"{prefix}{self.key}.{self.inside}")


@dataclass(frozen=True)
class NamedNumbers(Field):
    """A table of numbers with free names, each a C identifier."""

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
    """The keys `q1`, `q2`, ..., each read as a field of `kind`; the value is a dict by joint, from 1."""

    kind: type[Field]

    def takes(self, key: str) -> bool:
        return re.fullmatch(r"q[1-9]\d?", key) is not None

    def of(self, place: Place, table: Table, joint: JointType) -> dict[int, Any]:
        own = [self.kind(key, self.meaning, unit=self.unit) for key in table if self.takes(key)]
        return {int(field.key[1:]): field.of(place, table, joint) for field in own}


@dataclass(frozen=True)
class Others(Field):
    """All undeclared keys (such as an effect's parameters), each read as a field of `kind`; a dict by name."""

    kind: type[Field]
    besides: tuple[str, ...]

    def takes(self, key: str) -> bool:
        return key not in self.besides

    def of(self, place: Place, table: Table, joint: JointType) -> dict[str, Any]:
        own = [self.kind(key, self.meaning, unit=self.unit) for key in table if self.takes(key)]
        return {field.key: field.of(place, table, joint) for field in own}


@dataclass(frozen=True)
class Inner(Field):
    """A nested table; if it is omitted and the default is {}, it is read as an empty table."""

    fields: tuple[Field, ...]

    def of(self, place: Place, table: Table, joint: JointType) -> Any:
        return super().of(place, {self.key: {}, **table} if self.default == {} else table, joint)

    def read(self, place: Place, value: Any, joint: JointType) -> Any:
        return self._table(place.inside(self.key), self.key, value, joint)

    def _table(self, place: Place, key: str, value: Any, joint: JointType) -> dict[str, Any]:
        expected = f"{quote(key)} with {', '.join(field.key for field in self.fields)}"
        return read(place, table_at(place, value, expected), self.fields, joint)

    def rows(self, prefix: str) -> Iterator[FieldRow]:
        yield from rows(self.fields, f"{prefix}{self.key}.")

    def schema(self) -> Schema:
        return table_schema(self.fields)


@dataclass(frozen=True)
class Named(Inner):
    """Nested tables with names chosen by the user, each a C identifier."""

    def read(self, place: Place, value: Any, joint: JointType) -> dict[str, Any]:
        made = {}
        for name, item in table_at(place.inside(self.key), value, f"[{self.key}.NAME], one each").items():
            identifier(place.inside(self.key), "name", name)
            made[name] = self._table(place.inside(f"{self.key}.{name}"), name, item, joint)
        return made

    def rows(self, prefix: str) -> Iterator[FieldRow]:
        yield from rows(self.fields, f"{prefix}{self.key}.NAME.")

    def schema(self) -> Schema:
        return {"type": "object", "additionalProperties": super().schema(), "propertyNames": dict(NAME_SCHEMA)}


@dataclass(frozen=True)
class Several(Inner):
    """An array of [[key]] tables. one: what messages call each, by default the key."""

    one: str = ""

    def read(self, place: Place, value: Any, joint: JointType) -> Any:
        items = enumerate(list_at(place, self.key, value), 1)
        one = self.one or self.key
        return tuple(self._table(place.inside(f"{one} {k}"), self.key, item, joint) for k, item in items)

    def schema(self) -> Schema:
        return {"type": "array", "items": super().schema()}
