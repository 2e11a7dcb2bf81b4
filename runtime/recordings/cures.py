"""What to type where a signal is wrong: options of `--map` with the file's own names.

cells   of each signal, what `--map` takes for the field from which it was read; ours where they are not known
"""

from __future__ import annotations

from collections.abc import Mapping


def read_from(cells: Mapping[str, str], signal: str, source: str) -> str:
    """A signal from the field that another was read from."""
    return f'--map {signal}="{cells.get(source, source)}"'


def turned_round(cells: Mapping[str, str], signal: str) -> str:
    """A signal with the other sign."""
    cell = cells.get(signal, signal)
    return f'--map {signal}="{cell.removeprefix("-") if cell.startswith("-") else f"-{cell}"}"'


def in_unit(cells: Mapping[str, str], signal: str, unit: str) -> str:
    """A signal in another unit than it was read in."""
    return f'--map {signal}="{bare(cells.get(signal, signal))} [{unit}]"'


def bare(cell: str) -> str:
    """A field without its unit."""
    return cell.split(" [")[0]
