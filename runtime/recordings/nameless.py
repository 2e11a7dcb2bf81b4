"""Columns of files without a header: their names are numbers, and others are given to them in their order."""

from __future__ import annotations

from collections.abc import Iterator

NUMBERED = "#{}"
"""The name of a column, counted from 1, where the file has none."""


def in_order(names: str) -> Iterator[str]:
    """`t,q1 [deg],-,tau1` as entries of `--map`: "t=#1", "q1=#2 [deg]", "tau1=#4"; `-` leaves a column out."""
    for number, cell in enumerate(names.split(","), 1):
        name, bracket, unit = cell.partition("[")
        if name.strip() not in ("", "-"):
            yield f"{name.strip()}={NUMBERED.format(number)}{' ' * bool(bracket)}{bracket}{unit}"
