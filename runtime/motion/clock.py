"""One even grid of time for each recording, chosen once, before anything is measured on it.

Controllers stamp their samples in whole milliseconds, late, or at steps that are not even; samples get lost. Filters,
spectra, derivatives, skews and delays are meant for even samples. Stamps are a reading of a clock: where an even clock,
its samples counted, explains them, the count tells the instants, and a lost sample is a place that was left out. Else
the stamps are believed, and the signals are interpolated at even instants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, minimum_filter1d, uniform_filter1d

from runtime.motion.settings import (
    CLOCK_AHEAD,
    CLOCK_PHASE,
    CLOCK_SMOOTHER,
    CLOCK_WANDER,
    COUNTED_AT_ONCE,
    ENOUGH_FOR_CLOCK,
    EVEN_GRID,
    SPLINE_DEGREE,
    STAMP_DIGITS,
    STAMP_ROUNDED,
    STEP_DIGITS,
)
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]
Counts = NDArray[np.intp]


@dataclass(frozen=True)
class Stretch:
    """A gap-free segment of a recording on its grid.

    samples   of the recording
    places    (N,) where they lie on the grid, in periods from the first; None where one lies on each place
    size      M, places of the grid
    """

    samples: slice
    places: Array | None
    size: int

    def of(self, x: Array) -> Array:
        """Signals x (..., N) of its samples on the grid, (..., M); NaN where a signal was not measured.

        Splines, which at half of what CUTOFF_OF_SAMPLING asks are exact to a part in ten thousand. Torque and
        positions pass the same, so that what it does to one it does to the other.
        """
        return x if self.places is None else interpolated(self.places, x, np.arange(self.size))

    def held(self, x: Array) -> Array:
        """Of signals x (n, N) that keep each sample's value until the next, means over every place and the period that
        follows on it, (n, M)."""
        if self.places is None:
            return x
        edges, places = np.append(self.places, self.places[-1] + 1), np.arange(self.size + 1)
        whole = np.cumsum(np.pad(x * np.diff(edges), ((0, 0), (1, 0))), axis=1)
        return np.diff([np.interp(places, edges, row) for row in whole], axis=1)


@dataclass(frozen=True)
class EvenGrid:
    """A recording's even grid: period, s; spacing, s, of the step in which an instant lies on the average, from which
    follows what frequencies the samples tell; a stretch for each segment."""

    period: float
    spacing: float
    stretches: tuple[Stretch, ...]

    @property
    def wavers(self) -> bool:
        """Whether samples lie between the places."""
        return any(s.places is not None and bool(np.any(s.places % 1)) for s in self.stretches)

    @property
    def longest(self) -> Stretch:
        """The stretch with the most samples."""
        return max(self.stretches, key=lambda s: s.size)


def interpolated(places: Array, x: Array, at: Array | Counts) -> Array:
    """x (..., N), known at ascending places (N,), at other places (M,) -> (..., M)."""
    from scipy.interpolate import make_interp_spline  # where it is used: it takes longer to load than a fit

    rows = x.reshape(-1, x.shape[-1])
    out = np.full((len(rows), len(at)), np.nan)
    known = np.isfinite(rows).all(axis=1)
    if known.any():
        out[known] = make_interp_spline(places, rows[known], k=SPLINE_DEGREE, axis=1)(at)
    return out.reshape(*x.shape[:-1], len(at))


def grid(recording: Recording) -> EvenGrid:
    """The grid that a recording's stamps, and where they leave it open its positions, ask for."""
    stamps = [recording.t[s] for s in recording.segments]
    mean = _mean_step(stamps)
    if all(_even(t, mean) for t in stamps):
        return EvenGrid(mean, mean, tuple(Stretch(s, None, s.stop - s.start) for s in recording.segments))
    period = _period(max(stamps, key=len))
    counts = [_counts(t, period) for t in stamps]
    if _counted(recording, period, counts):
        places, period = counts, _fitted(stamps, counts)
    else:
        period = mean
        places = [(t - t[0]) / period for t in stamps]
    steps = np.concatenate([np.diff(p) for p in places])
    spacing = period * float(np.mean(steps**2) / np.mean(steps))
    stretches = (_stretch(s, p) for s, p in zip(recording.segments, places, strict=True))
    return EvenGrid(period, spacing, tuple(stretches))


def _stretch(samples: slice, places: Array | Counts) -> Stretch:
    size = int(np.floor(places[-1] + EVEN_GRID)) + 1
    whole = size == len(places) and bool(np.all(np.diff(places) == 1))
    return Stretch(samples, None if whole else np.asarray(places, dtype=float), size)


def _mean_step(stamps: Sequence[Array]) -> float:
    """s, to the digits that differences of instants have."""
    return float(f"{sum(t[-1] - t[0] for t in stamps) / sum(len(t) - 1 for t in stamps):.{STEP_DIGITS}g}")


def _even(t: Array, period: float) -> bool:
    """Whether one sample lies on each place, to a small part of a period; so slow a wander of the clock moves none."""
    even = np.linspace(t[0], t[-1], len(t))
    drift = abs((t[-1] - t[0]) / (len(t) - 1) - period) / period
    return bool(np.abs(t - even).max() < EVEN_GRID * period) and drift < CLOCK_WANDER


