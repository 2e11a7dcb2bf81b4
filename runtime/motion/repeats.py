"""Motion that a recording repeats, and the noise floor: what repeats in a residual too is missing physics.

Without repeats the floor follows from the spectra of the instruments' noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, Mask
from runtime.motion.filters import convolved
from runtime.motion.motion import Motion
from runtime.motion.piece import Piece
from runtime.motion.settings import REPEAT_ALIKE, REPEAT_ALIKE_RATE, REPEAT_WINDOW_S, REPEATABLE_SHARE
from runtime.motion.spectra import in_band_white_density

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class RepeatedRows:
    """In-band rows `first` and `second` (P,), of all rows, at which the motion was the same: exactly `late` rows, less
    than one, after `second`."""

    first: Rows
    second: Rows
    late: float

    @property
    def _taps(self) -> Rows:
        return np.arange(-4, 5)

    @property
    def _between(self) -> Rows:
        return self.second[:, None] + self._taps

    def at_recurrence(self, x: Array) -> Array:
        """Signals x (..., M) when the motion came back, interpolated between their rows (..., P)."""
        away = self._taps - self.late
        kernel: Array = np.sinc(away) * np.cos(np.pi / 2 * away / 5) ** 2
        return np.asarray(x[..., self._between] @ (kernel / kernel.sum()))

    def usable(self, use: Mask) -> Mask:
        """(P,) pairs of which all rows count; use (M,)."""
        return np.asarray(use[self.first] & use[self._between].all(axis=-1))

    def inside(self, size: int) -> bool:
        """Whether all rows of the pairs lie among so many."""
        between = self._between
        return bool(between[0, 0] >= 0 and between[-1, -1] < size)


@dataclass(frozen=True)
class Repeats:
    """All pairs of repeated windows, and for how long motion was repeated, s."""

    pairs: tuple[RepeatedRows, ...]
    seconds: float

    def pure_error(self, residual: Array, use: Mask) -> tuple[float, float] | None:
        """Standard deviation of the part of a residual (M,) that does not repeat, and of the part that does, less two
        standard errors; None with fewer than 100 pairs of rows, whose variance is known to a seventh.

        Between two passes the repeating part cancels in the difference and remains in the mean product. By chance that
        varies as the mean product of sum and difference does, which is zero otherwise: ten stretches show how much,
        also where one of them holds all that repeats.
        """
        both = [(residual[p.first], p.at_recurrence(residual), p.usable(use)) for p in self.pairs]
        a = np.concatenate([x[k] for x, _, k in both]) if both else np.zeros(0)
        b = np.concatenate([y[k] for _, y, k in both]) if both else np.zeros(0)
        if len(a) < 100:
            return None
        noise = float(np.mean((a - b) ** 2) / 2)
        means = [float(stretch.mean()) for stretch in np.array_split((a + b) * np.roll(a - b, len(a) // 2) / 2, 10)]
        chance = float(np.std(means, ddof=1)) / len(means) ** 0.5
        repeating = float(np.mean(a * b)) - 2 * chance
        return float(np.sqrt(noise)), float(np.sqrt(max(repeating, 0.0)))


def find(motion: Motion) -> tuple[Repeats, ...]:
    """By joint, in the rows of its equation: windows of two seconds whose joint angles come back later in the same
    piece; no pairs where fewer than two windows do."""
    found: dict[int, Repeats] = {}
    for view in motion.views:
        pairs: list[RepeatedRows] = []
        start = 0
        for piece in view.pieces:
            own = _in_piece(piece, motion.standstill)
            pairs += [replace(p, first=start + p.first, second=start + p.second) for p in own]
            start += len(piece.centres)
        seconds = sum(len(p.first) for p in pairs) / motion.row_rate(view.joints[0])
        repeats = Repeats(tuple(pairs) if len(pairs) >= 2 else (), seconds)
        found |= dict.fromkeys(view.joints, repeats)
    return tuple(found[i] for i in range(motion.n))


def _in_piece(piece: Piece, standstill: Array) -> list[RepeatedRows]:
    factor = piece.low_pass.factor
    # The search sees the motion at 50 Hz, and at most 60 windows, before it aligns to the nearest row.
    stride, windows = max(1, round(1 / (piece.dt * 50 * factor))), 60
    # A joint that is held comes back to where its friction leaves it, whatever the motion.
    free = np.isfinite(standstill)
    q, qd, standstill = piece.q[free][:, piece.centres], piece.qd[free][:, piece.centres], standstill[free]
    coarse, step, reach = q[:, ::stride], qd * (piece.dt * factor), np.ptp(q, axis=1)
    width = round(REPEAT_WINDOW_S / (piece.dt * factor * stride))
    every = width * max(1, coarse.shape[1] // (width * windows))
    rows = []
    for begin in range(0, coarse.shape[1] - 2 * width, every):
        window = coarse[:, begin : begin + width]
        # A window in which no joint moves by a fiftieth of its range comes back everywhere.
        if not np.any(np.ptp(window, axis=1) > 0.02 * reach):
            continue
        lag = _best_lag(coarse, window, begin, width)
        if lag is None:
            continue
        p = _align(q, step, begin * stride, width=width * stride, lag=lag * stride, stride=stride)
        if not p.inside(q.shape[1]):
            continue
        alike = np.sqrt(np.mean((q[:, p.first] - p.at_recurrence(q)) ** 2, axis=1)) < REPEAT_ALIKE * reach
        rates = np.sqrt(np.mean((qd[:, p.first] - p.at_recurrence(qd)) ** 2, axis=1))
        quick = rates < REPEAT_ALIKE_RATE * np.abs(qd).max(axis=1) + standstill
        if alike.all() and quick.all():
            rows.append(p)
    return rows


def _best_lag(coarse: Array, window: Array, begin: int, width: int) -> int | None:
    """Lag, in coarse samples, at which the window recurs best after its own end; None where no room is left."""
    later = coarse[:, begin + width :]
    if later.shape[1] < width:
        return None
    mismatch = np.zeros(later.shape[1] - width + 1)
    for row, part in zip(later, window, strict=True):
        cross = convolved(row, part[None, ::-1])[0]
        energy = np.concatenate([[0.0], np.cumsum(row**2)])
        scale = max(float(np.ptp(coarse)), 1e-300) ** 2
        mismatch += (energy[width:] - energy[:-width] - 2 * cross + part @ part) / (width * scale)
    return width + int(np.argmin(mismatch))


def _align(q: Array, step: Array, begin: int, width: int, lag: int, stride: int) -> RepeatedRows:
    """The window's rows and those of its recurrence, a lag later; step (n, M): growth of q in a row."""
    first = np.arange(begin, begin + width)
    best, rows = np.inf, first
    for shift in range(lag - stride, lag + stride + 1):
        second = first + shift
        if second[-1] < q.shape[1]:
            error = float(np.sum((q[:, first] - q[:, second]) ** 2))
            if error < best:
                best, rows = error, second
    ahead, by = q[:, first] - q[:, rows], step[:, rows]
    late = float(np.sum(ahead * by)) / max(float(np.sum(by**2)), 1e-300)
    return RepeatedRows(first, rows, float(np.clip(late, -1.0, 1.0)))


