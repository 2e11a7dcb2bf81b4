"""Figures of one joint in a comparison or diagnosis: its error, torque and residual over time, signals and frequency.

Every figure is about 10 cm wide, so that its labels can be read on a phone; clouds are rasterised. The colours can be
distinguished with colour blindness (Okabe & Ito 2008), and each means the same in all figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.report.plots.style import (
    ABOVE_LEGEND,
    AFTER,
    BEFORE,
    FAINT,
    INK,
    WIDTH,
    envelope,
    legend,
    residual_scale,
    styled,
)

_MOST_POINTS = 5000
_BINS = 28
_LEAST_IN_BIN = 8
_SLIVER = 0.02


@dataclass(frozen=True)
class PlotAxis:
    """A signal on the horizontal axis of a residual: values (M,) and a label with the unit.

    forward   (M,) whether the joint moves forwards, so that each direction has its own mean; None: one mean
    creep     whether the axis is stretched about 0, where friction changes most
    """

    label: str
    values: Array
    forward: NDArray[np.bool_] | None = None
    creep: bool = False

    @property
    def width(self) -> float:
        """Distance from 0 within which a stretched axis is linear."""
        size = np.abs(self.values)
        return max(float(np.quantile(size, 0.2)), 1e-3 * float(size.max()), 1e-300)

    def stretched(self) -> Array:
        """The values as they are drawn, with `creep` stretched about 0."""
        return np.arcsinh(self.values / self.width) if self.creep else self.values

    def unstretched(self, x: Array) -> Array:
        """The inverse of `stretched`, for positions on the axis."""
        return self.width * np.sinh(x) if self.creep else x

    def sides(self) -> list[NDArray[np.bool_]]:
        """Masks (M,) of the samples with a common mean: one for each direction of motion."""
        if self.creep:
            return [self.values < 0, self.values > 0]
        if self.forward is None:
            return [np.ones(len(self.values), dtype=bool)]
        return [self.forward, ~self.forward]


# --- the error ---


@styled
def error_fall(
    steps: Sequence[str],
    fitted: Sequence[float],
    held_out: Sequence[float] | None,
    floor: float,
    title: str = "",
    held_out_floor: float | None = None,
) -> Figure:
    """Relative error ‖τ − τ̂‖/‖τ‖ of one joint after each step, as bars that shrink towards their noise floor.

    steps (S,) what was added; fitted, held_out (S,) errors, and their floors: each relative to the torque.
    """
    count, both = len(steps), held_out is not None
    figure = Figure(figsize=(WIDTH, 1.15 + (0.52 if both else 0.4) * count), layout="constrained")
    ax = figure.add_subplot()
    rows = np.arange(count, dtype=float)
    colours = [BEFORE if k == 0 else AFTER for k in range(count)]
    kinds: list[tuple[str, Sequence[float], float | None, float, float]] = [
        ("fitted", fitted, floor, -0.2 if both else 0.0, 0.9)
    ]
    if held_out is not None:
        kinds.append(("held out", held_out, held_out_floor, 0.2, 0.4))
    height = 0.36 if both else 0.56
    for _, values, least, shift, alpha in kinds:
        ax.barh(rows + shift, [100 * v for v in values], height, color=colours, alpha=alpha, lw=0, zorder=2)
        _label_bars(ax, rows + shift, values, height, least)
    handles: list[Artist] = [Patch(color=INK, alpha=alpha, label=what) for what, *_, alpha in kinds if both]
    legend(ax, [*handles, Line2D([], [], color=INK, lw=1.6, label="noise floor")])
    longest = max([*fitted, *(held_out or ()), floor, held_out_floor or 0.0, 1e-6])
    ax.set(ylim=(count - 0.45, -0.55), xlim=(0, 134 * longest), xlabel="error, % of the torque")
    ax.set_yticks(rows, steps)
    ax.tick_params(axis="y", length=0)
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.spines["left"].set_visible(False)
    if title:
        ax.set_title(title, pad=ABOVE_LEGEND)
    return figure


def _label_bars(ax: Axes, rows: Array, values: Sequence[float], height: float, floor: float | None) -> None:
    """The value behind each bar, and a mark at its noise floor, if that is known."""
    if floor is not None:
        reach = 0.5 * height + 0.04
        ax.vlines(np.full(len(rows), 100 * floor), rows - reach, rows + reach, color=INK, lw=1.6, zorder=3)
    for row, value in zip(rows, values, strict=True):
        # A label does not overlap the mark of the noise floor.
        end = floor if floor is not None and value < floor < 1.4 * value else value
        ax.annotate(
            f"{100 * value:.2f} %", (100 * end, row), (4, 0), textcoords="offset points", va="center", fontsize=8
        )


# --- the residual over a signal ---


@styled
def residual_over(
    axis: PlotAxis,
    before: Array,
    after: Array | None,
    floor: float,
    unit: str,
    curve: Array | None = None,
    curve_label: str = "",
    title: str = "",
) -> Figure:
    """Residual (M,) over a signal: cloud, running mean, noise floor as a band, and the mean of a curve.

    after   (M,) the residual after the improvement, in a second panel on the same scale; None: one panel
    curve   (M,) torque that the added effects explain
    """
    parts = [("before", before, BEFORE)] if after is None else [("before", before, BEFORE), ("after", after, AFTER)]
    figure = Figure(figsize=(WIDTH, 2.1 if after is None else 3.4), layout="constrained")
    panels = figure.subplots(len(parts), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for ax, (label, residual, colour) in zip(panels, parts, strict=True):
        # A fixed seed picks the same rows in every figure and every run; many dots are more transparent.
        pick = np.random.default_rng(0).permutation(len(residual))[:_MOST_POINTS]
        alpha = float(np.clip(600 / max(len(pick), 1), 0.16, 0.7))
        ax.scatter(axis.values[pick], residual[pick], s=2.2, c=colour, alpha=alpha, lw=0, rasterized=True, zorder=2)
        ax.axhspan(-floor, floor, color=FAINT, alpha=0.22, lw=0, zorder=0)
        ax.axhline(0, color=FAINT, lw=0.6, zorder=1)
        _means(ax, axis, residual, signed=True, label=label, color=colour, lw=2.2, zorder=4)
        ax.set_ylabel(f"residual, {unit}")
        ax.yaxis.set_major_locator(MaxNLocator(4))
    if curve is not None:
        _means(panels[0], axis, curve, label=curve_label, color=INK, lw=1.5, ls=(0, (3, 1.5)), zorder=5)
    for ax in panels if after is not None else ():
        legend(ax)
    residual_scale(panels[0], [before], floor)
    _stretch(panels[-1], axis)
    panels[-1].set_xlabel(axis.label)
    panels[0].set_title(title, pad=6 if after is None else ABOVE_LEGEND)
    figure.align_ylabels()
    return figure


def _means(ax: Axes, axis: PlotAxis, y: Array, label: str, signed: bool = False, **style: Any) -> None:
    """Running mean of each direction of motion; over the velocity it breaks at standstill.

    signed   whether + and − stand at the ends of the two directions, unless they are apart already
    """
    sides, ends = axis.sides(), list[tuple[float, float, str]]()
    for k, (side, name) in enumerate(zip(sides, "+−", strict=False)):
        x, mean = running_mean(axis.stretched()[side], y[side])
        x = axis.unstretched(x)
        ax.plot(x, mean, label="" if k else label, **style)
        ends += [(float(mean[-1]), float(x[-1]), name)] if len(x) else []
    if not signed or axis.creep or len(sides) < 2:
        return
    # The higher one is moved up and the other down: they never overlap.
    for (height, x_end, name), shift in zip(sorted(ends, reverse=True), (4, -4), strict=False):
        place: Any = {"xytext": (4, shift), "textcoords": "offset points", "va": "center"}
        ax.annotate(name, (x_end, height), **place, color=style["color"], zorder=6)


def running_mean(x: Array, y: Array, bins: int = _BINS) -> tuple[Array, Array]:
    """Means of x and y in bins with about equal numbers of samples; no bin is narrower than 2 % of the range of x."""
    if len(x) < _LEAST_IN_BIN:
        return np.zeros(0), np.zeros(0)
    quantiles = np.quantile(x, np.linspace(0, 1, min(bins, len(x) // _LEAST_IN_BIN) + 1))
    least, edges = _SLIVER * float(np.ptp(x)), [quantiles[0]]
    for edge in quantiles[1:-1]:
        if edge - edges[-1] > least:
            edges.append(edge)
    index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 1)
    count = np.bincount(index, minlength=len(edges))
    use = count > 0
    mean_x, mean_y = (np.bincount(index, weights=v, minlength=len(edges))[use] / count[use] for v in (x, y))
    return mean_x, mean_y


def _stretch(ax: Axes, axis: PlotAxis) -> None:
    lowest, highest = float(axis.values.min()), float(axis.values.max())
    spread = highest - lowest or 1.0
    ax.set_xlim(lowest - 0.02 * spread, highest + 0.02 * spread)
    if not axis.creep:
        ax.xaxis.set_major_locator(MaxNLocator(6))
        return
    ax.set_xscale("asinh", linear_width=axis.width)
    ax.xaxis.set_major_locator(FixedLocator(_creep_ticks(lowest, highest, axis.width)))
    ax.xaxis.set_major_formatter(_plain)
    ax.xaxis.set_minor_locator(NullLocator())


@FuncFormatter
def _plain(value: float, _: object) -> str:
    return f"{value:g}".replace("-", "−")


def _creep_ticks(lowest: float, highest: float, width: float) -> list[float]:
    """Ticks of a stretched axis: 0 and a few round rates on either side."""
    ticks = [0.0]
    for sign, end in ((1.0, highest), (-1.0, -lowest)):
        round_ones = [m * 10.0**e for e in range(-9, 4) for m in (1.0, 3.0) if 0.7 * width <= m * 10.0**e <= end]
        ticks += [sign * v for v in round_ones[::-1][:: 1 if len(round_ones) < 4 else 2]]
    return sorted(ticks)


@styled
def spectrum(
    frequency: Array,
    before: Array,
    after: Array | None,
    noise: float,
    cutoff: float,
    unit: str,
    title: str = "",
    lines: Sequence[float] = (),
) -> Figure:
    """Amplitude density of the residual over the frequency, with the white noise of the instruments.

    frequency (F,) Hz; before, after (F,) and noise: unit/√Hz; cutoff of the band, Hz; lines to mark, Hz
    """
    figure = Figure(figsize=(WIDTH, 2.1), layout="constrained")
    ax = figure.add_subplot()
    use = (frequency > 0) & (frequency <= cutoff)
    ax.axhspan(1e-12, max(noise, 1e-12), color=FAINT, alpha=0.22, lw=0, zorder=0)
    ax.plot(frequency[use], before[use], color=BEFORE, lw=1.2)
    if after is not None:
        ax.plot(frequency[use], after[use], color=AFTER, lw=1.2)
    low = min(float(np.min(y[use], initial=np.inf)) for y in (before, after) if y is not None)
    high = max(float(np.max(y[use], initial=0.0)) for y in (before, after) if y is not None)
    if 0 < low < high:
        ax.set(yscale="log", ylim=(0.7 * min(low, noise or low), 1.6 * high))
        ax.yaxis.set_major_formatter(_plain)
        ax.yaxis.set_minor_formatter(NullFormatter())
    ax.set(xlabel="frequency, Hz", ylabel=f"residual, {unit}/√Hz", xlim=(0, cutoff))
    for k, line in enumerate(lines):
        ax.axvline(line, color=FAINT, lw=0.8, ls=(0, (2, 2)), zorder=1)
        side: Any = (
            {"ha": "left", "s": f" {line:.2f} Hz"} if line < 0.8 * cutoff else {"ha": "right", "s": f"{line:.2f} Hz "}
        )
        # Labels are staggered, so that those of close lines do not overlap.
        ax.text(line, y=0.97 - 0.11 * k, transform=ax.get_xaxis_transform(), va="top", fontsize=8, **side)
    ax.set_title(title)
    return figure


# --- what the residual follows ---


@styled
def structure(shares: Sequence[tuple[str, float, float | None]], title: str = "") -> Figure:
    """Share of the residual's variance that a curve over each signal explains: (signal, before, after or None)."""
    both = any(after is not None for _, _, after in shares)
    figure = Figure(figsize=(WIDTH, (1.05 if both else 0.85) + 0.3 * len(shares)), layout="constrained")
    ax = figure.add_subplot()
    rows = np.arange(len(shares), dtype=float)
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
    if both:
        legend(ax, [Patch(color=BEFORE, label="before"), Patch(color=AFTER, label="after")])
    ax.set_title(title, pad=ABOVE_LEGEND if both else 6)
    return figure


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
        own = {name: getattr(self, name)[use] for name in ("t", "piece", "tau", "before")}
        return replace(self, **own, after=None if self.after is None else self.after[use])

    def models(self) -> list[tuple[str, Array, str]]:
        """Name, predicted torque and colour of each model."""
        if self.after is None:
            return [("predicted", self.before, BEFORE)]
        return [("predicted before", self.before, BEFORE), ("predicted after", self.after, AFTER)]


