"""Figures of an execution: one joint over one cycle, planned against executed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from runtime.report.plots.style import AFTER, BEFORE, FAINT, INK, WIDTH, styled

Array = NDArray[np.float64]


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
