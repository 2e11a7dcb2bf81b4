"""What optimize and sweep print on the terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from runtime.report.terminal.cells import Document, empty_table, figure, percent, say, show_table
from runtime.wording import fixed, joints_said, numbered

_EVERY = 5.0  # s
_MOST_LETTERS = 100
"""Letters of a reason in a table's cell; --json and the table of jobs have all of it."""


def plan(document: Document) -> None:
    """The answer first, then joint by joint."""
    if not document["feasible"]:
        say(f"INFEASIBLE: {document['reason']}")
        return
    objective = document["objective"]
    unit = "" if objective["unit"] == "1" else f" {objective['unit']}"
    joints = joints_said(objective["joints"], len(document["joints"]))
    say(
        f"{document['scenario']} in {document['cycle_time']:g} s, "
        f"{'with' if document['friction'] else 'without'} friction: {objective['goal']} of {joints} "
        f"{figure(objective['value'])}{unit}"
    )
    for spring in document["springs"]:
        say(f"spring at joint {spring['joint']}: {spring['text']}{_bought(document, spring)}")
    if len(document["catalogue"]) > 1:
        units = {str(spring["joint"]): spring["unit"] for spring in document["springs"]}
        others = "; ".join(_choice(c, units) for c in document["catalogue"])
        say(f"springs compared, the best first: {others}")
    table = empty_table("joint", "cost", "peak torque", "peak speed", "range")
    for joint in document["joints"]:
        (low, high), position, force = joint["range"], joint["units"]["position"], joint["units"]["force"]
        table.add_row(
            numbered(joint["joint"], joint["name"]),
            f"{figure(joint['cost'])} ({force})^2 s",
            f"{figure(joint['peak_torque'])} {force}",
            f"{figure(joint['peak_speed'])} {position}/s",
            f"{fixed(low)} to {fixed(high)} {position}",
        )
    show_table(table)
    solver = document["solver"]
    met = sum(a["met"] for a in solver["attempts"])
    say(f"{met} of {len(solver['attempts'])} starts met all constraints; {solver['seconds']:.2f} s")
    for term, why in document["left_out"].items():
        say(f"not in the plan: {term}, {why}")
    for warning in document["warnings"]:
        say(f"warning: {warning}")


def _bought(document: Document, spring: Document) -> str:
    """What was sought, where the spring had to be one of a catalogue."""
    if not any(str(spring["joint"]) in sizes for choice in document["catalogue"] for sizes in _sizes(choice)):
        return ""
    return f" (from the catalogue; sought {figure(spring['sought'])} {spring['unit']})"


def _sizes(choice: Document) -> list[Mapping[str, float]]:
    """By joint, of springs that can be bought; apart, those that are sized in different units."""
    return [by_joint for key, by_joint in choice.items() if key != "cost"]


def _choice(choice: Document, units: Mapping[str, str]) -> str:
    sizes = [item for by_joint in _sizes(choice) for item in by_joint.items()]
    springs = ", ".join(f"{size:g} {units[joint]}" for joint, size in sizes)
    return f"{springs} {figure(choice['cost']) if choice['cost'] is not None else 'infeasible'}"


@contextmanager
def sweep_progress(jobs: int, before: int) -> Iterator[Callable[[bool | None], None]]:
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


def sweep(document: Document) -> None:
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
            cells.append("; ".join(_spring_sizes(s) for s in v["springs"]))
        if wrong:
            cells += [_missing(v), _shortened(v["reason"] or "")]
        table.add_row(*cells)
    show_table(table)
    new = document["jobs"] - document["found_finished"]
    say(f"{document['table']}: {document['jobs']} jobs, {new} of them now, {document['seconds']:.1f} s")


def _spring_sizes(spring: Document) -> str:
    unit = spring["unit"]
    size, *others = (figure(value) for key, value in spring.items() if key not in ("joint", "unit"))
    return f"{spring['joint']}: {', '.join((f'{size} {unit}', *others))}"


def _missing(variation: Document) -> str:
    counts = {"infeasible": variation["infeasible"], "failed": variation["failed"]}
    return ", ".join(f"{count} {what}" for what, count in counts.items() if count)


def _shortened(text: str) -> str:
    return text if len(text) <= _MOST_LETTERS else text[: _MOST_LETTERS - 1] + "…"