@styled
def torque_over_time(trace: Trace, title: str = "") -> Figure:
    """Measured and predicted torque over a whole recording, and the running rms of the residual.

    Measured and predicted torque have a panel each on the same scale: drawn so densely, one would hide the other.
    """
    figure = Figure(figsize=(WIDTH, 3.8), layout="constrained")
    measured, predicted, low = figure.subplots(3, 1, sharex=True, height_ratios=(3, 3, 2))
    name, torque, colour = trace.models()[-1]
    for ax, y, style in (
        (measured, trace.tau, {"color": INK, "label": "measured"}),
        (predicted, torque, {"color": colour, "label": name}),
    ):
        if 2 * len(y) // _MOST_LINE < 3:
            _curve(ax, trace, y, lw=0.8, **style)
        else:
            ax.plot(*envelope(trace.t, y, _MOST_LINE), lw=0.8, **style)
    ends = [limit for ax in (measured, predicted) for limit in ax.get_ylim()]
    for ax in (measured, predicted):
        ax.set_ylim(min(ends), max(ends))
        ax.axhline(0, color=FAINT, lw=0.4, zorder=0)
        ax.set_ylabel(f"torque, {trace.unit}" if trace.unit != "N" else "force, N")
        ax.tick_params(axis="x", length=0)
        ax.margins(x=0.01)
        legend(ax)
    for _, torque, colour in trace.models():
        low.plot(*_running_rms(trace, trace.tau - torque), color=colour, lw=1.4)
    low.axhspan(0, trace.floor, color=FAINT, alpha=0.25, lw=0, zorder=0)
    low.set_ylim(0, None)
    low.set_ylabel(f"residual\nrms, {trace.unit}")
    low.set_xlabel("time, s")
    for ax in (measured, predicted, low):
        ax.yaxis.set_major_locator(MaxNLocator(4))
    if title:
        measured.set_title(title, pad=ABOVE_LEGEND)
    figure.align_ylabels()
    return figure


