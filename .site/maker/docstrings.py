"""Docstrings as Markdown: the aligned rows `name   meaning` become a list, examples that are indented become code."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

_ROW = re.compile(r"(?! )(?:[\w.…, /*]+?(?:\([^)]*\))?) {2,}\S.*")
_LONG = re.compile(r"^([\w, ]+)\n {6,}(?=\S)", re.MULTILINE)
"""Names that take all of a line; their meaning follows on the next one."""


class Rows(Extension):
    """Turns the docstrings of all objects while they are loaded."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Turn one docstring."""
        if obj.docstring is not None:
            obj.docstring.value = as_markdown(obj.docstring.value)


def as_markdown(text: str) -> str:
    """A docstring with its rows as a list; a line that is indented below a row goes on with it."""
    lines: list[str] = []
    in_list = False
    for line in _LONG.sub(r"\1   ", text).splitlines():
        rows = _rows(line)
        goes_on = in_list and line.startswith(" ")
        if rows:
            lines += rows if in_list else ["", *rows]
        elif goes_on:
            lines.append(f"    {line.strip()}")
        else:
            lines += ["", line] if in_list and line else [line]
        in_list = bool(rows) or goes_on
    return "\n".join(lines)


def _rows(line: str) -> list[str]:
    """The rows that stand side by side in a line, as items of a list; none if it has none."""
    if not _ROW.fullmatch(line):
        return []
    cells = re.split(r" {3,}", line)
    if len(cells) % 2:
        cells = re.split(r" {2,}", line, maxsplit=1)
    return [f"- **{name.strip()}** — {meaning}" for name, meaning in zip(cells[::2], cells[1::2], strict=True)]
