"""Signals of a recording: statistics, and delays between them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from runtime.arrays import Array
from runtime.documents.recordings import ClockEntry, RecordedJoint, ShiftEntry, SignalEntry
from runtime.inspection.settings import FOLLOWS, LATEST_SHIFT, MOVES_FROM
from runtime.motion.clock import EvenGrid, grid
from runtime.motion.noise import SampleNoise, resolution
from runtime.recordings import recording as recorded
from runtime.recordings.recording import Recording
from runtime.recordings.settings import GAP, ROUNDING


def integrated(x: Array, t: Array) -> Array:
    """(N,) of x (N,) over t (N,) from the first on, by trapezoids."""
    return np.append(0.0, np.cumsum(np.diff(t) * (x[1:] + x[:-1]) / 2))


def clock_entry(recording: Recording) -> ClockEntry:
    """Rate, jitter and gaps of the samples; jitter is 0 where it is only rounding."""
    steps = np.concatenate([np.diff(recording.t[s]) for s in recording.segments])
    whole = np.diff(recording.t)[np.diff(recording.run) == 0]
    step = float(np.median(steps))
    return ClockEntry(
        samples=len(recording.t),
        seconds=float(sum(recording.t[s.stop - 1] - recording.t[s.start] for s in recording.segments)),
        rate_hz=1 / step,
        jitter=jitter if (jitter := float(np.std(steps))) > ROUNDING * step else 0.0,
        longest_step=float(steps.max()),
        gaps=int(np.count_nonzero((whole > GAP * step) | (whole <= 0))),
        runs=len(np.unique(recording.run)),
        period=grid(recording).period,
    )


def signal_entries(recording: Recording) -> list[SignalEntry]:
    """Field, unit, range, resolution and standard deviation of the white noise of each signal."""
    even = grid(recording)
    found = []
    for name, unit, values in complete_signals(recording):
        low, high = float(values.min()), float(values.max())
        found.append(
            SignalEntry(
                signal=name,
                field=recording.cells.get(name, name),
                unit=unit,
                least=low,
                largest=high,
                resolution=resolution(values),
                noise=_noise(values, even) if high > low else 0.0,
            )
        )
    return found


def joint_entries(recording: Recording, names: tuple[str | None, ...]) -> list[RecordedJoint]:
    """Whether, how far and how fast each joint moves. names: of the model's joints."""
    even = grid(recording)
    found = []
    for i, q in enumerate(recording.q):
        rate = np.concatenate([np.diff(s.on_grid(q)) for s in even.stretches]) / even.period
        found.append(
            RecordedJoint(
                joint=i + 1,
                name=names[i] if i < len(names) else None,
                moves=moves(q, even),
                unit="m" if recording.types[i] == "prismatic" else "rad",
                range=float(np.ptp(q)),
                # The very fastest samples are noise of the difference.
                top_speed=float(np.quantile(np.abs(rate), 0.999)),
                powered=bool(np.ptp(recording.tau[i]) > 0),
            )
        )
    return found


def moves(q: Array, even: EvenGrid) -> bool:
    """Whether a joint's position (N,) changes by more than its resolution and noise."""
    far = float(np.ptp(q))
    return far > 0 and far > MOVES_FROM * max(resolution(q), _noise(q, even))


def complete_signals(recording: Recording) -> Iterator[tuple[str, str, Array]]:
    """Name, unit and values (N,) of every signal without missing samples."""
    return (found for found in recorded.measured(recording) if np.isfinite(found[2]).all())


def _noise(values: Array, even: EvenGrid) -> float:
    """Standard deviation of the white noise of a signal (N,)."""
    rate = 1 / even.period
    return float(np.sqrt(SampleNoise.on(even.longest, rate).density(values) * rate / 2))


def shift_entries(recording: Recording) -> list[ShiftEntry]:
    """Delay in s of each signal that follows its joint's motor position, where it can be determined."""
    samples = max(recording.segments, key=lambda s: s.stop - s.start)
    t, found = recording.t[samples], []
    groups = {"qd{}": recording.qd, "q{}_link": recording.q_link, "q{}_desired": recording.q_desired}
    for pattern, rows in groups.items():
        for joint, values in enumerate(rows if rows is not None else ()):
            if not np.isfinite(values).all() or not np.ptp(recording.q[joint]):
                continue
            q, other = recording.q[joint, samples], values[samples]
            if rows is recording.qd:
                q, other = q - q.mean(), integrated(other, t)
            late = _lag(t, q, other)
            if late is not None and abs(late) > recording.dt / 10.0:  # less has no effect on a fit
                found.append(ShiftEntry(signal=pattern.format(joint + 1), value=late, unit="s"))
    return found


def scale(q: Array, x: Array, t: Array) -> tuple[float, float]:
    """a of the fit x = a q + b + c t, and the part of x's variance that it explains.

    b is the constant of an integral, c the offset of a rate.
    """
    slow = np.vander((t - t[0]) / (t[-1] - t[0]), 2)
    clean = [y - slow @ np.linalg.lstsq(slow, y, rcond=None)[0] for y in (q, x)]
    power = float(clean[1] @ clean[1])
    a = float(clean[0] @ clean[1]) / max(float(clean[0] @ clean[0]), 1e-300)
    return a, 1 - float(np.sum((clean[1] - a * clean[0]) ** 2)) / max(power, 1e-300)


def _lag(t: Array, q: Array, other: Array) -> float | None:
    """Delay s of `other` behind q in s, by Gauss-Newton on other(t) = a q(t − s) + b + c t; None if it does not fit.

    Source: separable least squares, Ljung, System Identification, 1999.
    """
    late = 0.0
    rate = np.gradient(q, t)
    for _ in range(4):  # converges quadratically
        inside = (t - late >= t[0]) & (t - late <= t[-1])
        at = t[inside] - late
        columns = [np.interp(at, t, q), np.interp(at, t, rate), np.ones(len(at)), at - at[0]]
        x = np.array(columns).T / (sizes := np.array([np.linalg.norm(c) or 1.0 for c in columns]))
        theta = np.linalg.lstsq(x, other[inside], rcond=None)[0] / sizes
        left = other[inside] - np.array(columns).T @ theta
        if theta[0] == 0 or left @ left > (1 - FOLLOWS) * np.sum((other[inside] - other[inside].mean()) ** 2):
            return None
        late -= float(theta[1] / theta[0])
        if abs(late) > LATEST_SHIFT:
            return None
    return late
