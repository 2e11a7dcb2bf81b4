"""A sweep for people: how far it is, and what came of each variation."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from runtime.report.terminal.cells import Document, empty_table, figure, percent, say, show_table

_EVERY = 5.0  # s
_REASON = 100
"""Letters of a reason in a table's cell; --json and the table of jobs have all of it."""


@contextmanager
def progress(jobs: int, before: int) -> Iterator[Callable[[bool | None], None]]:
    """On standard error: a bar on a terminal, else a line every few seconds. Yields a function that is called for each
    job that ends: with whether it has a plan, None if it failed."""
    bad = {"infeasible": 0, "failed": 0}

    def note(feasible: bool | None) -> str:
        if not feasible:
            bad["failed" if feasible is None else "infeasible"] += 1
        return ", ".join(f"{count} {what}" for what, count in bad.items() if count)

    screen = Console(stderr=True, markup=False, highlight=False)
    if not screen.is_terminal:
        yield _lines(jobs, before, note)
        return
    parts = (
        TextColumn("jobs"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[bad]}"),
    )
    with Progress(*parts, console=screen) as bar:
        task = bar.add_task("", total=jobs, completed=before, bad="")
        yield lambda feasible: bar.update(task, advance=1, bad=note(feasible))


def _lines(jobs: int, done: int, note: Callable[[bool | None], str]) -> Callable[[bool | None], None]:
    last = time.monotonic()
    if done:
        print(f"{done} of {jobs} jobs were finished before", file=sys.stderr, flush=True)

    def tell(feasible: bool | None) -> None:
        nonlocal last, done
        done, bad = done + 1, note(feasible)
        if time.monotonic() - last >= _EVERY:
            last = time.monotonic()
            print(f"{done} of {jobs} jobs" + (f", {bad}" if bad else ""), file=sys.stderr, flush=True)

    return tell


def show(document: Document) -> None:
    """One line a variation: the best cost, how the seeds spread about it, its springs, what did not work."""
    variations = document["variations"]
    several = any(v["jobs"] > 1 for v in variations)
    sprung = any(v["springs"] for v in variations)
    wrong = any(v["reason"] for v in variations)
    spread = ("median", "worst", "within 1 %") if several else ()
    headings = (*variations[0]["at"], "best", *spread, *(("springs",) if sprung else ()))
    say(f"{document['scenario']}, {document['arm']}: {document['goal']}")
    table = empty_table(*headings, *(("no plan", "why") if wrong else ()))
    for v in variations:
        cells = [*("" if x is None else f"{x:g}" if isinstance(x, float) else str(x) for x in v["at"].values())]
        cells.append(figure(v["best"]))
        if several:
            cells += [figure(v["median"]), figure(v["worst"]), percent(v["close"])]
        if sprung:
            cells.append("; ".join(_spring(s) for s in v["springs"]))
        if wrong:
            cells += [_missing(v), _short(v["reason"] or "")]
        table.add_row(*cells)
    show_table(table)
    new = document["jobs"] - document["found_finished"]
    say(f"{document['table']}: {document['jobs']} jobs, {new} of them now, {document['seconds']:.1f} s")


def _spring(spring: Document) -> str:
    unit = spring["unit"]
    size, *others = (figure(value) for key, value in spring.items() if key not in ("joint", "unit"))
    return f"{spring['joint']}: {', '.join((f'{size} {unit}', *others))}"


def _missing(variation: Document) -> str:
    counts = {"infeasible": variation["infeasible"], "failed": variation["failed"]}
    return ", ".join(f"{count} {what}" for what, count in counts.items() if count)


def _short(text: str) -> str:
    return text if len(text) <= _REASON else text[: _REASON - 1] + "…"
