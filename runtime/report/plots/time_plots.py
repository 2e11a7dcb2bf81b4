"""Figures over time: torque and residual of one joint, over a whole recording or some seconds of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from runtime.report.plots.style import AFTER, BEFORE, FAINT, INK, WIDTH, residual_scale, styled

Array = NDArray[np.float64]

_MOST_LINE = 700


@dataclass(frozen=True)
class Trace:
    """Torques of one joint over time, each (M,): measured, and predicted before and after; after may be None."""

    t: Array
    piece: NDArray[np.intp]
    tau: Array
    before: Array
    after: Array | None
    floor: float
    unit: str

    def cut(self, start: float, stop: float, piece: int) -> Trace:
        """The samples of one piece from start to stop, s."""
        use = (self.t >= start) & (self.t <= stop) & (self.piece == piece)
        after = None if self.after is None else self.after[use]
        return Trace(self.t[use], self.piece[use], self.tau[use], self.before[use], after, self.floor, self.unit)

    def models(self) -> list[tuple[str, Array, str]]:
        """Name, predicted torque and colour of what there is."""
        if self.after is None:
            return [("predicted", self.before, BEFORE)]
        return [("predicted before", self.before, BEFORE), ("predicted after", self.after, AFTER)]


@styled
def torque_over_time(trace: Trace, title: str = "") -> Figure:
    """Measured torque over a whole recording and, apart from it on the same scale, the predicted one: so densely drawn,
    one would hide the other. Below how large the residual is as time goes on."""
    figure = Figure(figsize=(WIDTH, 3.8), layout="constrained")
    measured, predicted, low = figure.subplots(3, 1, sharex=True, height_ratios=(3, 3, 2))
    name, torque, colour = trace.models()[-1]
    _envelope(measured, trace, trace.tau, color=INK, lw=0.8, label="measured")
    _envelope(predicted, trace, torque, color=colour, lw=0.8, label=name)
    ends = [limit for ax in (measured, predicted) for limit in ax.get_ylim()]
    for ax in (measured, predicted):
        ax.set_ylim(min(ends), max(ends))
        ax.axhline(0, color=FAINT, lw=0.4, zorder=0)
        ax.set_ylabel(f"torque, {trace.unit}" if trace.unit != "N" else "force, N")
        ax.tick_params(axis="x", length=0)
        ax.margins(x=0.01)
        _legend(ax)
    for _, torque, colour in trace.models():
        low.plot(*_running_rms(trace, trace.tau - torque), color=colour, lw=1.4)
    low.axhspan(0, trace.floor, color=FAINT, alpha=0.25, lw=0, zorder=0)
    low.set_ylim(0, None)
    low.set_ylabel(f"rms left, {trace.unit}")
    low.set_xlabel("time, s")
    for ax in (measured, predicted, low):
        ax.yaxis.set_major_locator(MaxNLocator(4))
    if title:
        measured.set_title(title, pad=17)
    figure.align_ylabels()
    return figure


@styled
def torque_closely(trace: Trace, title: str = "") -> Figure:
    """Measured and predicted torque over some seconds; below it the residual, with the noise floor as a band."""
    figure, top, low = _time_axes(trace, title)
    drawn = _Lines(trace.t, trace.piece)
    drawn.line(top, trace.tau, color=INK, lw=1.6, label="measured")
    for name, predicted, colour in trace.models():
        drawn.line(top, predicted, color=colour, lw=1.2, label=name)
        drawn.line(low, trace.tau - predicted, color=colour, lw=1.1)
    low.axhspan(-trace.floor, trace.floor, color=FAINT, alpha=0.25, lw=0, zorder=0)
    low.axhline(0, color=FAINT, lw=0.6, zorder=0)
    residual_scale(low, [trace.tau - trace.before], trace.floor)
    low.set_ylabel(f"residual, {trace.unit}")
    _legend(top)
    return figure


@styled
def effect_closely(trace: Trace, name: str, title: str = "") -> Figure:
    """The residual over some seconds before and after an effect was added, and the torque that it explains, dashed.

    For effects with a memory, whose torque is no function of any signal at the same instant. `after` must be there.
    """
    assert trace.after is not None
    figure, top, low = _time_axes(trace, title, (1, 1))
    drawn = _Lines(trace.t, trace.piece)
    for ax, (label, predicted, colour) in zip((top, low), trace.models(), strict=True):
        drawn.line(ax, trace.tau - predicted, color=colour, lw=1.2, label=label.replace("predicted", "residual"))
        ax.axhspan(-trace.floor, trace.floor, color=FAINT, alpha=0.25, lw=0, zorder=0)
        ax.axhline(0, color=FAINT, lw=0.6, zorder=0)
        residual_scale(ax, [trace.tau - trace.before], trace.floor)
        ax.set_ylabel(f"residual, {trace.unit}")
    drawn.line(top, trace.after - trace.before, color=INK, lw=1.4, ls=(0, (3, 1.5)), label=name)
    for ax in (top, low):
        _legend(ax)
    return figure


def _time_axes(trace: Trace, title: str, heights: tuple[int, int] = (3, 2)) -> tuple[Figure, Axes, Axes]:
    figure = Figure(figsize=(WIDTH, 3.2), layout="constrained")
    top, low = figure.subplots(2, 1, sharex=True, height_ratios=heights)
    top.set_ylabel(f"torque, {trace.unit}" if trace.unit != "N" else "force, N")
    low.set_xlabel("time, s")
    if title:
        top.set_title(title, pad=17)
    for ax in (top, low):
        ax.yaxis.set_major_locator(MaxNLocator(4))
    top.tick_params(axis="x", length=0)
    top.margins(x=0.01)
    figure.align_ylabels()
    return figure, top, low


def _legend(ax: Axes) -> None:
    """Names in their colours, in one line above the curves."""
    where: Any = {"loc": "lower left", "bbox_to_anchor": (0, 1.0), "borderaxespad": 0, "borderpad": 0.2}
    shape: Any = {"ncols": 3, "handlelength": 1.1, "columnspacing": 1.2}
    ax.legend(**where, **shape, frameon=False, labelcolor="linecolor", fontsize=8)


def _running_rms(trace: Trace, residual: Array, bins: int = 90) -> tuple[Array, Array]:
    """Time and rms of a residual in equally long bins; nan where a bin is empty."""
    edges = np.linspace(trace.t.min(), trace.t.max(), bins + 1)
    index = np.clip(np.searchsorted(edges, trace.t, side="right") - 1, 0, bins - 1)
    count = np.bincount(index, minlength=bins)
    total = np.bincount(index, weights=residual**2, minlength=bins)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return (edges[1:] + edges[:-1]) / 2, np.sqrt(mean)


class _Lines:
    """Curves over time that break where rows are missing."""

    def __init__(self, t: Array, piece: NDArray[np.intp]) -> None:
        self.t = t
        step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
        self.breaks = np.flatnonzero((np.diff(t) > 5 * step) | (np.diff(t) < 0) | (np.diff(piece) != 0)) + 1

    def line(self, ax: Axes, y: Array, **style: Any) -> None:
        ax.plot(np.insert(self.t, self.breaks, np.nan), np.insert(y, self.breaks, np.nan), **style)


def _envelope(ax: Axes, trace: Trace, y: Array, **style: Any) -> None:
    """A curve over a long time: the smallest and largest value of each bin, in their order in time."""
    size = 2 * len(y) // _MOST_LINE
    if size < 3:
        _Lines(trace.t, trace.piece).line(ax, y, **style)
        return
    bins = y[: len(y) // size * size].reshape(-1, size)
    pick = np.sort(np.stack([bins.argmin(axis=1), bins.argmax(axis=1)], axis=1), axis=1)
    index = (pick + size * np.arange(len(bins))[:, None]).ravel()
    ax.plot(trace.t[index], y[index], **style)
