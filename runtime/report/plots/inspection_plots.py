"""A recording at a glance: positions, rates and torques of all joints over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from runtime.report.plots.style import AFTER, FAINT, INK, WIDTH, styled

Array = NDArray[np.float64]

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
