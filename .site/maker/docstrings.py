"""Docstrings as Markdown: the aligned rows `name   meaning` become a list, examples that are indented become code."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

_ROW = re.compile(r"(?P<names>(?! )[\w.…, /*]+?(?:\([^)]*\))?) {2,}(?P<meaning>\S.*)")


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
    for line in text.splitlines():
        row = _ROW.fullmatch(line)
        if row:
            lines += [] if in_list else [""]
            lines.append(f"- **{row['names'].strip()}** — {row['meaning']}")
        elif in_list and line.startswith(" "):
            lines.append(f"    {line.strip()}")
        else:
            lines += ["", line] if in_list and line else [line]
        in_list = bool(row) or (in_list and line.startswith(" "))
    return "\n".join(lines)
