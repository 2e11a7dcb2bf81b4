"""Signals of several clocks brought to one: resampling, and the offset between the clocks of torques and positions.

Topics may be stamped by another machine or after a queue. At each instant the torque of any arm is about a linear
combination of accelerations, rates, signs of rates and functions of the positions. This combination is fitted for trial
shifts of the torques; the shift with the smallest residual is the offset between the clocks. All signals are smoothed
by one kernel. The uncertainty is the difference between kernels of different widths, which the neglected coupling and
friction bias differently, and a part of a sample.

Source: separable least squares in the delay, Ljung, System Identification, 1999; derivatives of a Gaussian as filters,
Lindeberg, Scale-Space Theory, 1994.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import gaussian_filter1d

from runtime.recordings.columns import Column
from runtime.recordings.contents import Array, Contents, Refusal, Samples, check_finite, check_whole
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
    """Offset in s by which one clock's stamps are later than another's, and its standard error in s."""

    value: float
    error: float

    @property
    def significant(self) -> bool:
        """Whether it differs from zero."""
        return abs(self.value) > CLOCK_SHIFT_CLEAR * self.error


def torque_shift(t: Array, q: Array, there: Array, tau: Array) -> ClockShift | None:
    """Offset between the clocks of torques (k, M) at `there` (M,) and positions (n, N) at t (N,).

    The first k positions are those of the torques' joints; joints without motion or torque are left out.
    None where the motion does not determine the offset.
    """
    step = max(float(np.median(np.diff(t))), float(np.median(np.diff(there))))
    begin, end = max(t[0], there[0]), min(t[-1], there[-1])
    at = np.arange(begin, min(end, begin + CLOCK_SHIFT_SAMPLES * step), step)
    most = round(CLOCK_SHIFT_MOST / step)
    moved = [x for x in q if np.ptp(x) > 0]
    used = [(x, y) for x, y in zip(q, tau, strict=False) if np.ptp(x) > 0 and np.ptp(y) > 0]
    if len(at) <= 4 * most or not used:
        return None
    positions = [np.interp(at, t, x) for x in moved]
    found = []
    for width in (max(seconds / step, 1.0) for seconds in CLOCK_SHIFT_SMOOTHING):
        others, residual = features(positions, width), np.zeros(2 * most + 1)
        for x, y in used:
            own = dry(np.interp(at, t, x), width)
            torque = gaussian_filter1d(np.interp(at, there, y), width)
            residual += _residual(np.vstack([others, own]), torque, most)
        found.append(_smallest(residual / len(used), most, step))
    shifts = [shift for shift in found if shift is not None]
    if len(shifts) < len(found):
        return None
    return ClockShift(float(np.median(shifts)), float(np.hypot(np.ptp(shifts), CLOCK_SHIFT_FINEST * step)))


def dry(x: Array, width: float) -> Array:
    """(N,) smoothed sign of the rate of a position (N,), which dry friction follows. width: samples."""
    sign: Array = gaussian_filter1d(np.sign(gaussian_filter1d(x, width, order=1)), width)
    return sign


def features(positions: list[Array], width: float) -> Array:
    """(K, N) signals that torques combine: derivatives, sine and cosine of each joint's position (N,)."""
    rows = [np.ones(len(positions[0]))]
    for x in positions:
        rows += [gaussian_filter1d(x, width, order=k) for k in (1, 2)]
        rows += [gaussian_filter1d(f(x), width) for f in (np.sin, np.cos)]
    return np.array(rows)


def _residual(features: Array, torque: Array, most: int) -> Array:
    """(2 most + 1,) part of a torque (N,) that features (K, N) do not explain, for shifts of −most to most samples."""
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


def _smallest(residual: Array, most: int, step: float) -> float | None:
    """Shift in s with the smallest residual; of several equal minima, as in periodic motion, the one nearest to 0."""
    inner = residual[1:-1]
    valleys = 1 + np.flatnonzero((inner <= residual[:-2]) & (inner <= residual[2:]))
    if not len(valleys) or residual[valleys].min() > CLOCK_SHIFT_STANDS_OUT * np.median(residual):
        return None
    tied = valleys[residual[valleys] <= CLOCK_SHIFT_TIED * max(residual[valleys].min(), ROUNDING)]
    k = int(tied[np.argmin(np.abs(tied - most))])
    before, here, after = residual[k - 1 : k + 2]
    bend = before - 2 * here + after
    return float((k - most + (0.5 * (before - after) / bend if bend > 0 else 0.0)) * step)


