"""Signals of a joint for canvases, with the same numbers as the figures of report/plots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.arrays import Array
from runtime.diagnosis.steps import Step
from runtime.identification.compare import JointSeries, structure_shares
from runtime.loop.improve import HeldOut
from runtime.motion import spectra
from runtime.motion.motion import Motion
from runtime.recordings.recording import Recording
from runtime.report.page import page_figures as figures
from runtime.report.plots.joint_plots import PlotAxis, running_mean
from runtime.report.plots.style import residual_reach
from runtime.report.signals.signal_set import Colour, DrawnCurve, DrawnLine, SignalPanel, SignalSet, around, curve
from runtime.wording import numbered, percent

MEASURED, PREDICTED, RESIDUAL = "measured", "predicted", "residual"
BEFORE, AFTER = " before", " after"
_SHOWN = ("velocity", "position", "load", "temperature", "acceleration")
"""Horizontal axes of the residual, in the same order for every joint and recording."""


def of_joint(first: Step, last: Step, joint: int, added: str = "") -> SignalSet:
    """A joint (0-based) as fitted, in the first and the last step; one model if they are the same.

    added   name of the added effects
    """
    before = first.joints[joint]
    after = None if last is first else last.joints[joint]
    steps = [first] if last is first else [first, last]
    motion = first.fit.motion
    residuals = [step.fit.residual[joint] for step in steps]
    return of_series(before, after, added, (_spectrum(before, residuals, motion),))


def of_held_out(before: HeldOut | None, after: HeldOut, joint: int, added: str = "") -> SignalSet:
    """A joint (0-based) on held-out recordings, before and after effects were added.

    One model without `before`, or if `before` has other rows.
    """
    series = after.joints[joint]
    if before is None or not np.array_equal(before.joints[joint].t, series.t):
        return of_series(series, None, "", (_spectrum(series, [after.residuals[joint]], after.motion),))
    own, residuals = before.joints[joint], [before.residuals[joint], after.residuals[joint]]
    return of_series(own, series, added, (_spectrum(own, residuals, after.motion),))


def of_series(
    before: JointSeries, after: JointSeries | None, added: str = "", more: Sequence[SignalPanel] = ()
) -> SignalSet:
    """A joint's series on the same rows, before and after effects were added; one model if `after` is None."""
    models: list[tuple[str, Colour, JointSeries]] = [
        (BEFORE, "before", before) if after else ("", _of_one(before), before)
    ]
    if after is not None:
        models.append((AFTER, "after", after))
    lines = {MEASURED: before.tau}
    for suffix, _, series in models:
        lines[PREDICTED + suffix] = series.predicted
        lines[RESIDUAL + suffix] = series.residual
    floor = (after or before).floor.value
    residuals = tuple(DrawnLine(RESIDUAL + suffix, RESIDUAL + suffix, colour) for suffix, colour, _ in models)
    torque = "force" if before.force_unit == "N" else "torque"
    drawn = (
        DrawnLine(MEASURED, MEASURED, "ink"),
        *(DrawnLine(PREDICTED + suffix, PREDICTED + suffix, colour) for suffix, colour, _ in models),
    )
    reach = residual_reach([before.residual], floor)
    panels = [
        SignalPanel(
            "time",
            f"{torque.capitalize()} over time",
            "time",
            ("time, s", f"{torque}, {before.force_unit}"),
            *around([lines[line.line] for line in drawn]),
            lines=drawn,
        ),
        SignalPanel(
            "time",
            "Residual over time",
            "time",
            labels=("time, s", f"residual, {before.force_unit}"),
            low=-reach,
            high=reach,
            lines=residuals,
            band=floor,
        ),
    ]
    share = structure_shares(before)
    axes = {name: figures.axis_of(before, name) for name in (*figures.signals(before), "acceleration")}
    axes = {name: axis for name, axis in axes.items() if name != "time"}
    for name in _SHOWN:
        if name not in axes:
            continue
        panels.append(
            _over(
                name, axes[name], models, residuals=residuals, reach=reach, floor=floor, added=added, share=share[name]
            )
        )
    return SignalSet(
        f"Joint {numbered(before.joint, before.name)}",
        figures.clock(before)[0],
        lines,
        axes={name: axis.values for name, axis in axes.items()},
        panels=(*panels, *more),
        floor=floor,
        unit=before.force_unit,
    )


