"""The terminal: sections as lines and tables, and progress of long work on standard error."""

from __future__ import annotations

import re
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table as RichTable

from runtime.progress import Progress, heard_by
from runtime.report.sections import Bullets, Cell, Commands, Facts, Group, Paragraph, Section, TableSection

D = TypeVar("D")
_UNBOUNDED = 10_000
"""Columns that no table needs."""
_NARROW = 100
"""Columns of a screen below which the columns of a table stand closer."""
_COMMAND = "tendon "
_PATIENCE = 2.0  # s
_EVERY = 10.0  # s
_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")


def show(sections: Iterable[Section]) -> None:
    """Print sections on standard output; figures are left out."""
    for section in sections:
        match section:
            case Paragraph(text, kind):
                say({"warning": "Warning: ", "code": "  "}.get(kind, "") + text)
            case Bullets(items):
                say(*(f"  {item}" for item in items))
            case Facts(facts):
                say("  " + "; ".join(f"{name} {value}" for name, value in facts))
            case TableSection():
                _show_table(section)
            case Commands(commands):
                for command in commands:
                    say(f"  {command.command}", f"      {command.what}")
            case Group(title, inside):
                say("", *([f"{title}:"] if title else []))
                show(inside)


def printer(sections: Callable[[D], Iterable[Section]]) -> Callable[[D], None]:
    """A function that prints the sections of a document."""
    return lambda document: show(sections(document))


def say(*lines: str) -> None:
    """Print lines on standard output; a terminal breaks them between words, except commands, which may be copied."""
    for line in map(_typed, lines):
        whole = not sys.stdout.isatty() or line.lstrip().startswith(_COMMAND)
        for part in [line] if whole else _wrapped(line, _console().width):
            _console().print(part, soft_wrap=True)


def _typed(text: str) -> str:
    """Numbers and units as one types them: `-`, `1e-07` and `kg m^2` for `−`, `1·10⁻⁷` and `kg m²`."""
    text = re.sub(r"·10([⁰¹²³⁴-⁹⁻]+)", lambda power: f"e{int(power[1].translate(_RAISED)):+03d}", text)
    text = re.sub(r"[⁰¹²³⁴-⁹⁻]+", lambda power: "^" + power[0].translate(_RAISED), text)
    return text.replace("−", "-").replace("→", "->").replace("\N{NO-BREAK SPACE}", " ")


def _wrapped(line: str, width: int) -> list[str]:
    inside = line[: len(line) - len(line.lstrip())] + "  "
    return textwrap.wrap(line, width, subsequent_indent=inside, break_long_words=False, break_on_hyphens=False) or [""]


def _console() -> Console:
    # Off a terminal, a fixed width keeps tables whole in files and pipes.
    width = None if sys.stdout.isatty() else 140
    return Console(markup=False, highlight=False, width=width)


def _show_table(table: TableSection) -> None:
    """Print a table without breaking a word; one that is too wide is printed row by row."""
    screen, names = _console(), [column.name for column in table.columns]
    columns = [[_typed(name), *map(_cell, cells)] for name, *cells in zip(names, *table.rows, strict=True)]
    made = RichTable(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=screen.width < _NARROW)
    for k, (heading, *_) in enumerate(columns):
        made.add_column(heading, overflow="fold", no_wrap=k == 0)
    for row in list(zip(*columns, strict=True))[1:]:
        made.add_row(*row)
    if table.caption:
        say(f"{table.caption}:")
    widest = [max(map(cell_len, cells)) for cells in columns]
    least = [max(map(_longest_word, cells)) for cells in columns]
    between = Measurement.get(screen, screen.options.update(max_width=_UNBOUNDED), made).maximum - sum(widest)
    room = screen.width - between
    if sum(least) > room:
        _show_rows(columns, screen.width)
        return
    for cap in range(max(widest, default=0), -1, -1):
        widths = [max(narrow, min(wide, cap)) for wide, narrow in zip(widest, least, strict=True)]
        if sum(widths) <= room:
            break
    for column, width in zip(made.columns, widths, strict=True):
        column.width, column.no_wrap = width, False
    screen.print(made)


def _cell(cell: str | Cell) -> str:
    if isinstance(cell, str):
        return _typed(cell)
    remarks = ", ".join(filter(None, (cell.flag, cell.note)))
    return _typed(f"{cell.text} ({remarks})" if remarks else cell.text)


def _longest_word(cell: str) -> int:
    """Columns; blanks at the beginning stay with the first word."""
    return max(map(cell_len, re.findall(r"^\s*\S+|\S+", cell)), default=0)


def _show_rows(columns: Sequence[Sequence[str]], width: int) -> None:
    """Print a line a cell, below the first cell of its row; each column is its heading and its cells."""
    head, *names = (cells[0] for cells in columns)
    for first, *rest in list(zip(*columns, strict=True))[1:]:
        lines = [f"{head} {first}".strip(), *(f"  {name}: {cell}" for name, cell in zip(names, rest, strict=True))]
        for line in lines:
            say(*_wrapped(line, width))


# --- progress ---


@contextmanager
def working(what: str) -> Iterator[Callable[[str], None]]:
    """Show the work on standard error: on a terminal a spinner with progress and time left, else a line after two
    seconds and one every ten.

    Yields a function that prints a line in between.
    """
    console = Console(stderr=True, markup=False, highlight=False, soft_wrap=True)
    if console.is_terminal:
        with console.status(f"{what} …") as status, heard_by(lambda p: status.update(f"{what} … {_how_far(p)}")):
            yield console.print
        return
    timer = threading.Timer(_PATIENCE, lambda: _to_stderr(f"{what} …"))
    timer.daemon = True
    timer.start()
    last = time.monotonic()

    def heard(progress: Progress) -> None:
        nonlocal last
        if time.monotonic() - last >= _EVERY and progress.left >= 1:
            last = time.monotonic()
            _to_stderr(f"{what} … {_how_far(progress)}")

    try:
        with heard_by(heard):
            yield _to_stderr
    finally:
        timer.cancel()


def _to_stderr(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _how_far(progress: Progress) -> str:
    share = min(progress.done / progress.parts, 1.0)
    done = f"{progress.what} {progress.done} of {progress.parts} ({share:.0%})"
    return f"{done}, {progress.left:.0f} s left" if progress.left >= 1 else done
