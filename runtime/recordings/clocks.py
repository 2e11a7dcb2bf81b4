"""By how much the clock of the torques differs from that of the positions, told by the motion itself.

What stamps one topic may be another machine, or the same one a queue later. A torque answers the motion at its own
instant: it is a combination of accelerations, rates, signs of rates and functions of the positions, whatever the arm.
Over trial shifts that combination is fitted anew; where it explains the torques best, the clocks meet. All are smoothed
by one kernel. What it leaves out, the arm's coupling and much of its friction, pulls kernels of different widths to
different shifts: by how much they differ, and by a part of a sample, so much is the answer worth.

Source: separable least squares in the delay, Ljung, System Identification, 1999; derivatives of a Gaussian as filters,
Lindeberg, Scale-Space Theory, 1994.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import gaussian_filter1d

from runtime.recordings.columns import Column
from runtime.recordings.contents import Array, Contents, Refusal, Samples, check_finite
from runtime.recordings.settings import (
    CLOCK_SHIFT_CLEAR,
    CLOCK_SHIFT_FINEST,
    CLOCK_SHIFT_LEAST,
    CLOCK_SHIFT_MOST,
    CLOCK_SHIFT_SAMPLES,
    CLOCK_SHIFT_SMOOTHING,
    CLOCK_SHIFT_STANDS_OUT,
    CLOCK_SHIFT_TIED,
    GAP,
    MIN_SAMPLES,
    ROUNDING,
    SPLINE_DEGREE,
)


@dataclass(frozen=True)
class ClockShift:
    """s by which one clock's stamps are later than another's, and what of it is uncertain."""

    value: float
    error: float

    @property
    def clear(self) -> bool:
        """Whether there is one."""
        return abs(self.value) > CLOCK_SHIFT_CLEAR * self.error


def torque_shift(t: Array, q: Array, there: Array, tau: Array) -> ClockShift | None:
    """By how much torques (k, M), stamped at `there` (M,), are stamped later than positions (n, N) at t (N,).

    The first k positions are those of the torques' joints.

    None where the motion does not tell. Joints without motion or torque tell nothing.
    """
    step = max(float(np.median(np.diff(t))), float(np.median(np.diff(there))))
    begin, end = max(t[0], there[0]), min(t[-1], there[-1])
    at = np.arange(begin, min(end, begin + CLOCK_SHIFT_SAMPLES * step), step)
    most = round(CLOCK_SHIFT_MOST / step)
    moved = [x for x in q if np.ptp(x) > 0]
    told = [(x, y) for x, y in zip(q, tau, strict=False) if np.ptp(x) > 0 and np.ptp(y) > 0]
    if len(at) <= 4 * most or not told:
        return None
    positions = [np.interp(at, t, x) for x in moved]
    found = []
    for width in (max(seconds / step, 1.0) for seconds in CLOCK_SHIFT_SMOOTHING):
        others, left = _features(positions, width), np.zeros(2 * most + 1)
        for x, y in told:
            own = gaussian_filter1d(np.sign(gaussian_filter1d(np.interp(at, t, x), width, order=1)), width)
            torque = gaussian_filter1d(np.interp(at, there, y), width)
            left += _left(np.vstack([others, own]), torque, most)
        found.append(_least(left / len(told), most, step))
    shifts = [shift for shift in found if shift is not None]
    if len(shifts) < len(found):
        return None
    return ClockShift(float(np.median(shifts)), float(np.hypot(np.ptp(shifts), CLOCK_SHIFT_FINEST * step)))


def _features(positions: list[Array], width: float) -> Array:
    """(K, N) what torques combine: of each joint's position (N,) its derivatives and its sine and cosine."""
    rows = [np.ones(len(positions[0]))]
    for x in positions:
        rows += [gaussian_filter1d(x, width, order=k) for k in (1, 2)]
        rows += [gaussian_filter1d(f(x), width) for f in (np.sin, np.cos)]
    return np.array(rows)


def _left(features: Array, torque: Array, most: int) -> Array:
    """(2 most + 1,) what part of a torque (N,) features (K, N) leave where it is taken −most to most samples later."""
    inside = slice(most, len(torque) - most)
    basis, size, _ = np.linalg.svd(features[:, inside].T, full_matrices=False)
    basis = basis[:, size > size[0] * np.sqrt(np.finfo(float).eps)]
    count, length = basis.shape[0], next_fast_len(len(torque))
    spectrum = rfft(torque - torque.mean(), length)
    products = irfft(spectrum * np.conj(rfft(basis, length, axis=0)).T, length)[:, : 2 * most + 1]
    squares = np.concatenate([[0.0], np.cumsum((torque - torque.mean()) ** 2)])
    whole = squares[count:] - squares[:-count]
    rest: Array = 1 - np.sum(products**2, axis=0) / np.maximum(whole[: 2 * most + 1], 1e-300)
    return rest


def _least(left: Array, most: int, step: float) -> float | None:
    """s at which least is left; of several that are as good, as in a periodic motion, the nearest to none."""
    inner = left[1:-1]
    valleys = 1 + np.flatnonzero((inner <= left[:-2]) & (inner <= left[2:]))
    if not len(valleys) or left[valleys].min() > CLOCK_SHIFT_STANDS_OUT * np.median(left):
        return None
    tied = valleys[left[valleys] <= CLOCK_SHIFT_TIED * max(left[valleys].min(), ROUNDING)]
    k = int(tied[np.argmin(np.abs(tied - most))])
    before, here, after = left[k - 1 : k + 2]
    bend = before - 2 * here + after
    return float((k - most + (0.5 * (before - after) / bend if bend > 0 else 0.0)) * step)


