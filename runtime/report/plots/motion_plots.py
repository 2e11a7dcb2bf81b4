"""Figures of motions over time: a plan joint by joint, an execution beside its plan, the signals of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from runtime.documents.parts import given
from runtime.documents.plans import MotionDocument
from runtime.report.plots.style import AFTER, BEFORE, FAINT, INK, WIDTH, styled

Array = NDArray[np.float64]

_ROW = 1.15  # inches, of each joint
_PANEL = 1.05  # inches, of each panel of one joint
_LINE = 0.25  # of a panel's height, of a line of text
_NEAR = 1.7
"""Times the largest value; a limit further away is said and not drawn, so that the curve keeps its size."""


@styled
def plan(document: MotionDocument) -> Figure:
    """Position, speed and torque of motor and spring over one cycle, of every joint that moves."""
    moving = moving_joints(document)
    figure = Figure(figsize=(2.6 * WIDTH, 0.7 + _ROW * len(moving)), layout="constrained")
    axes = figure.subplots(len(moving), 3, sharex=True, squeeze=False)
    for row, joint in zip(axes, moving, strict=True):
        _draw(row, document, joint, named=True)
    for ax in axes[0]:
        _phases(ax, document, named=True)
    for ax in axes[-1]:
        ax.set_xlabel("time, s")
    figure.align_ylabels()
    return figure


@styled
def plan_of_joint(document: MotionDocument, joint: int) -> Figure:
    """The same of one joint (1-based), one panel below the other."""
    figure = Figure(figsize=(WIDTH, 0.5 + 3 * _PANEL), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    _draw(axes, document, joint, named=False)
    _phases(axes[0], document, named=True)
    axes[-1].set_xlabel("time, s")
    figure.align_ylabels()
    return figure


def moving_joints(document: MotionDocument) -> list[int]:
    """Joints (1-based) whose position changes; all of them where none does."""
    joints = document.joints
    return [j.joint for j in joints if j.range[1] > j.range[0]] or [j.joint for j in joints]


def _draw(axes: Sequence[Axes], document: MotionDocument, joint: int, named: bool) -> None:
    """named: whether the labels say which joint."""
    samples, entry = document.samples, document.joints[joint - 1]
    limits, units = entry.limits, entry.units
    t = np.array(samples.t)
    q, qd, tau, spring = (
        np.array(row[joint - 1], dtype=float) for row in (samples.q, samples.qd, samples.tau, samples.spring)
    )
    position, speed, torque = axes
    position.plot(t, q, color=INK, lw=1.3)
    speed.plot(t, qd, color=INK, lw=1.3)
    torque.plot(t, tau, color=AFTER, lw=1.3, label="motor")
    if joint in {each["joint"] for each in document.springs}:
        torque.plot(t, spring, color=BEFORE, lw=1.1, ls="--", label="spring")
        torque.legend(frameon=False, fontsize=7.5, loc="upper left", ncols=2)
        _widen(torque, _LINE, above=True)
    _limits(position, q, limits.position, units.position)
    _limits(speed, qd, both_ways(limits.speed), f"{units.position}/s")
    _limits(torque, tau, both_ways(limits.torque), units.force)
    which = f" {joint}" if named else ""
    position.set_ylabel(f"position{which}, {units.position}")
    speed.set_ylabel(f"speed{which}, {units.position}/s")
    torque.set_ylabel(f"torque{which}, {units.force}")
    for ax in axes:
        low, high = ax.get_ylim()
        if low < 0 < high:
            ax.axhline(0, color=FAINT, lw=0.4, zorder=0)
        ax.set_xlim(0, document.cycle_time)
        ax.yaxis.set_major_locator(MaxNLocator(4))
        _phases(ax, document, named=False)


def both_ways(limit: float | None) -> tuple[float, float] | None:
    """The ends of what a limit of a size allows."""
    return None if limit is None else (-limit, limit)


def _limits(ax: Axes, values: Array, limits: Sequence[float] | None, unit: str) -> None:
    """A limit near the curve is drawn, one that is far away or not stated is said."""
    if limits is None:
        _note(ax, values, "no limit stated")
        return
    near = near_limits(values, limits)
    for limit in near:
        ax.axhline(limit, color=BEFORE, lw=0.9, ls=(0, (4, 2)), zorder=1)
    if not near:
        low, high = limits
        _note(ax, values, f"limits ±{high:g} {unit}" if low == -high else f"limits {low:g} and {high:g} {unit}")


def near_limits(values: Array, limits: Sequence[float]) -> list[float]:
    """Those that are drawn beside a curve."""
    low, high = float(values.min()), float(values.max())
    room = (_NEAR - 1) * max(high - low, abs(low), abs(high), 1e-9)
    return [limit for limit in limits if low - room <= limit <= high + room]


def _note(ax: Axes, values: Array, text: str) -> None:
    """In that corner on the right which the curve leaves free, made larger where neither is large enough."""
    (low, high), late = ax.get_ylim(), values[len(values) // 2 :]
    free = {True: (high - late.max()) / (high - low), False: (late.min() - low) / (high - low)}
    above = free[True] > free[False]
    _widen(ax, _LINE - free[above], above)
    place = (0.97, "top") if above else (0.03, "bottom")
    ax.text(0.99, place[0], text, transform=ax.transAxes, ha="right", va=place[1], color=FAINT, fontsize=7)


def _widen(ax: Axes, part: float, above: bool) -> None:
    """Room beyond the curves on one side, a part of the panel's height; none if that is negative."""
    low, high = ax.get_ylim()
    more = max(0.0, part) * (high - low)
    ax.set_ylim(low if above else low - more, high + more if above else high)


