"""By how much one signal of a recording lags behind another: rate, link-side encoder and target behind the motor's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.inspection.settings import FOLLOWS, LATEST_SHIFT, SHIFT_PASSES, SMALLEST_SHIFT
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]


def shifts_json(recording: Recording) -> list[dict[str, Any]]:
    """Of each signal the s by which it is later than its joint's position at the motor; of those that can be told."""
    samples = max(recording.segments, key=lambda s: s.stop - s.start)
    t = recording.t[samples]
    found = []
    for name, joint, values in compared(recording):
        q, other = recording.q[joint, samples], values[samples]
        if name.startswith("qd"):
            q, other = q - q.mean(), integral(t, other)
        late = _later(t, q, other)
        if late is not None and abs(late) > SMALLEST_SHIFT * recording.dt:
            found.append({"signal": name, "value": late, "unit": "s"})
    return found


def compared(recording: Recording) -> Iterator[tuple[str, int, Array]]:
    """Signals that follow a joint's position or its rate: name, joint (0-based) and values (N,)."""
    groups = {"qd{}": recording.qd, "q{}_link": recording.q_link, "q{}_desired": recording.q_desired}
    for pattern, rows in groups.items():
        for joint, values in enumerate(rows if rows is not None else ()):
            if np.isfinite(values).all() and np.ptp(recording.q[joint]) > 0:
                yield pattern.format(joint + 1), joint, values


def integral(t: Array, x: Array) -> Array:
    """Of x (N,) over t (N,), from 0; trapezia."""
    return np.concatenate([[0.0], np.cumsum((x[1:] + x[:-1]) / 2 * np.diff(t))])


def scale(q: Array, x: Array, t: Array) -> tuple[float, float]:
    """a of x = a q + b + c t, and what part of x's variance is explained so.

    b and c: where an integral begins, and the offset of a rate.
    """
    slow = np.vander((t - t[0]) / (t[-1] - t[0]), 2)
    clean = [y - slow @ np.linalg.lstsq(slow, y, rcond=None)[0] for y in (q, x)]
    power = float(clean[1] @ clean[1])
    a = float(clean[0] @ clean[1]) / max(float(clean[0] @ clean[0]), 1e-300)
    return a, 1 - float(np.sum((clean[1] - a * clean[0]) ** 2)) / max(power, 1e-300)


def _later(t: Array, q: Array, other: Array) -> float | None:
    """s by which `other` lags behind q; None where it does not follow it.

    other(t) = a q(t − s) + b + c t, linearised in s about the shift found so far. Source: Gauss and Newton's method on
    separable least squares; Ljung, System Identification, 1999.
    """
    late = 0.0
    rate = np.gradient(q, t)
    for _ in range(SHIFT_PASSES):
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
