"""C structs described once: the typedef for the compiler, and the same as JSON for whoever fills them from outside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from codegen.c.c_code import comment
from symbolic.functions import Struct


@dataclass(frozen=True)
class RecordField:
    """type: float, int32_t, uint32_t or the name of an earlier record; count: of an array, or None."""

    name: str
    type: str
    unit: str
    meaning: str
    count: int | None = None
    kind: Literal["value", "pointer"] = "value"

    def declaration(self) -> str:
        """pointer: to const, so that a record can stand in read-only memory."""
        array = "" if self.count is None else f"[{self.count}]"
        target = f"const {self.type} *{self.name}" if self.kind == "pointer" else f"{self.type} {self.name}{array}"
        return f"{target}; {comment(f'{self.unit}: {self.meaning}' if self.unit else self.meaning)}"


@dataclass(frozen=True)
class Record:
    """A struct; declared: by another header."""

    name: str
    meaning: str
    fields: tuple[RecordField, ...]
    declared: bool = False

    def typedef(self) -> str:
        """The struct in C, each field with its unit and meaning."""
        lines = [f"    {field.declaration()}" for field in self.fields]
        return "\n".join([comment(self.meaning), "typedef struct {", *lines, f"}} {self.name};"])

    def to_json(self) -> dict[str, Any]:
        """Name and fields, as the runtime reads them to fill the struct."""
        return {"name": self.name, "fields": [_json(field) for field in self.fields]}


def _json(field: RecordField) -> dict[str, Any]:
    return {"name": field.name, "type": field.type, "count": field.count, "pointer": field.kind == "pointer"}


def of_struct(name: str, meaning: str, struct: Struct, declared: bool = False) -> Record:
    """A record of the parameters of generated functions."""
    rows = zip(struct.symbols, struct.units, struct.meanings, strict=True)
    return Record(name, meaning, tuple(RecordField(s.name, "float", unit, text) for s, unit, text in rows), declared)


def size_lines(records: Sequence[Record], array: str) -> list[str]:
    """Statements that write the size of every record, in order."""
    return [f"{array}[{i}] = (uint32_t)sizeof({record.name});" for i, record in enumerate(records)]