@dataclass(frozen=True)
class Floor:
    """The noise floor of a residual: what a perfect model would leave.

    value      standard deviation of noise in the residual; at most the residual's own
    source     "repeats" or "spectrum"
    spectrum   the same from white torque and encoder noise alone
    repeating  standard deviation of the part that comes back with the motion; None without repeats
    """

    value: float
    source: Literal["repeats", "spectrum"]
    spectrum: float
    repeating: float | None

    def repeatable(self, rms: float) -> bool | None:
        """Whether the residual comes back with the motion; None where no motion was repeated."""
        if self.repeating is None:
            return None
        return self.repeating**2 > REPEATABLE_SHARE * rms**2


def floor(motion: Motion, repeats: Repeats, joint: int, residual: Array, read: Array) -> Floor:
    """Floor of a residual (M,), zero where rows do not count; read (M,): change of the predicted torque by another
    realisation of the encoders' errors."""
    use = motion.moving(joint)
    band, cutoff = motion.band, motion.cutoff(joint)
    torque = band.torque_density[joint] * cutoff
    if band.filtered and band.filtered[joint] and use.any():
        torque = in_band_white_density(residual, motion.row_rate(joint), cutoff) * cutoff / np.mean(use)
    left = float(np.mean(motion.noise_left(joint)[use])) if use.any() else 1.0
    spectrum = float(np.sqrt(torque * left + np.mean(read[use] ** 2))) if use.any() else float(np.sqrt(torque))
    parts = repeats.pure_error(residual, use)
    if parts is None:
        return Floor(spectrum, "spectrum", spectrum, None)
    # Two passes under a disturbance may differ by more than either holds.
    return Floor(min(parts[0], float(np.sqrt(np.mean(residual[use] ** 2)))), "repeats", spectrum, parts[1])