def of_recording(recording: Recording, joint: int) -> SignalSet:
    """A joint (0-based) of a recording: every sample, unfiltered."""
    turns = recording.types[joint] == "revolute"
    force, position = ("N m", "rad") if turns else ("N", "m")
    torque = "torque" if turns else "force"
    rows = {torque: (recording.tau[joint], force), "position": (recording.q[joint], position)}
    if recording.qd is not None and np.isfinite(recording.qd[joint]).any():
        rows["velocity"] = (recording.qd[joint], f"{position}/s")
    warmth = recording.temperature[joint]
    if warmth is not None:
        rows["temperature"] = (warmth, "°C")
    panels = tuple(
        SignalPanel(
            "time",
            f"{name.capitalize()} over time",
            "time",
            ("time, s", f"{name}, {unit}"),
            *around([values]),
            lines=(DrawnLine(name, name, "ink"),),
        )
        for name, (values, unit) in rows.items()
    )
    lines = {name: values for name, (values, _) in rows.items()}
    t = figures.running_clock(recording.t, recording.run)[0]
    units = {name: unit for name, (_, unit) in rows.items()}
    return SignalSet(
        f"Joint {joint + 1} as recorded", t, lines, axes={}, panels=panels, floor=0.0, unit=force, units=units
    )


def _of_one(series: JointSeries) -> Colour:
    return "after" if series.at_floor else "before"


def _over(
    name: str,
    axis: PlotAxis,
    models: Sequence[tuple[str, Colour, JointSeries]],
    residuals: tuple[DrawnLine, ...],
    reach: float,
    floor: float,
    added: str,
    share: float,
) -> SignalPanel:
    """The residual over a signal, with its running means and the torque of the added effects."""
    curves: list[DrawnCurve] = []
    for suffix, colour, series in models:
        curves += _means(axis, series.residual, RESIDUAL + suffix, colour)
    if len(models) > 1 and added:
        curves += _means(axis, models[1][2].predicted - models[0][2].predicted, added, "ink", dashed=True)
    when = BEFORE if len(models) > 1 else ""
    return SignalPanel(
        "over",
        f"Residual over {name}",
        name,
        labels=(axis.label, f"residual, {models[0][2].force_unit}"),
        low=-reach,
        high=reach,
        lines=residuals,
        curves=tuple(curves),
        band=floor,
        stretch=axis.width if axis.creep else 0.0,
        note=f"{name.capitalize()} explains {percent(share, 0)} of the residual's variance{when}.",
    )


def _means(axis: PlotAxis, y: Array, name: str, colour: Colour, dashed: bool = False) -> list[DrawnCurve]:
    """Running means of each direction of motion."""
    found = []
    for side in axis.sides():
        x, mean = running_mean(axis.stretched()[side], y[side])
        found.append(curve(name, colour, axis.unstretched(x), y=mean, dashed=dashed))
    return found


def _spectrum(before: JointSeries, residuals: Sequence[Array], motion: Motion) -> SignalPanel:
    """Spectrum of the residual, with the white noise of the instruments and the peaks.

    residuals   (M,) of every row of a motion: of one model, or before and after
    """
    joint = before.joint - 1
    cutoff, rate = motion.cutoff(joint), motion.row_rate(joint)
    several = len(residuals) > 1
    suffixes = (BEFORE, AFTER) if several else ("",)
    colours: tuple[Colour, ...] = ("before", "after") if several else (_of_one(before),)
    curves = []
    for suffix, colour, residual in zip(suffixes, colours, residuals, strict=False):
        frequency, density = figures.amplitudes(residual, rate)
        use = (frequency > 0) & (frequency <= cutoff) & (density > 0)
        curves.append(curve(RESIDUAL + suffix, colour, frequency[use], density[use]))
    drawn = [y for c in curves for y in c.y if y is not None]
    noise = float(before.floor.spectrum / np.sqrt(cutoff))
    low, high = (min(drawn), max(drawn)) if drawn else (1.0, 1.0)
    peaks = spectra.peaks(residuals[-1], rate, cutoff)
    return SignalPanel(
        "curves",
        "Residual over frequency",
        "frequency",
        labels=("frequency, Hz", f"residual, {before.force_unit}/√Hz"),
        low=0.7 * min(low, noise or low),
        high=1.6 * high,
        lines=(),
        curves=tuple(curves),
        band=noise,
        log=True,
        marks=tuple(float(f) for f in peaks),
        note="Grey: the noise of the instruments alone, if it is white.",
    )
