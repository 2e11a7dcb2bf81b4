"""A report as data: sections that the terminal, the HTML page, the studio and notebooks show alike.

One module a subject makes sections from a document of runtime/documents: words, numbers with their formats, and units
are chosen there once. Three thin renderers show them: `terminal.show`, `page.html` and, with its fragments, the studio.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

import msgspec

from runtime.documents.diagnosis import CommandEntry
from runtime.documents.parts import IterationsEntry


class Paragraph(msgspec.Struct, frozen=True, tag=True):
    """A paragraph; `code`: an equation."""

    text: str
    kind: Literal["plain", "note", "warning", "code"] = "plain"


class Bullets(msgspec.Struct, frozen=True, tag=True):
    """A list of sentences or values."""

    items: tuple[str, ...]


class Facts(msgspec.Struct, frozen=True, tag=True):
    """Names with their values; `large`: the figures at the head of a page."""

    facts: tuple[tuple[str, str], ...]
    large: bool = False


class TableColumn(msgspec.Struct, frozen=True):
    """A column of a table; `kind` sets its alignment and how it wraps."""

    name: str
    kind: Literal["number", "estimate", "words"] = "number"


class Cell(msgspec.Struct, frozen=True):
    """A cell with a remark behind its text: a flag that warns, or a note."""

    text: str
    flag: str = ""
    note: str = ""


class TableSection(msgspec.Struct, frozen=True, tag=True):
    """Rows of formatted cells, the first of which names the row; `bold`: rows (from 0) that stand out."""

    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[str | Cell, ...], ...]
    caption: str = ""
    bold: tuple[int, ...] = ()


class Commands(msgspec.Struct, frozen=True, tag=True):
    """Command lines to copy, each with what it does."""

    commands: tuple[CommandEntry, ...]


class Plots(msgspec.Struct, frozen=True, tag=True):
    """Plots by the names under which the page has drawn them; other renderers leave them out."""

    names: tuple[str, ...]


class Group(msgspec.Struct, frozen=True, tag=True):
    """Sections under a heading.

    name    anchor in the page; the page's navigation lists the named groups of the top level
    folded  whether it is closed at first; None: it cannot be folded
    aside   words behind the heading, which are seen while it is closed
    """

    title: str
    sections: tuple[Section, ...]
    name: str = ""
    folded: bool | None = None
    aside: str = ""


Section = Paragraph | Bullets | Facts | TableSection | Commands | Plots | Group


def table(
    columns: Iterable[TableColumn | str], rows: Iterable[Sequence[str | Cell]], caption: str = ""
) -> TableSection:
    """A table; a column of numbers may be given by its name alone."""
    made = tuple(TableColumn(c) if isinstance(c, str) else c for c in columns)
    return TableSection(made, tuple(tuple(row) for row in rows), caption)


def words(name: str) -> TableColumn:
    """A column of words."""
    return TableColumn(name, "words")


def texts(lines: Iterable[str], kind: Literal["plain", "note", "warning"] = "plain") -> list[Section]:
    """A paragraph a line."""
    return [Paragraph(line, kind) for line in lines]


def cut(search: IterationsEntry) -> list[str]:
    """What a search says that was cut; nothing of a complete one."""
    if search.ended == "complete":
        return []
    made = f"The search was cut after {search.iterations} iterations"
    if search.ended == "budget":
        return [f"{made} by its budget of {search.budget}; a larger --budget may find better."]
    return [f"{made} by its time limit or Ctrl-C; the whole search may find better."]
