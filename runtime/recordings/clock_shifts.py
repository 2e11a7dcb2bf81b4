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

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import gaussian_filter1d

from runtime.recordings.settings import (
    CLOCK_SHIFT_CLEAR,
    CLOCK_SHIFT_FINEST,
    CLOCK_SHIFT_MOST,
    CLOCK_SHIFT_SAMPLES,
    CLOCK_SHIFT_SMOOTHING,
    CLOCK_SHIFT_STANDS_OUT,
    CLOCK_SHIFT_TIED,
    ROUNDING,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ClockShift:
    """s by which one clock's stamps are later than another's, and what of it is uncertain."""

    value: float
    error: float

    @property
    def clear(self) -> bool:
        """Whether there is one."""
        return abs(self.value) > CLOCK_SHIFT_CLEAR * self.error


def late(t: Array, q: Array, there: Array, tau: Array) -> ClockShift | None:
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
