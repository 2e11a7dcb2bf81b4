"""Figure 4: friction torque over speed from the identification experiment, and the map that was estimated from it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from runtime.report.plots.style import BEFORE, FAINT, INK, WIDTH, styled
from runtime.study.identification import JointFriction

JOINT = 2
"""The one that the paper shows."""


@styled
def friction(found: JointFriction) -> Figure:
    """Measured friction torque of a joint, the estimated map, and the published one."""
    figure = Figure(figsize=(1.25 * WIDTH, 0.85 * WIDTH), layout="constrained")
    ax = figure.subplots()
    measured = found.measured()
    for number, (speed, torque) in enumerate(measured):
        label = "experiment" if number == 0 else None
        ax.plot(speed, torque, color=FAINT, alpha=0.45, lw=0.5, label=label)
    top = max(float(np.abs(speed).max()) for speed, _ in measured)
    # The map has no value at rest.
    branch = np.linspace(1e-6 * top, top, 200)
    for number, speeds in enumerate((-branch[::-1], branch)):
        labels = ("estimated map", "published map") if number == 0 else (None, None)
        ax.plot(speeds, found.friction(speeds), color=INK, lw=1.6, label=labels[0])
        ax.plot(speeds, found.printed_friction(speeds), color=BEFORE, lw=0.9, ls=(0, (4, 4)), label=labels[1])
    ax.axhline(0, color=FAINT, lw=0.4, zorder=0)
    ax.axvline(0, color=FAINT, lw=0.4, zorder=0)
    ax.margins(x=0.02)
    ax.set_xlabel(f"speed of joint {found.joint}, rad/s")
    ax.set_ylabel(f"friction torque of joint {found.joint}, N m")
    legend = ax.legend(frameon=False, loc="upper left")
    legend.get_lines()[0].set(linewidth=1.6, alpha=1.0)
    return figure