@dataclass(frozen=True)
class BroughtClock:
    """Signals of one clock, resampled at the times of the positions, whose clock is `home`.

    rate, home_rate   Hz
    shift             offset between the clocks; None: not determined, or no torques are among the signals
    corrected         whether the stamps were corrected by it
    """

    name: str
    home: str
    signals: tuple[str, ...]
    rate: float
    home_rate: float
    shift: ClockShift | None
    corrected: bool

    def __str__(self) -> str:
        to = f"at the times of the positions of {self.home} ({self.home_rate:.4g} Hz)"
        resampled = f"{', '.join(self.signals)} of {self.name} ({self.rate:.4g} Hz) resampled {to}"
        if not any(signal.startswith("tau") for signal in self.signals):
            return resampled
        if self.shift is None:
            return f"{resampled}; the offset between their clocks cannot be determined from this motion"
        seconds, error = abs(self.shift.value), self.shift.error
        if not self.corrected:
            return f"{resampled}; the offset between their clocks is at most {seconds + error:.2g} s"
        side = "later" if self.shift.value > 0 else "earlier"
        why = "" if self.shift.value > 0 else " (another clock, or a delay of the drive)"
        return (
            f"{resampled} and corrected: their stamps are {seconds:.3g} s (± {error:.1g} s) {side} than the motion{why}"
        )


def on_one(
    contents: Contents,
    used: Mapping[str, Column],
    allow_gaps: bool,
    refuse: Refusal,
    look: Callable[[Samples], Samples],
) -> tuple[Samples, tuple[BroughtClock, ...]]:
    """The used columns in SI at the times of the positions, and the clocks that were resampled.

    look: what makes of the samples of each clock those that can be believed (samples.py)
    """
    of_t = contents.fields[used["t"].index].clock
    groups: dict[str, dict[str, Column]] = {}
    for name, column in used.items():
        clock = contents.fields[column.index].clock
        # Fields without a time of their own share t.
        groups.setdefault(clock if clock in contents.times else of_t, {})[name] = column
    groups.setdefault(of_t, {}).pop("t")
    home = next(clock for clock, members in groups.items() if "q1" in members)
    tables = {}
    for clock, members in groups.items():
        if members:
            # A clock's own time is in the unit of t.
            at, t = contents.times.get(clock, 0), used["t"]
            own = t if clock == of_t else replace(t, index=at, cell=contents.fields[at].name)
            tables[clock] = look(_loaded(contents, {"t": own, **members}, allow_gaps, refuse))
    positions = table = tables.pop(home)
    brought = []
    for clock, found in tables.items():
        other = _ascending(found, clock, allow_gaps, refuse)
        if np.array_equal(other.signals["t"], positions.signals["t"]):
            # Topics of one node, with equal stamps.
            table = _joined(table, other, clock, allow_gaps=allow_gaps, refuse=refuse)
            continue
        shift = None if "run" in table.signals else _shift(positions, other)
        apart = CLOCK_SHIFT_LEAST / min(_rate(positions), _rate(other))
        corrected = shift is not None and shift.significant and abs(shift.value) > apart
        if shift is not None and corrected:
            other = replace(other, signals=other.signals | {"t": other.signals["t"] - shift.value})
        table = _joined(table, other, clock, allow_gaps=allow_gaps, refuse=refuse)
        rates = _rate(other), _rate(positions)
        brought.append(BroughtClock(clock, home, tuple(groups[clock]), *rates, shift=shift, corrected=corrected))
    return table, tuple(brought)


