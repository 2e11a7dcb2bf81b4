"""Figures of motions over time: a plan joint by joint, an execution beside its plan, the signals of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from runtime.arrays import Array
from runtime.documents.parts import given
from runtime.documents.plans import MotionDocument
from runtime.report.plots.style import AFTER, BEFORE, FAINT, INK, WIDTH, envelope, legend, styled

_ROW = 1.15  # inches, of each joint
_PANEL = 1.05  # inches, of each panel of one joint
_LINE = 0.25  # of a panel's height, of a line of text
_NEAR = 1.7
"""Times the largest value: a limit further away is written and not drawn, so that the curve keeps its size."""


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
    """The same of one joint (1-based), in three panels."""
    figure = Figure(figsize=(WIDTH, 0.5 + 3 * _PANEL), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    _draw(axes, document, joint, named=False)
    _phases(axes[0], document, named=True)
    axes[-1].set_xlabel("time, s")
    figure.align_ylabels()
    return figure


def moving_joints(document: MotionDocument) -> list[int]:
    """Joints (1-based) whose position changes; all of them if none does."""
    joints = document.joints
    return [j.joint for j in joints if j.range[1] > j.range[0]] or [j.joint for j in joints]


def _draw(axes: Sequence[Axes], document: MotionDocument, joint: int, named: bool) -> None:
    """named: whether the labels hold the number of the joint."""
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
        torque.plot(t, spring, color=BEFORE, lw=1.1, label="spring")
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
    """The range that a limit of the absolute value allows."""
    return None if limit is None else (-limit, limit)


def _limits(ax: Axes, values: Array, limits: Sequence[float] | None, unit: str) -> None:
    """Draw limits near the curve; write down those that are far away or not stated."""
    if limits is None:
        _note(ax, values, "no limit stated")
        return
    near = near_limits(values, limits)
    for limit in near:
        ax.axhline(limit, color=INK, lw=0.9, ls=(0, (7, 2, 1, 2)), zorder=1)
    if not near:
        low, high = limits
        _note(ax, values, f"limits ±{high:g} {unit}" if low == -high else f"limits {low:g} and {high:g} {unit}")


def near_limits(values: Array, limits: Sequence[float]) -> list[float]:
    """Limits that are near enough to a curve to be drawn."""
    low, high = float(values.min()), float(values.max())
    room = (_NEAR - 1) * max(high - low, abs(low), abs(high), 1e-9)
    return [limit for limit in limits if low - room <= limit <= high + room]


def _note(ax: Axes, values: Array, text: str) -> None:
    """Write a text in the corner on the right that is free; the panel grows where neither is."""
    (low, high), late = ax.get_ylim(), values[len(values) // 2 :]
    free = {True: (high - late.max()) / (high - low), False: (late.min() - low) / (high - low)}
    above = free[True] > free[False]
    _widen(ax, _LINE - free[above], above)
    place = (0.97, "top") if above else (0.03, "bottom")
    ax.text(0.99, place[0], text, transform=ax.transAxes, ha="right", va=place[1], color=FAINT, fontsize=7)


def _widen(ax: Axes, part: float, above: bool) -> None:
    low, high = ax.get_ylim()
    more = max(0.0, part) * (high - low)
    ax.set_ylim(low if above else low - more, high + more if above else high)


def _phases(ax: Axes, document: MotionDocument, named: bool) -> None:
    """Mark the ends of phases and shade phases in contact; named: write their end points above the panel instead."""
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
    """One joint over one cycle: planned series (F,), executed ones (K, F) with a row per cycle.

    t                s
    torque_planned   of the motor, with every effect of the model
    spring           torque with which a spring pushes the joint forward; None without one
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
    """Position, tracking error and torque of all executed cycles over the plan."""
    figure = Figure(figsize=(WIDTH, 3.7), layout="constrained")
    position, error, torque = figure.subplots(3, 1, sharex=True)
    for row in joint.q:
        position.plot(joint.t, row, color=AFTER, lw=1.3)
        error.plot(joint.t, row - joint.q_planned, color=AFTER, lw=0.8)
    position.plot(joint.t, joint.q_planned, color=INK, lw=0.9, ls=(0, (4, 2)))
    for row in joint.torque:
        torque.plot(joint.t, row, color=AFTER, lw=0.8)
    (planned,) = torque.plot(joint.t, joint.torque_planned, color=INK, lw=1.1, ls=(0, (4, 2)), label="planned")
    named = [Line2D([], [], color=AFTER, lw=1.3, label="executed"), planned]
    if joint.spring is not None:
        named += torque.plot(joint.t, joint.spring, color=BEFORE, lw=1.1, label="spring")
    legend(position, named)
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


_POINTS = 4000
"""Points of a long curve."""


@styled
def signals_over_time(t: Array, rows: Sequence[tuple[str, str, Array]], pieces: Sequence[slice], title: str) -> Figure:
    """A panel for each signal, given as name, unit and values (N,), over t (N,); curves break at gaps."""
    figure = Figure(figsize=(1.6 * WIDTH, 0.75 * len(rows) + 0.8), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(rows), sharex=True))
    for k, (ax, (name, unit, values)) in enumerate(zip(axes, rows, strict=True)):
        for piece in pieces:
            ax.plot(*envelope(t[piece], values[piece], _POINTS), color=AFTER if name.startswith("tau") else INK, lw=0.6)
        ax.set_ylabel(f"{name}\n{unit}", rotation=0, ha="right", va="center")
        ax.grid(axis="x", color=FAINT, alpha=0.2, lw=0.5)
        if k == 0:
            ax.set_title(title)
    axes[-1].set_xlabel("t, s")
    return figure


@dataclass(frozen=True)
class ReplayedJointLines:
    """A joint's positions over t (F,): recorded (F,), and those of one model or two, before and after.

    elsewhere   those of the same models in MuJoCo; empty where nobody asked
    """

    t: Array
    recorded: Array
    models: tuple[Array, ...]
    elsewhere: tuple[Array, ...]
    unit: str


@styled
def replayed_joint(lines: ReplayedJointLines) -> Figure:
    """Positions of the recording and of the models, and by how much these are off."""
    figure = Figure(figsize=(WIDTH, 0.5 + 2 * _PANEL), layout="constrained")
    position, off = figure.subplots(2, 1, sharex=True)
    colours = (BEFORE, AFTER)[-len(lines.models) :]
    off.axhline(0.0, color=FAINT, lw=0.8)
    for q, colour in zip(lines.models, colours, strict=True):
        position.plot(lines.t, q, color=colour, lw=1.1)
        off.plot(lines.t, q - lines.recorded, color=colour, lw=1.1)
    for q in lines.elsewhere:
        off.plot(lines.t, q - lines.recorded, "--", color=INK, lw=0.8)
    position.plot(lines.t, lines.recorded, color=INK, lw=0.9)
    position.set_ylabel(f"position, {lines.unit}")
    off.set_ylabel(f"off, {lines.unit}")
    off.set_xlabel("time, s")
    figure.align_ylabels()
    return figure
