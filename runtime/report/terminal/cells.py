"""What the pages of the terminal are made of: lines, tables and the numbers in their cells."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from runtime.wording import numbered
from symbolic.model_file.checks import at_joint

Document = Mapping[str, Any]
Names = Mapping[int, str | None]
INTERVAL = "95 % interval"
ROOMY = 100
"""Columns of a screen that have room for the names of joints beside six numbers."""


def say(*lines: str) -> None:
    """Plain lines on standard output."""
    for line in lines:
        console().print(line, soft_wrap=True)


def fit_table(document: Document, names: Names) -> None:
    """Parameters of an identification with their 95 % intervals; on a narrow screen the joints' numbers alone, whose
    names stand in the table of what is left."""
    names = {} if is_narrow() else names
    table = whole_intervals(empty_table("joint", "parameter", "file", "fit", INTERVAL, "unit"), document)
    for p in document["inertial"]:
        table.add_row(
            joint_cell(p["joint"], names), p["name"], figure(p["model"]), figure(p["fit"]), interval(p, ""), unit(p)
        )
    for p in document["rotors"]:
        table.add_row(
            joint_cell(p["joint"], names), f"{p['name']}, further", "", figure(p["fit"]), interval(p, ""), unit(p)
        )
    for entry in document["effects"]:
        for name, p in entry["parameters"].items():
            label = f"{entry['name']}: {name}"
            table.add_row(joint_cell(entry["joint"], names), label, "", figure(p["value"]), interval(p, ""), unit(p))
    console().print(table)


def joints_table(document: Document) -> None:
    """What is left of each joint's torque, beside its noise floor."""
    table = empty_table("joint", "residual rms", "of the torque", "noise floor", "floor from", "repeatable")
    for j in document["joints"]:
        repeats = {True: "yes", False: "no", None: "unknown"}[j.get("repeatable")]
        table.add_row(
            numbered(j["joint"], j.get("name")),
            figure(j["rms"]),
            percent(j["relative"]),
            figure(j["floor"]),
            j["floor_source"],
            repeats,
        )
    console().print(table)


def delay_lines(document: Document) -> None:
    """The whole delay from torque to motion, and how much of it is assumed; joints that agree in one line."""
    alike: dict[str, list[int]] = {}
    for d in document["delay"]:
        alike.setdefault(_delay(d), []).append(d["joint"])
    for text, joints in alike.items():
        where = "every joint" if 1 < len(joints) == len(document["delay"]) else _joints(joints)
        say(f"Delay from torque to motion, {where}: {text}.")


def _joints(numbers: Sequence[int]) -> str:
    return f"joint{'' if len(numbers) == 1 else 's'} {', '.join(map(str, numbers))}"


def _delay(d: Document) -> str:
    parts = [f"{1e3 * d['assumed']:.3g} ms assumed, of a hold"] if d["assumed"] else []
    parts += [f"{1e3 * d['estimated']:.3g} ms estimated"] if d["estimated"] else []
    known = d["interval"]
    within = f", 95 % in [{1e3 * known[0]:.3g}, {1e3 * known[1]:.3g}]" if known else ""
    return f"{1e3 * d['value']:.3g} ms{within} ({'; '.join(parts)})"


def console() -> Console:
    """Where tables go."""
    # Off a terminal, a fixed width keeps tables whole in files and pipes.
    width = None if sys.stdout.isatty() else 140
    return Console(markup=False, highlight=False, width=width)


def is_narrow() -> bool:
    """Whether a table of parameters would not fit beside long names."""
    return console().width < ROOMY


def empty_table(*headings: str) -> Table:
    """A table with these headings, none of whose words is broken; numbers stand closer on a narrow screen."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=is_narrow())
    for k, heading in enumerate(headings):
        longest = max(map(len, heading.split()), default=0)
        table.add_column(heading, overflow="fold", no_wrap=k == 0, min_width=longest)
    return table


def whole_intervals(table: Table, document: Document) -> Table:
    """The table, whose intervals stay in one line unless one of them says with which others it is entangled."""
    each = [*document["inertial"], *(p for e in document["effects"] for p in e["parameters"].values())]
    for column in table.columns:
        column.no_wrap = column.no_wrap or (column.header == INTERVAL and not any(map(entangled, each)))
    return table


def figure(value: float | None) -> str:
    """A number, a few digits."""
    return "–" if value is None else f"{value:.4g}"


def percent(value: float | None) -> str:
    """A ratio as a percentage."""
    return "–" if value is None else f"{100 * value:.2f} %" if abs(value) < 0.1 else f"{100 * value:.1f} %"


def entangled(p: Document) -> Sequence[str]:
    """The others with which alone a parameter can be told."""
    return p.get("inseparable_from") or ()


def interval(p: Document, before: str = ", 95 % in ") -> str:
    """A 95 % interval, and with which others a parameter can only be told."""
    known = p.get("interval")
    text = f"{before}[{figure(known[0])}, {figure(known[1])}]" if known else ""
    tangled = entangled(p)
    return f"{text} only together with {', '.join(tangled)}".strip() if tangled else text


def unit(p: Document) -> str:
    """Nothing for 1."""
    return "" if p["unit"] == "1" else str(p["unit"])


def several(values: Sequence[float] | None, show: Any) -> str:
    """A number a joint."""
    return "–" if values is None else ", ".join(show(v) for v in values)


def names_of(document: Document) -> Names:
    """The names that the model file gives its joints, by their numbers."""
    return {j["joint"]: j.get("name") for j in document["joints"]}


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