@styled
def torque_closely(trace: Trace, title: str = "") -> Figure:
    """Measured and predicted torque over some seconds, and the residual with the noise floor as a band."""
    figure, top, low = _time_axes(trace, title)
    _curve(top, trace, trace.tau, color=INK, lw=1.6, label="measured")
    for name, predicted, colour in trace.models():
        _curve(top, trace, predicted, color=colour, lw=1.2, label=name)
        _curve(low, trace, trace.tau - predicted, color=colour, lw=1.1)
    low.axhspan(-trace.floor, trace.floor, color=FAINT, alpha=0.25, lw=0, zorder=0)
    low.axhline(0, color=FAINT, lw=0.6, zorder=0)
    residual_scale(low, [trace.tau - trace.before], trace.floor)
    low.set_ylabel(f"residual, {trace.unit}")
    legend(top)
    return figure


@styled
def effect_closely(trace: Trace, name: str, title: str = "") -> Figure:
    """Residual over some seconds before and after an effect was added, and the torque that it explains, dashed.

    For effects with a memory, whose torque is not a function of a signal at the same instant. `after` must be given.
    """
    assert trace.after is not None
    figure, top, low = _time_axes(trace, title, (1, 1))
    for ax, (label, predicted, colour) in zip((top, low), trace.models(), strict=True):
        _curve(ax, trace, trace.tau - predicted, color=colour, lw=1.2, label=label.replace("predicted", "residual"))
        ax.axhspan(-trace.floor, trace.floor, color=FAINT, alpha=0.25, lw=0, zorder=0)
        ax.axhline(0, color=FAINT, lw=0.6, zorder=0)
        residual_scale(ax, [trace.tau - trace.before], trace.floor)
        ax.set_ylabel(f"residual, {trace.unit}")
    _curve(top, trace, trace.after - trace.before, color=INK, lw=1.4, ls=(0, (3, 1.5)), label=name)
    for ax in (top, low):
        legend(ax)
    return figure


