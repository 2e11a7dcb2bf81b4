"""Columns of files without a header: their names are numbers, and others are given to them in their order."""

from __future__ import annotations

from collections.abc import Iterator

NUMBERED = "#{}"
"""The name of a column, counted from 1, where the file has none."""
_LEAST, _MOVING = ("q", "tau"), ("q", "qd", "tau")
"""Signals that a recording has of every joint."""


def in_order(names: str) -> Iterator[str]:
    """`t,q1 [deg],-,tau1` as entries of `--map`: "t=#1", "q1=#2 [deg]", "tau1=#4"; `-` leaves a column out."""
    for number, cell in enumerate(names.split(","), 1):
        name, bracket, unit = cell.partition("[")
        if name.strip() not in ("", "-"):
            yield f"{name.strip()}={NUMBERED.format(number)}{' ' * bool(bracket)}{bracket}{unit}"


def unnamed(count: int, n: int | None = None) -> str:
    """That a file begins with so many numbers, and what to type.

    n   joints of the arm, read with rates and without where both may be; None where nobody knows, and whatever number
        of joints comes out even is said
    """
    if n is None:
        fitting = [(s, (count - 1) // len(s)) for s in (_LEAST, _MOVING) if count > 1 and (count - 1) % len(s) == 0]
    else:
        fitting = [(s, n) for s in (_MOVING, _LEAST) if s is _LEAST or count == 1 + len(s) * n]
    layouts = [["t", *(f"{x}{i}" for x in s for i in range(1, k + 1))] for s, k in fitting or [(_LEAST, 1)]]
    begins = f"its first line is no header but {count} number{'s' if count > 1 else ''}"
    if len(layouts[0]) > count:
        return f"{begins}; expected at least {len(layouts[0])}: {','.join(layouts[0])}"
    typed = (f"--columns {','.join([*plain, *'-' * (count - len(plain))])}" for plain in layouts)
    return f"{begins}; name its {count} columns with {' or '.join(typed)}"
