"""Tables within a user's file, declared as `fields` declares single keys: one, several, named, open."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from symbolic.model_file.checks import Place, identifier, number, quote, table_at
from symbolic.model_file.fields import Field, FieldRow, JointType, SingleField, Table, list_at, read, rows


@dataclass(frozen=True)
class OpenTable(SingleField):
    """A table into which its reader looks; inside: what a guide calls its keys; example: for messages."""

    inside: str
    example: str

    def read(self, place: Place, value: Any, _: JointType) -> dict[str, Any]:
        return table_at(place.inside(self.key), value, self.example)

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


def _with(key: str, fields: Sequence[Field]) -> str:
    return f"{quote(key)} with {', '.join(field.key for field in fields)}"