def _time_axes(trace: Trace, title: str, heights: tuple[int, int] = (3, 2)) -> tuple[Figure, Axes, Axes]:
    figure = Figure(figsize=(WIDTH, 3.2), layout="constrained")
    top, low = figure.subplots(2, 1, sharex=True, height_ratios=heights)
    top.set_ylabel(f"torque, {trace.unit}" if trace.unit != "N" else "force, N")
    low.set_xlabel("time, s")
    if title:
        top.set_title(title, pad=ABOVE_LEGEND)
    for ax in (top, low):
        ax.yaxis.set_major_locator(MaxNLocator(4))
    top.tick_params(axis="x", length=0)
    top.margins(x=0.01)
    figure.align_ylabels()
    return figure, top, low


def _running_rms(trace: Trace, residual: Array, bins: int = 90) -> tuple[Array, Array]:
    """Time and rms of a residual in bins of equal length; NaN where a bin is empty."""
    edges = np.linspace(trace.t.min(), trace.t.max(), bins + 1)
    index = np.clip(np.searchsorted(edges, trace.t, side="right") - 1, 0, bins - 1)
    count = np.bincount(index, minlength=bins)
    total = np.bincount(index, weights=residual**2, minlength=bins)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return (edges[1:] + edges[:-1]) / 2, np.sqrt(mean)


def _curve(ax: Axes, trace: Trace, y: Array, **style: Any) -> None:
    t, steps = trace.t, np.diff(trace.t)
    step = float(np.median(steps)) if len(steps) else 1.0
    breaks = np.flatnonzero((steps > 5 * step) | (steps < 0) | (np.diff(trace.piece) != 0)) + 1
    ax.plot(np.insert(t, breaks, np.nan), np.insert(y, breaks, np.nan), **style)
