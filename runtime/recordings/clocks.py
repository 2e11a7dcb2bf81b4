"""Signals that are sampled apart, brought to the instants of the positions.

Each clock's samples are checked as they stand in the file. What is asked for at instants that a clock does not cover,
or that lie in one of its gaps, is not known: such samples are left out at both ends, and between refused as a gap is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from runtime.recordings import checks
from runtime.recordings.columns import Column
from runtime.recordings.contents import Array, Contents, Samples
from runtime.recordings.errors import Refusal
from runtime.recordings.settings import GAP, MIN_SAMPLES, ROUNDING, SPLINE_DEGREE


def on_one(
    contents: Contents, used: Mapping[str, Column], allow_gaps: bool, refuse: Refusal
) -> tuple[Samples, tuple[str, ...]]:
    """The used columns in SI over the instants of the positions, and what was brought there, a line each clock."""
    of_t = contents.fields[used["t"].index].clock
    groups: dict[str, dict[str, Column]] = {}
    for name, column in used.items():
        clock = contents.fields[column.index].clock
        # What has no time of its own goes by the one that is called t.
        groups.setdefault(clock if clock in contents.times else of_t, {})[name] = column
    groups.setdefault(of_t, {}).pop("t")
    home = next(clock for clock, members in groups.items() if "q1" in members)
    tables = {
        clock: _loaded(contents, {"t": _time(contents, clock, used["t"], of_t), **members}, allow_gaps, refuse)
        for clock, members in groups.items()
        if members
    }
    table, notes = tables.pop(home), []
    rate = _rate(table)
    for clock, other in tables.items():
        table = _joined(table, other, clock, allow_gaps, refuse)
        notes.append(
            f"{', '.join(groups[clock])} of {clock} ({_rate(other):.4g} Hz) brought to the instants of the positions "
            f"of {home} ({rate:.4g} Hz)"
        )
    return table, tuple(notes)


def _rate(table: Samples) -> float:
    """Hz."""
    step = float(np.median(np.diff(table.signals["t"]))) if len(table.numbers) > 1 else 0.0
    return 1 / step if step > 0 else np.inf


def _time(contents: Contents, clock: str, t: Column, of_t: str) -> Column:
    """The time of a clock, in the unit of the one that is called t."""
    if clock == of_t:
        return t
    return replace(t, index=contents.times[clock], cell=contents.fields[contents.times[clock]].name)


def _loaded(contents: Contents, used: Mapping[str, Column], allow_gaps: bool, refuse: Refusal) -> Samples:
    """Fields of one clock in SI, finite."""
    raw = contents.load({name: column.index for name, column in used.items()})
    lengths = {name: len(values) for name, values in raw.signals.items()}
    if len(set(lengths.values())) > 1:
        name = next(n for n in lengths if lengths[n] != lengths["t"])
        refuse(
            f"{name} has {lengths[name]} samples and t {lengths['t']}; expected as many, or a time beside each; "
            "name the right one with --map t="
        )
    signals = {name: used[name].in_si(values) for name, values in raw.signals.items()}
    return checks.finite(replace(raw, signals=signals), allow_gaps, refuse)


def _joined(table: Samples, other: Samples, clock: str, allow_gaps: bool, refuse: Refusal) -> Samples:
    """A table with the signals of another clock at its instants, where that has some."""
    t, there = table.signals["t"], other.signals["t"]
    if len(there) < MIN_SAMPLES:
        refuse(f"only {len(there)} samples in {clock}; expected at least {MIN_SAMPLES}")
    steps = np.diff(there)
    if (back := steps <= 0).any():
        if not allow_gaps:
            k = int(np.argmax(back)) + 1
            refuse(f"time runs backwards, {there[k]:.9g} s after {there[k - 1]:.9g} s", other.at("t", k))
        ahead = np.concatenate([[True], there[1:] > np.maximum.accumulate(there)[:-1]])
        other = other.kept(ahead)
        there = other.signals["t"]
        steps = np.diff(there)
    inside = (t >= there[0]) & (t <= there[-1])
    if np.count_nonzero(inside) < MIN_SAMPLES:
        refuse(
            f"{clock} runs from {there[0]:.9g} to {there[-1]:.9g} s and the positions from {t[0]:.9g} to {t[-1]:.9g} "
            f"s; expected at least {MIN_SAMPLES} samples in common"
        )
    known = _covered(t, there, steps)
    if (hole := inside & ~known).any() and not allow_gaps:
        k = int(np.searchsorted(there, t[int(np.argmax(hole))]))
        refuse(
            f"a gap of {steps[k - 1]:.4g} s in {clock}, over {GAP:g} times the median step of {np.median(steps):.4g} "
            "s; pass --allow-gaps to split there",
            other.at("t", k),
        )
    use = inside & known
    kept = table.kept(use)
    brought = {name: _at(there, x, t[use]) for name, x in other.signals.items() if name != "t"}
    return replace(kept, signals=kept.signals | brought, places={**other.places, **kept.places})


def _covered(t: Array, there: Array, steps: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """(N,) whether an instant lies in no gap of another clock."""
    after = np.clip(np.searchsorted(there, t), 1, len(steps))
    covered: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] = steps[after - 1] <= GAP * np.median(steps) * (
        1 + ROUNDING
    )
    return covered


def _at(there: Array, x: Array, t: Array) -> Array:
    from scipy.interpolate import make_interp_spline  # where it is used: it takes longer to load than a fit

    spline: Array = make_interp_spline(there, x, k=SPLINE_DEGREE)(t)
    return spline
