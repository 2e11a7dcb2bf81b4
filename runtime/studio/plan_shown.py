"""What the page shows of plans, of their executions and of sweeps: documents that are written as JSON as they stand.

Names, sentences and numbers with their units are text; nothing in them is HTML.
"""

from __future__ import annotations

from typing import Any, TypedDict

from runtime.studio.shown import Row


class SweptAt(TypedDict):
    """Of which sweep, from 1, a plan is which point, from 0; what its own cost is, and the sweep's."""

    sweep: int
    point: int
    swept_cost: float
    cost: float


class PlanShown(TypedDict):
    """A plan that was opened.

    name      of the file
    headline  what it came to; springs: sentences; phases: in words
    facts     [{name, value}]
    table     of every joint: costs, peaks, limits; {heads, rows}, a row's first cell its name
    joints    those that move, 1-based
    called    of every joint
    arm       picture of arm_motion, its data as an object
    command   what executes it in a terminal
    swept     where it is the plan of a sweep's point
    """

    name: str
    headline: str
    springs: list[str]
    phases: list[str]
    facts: list[Row]
    table: Row
    joints: list[int]
    called: list[str]
    arm: Row
    notes: list[str]
    command: str
    swept: SweptAt | None


class ExecutedShown(TypedDict):
    """A plan's execution on the simulated arm.

    kind, tag   "clean": done, "unexplained": stopped, "refused": nothing moved
    reason      why it stopped or was refused, or ""
    arm         planned and executed, one over the other; None where nothing moved
    """

    kind: str
    tag: str
    headline: str
    reason: str
    facts: list[Row]
    table: Row
    arm: Row | None
    notes: list[str]


class PointShown(TypedDict):
    """A variation of a sweep.

    at      what varies, None where its case leaves that out
    cost    of the best plan, None without one; plans: how many of its `jobs` have one; seed: of the best
    figures what else was found of it, by column
    reason  why there is no plan, or ""
    """

    at: dict[str, Any]
    cost: float | None
    jobs: int
    plans: int
    seed: int
    figures: dict[str, float]
    reason: str


class SweepShown(TypedDict):
    """A sweep's table. axes: what varies; more: how many variations are not shown; jobs: its rows."""

    name: str
    axes: list[str]
    points: list[PointShown]
    more: int
    jobs: int
