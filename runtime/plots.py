"""Figures of a comparison or diagnosis: data in, Figure out. They read the same in a notebook and in the report.

Every figure is about 11 cm wide, so that its labels stay readable on a phone; clouds are rasterised. The
colours are told apart by colour-blind people (Okabe & Ito 2008), and every one stands for one thing in all
figures.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import AsinhLocator, FuncFormatter, MaxNLocator
from numpy.typing import NDArray

Array = NDArray[np.float64]
P = ParamSpec("P")

INK = "#1f2730"  # what was measured; text
FAINT = "#66727f"  # axes, the noise floor
BEFORE = "#c8500a"  # the model as given
AFTER = "#0a6fb0"  # the improved model
COLOURS = {"ink": INK, "faint": FAINT, "before": BEFORE, "after": AFTER}
"""Names of the colours, by which a page may exchange them."""

_STYLE = {
    "font.family": "sans-serif",
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.facecolor": "none",
    "axes.unicode_minus": True,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "savefig.dpi": 170,
    "text.color": INK,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "lines.solid_capstyle": "round",
    "path.simplify_threshold": 0.2,
    "svg.fonttype": "none",
}
_WIDTH = 4.5  # inches
_MOST_POINTS = 5000
_MOST_LINE = 700
_BINS = 28
_LEAST_IN_BIN = 8


def _styled(make: Callable[P, Figure]) -> Callable[P, Figure]:
    @wraps(make)
    def styled(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with mpl.rc_context(_STYLE):  # type: ignore[arg-type]
            return make(*args, **kwargs)

    return styled


def svg(figure: Figure, name: str) -> str:
    """The figure as an SVG document, the same bytes at every call; `name` keeps its ids apart from other figures'."""
    buffer = io.StringIO()
    with mpl.rc_context({**_STYLE, "svg.hashsalt": name}):  # type: ignore[arg-type]
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Type": None, "Format": None})
    return buffer.getvalue()


@dataclass(frozen=True)
class Axis:
    """A signal to lay a residual over: values (M,), its name with unit.

    forward   (M,) whether the joint moves forwards, to average each direction on its own; None: one mean
    creep     stretch the axis about 0, where friction changes most
    """

    label: str
    values: Array
    forward: NDArray[np.bool_] | None = None
    creep: bool = False


# --- the error ---


@_styled
def error_fall(
    steps: Sequence[str], fitted: Sequence[float], held_out: Sequence[float] | None, floor: float, title: str = ""
) -> Figure:
    """Relative error ‖τ − τ̂‖/‖τ‖ of one joint after each step, as bars that shrink towards the noise floor.

    steps (S,) what was added; fitted, held_out (S,) errors, and floor: each relative to the torque.
    """
    count = len(steps)
    pitch = 0.52 if held_out is not None else 0.4
    figure = Figure(figsize=(_WIDTH, 0.95 + pitch * count), layout="constrained")
    ax = figure.add_subplot()
    rows = np.arange(count, dtype=float)
    colours = [BEFORE if k == 0 else AFTER for k in range(count)]
    height = 0.36 if held_out is not None else 0.56
    shift = 0.2 if held_out is not None else 0.0
    _bars(ax, rows - shift, fitted, height, colours, 0.9, "fitted " if held_out is not None else "")
    if held_out is not None:
        _bars(ax, rows + shift, held_out, height, colours, 0.4, "held out ")
    longest = max([*fitted, *(held_out or ())])
    ax.axvspan(0, 100 * floor, color=FAINT, alpha=0.16, lw=0, zorder=0)
    ax.axvline(100 * floor, color=FAINT, lw=1.1, ls=(0, (4, 2)), zorder=3)
    ax.text(100 * floor, -0.62, "noise floor", color=FAINT, ha="center", va="bottom", fontsize=8)
    ax.set(ylim=(count - 0.45, -0.6), xlim=(0, 128 * longest), xlabel="error, % of the torque")
    ax.set_yticks(rows, steps)
    ax.tick_params(axis="y", length=0)
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.spines["left"].set_visible(False)
    if title:
        ax.set_title(title, pad=16)
    return figure


def _bars(
    ax: Axes, rows: Array, values: Sequence[float], height: float, colours: list[str], alpha: float, what: str
) -> None:
    bars = ax.barh(rows, [100 * v for v in values], height, color=colours, alpha=alpha, lw=0, zorder=2)
    for k, (bar, value) in enumerate(zip(bars, values, strict=True)):
        text = f" {what if k == 0 else ''}{100 * value:.2f} %"
        ax.text(bar.get_width(), bar.get_y() + bar.get_height() / 2, text, va="center", ha="left", fontsize=8)


# --- torque over time ---


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
        use = (self.t >= start) & (self.t <= stop) & (self.piece == piece)
        after = None if self.after is None else self.after[use]
        return Trace(self.t[use], self.piece[use], self.tau[use], self.before[use], after, self.floor, self.unit)


