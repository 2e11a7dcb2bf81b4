"""The figures of a result: which plots are drawn for its joints and findings, as SVG elements for a page."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup, escape
from matplotlib.figure import Figure
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.diagnosis.steps import Step
from runtime.identification.compare import JointSeries, structure_shares
from runtime.model.catalogue import EffectInfo
from runtime.motion import spectra
from runtime.report.plots import joint_plots, style
from runtime.report.summary import ResultSummary, relative_floor
from runtime.wording import AS_GIVEN

ORDER = ("velocity", "position", "load", "temperature", "time")
_ZOOM_S = 2.5
_NOTHING = 0.01
_FOLLOWS = 0.1
_LONGEST_NAME = 34


@dataclass(frozen=True)
class Drawn:
    """A figure of a result: its SVG element for a page, its caption, and the Matplotlib figure.

    A notebook shows it on white.
    """

    svg: Markup
    caption: str
    figure: Figure = field(repr=False, compare=False)

    def save(self, path: Path | str) -> None:
        """Write the figure to a file: .svg, .png or .pdf. Raises OSError."""
        style.save(self.figure, Path(path))

    def _repr_html_(self) -> str:
        name = hashlib.sha256(self.svg.encode()).hexdigest()[:12]
        text = style.svg(self.figure, name)
        box = "display:inline-block;margin:0 1em 1em 0;background:#fff;color:#1f2730"
        drawing, caption = text[text.index("<svg") :], escape(self.caption)
        return f'<figure style="{box}">{drawing}<figcaption>{caption}</figcaption></figure>'


def drawn(figure: Figure, name: str, caption: str) -> Drawn:
    """An SVG element to embed in a page, which sets its colours; `name` is unique on the page."""
    text = style.svg(figure, name)
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r' xmlns(:xlink)?="[^"]*"', "", text)
    text = re.sub(r' id="[A-Za-z][A-Za-z0-9.]*_\d+"', "", text)  # axes_1 and the like: the same in every figure
    text = re.sub(r"font-family: [^;\"]*;?", "", text)
    text = re.sub(r"font: ([^;\"']*?px) [^;\"]*", r"font-size: \1", text)
    text = re.sub(r'<svg height="[^"]*"', "<svg", text)
    text = re.sub(r' (width|height)="[\d.]+pt"', "", text, count=2)
    for colour, code in style.COLOURS.items():
        text = text.replace(code, f"var(--{colour})")
    text = re.sub(r"\n\s*", "\n", text)
    text = text.replace("<svg", f'<svg role="img" aria-label="{escape(caption)}"', 1)
    return Drawn(Markup(text), caption, figure)


def label(step: Step) -> str:
    """What a step did to the model, in a few words."""
    return AS_GIVEN if step.added is None else f"+\N{NO-BREAK SPACE}{step.added}"


def error(steps: Sequence[Step], joint: int, held_out_floor: float | None = None) -> Figure:
    """Error of a joint (0-based) after each step; held_out_floor: relative to the torque.

    The noise floor is that of the last step: the error of a wrong model raises the floor from repeats.
    """
    held = [s.held_out.relative[joint] for s in steps if s.held_out is not None]
    series = steps[-1].joints[joint]
    title = f"Joint {joint + 1}" if len(steps[0].joints) > 1 else ""
    return joint_plots.error_fall(
        [label(s) for s in steps],
        [s.fitted.relative[joint] for s in steps],
        held if len(held) == len(steps) else None,
        floor=relative_floor(series),
        title=title,
        held_out_floor=held_out_floor,
    )


def of_result(summary: ResultSummary) -> list[Drawn]:
    """For every joint its error after each step, then its torque and residual."""
    found = []
    for i in range(len(summary.first.joints)):
        caption = f"Error of joint {i + 1} after each step; the marks across the bars are the noise floor."
        found.append(drawn(error(summary.steps, i, summary.held_out_floor(i)), f"error{i + 1}", caption))
        found += of_joint(summary.first, summary.last, i, summary.findings_at(i))
    return found


def of_joint(first: Step, last: Step, joint: int, findings: Sequence[Step]) -> list[Drawn]:
    """Torque over time, whole and in detail, then the residual over every signal, the largest share first.

    No figures of a joint that never moves.
    """
    before = first.joints[joint]
    if len(before.t) < 2:
        return []
    after = last.joints[joint] if last is not first else None
    number = joint + 1
    trace, end_to_end = _trace(before, after)
    caption = "Measured and predicted torque, and the residual"
    found = [
        drawn(
            joint_plots.torque_over_time(trace, "All of the recording"),
            f"time{number}",
            f"{caption}{', recordings end to end' if end_to_end else ''}.",
        )
    ]
    zoom = trace.cut(*_largest_change(trace))
    if len(zoom.t) > 1:
        seconds = f"{zoom.t[-1] - zoom.t[0]:.1f} s"
        why = "where the improvement is largest" if after is not None else "where the residual is largest"
        title = f"The {seconds} {why}"
        found.append(
            drawn(
                joint_plots.torque_closely(zoom, title),
                f"zoom{number}",
                f"{caption}, in {seconds}; gaps are standstill.",
            )
        )
    curve = after.predicted - before.predicted if after is not None and findings else None
    name = " + ".join(dict.fromkeys(f.term.effect for f in findings))
    name = name if len(name) <= _LONGEST_NAME else "all that was added"
    share = structure_shares(before)
    for signal in sorted(signals(before), key=lambda s: -share[s]):
        found.append(
            _residual(
                before, after, signal, curve=curve, label=name, name=f"residual{number}{signal}", share=share[signal]
            )
        )
    # A residual that follows no signal may be a disturbance, which the spectrum shows.
    place = len(found) if max(share.values()) > _FOLLOWS else 2
    found.insert(place, _spectrum(first, last, joint))
    return found


def _spectrum(first: Step, last: Step, joint: int) -> Drawn:
    """Spectrum of the residual: a line is a disturbance, or a motor's ripple at constant speed."""
    motion, before = first.fit.motion, first.joints[joint]
    left, cutoff = last.fit.residual[joint], motion.cutoff(joint)
    frequency, before_density = density(first, joint)
    line = spectra.strongest_line(left, motion.row_rate(joint))
    peaks = spectra.peaks(left, last.fit.motion.row_rate(joint), cutoff)
    if line is not None:
        peaks = [line.frequency, *(p for p in peaks if abs(p - line.frequency) > 2 * frequency[1])]
    figure = joint_plots.spectrum(
        frequency,
        before_density,
        None if last is first else density(last, joint)[1],
        noise=before.floor.spectrum / np.sqrt(cutoff),
        cutoff=cutoff,
        unit=before.force_unit,
        title="Residual over frequency",
        lines=peaks,
    )
    caption = "Residual over frequency; grey: the noise of the instruments alone, if it is white."
    if line is not None:
        caption += f" The line at {line.frequency:.2f} Hz holds {100 * line.share:.0f} % of the power."
    elif peaks:
        caption += f" Peaks that hold little of it: {', '.join(f'{p:.2f} Hz' for p in peaks)}."
    return drawn(figure, f"spectrum{joint + 1}", caption)


