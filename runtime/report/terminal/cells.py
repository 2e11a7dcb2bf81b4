"""What the pages of the terminal are made of: lines, tables and the numbers in their cells."""

from __future__ import annotations

import math
import re
import sys
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from runtime.documents.fits import InertialEntry, RotorEntry
from runtime.documents.parts import DelayEntry, EstimateEntry, SkewEntry, given
from runtime.wording import joints_said, milliseconds, numbered
from symbolic.model_file.checks import at_joint

_ENDLESS = 10_000
"""Columns that no table needs."""
Document = Mapping[str, Any]
Estimated = EstimateEntry | InertialEntry | RotorEntry
Names = Mapping[int, str | None]
ROOMY = 100
"""Columns of a screen that have room for the names of joints beside six numbers."""


COMMAND = "tendon "


def say(*lines: str) -> None:
    """Plain lines on standard output: on a terminal broken between words, but for what is to be copied."""
    for line in lines:
        whole = not sys.stdout.isatty() or line.lstrip().startswith(COMMAND)
        for part in [line] if whole else wrapped(line, console().width):
            console().print(part, soft_wrap=True)


def wrapped(line: str, width: int) -> list[str]:
    """A line in as many as it takes, the others further in than the first; no word is broken."""
    inside = line[: len(line) - len(line.lstrip())] + "  "
    return textwrap.wrap(line, width, subsequent_indent=inside, break_long_words=False, break_on_hyphens=False) or [""]


def delay_lines(delays: Sequence[DelayEntry]) -> None:
    """Delay from torque to motion and how much of it is assumed; joints that agree in one line."""
    alike: dict[str, list[int]] = {}
    for d in delays:
        alike.setdefault(_delay(d), []).append(d.joint)
    for text, joints in alike.items():
        where = "every joint" if 1 < len(joints) == len(delays) else joints_said(joints)
        say(f"Delay from torque to motion, {where}: {text}.")


def _delay(d: DelayEntry) -> str:
    parts = [f"{milliseconds(d.assumed)} ms assumed, from a hold"] if d.assumed else []
    parts += [f"{milliseconds(d.estimated)} ms estimated"] if d.estimated else []
    low, high = d.interval or (None, None)
    known = low is not None and high is not None and math.isfinite(low) and math.isfinite(high)
    within = f", 95 % in [{milliseconds(low)}, {milliseconds(high)}]" if known else ""
    return f"{milliseconds(d.value)} ms{within} ({'; '.join(parts)})"


def console() -> Console:
    """Where tables go."""
    # Off a terminal, a fixed width keeps tables whole in files and pipes.
    width = None if sys.stdout.isatty() else 140
    return Console(markup=False, highlight=False, width=width)


def is_narrow() -> bool:
    """Whether a table of parameters has no room for the names of joints."""
    return console().width < ROOMY


def empty_table(*headings: str) -> Table:
    """A table with these headings; on a narrow screen its columns stand closer."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=is_narrow())
    for k, heading in enumerate(headings):
        table.add_column(heading, overflow="fold", no_wrap=k == 0)
    return table


def show_table(table: Table) -> None:
    """On standard output: no word is broken, and where that takes more columns than there are, row by row."""
    screen = console()
    columns = [[str(column.header), *map(str, column.cells)] for column in table.columns]
    widest = [max(map(cell_len, cells)) for cells in columns]
    least = [max(map(_longest_word, cells)) for cells in columns]
    between = Measurement.get(screen, screen.options.update(max_width=_ENDLESS), table).maximum - sum(widest)
    room = screen.width - between
    if sum(least) > room:
        _show_rows(columns, screen.width)
        return
    for cap in range(max(widest, default=0), -1, -1):
        widths = [max(narrow, min(wide, cap)) for wide, narrow in zip(widest, least, strict=True)]
        if sum(widths) <= room:
            break
    for column, width in zip(table.columns, widths, strict=True):
        column.width, column.no_wrap = width, False
    screen.print(table)


def _longest_word(cell: str) -> int:
    """Columns; blanks at the beginning stay with the first word."""
    return max(map(cell_len, re.findall(r"^\s*\S+|\S+", cell)), default=0)


def _show_rows(columns: Sequence[Sequence[str]], width: int) -> None:
    """A line a cell, below the first of its row; column: its heading and its cells."""
    head, *names = (cells[0] for cells in columns)
    for first, *rest in list(zip(*columns, strict=True))[1:]:
        lines = [f"{head} {first}".strip(), *(f"  {name}: {cell}" for name, cell in zip(names, rest, strict=True))]
        for line in lines:
            say(*wrapped(line, width))


def figure(value: float | None) -> str:
    """A number, a few digits; 20050 is easier to read than 2.005e+04."""
    return "–" if value is None or not math.isfinite(value) else f"{float(f'{value:.4g}'):g}"


def percent(value: float | None) -> str:
    """A ratio as a percentage."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{100 * value:.2f} %" if abs(value) < 0.1 else f"{100 * value:.1f} %"


def interval(p: Estimated | SkewEntry, before: str = ", 95 % in ") -> str:
    """A 95 % interval and the parameters from which this one is inseparable; before: text that follows the value."""
    text = f"{before}[{figure(p.interval[0])}, {figure(p.interval[1])}]" if p.interval else ""
    others = None if isinstance(p, SkewEntry) else given(p.inseparable_from)
    if not others:
        return text
    only = f"only together with {', '.join(others)}"
    return f"{text} {only}" if text else f", {only}" if before else only


def unit_cell(unit: str) -> str:
    """Nothing for 1."""
    return "" if unit == "1" else unit


def joint_cell(joint: int | None, names: Names) -> str:
    """In a column of joints."""
    return "arm" if joint is None else numbered(joint, names.get(joint))


def place(joint: int | None) -> str:
    """As a heading."""
    return "arm" if joint is None else f"joint {joint}"


def at_named(joint: int | None, names: Names) -> str:
    """Where an effect acts, after its name."""
    name = None if joint is None else names.get(joint)
    return at_joint(joint) if name is None else f"{at_joint(joint)} ({name})"