def _period(t: Array) -> float:
    """The step of an even clock that is read with errors and now and then skips a sample, s.

    First of a few steps together, those that skip none; then of more and more, whose number the period found so far
    tells. Means, as rounding is an even dither in a mean and draws a median to its own places.
    """
    t = t[:ENOUGH_FOR_CLOCK]
    together = min(COUNTED_AT_ONCE, len(t) - 1)
    spans = t[together:] - t[:-together]
    middle = float(np.median(spans))
    period = float(spans[np.abs(spans - middle) < middle / (2 * together)].mean()) / together
    while 2 * together < len(t):
        together *= 2
        spans = t[together:] - t[:-together]
        period = float(spans.sum() / np.maximum(np.round(spans / period), 1).sum())
    return period


def _counts(t: Array, period: float) -> Counts:
    """(N,) the number of each sample of a clock of this period, the first 0.

    A step may be long because a sample was lost or because a stamp is late: after a loss all that follow are late. So
    of a few stamps from each on the earliest counts, less what the clock wanders meanwhile, its phase over long
    stretches; a count that is taken back was none.
    """
    late = t / period - np.arange(len(t))
    earliest = minimum_filter1d(late, CLOCK_AHEAD, origin=-(CLOCK_AHEAD // 2), mode="nearest")
    turns = uniform_filter1d(np.exp(2j * np.pi * earliest), CLOCK_PHASE, mode="nearest")
    phase = np.unwrap(np.angle(turns)) / (2 * np.pi)
    lost = np.round(earliest - phase).astype(np.intp)
    lost = np.minimum.accumulate(lost[::-1])[::-1]
    return np.arange(len(t)) + lost - lost[0]


def _fitted(stamps: Sequence[Array], counts: Sequence[Counts]) -> float:
    """The period that stamps and counts of all stretches have in common, s."""
    moment = sum(float((n - n.mean()) @ (t - t.mean())) for t, n in zip(stamps, counts, strict=True))
    return moment / sum(float(np.sum((n - n.mean()) ** 2)) for n in counts)


def _counted(recording: Recording, period: float, counts: Sequence[Counts]) -> bool:
    """Whether an even clock explains the stamps: they are its rounding, or the positions say so.

    A position is smooth over the true instants. Where both are as smooth, the simpler is believed: the count where
    rounding explains the stamps, else the stamps.
    """
    verdict = _smoother(recording, period, counts)
    if verdict != "neither":
        return verdict == "count"
    for s, n in zip(recording.segments, counts, strict=True):
        off = recording.t[s] - recording.t[s.start] - period * n
        slow = median_filter(off, 2 * COUNTED_AT_ONCE + 1, mode="nearest")
        rounding = (STAMP_ROUNDED * _digit(recording.t[s]) + EVEN_GRID * period) / 2
        if np.ptp(off - slow) > 2 * rounding:
            return False
    return True


def _digit(t: Array) -> float:
    """The decimal place to which stamps (N,) are printed, s; 0 where they are not."""
    for digits in range(STAMP_DIGITS):
        scaled = t * 10.0**digits
        if np.abs(scaled - np.round(scaled)).max() < EVEN_GRID:
            return float(10.0**-digits)
    return 0.0


def _smoother(recording: Recording, period: float, counts: Sequence[Counts]) -> Literal["count", "stamps", "neither"]:
    """Over which instants the positions are clearly smoother, at the joint that tells them apart best."""
    longest = int(np.argmax([len(n) for n in counts]))
    samples = recording.segments[longest]
    t, n = recording.t[samples][:ENOUGH_FOR_CLOCK] / period, counts[longest][:ENOUGH_FOR_CLOCK].astype(float)
    ratios = [0.0]
    for q in recording.q[:, samples][:, :ENOUGH_FOR_CLOCK]:
        if np.ptp(q) > 0:
            counted, stamped = (float(np.mean(roughness(at, q) ** 2)) for at in (n, t))
            ratios.append(float(np.log(max(counted, 1e-300) / max(stamped, 1e-300))))
    telling = max(ratios, key=abs)
    if abs(telling) < np.log(CLOCK_SMOOTHER):
        return "neither"
    return "count" if telling < 0 else "stamps"


def roughness(at: Array, x: Array) -> Array:
    """(N − 4,) by how much each sample of x (N,), of instants `at`, departs from the cubic through its four
    neighbours; white noise keeps its standard deviation."""
    size = len(x) - 4
    instant = at[2 : 2 + size]
    near = [at[k : k + size] - instant for k in (0, 1, 3, 4)]
    values = [x[k : k + size] for k in (0, 1, 3, 4)]
    predicted, square = np.zeros(size), np.ones(size)
    for k, place in enumerate(near):
        others = [p for j, p in enumerate(near) if j != k]
        weight = np.prod([p / (p - place) for p in others], axis=0)
        predicted += weight * values[k]
        square += weight**2
    return (x[2 : 2 + size] - predicted) / np.sqrt(square)