def _shift(positions: Samples, other: Samples) -> ClockShift | None:
    """Offset of the clock of the torques among `other`; None without torques or where it cannot be determined."""
    joints = [name.removeprefix("tau") for name in other.signals if name.removeprefix("tau").isdigit()]
    both = [k for k in joints if f"q{k}" in positions.signals]
    t = positions.signals["t"]
    if not both or (np.diff(t) <= 0).any():
        return None
    # Joints with a torque on this clock come first, as torque_shift expects.
    rest = [name for name in positions.signals if name[:1] == "q" and name[1:].isdigit() and name[1:] not in both]
    q = np.array([positions.signals[name] for name in (*(f"q{k}" for k in both), *rest)])
    tau = np.array([other.signals[f"tau{k}"] for k in both])
    return torque_shift(t, q, other.signals["t"], tau)


def _rate(table: Samples) -> float:
    """Median sampling rate, Hz."""
    step = float(np.median(np.diff(table.signals["t"]))) if len(table.numbers) > 1 else 0.0
    return 1 / step if step > 0 else np.inf


def _loaded(contents: Contents, used: Mapping[str, Column], allow_gaps: bool, refuse: Refusal) -> Samples:
    """Fields of one clock in SI, checked to be finite."""
    raw = check_whole(contents.load({name: column.index for name, column in used.items()}), allow_gaps, refuse)
    lengths = {name: len(values) for name, values in raw.signals.items()}
    if len(set(lengths.values())) > 1:
        name = next(n for n in lengths if lengths[n] != lengths["t"])
        refuse(
            f"{name} has {lengths[name]} samples and t has {lengths['t']}; expected equal numbers, or a time of "
            "its own for each; name the right time with --map t="
        )
    signals = {name: values * used[name].factor + used[name].offset for name, values in raw.signals.items()}
    return check_finite(replace(raw, signals=signals), allow_gaps, refuse)


def _ascending(other: Samples, clock: str, allow_gaps: bool, refuse: Refusal) -> Samples:
    """The samples with increasing time; refuses others unless gaps are allowed."""
    there = other.signals["t"]
    if len(there) < MIN_SAMPLES:
        refuse(f"only {len(there)} samples in {clock}; expected at least {MIN_SAMPLES}")
    back = np.diff(there) <= 0
    if not back.any():
        return other
    if not allow_gaps:
        k = int(np.argmax(back)) + 1
        refuse(
            f"time runs backwards, {there[k]:.9g} s after {there[k - 1]:.9g} s; pass --allow-gaps to drop them",
            other.at("t", k),
        )
    return other.kept(np.concatenate([[True], there[1:] > np.maximum.accumulate(there)[:-1]]))


def _joined(table: Samples, other: Samples, clock: str, allow_gaps: bool, refuse: Refusal) -> Samples:
    """A table with the signals of another clock interpolated at its times, where that clock has samples."""
    from scipy.interpolate import make_interp_spline  # slow to import

    t, there = table.signals["t"], other.signals["t"]
    steps = np.diff(there)
    inside = (t >= there[0]) & (t <= there[-1])
    if np.count_nonzero(inside) < MIN_SAMPLES:
        refuse(
            f"{clock} runs from {there[0]:.9g} to {there[-1]:.9g} s and the positions from {t[0]:.9g} to {t[-1]:.9g} "
            f"s; expected at least {MIN_SAMPLES} samples in both"
        )
    after = np.clip(np.searchsorted(there, t), 1, len(steps))
    known = (there[after] == t) | (there[after - 1] == t)
    known |= steps[after - 1] <= GAP * np.median(steps) * (1 + ROUNDING)
    if (hole := inside & ~known).any() and not allow_gaps:
        k = int(np.searchsorted(there, t[int(np.argmax(hole))]))
        refuse(
            f"a gap of {steps[k - 1]:.4g} s in {clock}, over {GAP:g} times the median step of {np.median(steps):.4g} "
            "s; pass --allow-gaps to split there",
            other.at("t", k),
        )
    use = inside & known
    kept = table.kept(use)
    others = {name: x for name, x in other.signals.items() if name != "t"}
    brought = {name: make_interp_spline(there, x, k=SPLINE_DEGREE)(t[use]) for name, x in others.items()}
    notes, turned = kept.notes + other.notes, kept.turned | other.turned
    joined = replace(kept, signals=kept.signals | brought, notes=notes, turned=turned)
    return replace(joined, places={**other.places, **kept.places})