@_styled
def torque_over_time(trace: Trace, title: str = "", whole: bool = True) -> Figure:
    """Measured and predicted torque; below it the residual, before and after, with the noise floor as a band.

    whole   draw the envelope of many samples, one clear line each; else every sample
    """
    figure = Figure(figsize=(_WIDTH, 3.5), layout="constrained")
    top, low = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    drawn = _Envelope(trace.t, trace.piece) if whole else _Lines(trace.t, trace.piece)
    drawn.line(top, trace.tau, color=INK, lw=0.8 if whole else 1.5, alpha=0.85, label="measured")
    model = [("predicted before", trace.before, BEFORE), ("after", trace.after, AFTER)]
    if trace.after is None:
        model = [("predicted", trace.before, BEFORE)]
    for label, predicted, colour in model:
        assert predicted is not None
        if not whole or colour == model[-1][2]:
            drawn.line(top, predicted, color=colour, lw=0.7 if whole else 1.2, alpha=0.95, label=label)
        drawn.line(low, trace.tau - predicted, color=colour, lw=0.6 if whole else 1.1, alpha=0.9)
    if whole and trace.after is not None:
        top.lines[-1].set_label("predicted after")
    low.axhspan(-trace.floor, trace.floor, color=FAINT, alpha=0.25, lw=0, zorder=0)
    low.axhline(0, color=FAINT, lw=0.6, zorder=0)
    # As in the header of a table: names in their colours, above the curves.
    top.legend(
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        ncols=3,
        frameon=False,
        borderaxespad=0,
        borderpad=0.2,
        handlelength=1.1,
        columnspacing=1.2,
        labelcolor="linecolor",
        fontsize=8,
    )
    top.set_ylabel(f"torque, {trace.unit}" if trace.unit != "N" else "force, N")
    low.set(ylabel=f"residual, {trace.unit}", xlabel="time, s")
    _limits(low, [trace.tau - trace.before], trace.floor)
    if title:
        top.set_title(title, pad=17)
    for ax in (top, low):
        ax.yaxis.set_major_locator(MaxNLocator(4))
    top.tick_params(axis="x", length=0)
    top.margins(x=0.01)
    figure.align_ylabels()
    return figure


class _Lines:
    """Curves over time that break where rows are missing."""

    def __init__(self, t: Array, piece: NDArray[np.intp]) -> None:
        self.t = t
        step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
        self.breaks = np.flatnonzero((np.diff(t) > 5 * step) | (np.diff(t) < 0) | (np.diff(piece) != 0)) + 1

    def line(self, ax: Axes, y: Array, **style: Any) -> None:
        ax.plot(np.insert(self.t, self.breaks, np.nan), np.insert(y, self.breaks, np.nan), **style)