def _phases(ax: Axes, document: MotionDocument, named: bool) -> None:
    """Where a phase ends, and those in contact shaded; named: from which point to which, above the panel."""
    begins = 0.0
    for phase in document.phases:
        ends = begins + phase.duration
        if named:
            start, end = given(phase.start), given(phase.end)
            wide = start is not None and phase.duration > 0.3 * document.cycle_time
            text = f"{start} – {end}" if wide else ""
            ax.text((begins + ends) / 2, 1.02, text, transform=ax.get_xaxis_transform(), ha="center", fontsize=7)
        else:
            ax.axvline(ends, color=FAINT, lw=0.5, ls=":", zorder=0)
            if phase.kind == "contact":
                ax.axvspan(begins, ends, color=FAINT, alpha=0.14, lw=0, zorder=0)
        begins = ends


@dataclass(frozen=True)
class JointCycles:
    """One joint over one cycle, (F,) each; executed ones a row a cycle, (K, F).

    t s; torque of the motor, of which a model's is what the plan asks for with all that the model knows; spring: what
    it pushes the joint forward with, None without one
    """

    t: Array
    q_planned: Array
    q: Array
    torque_planned: Array
    torque: Array
    spring: Array | None
    position_unit: str
    force_unit: str


@styled
def joint_cycles(joint: JointCycles) -> Figure:
    """Position, tracking error and torque; all executed cycles, one over the other."""
    figure = Figure(figsize=(WIDTH, 3.7), layout="constrained")
    position, error, torque = figure.subplots(3, 1, sharex=True)
    for row in joint.q:
        position.plot(joint.t, row, color=AFTER, lw=1.3)
        error.plot(joint.t, row - joint.q_planned, color=AFTER, lw=0.8)
    position.plot(joint.t, joint.q_planned, color=INK, lw=0.9, ls=(0, (4, 2)))
    for row in joint.torque:
        torque.plot(joint.t, row, color=AFTER, lw=0.8)
    torque.plot(joint.t, joint.torque_planned, color=INK, lw=1.1, ls=(0, (4, 2)))
    if joint.spring is not None:
        torque.plot(joint.t, joint.spring, color=BEFORE, lw=1.1)
    position.set_ylabel(f"position, {joint.position_unit}")
    error.set_ylabel(f"error, {joint.position_unit}")
    torque.set_ylabel(f"torque, {joint.force_unit}")
    torque.set_xlabel("time within the cycle, s")
    for ax in (position, error, torque):
        ax.yaxis.set_major_locator(MaxNLocator(4))
        ax.margins(x=0)
    for ax in (error, torque):
        ax.axhline(0, color=FAINT, lw=0.4, zorder=0)
    figure.align_ylabels()
    return figure


_POINTS = 2000
"""Columns of a picture; in each the least and the largest sample are drawn."""


@styled
def signals_over_time(t: Array, rows: Sequence[tuple[str, str, Array]], pieces: Sequence[slice], title: str) -> Figure:
    """A row for each signal: name, unit and values (N,) over t (N,); gap-free pieces apart from each other."""
    figure = Figure(figsize=(1.6 * WIDTH, 0.75 * len(rows) + 0.8), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(rows), sharex=True))
    for k, (ax, (name, unit, values)) in enumerate(zip(axes, rows, strict=True)):
        for piece in pieces:
            ax.plot(*envelope(t[piece], values[piece]), color=AFTER if name.startswith("tau") else INK, lw=0.6)
        ax.set_ylabel(f"{name}\n{unit}", rotation=0, ha="right", va="center")
        ax.grid(axis="x", color=FAINT, alpha=0.2, lw=0.5)
        if k == 0:
            ax.set_title(title)
    axes[-1].set_xlabel("t, s")
    return figure


def envelope(t: Array, x: Array) -> tuple[Array, Array]:
    """Samples (N,) as a line of few points that covers the same: the least and the largest of each column."""
    if len(t) <= 2 * _POINTS:
        return t, x
    size = len(t) // _POINTS
    whole = x[: size * _POINTS].reshape(_POINTS, size)
    ends = np.stack([whole.min(axis=1), whole.max(axis=1)], axis=1).ravel()
    return np.repeat(t[: size * _POINTS : size], 2), ends
