"""Figures of a recording's signals and clock: range, speed, resolution, noise, rate and jitter."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.inspection.settings import MOVES_FROM, TOP_SPEED
from runtime.motion.band import resolution
from runtime.motion.clock import EvenGrid, grid
from runtime.motion.white_noise import SampleNoise
from runtime.recordings import recording as recorded
from runtime.recordings.recording import Recording
from runtime.recordings.settings import GAP, ROUNDING

Array = NDArray[np.float64]


def clock_json(recording: Recording) -> dict[str, Any]:
    """Rate, jitter and gaps of the samples. jitter: 0 where it is but rounding."""
    steps = np.concatenate([np.diff(recording.t[s]) for s in recording.segments])
    whole = np.diff(recording.t)[np.diff(recording.run) == 0]
    step = float(np.median(steps))
    return {
        "samples": len(recording.t),
        "seconds": float(sum(recording.t[s.stop - 1] - recording.t[s.start] for s in recording.segments)),
        "rate_hz": 1 / step,
        "jitter": jitter if (jitter := float(np.std(steps))) > ROUNDING * step else 0.0,
        "longest_step": float(steps.max()),
        "gaps": int(np.count_nonzero((whole > GAP * step) | (whole <= 0))),
        "runs": len(np.unique(recording.run)),
        "period": grid(recording).period,
    }


def signals_json(recording: Recording) -> list[dict[str, Any]]:
    """Of each signal its field, unit, range, resolution and the standard deviation of its white noise."""
    even = grid(recording)
    found = []
    for name, unit, values in named(recording):
        low, high = float(values.min()), float(values.max())
        found.append(
            {
                "signal": name,
                "field": recording.cells.get(name, name),
                "unit": unit,
                "least": low,
                "largest": high,
                "resolution": resolution(values),
                "noise": _noise(values, even) if high > low else 0.0,
            }
        )
    return found


def joints_json(recording: Recording, names: tuple[str | None, ...]) -> list[dict[str, Any]]:
    """Of each joint whether it moves, how far and how fast; names: the model's."""
    even = grid(recording)
    found = []
    for i, q in enumerate(recording.q):
        rate = np.concatenate([np.diff(s.of(q[s.samples])) for s in even.stretches]) / even.period
        found.append(
            {
                "joint": i + 1,
                "name": names[i] if i < len(names) else None,
                "moves": moves(q, even),
                "unit": "m" if recording.types[i] == "prismatic" else "rad",
                "range": float(np.ptp(q)),
                "top_speed": float(np.quantile(np.abs(rate), TOP_SPEED)),
                "powered": bool(np.ptp(recording.tau[i]) > 0),
            }
        )
    return found


def moves(q: Array, even: EvenGrid) -> bool:
    """Whether a joint's position (N,) is more than resolution and noise."""
    far = float(np.ptp(q))
    return far > 0 and far > MOVES_FROM * max(resolution(q), _noise(q, even))


def named(recording: Recording) -> Iterator[tuple[str, str, Array]]:
    """Name, unit and values (N,) of every signal that was measured throughout."""
    return (found for found in recorded.measured(recording) if np.isfinite(found[2]).all())


def _noise(values: Array, even: EvenGrid) -> float:
    """Standard deviation of white noise."""
    rate = 1 / even.period
    return float(np.sqrt(SampleNoise.on(even.longest, rate).density(values) * rate / 2))
