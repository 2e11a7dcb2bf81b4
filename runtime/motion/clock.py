"""The even grid of time of a recording, chosen once, before anything is measured on it.

Controllers stamp their samples in whole milliseconds, late, or at uneven steps; samples get lost. Filters, spectra,
derivatives and delays need even samples. Where an even clock whose samples are counted explains the stamps, the count
gives the instants, and a lost sample leaves its place empty; else the stamps are used, and signals are interpolated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, minimum_filter1d, uniform_filter1d

from runtime.arrays import Array
from runtime.recordings.recording import Recording

Counts = NDArray[np.intp]

EVEN_GRID: Final = 0.02
"""part of a period; instants that depart less from an even grid count as on it, and the recording is not interpolated;
real recordings, whose controllers log steps of 10 and 12 ms."""


@dataclass(frozen=True)
class Stretch:
    """A gap-free segment of a recording on its grid.

    samples   of the recording
    places    (N,) of the samples on the grid, in periods from the first; None where one lies on each place
    size      M, places of the grid
    """

    samples: slice
    places: Array | None
    size: int

    def on_grid(self, x: Array) -> Array:
        """Signals x (..., samples of the recording) on the stretch's grid, (..., M); NaN where one was not measured.

        At half of CUTOFF_OF_SAMPLING the splines are exact to 1e-4. Torque and positions pass the same ones, so that
        an equation between them still holds.
        """
        own = x[..., self.samples]
        return own if self.places is None else interpolated(self.places, own, np.arange(self.size))

    def held(self, x: Array) -> Array:
        """As `on_grid` of x (n, ...), each value held until the next sample: means over the period after each place."""
        own = x[:, self.samples]
        if self.places is None:
            return own
        edges, places = np.append(self.places, self.places[-1] + 1), np.arange(self.size + 1)
        whole = np.cumsum(np.pad(own * np.diff(edges), ((0, 0), (1, 0))), axis=1)
        return np.diff([np.interp(places, edges, row) for row in whole], axis=1)


@dataclass(frozen=True)
class EvenGrid:
    """A recording's even grid, a stretch for each segment.

    period    s
    spacing   s, of the step in which an instant lies on average: it limits the frequencies that the samples show
    """

    period: float
    spacing: float
    stretches: tuple[Stretch, ...]

    @property
    def is_uneven(self) -> bool:
        """Whether samples lie between the places."""
        return any(s.places is not None and bool(np.any(s.places % 1)) for s in self.stretches)

    @property
    def longest(self) -> Stretch:
        """The stretch with the most samples."""
        return max(self.stretches, key=lambda s: s.size)


def interpolated(places: Array, x: Array, at: Array | Counts) -> Array:
    """x (..., N), known at ascending places (N,), at other places (M,) -> (..., M).

    By splines of degree 5: at the highest cut-off they lose 0.1 %, those of degree 3 lose 1 %.
    """
    from scipy.interpolate import make_interp_spline  # where it is used: it takes longer to load than a fit

    rows = x.reshape(-1, x.shape[-1])
    out = np.full((len(rows), len(at)), np.nan)
    known = np.isfinite(rows).all(axis=1)
    if known.any():
        out[known] = make_interp_spline(places, rows[known], k=5, axis=1)(at)
    return out.reshape(*x.shape[:-1], len(at))


def grid(recording: Recording) -> EvenGrid:
    """The grid on which a recording's samples lie, from its stamps and, where these leave it open, its positions."""
    segments = recording.segments
    stamps = [recording.t[s] for s in segments]
    # To ten digits; beyond them differences of instants are rounding.
    mean = float(f"{sum(t[-1] - t[0] for t in stamps) / sum(len(t) - 1 for t in stamps):.10g}")
    if all(_even(t, mean) for t in stamps):
        return EvenGrid(mean, mean, tuple(Stretch(s, None, s.stop - s.start) for s in segments))
    period = _period(max(stamps, key=len))
    counts = [_counts(t, period) for t in stamps]
    places: Sequence[Array | Counts] = counts
    if _counted(recording, period, counts):
        # The slope of stamps over counts of all stretches.
        moment = sum(float((n - n.mean()) @ (t - t.mean())) for t, n in zip(stamps, counts, strict=True))
        period = moment / sum(float(np.sum((n - n.mean()) ** 2)) for n in counts)
    else:
        period = mean
        places = [(t - t[0]) / period for t in stamps]
    steps = np.concatenate([np.diff(p) for p in places])
    spacing = period * float(np.mean(steps**2) / np.mean(steps))
    return EvenGrid(period, spacing, tuple(_stretch(s, p) for s, p in zip(segments, places, strict=True)))


