"""Figures of planned motions: positions and torques of one cycle, joint by joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from runtime.report.plots.style import AFTER, BEFORE, FAINT, INK, WIDTH, styled

_ROW = 1.15  # inches, of each joint


@styled
def plan(document: Mapping[str, Any]) -> Figure:
    """Position and motor torque of every joint that moves, over one cycle; a spring's torque beside the motor's.

    document   as results.document gives it
    """
    samples, joints = document["samples"], document["joints"]
    moving = [j["joint"] for j in joints if j["range"][1] > j["range"][0]]
    springs = {spring["joint"] for spring in document["springs"]}
    figure = Figure(figsize=(1.9 * WIDTH, 0.7 + _ROW * len(moving)), layout="constrained")
    axes = figure.subplots(len(moving), 2, sharex=True, squeeze=False)
    t = np.array(samples["t"])
    bounds = np.cumsum([phase["duration"] for phase in document["trajectory"]["phases"]])[:-1]
    for row, joint in zip(axes, moving, strict=True):
        position, torque = row
        position.plot(t, samples["q"][joint - 1], color=INK, lw=1.3)
        torque.plot(t, samples["tau"][joint - 1], color=AFTER, lw=1.3, label="motor")
        if joint in springs:
            torque.plot(t, samples["spring"][joint - 1], color=BEFORE, lw=1.1, ls="--", label="spring")
            torque.legend(frameon=False, fontsize=7.5, loc="best")
        for ax in row:
            ax.axhline(0, color=FAINT, lw=0.4, zorder=0)
            for bound in bounds:
                ax.axvline(bound, color=FAINT, lw=0.5, ls=":", zorder=0)
        position.set_ylabel(f"q{joint}, rad")
        torque.set_ylabel(f"τ{joint}, N m")
    for ax in axes[-1]:
        ax.set_xlabel("time, s")
        ax.set_xlim(0, document["cycle_time"])
    figure.align_ylabels()
    return figure