class _Envelope:
    """Curves over a long time: the smallest and largest value of each bin, in their order in time."""

    def __init__(self, t: Array, piece: NDArray[np.intp]) -> None:
        self.size = max(1, 2 * len(t) // _MOST_LINE)
        self.plain = _Lines(t, piece)
        self.t = t

    def line(self, ax: Axes, y: Array, **style: Any) -> None:
        if self.size < 3:
            self.plain.line(ax, y, **style)
            return
        keep = (len(y) // self.size) * self.size
        bins = y[:keep].reshape(-1, self.size)
        pick = np.sort(np.stack([bins.argmin(axis=1), bins.argmax(axis=1)], axis=1), axis=1)
        index = (pick + self.size * np.arange(len(bins))[:, None]).ravel()
        ax.plot(self.t[index], y[index], **style)


# --- the residual over a signal ---


@_styled
def residual_over(
    axis: Axis,
    before: Array,
    after: Array | None,
    floor: float,
    unit: str,
    curve: Array | None = None,
    curve_label: str = "",
    title: str = "",
) -> Figure:
    """Residual (M,) over a signal: cloud, running mean, the noise floor as a band, and a curve drawn through it.

    after   the same after the improvement, in a panel below on the same scale; None: one panel
    curve   (M,) torque that what was added explains
    """
    parts = [("before", before, BEFORE)] if after is None else [("before", before, BEFORE), ("after", after, AFTER)]
    figure = Figure(figsize=(_WIDTH, 2.3 if after is None else 3.6), layout="constrained")
    panels = figure.subplots(len(parts), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for ax, (label, residual, colour) in zip(panels, parts, strict=True):
        _cloud(ax, axis, residual, colour)
        ax.axhspan(-floor, floor, color=FAINT, alpha=0.22, lw=0, zorder=0)
        ax.axhline(0, color=FAINT, lw=0.6, zorder=1)
        _means(ax, axis, residual, color=colour, lw=2.2, zorder=4)
        if after is not None:
            ax.text(0.01, 0.98, label, transform=ax.transAxes, color=colour, va="top", weight="bold", fontsize=8.5)
        ax.set_ylabel(f"residual, {unit}")
        ax.yaxis.set_major_locator(MaxNLocator(4))
    if curve is not None:
        _means(panels[0], axis, curve, color=INK, lw=1.5, ls=(0, (3, 1.5)), zorder=5)
        panels[0].text(
            0.99,
            0.98,
            f"– – {curve_label}",
            transform=panels[0].transAxes,
            ha="right",
            va="top",
            fontsize=8.5,
            zorder=6,
        )
    _limits(panels[0], [before], floor)
    _stretch(panels[-1], axis)
    panels[-1].set_xlabel(axis.label)
    if title:
        panels[0].set_title(title)
    figure.align_ylabels()
    return figure


def _cloud(ax: Axes, axis: Axis, residual: Array, colour: str) -> None:
    # The same rows in every figure and every run: a fixed seed, no clock.
    pick = np.random.default_rng(0).permutation(len(residual))[:_MOST_POINTS]
    ax.scatter(axis.values[pick], residual[pick], s=2.2, c=colour, alpha=0.16, lw=0, rasterized=True, zorder=2)


def _means(ax: Axes, axis: Axis, y: Array, **style: Any) -> None:
    """Running mean, of each direction of motion on its own; over a rate, broken at standstill."""
    if axis.creep:
        sides = [axis.values < 0, axis.values > 0]
    else:
        sides = [np.ones(len(y), dtype=bool)] if axis.forward is None else [axis.forward, ~axis.forward]
    names = ["", ""] if axis.creep or len(sides) < 2 else ["+", "−"]
    for side, name in zip(sides, names, strict=False):
        x, mean = running_mean(axis.values[side], y[side])
        ax.plot(x, mean, **style)
        if name and len(x) and "ls" not in style:
            ax.annotate(
                name, (x[-1], mean[-1]), (4, 0), textcoords="offset points", va="center", color=style["color"], zorder=6
            )


def running_mean(x: Array, y: Array, bins: int = _BINS) -> tuple[Array, Array]:
    """Mean of x and of y in bins of equally many samples; fewer bins where samples are few."""
    bins = min(bins, len(x) // _LEAST_IN_BIN)
    if bins < 1:
        return np.zeros(0), np.zeros(0)
    order = np.argsort(x, kind="stable")
    parts = np.array_split(order, bins)
    return np.array([x[p].mean() for p in parts]), np.array([y[p].mean() for p in parts])


def _limits(ax: Axes, residuals: Sequence[Array], floor: float) -> None:
    """A scale that a few outliers do not set."""
    reach = max(float(np.quantile(np.abs(r), 0.997)) for r in residuals)
    reach = max(1.15 * reach, 2.5 * floor)
    ax.set_ylim(-reach, reach)


def _stretch(ax: Axes, axis: Axis) -> None:
    lowest, highest = float(axis.values.min()), float(axis.values.max())
    spread = highest - lowest or 1.0
    ax.set_xlim(lowest - 0.02 * spread, highest + 0.02 * spread)
    if not axis.creep:
        ax.xaxis.set_major_locator(MaxNLocator(6))
        return
    width = max(float(np.quantile(np.abs(axis.values), 0.2)), 1e-3 * max(abs(lowest), abs(highest)))
    ax.set_xscale("asinh", linear_width=width)
    ax.xaxis.set_major_locator(AsinhLocator(width, numticks=7, symthresh=0.0))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}".replace("-", "−")))
    ax.xaxis.set_minor_locator(mpl.ticker.NullLocator())


# --- where the residual sits ---


@_styled
def structure(shares: Sequence[tuple[str, float, float | None]], title: str = "") -> Figure:
    """Share of the residual's variance that a curve over each signal explains: (signal, before, after or None)."""
    figure = Figure(figsize=(_WIDTH, 0.85 + 0.3 * len(shares)), layout="constrained")
    ax = figure.add_subplot()
    rows = np.arange(len(shares), dtype=float)
    both = any(after is not None for _, _, after in shares)
    for k, (_, before, after) in enumerate(shares):
        values = [(before, BEFORE, -0.19 if both else 0.0)] + ([(after, AFTER, 0.19)] if after is not None else [])
        for value, colour, shift in values:
            ax.barh(rows[k] + shift, 100 * value, 0.34 if both else 0.6, color=colour, alpha=0.9, lw=0)
            ax.text(100 * value + 1, rows[k] + shift, f"{100 * value:.0f} %", va="center", fontsize=7 if both else 8)
    ax.set_yticks(rows, [name for name, _, _ in shares])
    ax.set(ylim=(len(shares) - 0.45, -0.55), xlim=(0, 112), xlabel="of the residual's variance, %")
    ax.set_xticks([0, 25, 50, 75, 100])
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    if title:
        ax.set_title(title)
    return figure
