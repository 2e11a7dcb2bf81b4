"""Structs of generated C, declared once for C and for those who fill them from Python."""

from __future__ import annotations

from dataclasses import dataclass

from codegen.c.c_code import comment
from symbolic.functions import Struct


@dataclass(frozen=True)
class RecordField:
    """A field. type: float, int32_t, uint32_t or an earlier record; count: of an array, else None."""

    name: str
    type: str
    unit: str
    meaning: str
    count: int | None = None
    pointer: bool = False

    def declaration(self) -> str:
        """The field in C; pointers are to const, so that a record can be in read-only memory."""
        array = "" if self.count is None else f"[{self.count}]"
        target = f"const {self.type} *{self.name}" if self.pointer else f"{self.type} {self.name}{array}"
        return f"{target}; {comment(f'{self.unit}: {self.meaning}' if self.unit else self.meaning)}"


@dataclass(frozen=True)
class Record:
    """A struct. declared: in another header."""

    name: str
    meaning: str
    fields: tuple[RecordField, ...]
    declared: bool = False

    def typedef(self) -> str:
        """The struct in C, each field with its unit and meaning."""
        lines = [f"    {field.declaration()}" for field in self.fields]
        return "\n".join([comment(self.meaning), "typedef struct {", *lines, f"}} {self.name};"])

    def to_json(self) -> dict[str, object]:
        """Name and fields, as the runtime reads them to fill the struct."""
        fields = [{"name": f.name, "type": f.type, "count": f.count, "pointer": f.pointer} for f in self.fields]
        return {"name": self.name, "fields": fields}


def of_struct(name: str, meaning: str, struct: Struct, declared: bool = False) -> Record:
    """The record of generated functions' parameters."""
    rows = zip(struct.symbols, struct.units, struct.meanings, strict=True)
    return Record(name, meaning, tuple(RecordField(s.name, "float", unit, text) for s, unit, text in rows), declared)
