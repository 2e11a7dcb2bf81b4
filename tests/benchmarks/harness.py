"""Timing and tables for the benchmarks: minima of repetitions, as other work on the machine only adds time."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from rich import box
from rich.console import Console
from rich.table import Table

SHORT = os.environ.get("TENDON_BENCH") == "short"
"""Every benchmark is to run once with few samples: what is equal is asserted, what is timed says little."""

Size = TypeVar("Size")


def sized(whole: Size, short: Size) -> Size:
    """A number of samples, rounds or seconds: that of the short form where it is asked for."""
    return short if SHORT else whole


def best(work: Callable[[], Any], repetitions: int, least: float = 0.0) -> float:
    """Shortest of `repetitions` runs, s; stops repeating once `least` seconds are spent, if that is given."""
    shortest, spent = float("inf"), 0.0
    for _ in range(repetitions):
        start = time.perf_counter()
        work()
        taken = time.perf_counter() - start
        shortest, spent = min(shortest, taken), spent + taken
        if least and spent > least:
            break
    return shortest


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds of one run, and what it returned."""
    start = time.perf_counter()
    result = work()
    return time.perf_counter() - start, result


def show(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], notes: Sequence[str] = ()) -> None:
    """A table, its first column to the left and the others to the right, and remarks below it."""
    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", title_style="bold")
    for number, name in enumerate(head):
        table.add_column(name, justify="right" if number else "left", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    console = Console(width=110, highlight=False)
    console.print()
    console.print(table)
    for note in notes:
        console.print(note, style="dim")