def _stretch(samples: slice, places: Array | Counts) -> Stretch:
    size = int(np.floor(places[-1] + EVEN_GRID)) + 1
    whole = size == len(places) and bool(np.all(np.diff(places) == 1))
    return Stretch(samples, None if whole else np.asarray(places, dtype=float), size)


def _even(t: Array, period: float) -> bool:
    even = np.linspace(t[0], t[-1], len(t))
    drift = abs((t[-1] - t[0]) / (len(t) - 1) - period) / period
    # An inertia is wrong by twice a drift at most; quartz clocks differ by a tenth of this and less.
    return bool(np.abs(t - even).max() < EVEN_GRID * period) and drift < 1e-3


def _period(t: Array) -> float:
    """The step of an even clock that is read with errors and now and then skips a sample, s.

    First from 16 steps together that skip none, then from more and more, whose number follows from the period found so
    far. Means, as rounding dithers a mean and pulls a median to its own places.
    """
    first, enough = 16, 50_000
    t = t[:enough]
    together = min(first, len(t) - 1)
    spans = t[together:] - t[:-together]
    middle = float(np.median(spans))
    period = float(spans[np.abs(spans - middle) < middle / (2 * together)].mean()) / together
    while 2 * together < len(t):
        together *= 2
        spans = t[together:] - t[:-together]
        period = float(spans.sum() / np.maximum(np.round(spans / period), 1).sum())
    return period


def _counts(t: Array, period: float) -> Counts:
    """(N,) the number of each sample of a clock of this period, from 0.

    A step is long because a sample was lost or because a stamp is late; after a loss all that follow are late. The
    earliest of eight stamps counts (a host is late by up to two periods, then catches up), less the wander of the
    clock: its phase over a thousand samples, long against losses. A count that is taken back was none.
    """
    late = t / period - np.arange(len(t))
    window, long = 8, 1000
    earliest = minimum_filter1d(late, window, origin=-(window // 2), mode="nearest")
    turns = uniform_filter1d(np.exp(2j * np.pi * earliest), long, mode="nearest")
    phase = np.unwrap(np.angle(turns)) / (2 * np.pi)
    lost = np.round(earliest - phase).astype(np.intp)
    lost = np.minimum.accumulate(lost[::-1])[::-1]
    return np.arange(len(t)) + lost - lost[0]


def _counted(recording: Recording, period: float, counts: Sequence[Counts]) -> bool:
    """Whether an even clock explains the stamps: positions are clearly smoother over the count, or they leave it open
    and the stamps are roundings of it."""
    ratio = _roughness_ratio(recording, period, counts)
    # Chance reaches a ratio of 1.5 with a thousand samples once in a million.
    if abs(ratio) >= np.log(1.5):
        return ratio < 0
    for s, n in zip(recording.segments, counts, strict=True):
        off = recording.t[s] - recording.t[s.start] - period * n
        slow = median_filter(off, 33, mode="nearest")
        # A hundredth for errors of arithmetic.
        rounding = ((1 + 1 / 100) * _digit(recording.t[s]) + EVEN_GRID * period) / 2
        if np.ptp(off - slow) > 2 * rounding:
            return False
    return True


def _digit(t: Array) -> float:
    """The decimal place, of seven, to which stamps (N,) are printed, s; 0 where they are not rounded to any."""
    for digits in range(7):
        scaled = t * 10.0**digits
        if np.abs(scaled - np.round(scaled)).max() < EVEN_GRID:
            return float(10.0**-digits)
    return 0.0


def _roughness_ratio(recording: Recording, period: float, counts: Sequence[Counts]) -> float:
    """Natural logarithm of the positions' roughness over the count to that over the stamps, at the joint where the two
    differ most."""
    longest, enough = int(np.argmax([len(n) for n in counts])), 50_000
    samples = recording.segments[longest]
    t, n = recording.t[samples][:enough] / period, counts[longest][:enough].astype(float)
    ratios = [0.0]
    for q in recording.q[:, samples][:, :enough]:
        if np.ptp(q) > 0:
            counted, stamped = (float(np.mean(_roughness(at, q) ** 2)) for at in (n, t))
            ratios.append(float(np.log(max(counted, 1e-300) / max(stamped, 1e-300))))
    return max(ratios, key=abs)


def _roughness(at: Array, x: Array) -> Array:
    """(N − 4,) by how much each sample of x (N,), at instants `at`, departs from the cubic through its four
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