@dataclass(frozen=True)
class BroughtClock:
    """Signals of a clock that were brought to that of the positions, `home`.

    rate, home_rate   Hz
    shift             by how much its stamps are later than the motion, as far as that is told; of torques only
    corrected         whether they were set right by it
    """

    name: str
    home: str
    signals: tuple[str, ...]
    rate: float
    home_rate: float
    shift: ClockShift | None
    corrected: bool

    def __str__(self) -> str:
        to = f"to the instants of the positions of {self.home} ({self.home_rate:.4g} Hz)"
        return f"{', '.join(self.signals)} of {self.name} ({self.rate:.4g} Hz) brought {to}{self._shifted()}"

    def _shifted(self) -> str:
        if not any(signal.startswith("tau") for signal in self.signals):
            return ""
        if self.shift is None:
            return "; by how much their clocks differ, the motion does not tell"
        seconds, error = abs(self.shift.value), self.shift.error
        if not self.corrected:
            return f"; their clocks differ by {seconds + error:.2g} s at most, if at all"
        said = f"{seconds:.3g} s (± {error:.1g} s) {'later' if self.shift.value > 0 else 'sooner'} than the motion"
        if self.shift.value > 0:
            return f" and set right: they are stamped {said} that they drive"
        return f" and set right: they are stamped {said} that they drive, by another clock or before a drive's delay"


def on_one(
    contents: Contents, used: Mapping[str, Column], allow_gaps: bool, refuse: Refusal
) -> tuple[Samples, tuple[BroughtClock, ...]]:
    """The used columns in SI over the instants of the positions, and what was brought there."""
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
    positions = table = tables.pop(home)
    brought = []
    for clock, found in tables.items():
        other = _ascending(found, clock, allow_gaps, refuse)
        if np.array_equal(other.signals["t"], positions.signals["t"]):
            # Topics of one node, each with the same stamps.
            table = _joined(table, other, clock, allow_gaps, refuse)
            continue
        shift = None if "run" in table.signals else _shift(positions, other)
        apart = CLOCK_SHIFT_LEAST / min(_rate(positions), _rate(other))
        corrected = shift is not None and shift.clear and abs(shift.value) > apart
        if shift is not None and corrected:
            other = replace(other, signals=other.signals | {"t": other.signals["t"] - shift.value})
        table = _joined(table, other, clock, allow_gaps, refuse)
        rates = _rate(other), _rate(positions)
        brought.append(BroughtClock(clock, home, tuple(groups[clock]), *rates, shift, corrected))
    return table, tuple(brought)


def _shift(positions: Samples, other: Samples) -> ClockShift | None:
    """By how much the torques of another clock are stamped later than the motion; None where it has none."""
    joints = [name.removeprefix("tau") for name in other.signals if name.removeprefix("tau").isdigit()]
    both = [k for k in joints if f"q{k}" in positions.signals]
    t = positions.signals["t"]
    if not both or (np.diff(t) <= 0).any():
        return None
    # Joints whose torques are stamped so come first, each beside its position; the others' positions follow.
    rest = [name for name in positions.signals if name[:1] == "q" and name[1:].isdigit() and name[1:] not in both]
    q = np.array([positions.signals[name] for name in (*(f"q{k}" for k in both), *rest)])
    tau = np.array([other.signals[f"tau{k}"] for k in both])
    return torque_shift(t, q, other.signals["t"], tau)


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
    return check_finite(replace(raw, signals=signals), allow_gaps, refuse)


def _ascending(other: Samples, clock: str, allow_gaps: bool, refuse: Refusal) -> Samples:
    """Samples of a clock that runs forwards."""
    there = other.signals["t"]
    if len(there) < MIN_SAMPLES:
        refuse(f"only {len(there)} samples in {clock}; expected at least {MIN_SAMPLES}")
    back = np.diff(there) <= 0
    if not back.any():
        return other
    if not allow_gaps:
        k = int(np.argmax(back)) + 1
        refuse(f"time runs backwards, {there[k]:.9g} s after {there[k - 1]:.9g} s", other.at("t", k))
    return other.kept(np.concatenate([[True], there[1:] > np.maximum.accumulate(there)[:-1]]))


def _joined(table: Samples, other: Samples, clock: str, allow_gaps: bool, refuse: Refusal) -> Samples:
    """A table with the signals of another clock at its instants, where that has some."""
    t, there = table.signals["t"], other.signals["t"]
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
    sampled = (there[after] == t) | (there[after - 1] == t)
    covered: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] = sampled | (
        steps[after - 1] <= GAP * np.median(steps) * (1 + ROUNDING)
    )
    return covered


def _at(there: Array, x: Array, t: Array) -> Array:
    from scipy.interpolate import make_interp_spline  # where it is used: it takes longer to load than a fit

    spline: Array = make_interp_spline(there, x, k=SPLINE_DEGREE)(t)
    return spline
