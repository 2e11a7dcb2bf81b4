"""What to type where a signal is wrong: options of `--map` with the file's own names.

cell    what `--map` takes for the field from which a signal was read, with its unit and a minus where it has one
"""

from __future__ import annotations


def option(signal: str, cell: str) -> str:
    """A signal from that field."""
    return f'--map {signal}="{cell}"'


def turned_round(cell: str) -> str:
    """With the other sign."""
    return cell.removeprefix("-") if cell.startswith("-") else f"-{cell}"


def in_unit(cell: str, unit: str) -> str:
    """In another unit than it was read in."""
    return f"{bare(cell)} [{unit}]"


def bare(cell: str) -> str:
    """A field without its unit."""
    return cell.split(" [")[0]
