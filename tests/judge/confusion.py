"""The confusion matrix: what was hidden against what was named first."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from .cases import KINDS
from .line import Line

LAST = ("other joint", "-", "unexplained", "refused", "no limit", "failed")
"""Columns that are no effect; "-": nothing was named and the verdict was clean."""


def counts(lines: Sequence[Line]) -> dict[str, Counter[str]]:
    """Of each case, in the order of its class, how often each column was the answer; pairs have no row."""
    rows = [x for x in lines if x.kind != "pairs"]
    order = sorted({(KINDS.index(x.kind), x.case) for x in rows})
    table: dict[str, Counter[str]] = {case: Counter() for _, case in order}
    for x in rows:
        table[x.case].update([x.column or x.outcome])
    return table


def columns(table: dict[str, Counter[str]]) -> list[str]:
    """Effects in the order of the rows, then the others, then what is no effect."""
    seen = {name for row in table.values() for name in row}
    effects = [case for case in table if case in seen]
    return [*effects, *sorted(seen - set(effects) - set(LAST)), *(x for x in LAST if x in seen)]


def text(lines: Sequence[Line], width: int = 110) -> list[str]:
    """The matrix to print: of each case how often it was right, then every wrong column that was ever the answer.

    Names stand upright over their columns; what does not fit in `width` is put below in a second block.
    """
    table = counts(lines)
    right = _right(lines)
    wrong = {case: row - Counter({c: right[case, c] for c in row}) for case, row in table.items()}
    shown = [c for c in columns(table) if any(row[c] for row in wrong.values())]
    label = max((len(case) for case in table), default=4)
    fit = max(1, (width - label - 14) // 4)
    out: list[str] = []
    for start in range(0, max(1, len(shown)), fit):
        part = shown[start : start + fit]
        tall = max((len(c) for c in part), default=0)
        for level in range(tall):
            letters = "".join(f"   {c.rjust(tall)[level]}" for c in part)
            head = "   n  right" if level == tall - 1 else " " * 10
            out.append(f"{'':{label}s}  {head} {letters}")
        for case, row in table.items():
            cells = "".join(f"{wrong[case][c] or '.':>4}" for c in part)
            total, good = sum(row.values()), sum(n for (k, _), n in right.items() if k == case)
            out.append(f"{case:{label}s}  {total:4d} {good:6d} {cells}")
    return out


def _right(lines: Sequence[Line]) -> Counter[tuple[str, str]]:
    """How often a column was the right answer, by case."""
    return Counter((x.case, x.column) for x in lines if x.kind != "pairs" and x.outcome == "right")


def write(path: Path, lines: Sequence[Line]) -> None:
    """The whole matrix as CSV: a row a case, a column an answer."""
    table = counts(lines)
    names = columns(table)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["truth", *names])
        writer.writerows([case, *(row[c] for c in names)] for case, row in table.items())


def figure(path: Path, lines: Sequence[Line]) -> None:
    """The whole matrix as a picture, in the format of the path's suffix; shares of each row as shades."""
    from matplotlib.figure import Figure

    table = counts(lines)
    names = columns(table)
    size = (0.28 * len(names) + 3.0, 0.22 * len(table) + 2.5)
    page = Figure(figsize=size, layout="constrained")
    axes = page.add_subplot()
    shares = [[row[c] / max(1, sum(row.values())) for c in names] for row in table.values()]
    axes.imshow(shares, cmap="Greys", vmin=0.0, vmax=1.0, aspect="auto")
    for y, (row, dark) in enumerate(zip(table.values(), shares, strict=True)):
        for x, name in enumerate(names):
            if row[name]:
                axes.text(
                    x, y, str(row[name]), ha="center", va="center", fontsize=7, color="w" if dark[x] > 0.5 else "k"
                )
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=8)
    axes.set_yticks(range(len(table)), list(table), fontsize=8)
    axes.set_xlabel("named first")
    axes.set_ylabel("hidden")
    page.savefig(path)