def density(step: Step, joint: int) -> tuple[Array, Array]:
    """Frequencies, Hz, and amplitude density of a joint's residual."""
    return amplitudes(step.fit.residual[joint], step.fit.motion.row_rate(joint))


def amplitudes(residual: Array, rate: float) -> tuple[Array, Array]:
    """Frequencies, Hz, and amplitude density of a residual (M,) at `rate`, Hz."""
    frequency, power = spectra.density(residual, rate)
    return frequency, np.sqrt(power)


def of_finding(finding: Step, info: EffectInfo, name: str, alone: bool) -> list[Drawn]:
    """Figures of a finding: over the signal that shows most of it, and over time if the effect has a memory.

    alone   whether it is the only finding at its joint, whose own figures show the first already
    """
    joint = finding.joint_index
    before, after = finding.previous.joints[joint], finding.joints[joint]
    curve, effect = after.predicted - before.predicted, finding.term.effect
    found = []
    if not alone:
        signal = strongest_signal(before, curve)
        found.append(
            _residual(
                before,
                after,
                signal,
                curve=curve,
                label=effect,
                name=f"{name}over",
                share=structure_shares(before)[signal],
            )
        )
    if info.states:
        trace, _ = _trace(before, after)
        closely = trace.cut(*_most(trace, curve**2))
        if len(closely.t) > 1:
            title = f"The {closely.t[-1] - closely.t[0]:.1f} s where {effect} acts most"
            caption = f"Residual in the seconds where {effect} acts most, and its torque drawn through it, dashed."
            found.append(drawn(joint_plots.effect_closely(closely, effect, title), f"{name}closely", caption))
    return found


def strongest_signal(series: JointSeries, curve: Array) -> str:
    """The signal over which the running mean of a torque (M,) varies most."""
    size = {}
    for signal in signals(series):
        axis = axis_of(series, signal)
        sides = [axis.forward, ~axis.forward] if axis.forward is not None else [axis.values < 0, axis.values > 0]
        size[signal] = sum(
            float(np.var(joint_plots.running_mean(axis.values[s], curve[s])[1]))
            for s in sides
            if np.count_nonzero(s) > 20
        )
    return max(size, key=lambda s: size[s])


def _residual(
    before: JointSeries,
    after: JointSeries | None,
    signal: str,
    curve: Array | None,
    label: str,
    name: str,
    share: float,
) -> Drawn:
    figure = joint_plots.residual_over(
        axis_of(before, signal),
        before.residual,
        None if after is None else after.residual,
        floor=before.floor.value,
        unit=before.force_unit,
        curve=curve,
        curve_label=label,
        title=f"Residual over {signal}",
    )
    when = "" if after is None else " before"
    caption = f"Residual over {signal}, which explains {100 * share:.0f} % of its variance{when}."
    return drawn(figure, name, caption)


def signals(series: JointSeries) -> list[str]:
    """Signals with a panel that vary."""
    values = series.signals()
    return [s for s in ORDER if s in values and float(np.ptp(values[s])) > 1e-9 * max(1.0, np.abs(values[s]).max())]


def axis_of(series: JointSeries, signal: str) -> joint_plots.PlotAxis:
    """A signal of a joint as the horizontal axis of a figure."""
    forward = series.qd > 0
    position, force = series.position_unit, series.force_unit
    units = {
        "velocity": f"velocity, {position}/s (stretched about 0)",
        "position": f"position, {position}",
        "acceleration": f"acceleration, {position}/s²",
        "load": f"load: predicted torque on the link, {force}",
        "temperature": "temperature above the start, K",
        "time": "time, s",
    }
    values = series.signals()[signal]
    if signal == "time":
        values = clock(series)[0]
    return joint_plots.PlotAxis(
        units[signal], values, None if signal == "velocity" else forward, creep=signal == "velocity"
    )


def _trace(before: JointSeries, after: JointSeries | None) -> tuple[joint_plots.Trace, bool]:
    t, end_to_end = clock(before)
    predicted = None if after is None else after.predicted
    trace = joint_plots.Trace(
        t,
        before.piece,
        before.tau,
        before=before.predicted,
        after=predicted,
        floor=before.floor.value,
        unit=before.force_unit,
    )
    return trace, end_to_end


def clock(series: JointSeries) -> tuple[Array, bool]:
    """`running_clock` of a joint's rows."""
    return running_clock(series.t, series.piece)


def running_clock(t: Array, piece: NDArray[np.integer[Any]]) -> tuple[Array, bool]:
    """Time (M,) that never falls, and whether recordings or runs were placed end to end for that."""
    t = t.copy()
    moved = False
    for start in np.flatnonzero(np.diff(piece)) + 1:
        if t[start] <= t[start - 1]:
            t[start:] += t[start - 1] - t[start] + 1.0
            moved = True
    return t, moved


def _largest_change(trace: joint_plots.Trace) -> tuple[float, float, int]:
    weight = (trace.tau - trace.before) ** 2
    if trace.after is not None:
        weight = weight - (trace.tau - trace.after) ** 2
    return _most(trace, weight)


def _most(trace: joint_plots.Trace, weight: Array) -> tuple[float, float, int]:
    """Start, end and piece of the seconds in which the sum of a weight (M,) is largest."""
    total = np.concatenate([[0.0], np.cumsum(weight)])
    ends = np.searchsorted(trace.t, trace.t + _ZOOM_S)
    last_of_piece = np.searchsorted(trace.piece, trace.piece, side="right")
    gain = total[np.minimum(ends, last_of_piece)] - total[:-1]
    start = int(np.argmax(gain))
    return float(trace.t[start]), float(trace.t[start] + _ZOOM_S), int(trace.piece[start])


def structure(first: Step, last: Step, joint: int) -> Drawn | None:
    """Shares of the signals that the residual of a joint follows, before and after; None if it follows none."""
    before = structure_shares(first.joints[joint])
    after: dict[str, Any] = structure_shares(last.joints[joint]) if last is not first else {}
    names = sorted((s for s in before if max(before[s], after.get(s, 0.0)) > _NOTHING), key=lambda s: -before[s])
    if not names:
        return None
    figure = joint_plots.structure([(s, before[s], after.get(s)) for s in names], "What the residual follows")
    caption = (
        f"Joint {joint + 1}: how much of the residual's variance each signal explains, with a curve for each "
        "direction of motion."
    )
    return drawn(figure, f"structure{joint + 1}", caption)
