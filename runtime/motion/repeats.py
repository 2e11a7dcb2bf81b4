"""Motion that a recording repeats: what repeats in the residual too is missing physics, the rest is noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from runtime.motion.filters import convolved
from runtime.motion.motion import BandView, Motion
from runtime.motion.piece import Piece
from runtime.motion.settings import (
    LASTING,
    REPEAT_ALIKE,
    REPEAT_ALIKE_RATE,
    REPEAT_LEAST_ROWS,
    REPEAT_LEAST_S,
    REPEAT_LEAST_TRAVEL,
    REPEAT_SEARCH_HZ,
    REPEAT_SIGMAS,
    REPEAT_STRETCHES,
    REPEAT_TAPS,
    REPEAT_WINDOW_S,
    REPEAT_WINDOWS,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RepeatedRows:
    """In-band rows `first` and `second` (indices into all rows) at which the motion was the same, but for a part of a
    row: at `second` it was so far ahead, and is the same `late` rows, less than one, after it."""

    first: NDArray[np.intp]
    second: NDArray[np.intp]
    late: float

    def again(self, x: Array) -> Array:
        """Signals x (..., M) when the motion came back, between their rows."""
        return np.asarray(x[..., self._between] @ self._kernel)

    def count(self, use: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether pairs count: all rows that are in them do."""
        return np.asarray(use[self.first] & use[self._between].all(axis=-1))

    def inside(self, size: int) -> bool:
        """Whether all rows that are in pairs are there, of so many."""
        return bool(self._between[0, 0] >= 0 and self._between[-1, -1] < size)

    @property
    def _between(self) -> NDArray[np.intp]:
        return self.second[:, None] + np.arange(-REPEAT_TAPS, REPEAT_TAPS + 1)

    @property
    def _kernel(self) -> Array:
        away = np.arange(-REPEAT_TAPS, REPEAT_TAPS + 1) - self.late
        kernel: Array = np.sinc(away) * np.cos(np.pi / 2 * away / (REPEAT_TAPS + 1)) ** 2
        return kernel / kernel.sum()


@dataclass(frozen=True)
class Repeats:
    """All pairs of repeated stretches, and for how long motion was repeated, s."""

    pairs: tuple[RepeatedRows, ...]
    seconds: float

    def pure_error(self, residual: Array, use: NDArray[np.bool_]) -> tuple[float, float] | None:
        """Standard deviation of what does not repeat in a residual (M,), and of what surely does; None: too few rows.

        Between two passes the repeating part cancels in the difference and remains in the mean. That mean varies by
        chance, as its stretches show: what it may owe to that is taken off.
        """
        both = [(residual[p.first], p.again(residual), p.count(use)) for p in self.pairs]
        a = np.concatenate([x[k] for x, _, k in both]) if both else np.zeros(0)
        b = np.concatenate([y[k] for _, y, k in both]) if both else np.zeros(0)
        if len(a) < REPEAT_LEAST_ROWS:
            return None
        noise = float(np.mean((a - b) ** 2) / 2)
        means = [float(stretch.mean()) for stretch in np.array_split(a * b, REPEAT_STRETCHES)]
        chance = float(np.std(means, ddof=1)) / REPEAT_STRETCHES**0.5
        repeating = float(np.mean(a * b)) - REPEAT_SIGMAS * chance
        return float(np.sqrt(noise)), float(np.sqrt(max(repeating, 0.0)))


def find(motion: Motion) -> tuple[Repeats, ...]:
    """Stretches of at least two seconds whose joint angles come back the same, later in the same piece; of every joint
    in the rows of its equation."""
    found = {joint: repeats for view in motion.views for joint, repeats in _of_view(motion, view).items()}
    return tuple(found[i] for i in range(motion.n))


def _of_view(motion: Motion, view: BandView) -> dict[int, Repeats]:
    """By joint of a view, the same for all."""
    pairs: list[RepeatedRows] = []
    start = 0
    for piece in view.pieces:
        for p in _in_piece(piece, motion.standstill):
            pairs.append(replace(p, first=start + p.first, second=start + p.second))
        start += len(piece.centres)
    rows = sum(len(p.first) for p in pairs)
    # A window is a whole number of rows, and may be a part of one shorter than it should be.
    enough = len(pairs) * REPEAT_WINDOW_S >= REPEAT_LEAST_S
    found = Repeats(tuple(pairs) if enough else (), rows / motion.row_rate(view.joints[0]))
    return dict.fromkeys(view.joints, found)


def _in_piece(piece: Piece, standstill: Array) -> list[RepeatedRows]:
    factor = piece.low_pass.factor
    stride = max(1, round(1 / (piece.dt * REPEAT_SEARCH_HZ * factor)))
    # A joint that is held comes back to where its friction leaves it; that says nothing of the motion.
    free = np.isfinite(standstill)
    q, qd, standstill = piece.q[free][:, piece.centres], piece.qd[free][:, piece.centres], standstill[free]
    coarse = q[:, ::stride]
    width = round(REPEAT_WINDOW_S / (piece.dt * factor * stride))
    found = []
    for begin in range(0, coarse.shape[1] - 2 * width, width * max(1, coarse.shape[1] // (width * REPEAT_WINDOWS))):
        window = coarse[:, begin : begin + width]
        if not np.any(np.ptp(window, axis=1) > REPEAT_LEAST_TRAVEL * np.ptp(q, axis=1)):
            continue
        lag = _same_later(coarse, window, begin, width)
        if lag is not None:
            found.append(
                _align(
                    q, qd * (piece.dt * factor), begin * stride, width=width * stride, lag=lag * stride, stride=stride
                )
            )
    tolerance = REPEAT_ALIKE * np.ptp(q, axis=1)
    rows = []
    for p in (p for p in found if p.inside(q.shape[1])):
        alike = np.sqrt(np.mean((q[:, p.first] - p.again(q)) ** 2, axis=1)) < tolerance
        rates = np.sqrt(np.mean((qd[:, p.first] - p.again(qd)) ** 2, axis=1))
        quick = rates < REPEAT_ALIKE_RATE * np.abs(qd).max(axis=1) + standstill
        if alike.all() and quick.all():
            rows.append(p)
    return rows


def _same_later(coarse: Array, window: Array, begin: int, width: int) -> int | None:
    """Lag in coarse samples at which the window recurs best after its own end."""
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
    """The window's rows and those of its recurrence; step (n, M): by how much q grows in a row."""
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
    """What a perfect model would leave.

    value      standard deviation of that part of the residual that no model explains; at most the residual's own
    source     "repeats" or "spectrum"
    spectrum   the same from white torque and encoder noise alone
    repeating  standard deviation of what comes back with the motion; None without repeats
    """

    value: float
    source: Literal["repeats", "spectrum"]
    spectrum: float
    repeating: float | None

    def repeatable(self, rms: float) -> bool | None:
        """Whether the residual comes back with the motion; None where no motion was repeated."""
        if self.repeating is None:
            return None
        return self.repeating**2 > LASTING * rms**2


def floor(motion: Motion, repeats: Repeats, joint: int, residual: Array, read: Array) -> Floor:
    """Floor of a residual (M,) that is zero where rows do not count.

    read (M,): what another reading of the encoders would change in the predicted torque.
    """
    use = motion.moving(joint)
    torque = motion.band.torque_density[joint] * motion.cutoff(joint)
    left = float(np.mean(motion.noise_left(joint)[use])) if use.any() else 1.0
    spectrum = float(np.sqrt(torque * left + np.mean(read[use] ** 2))) if use.any() else float(np.sqrt(torque))
    parts = repeats.pure_error(residual, use)
    if parts is None:
        return Floor(spectrum, "spectrum", spectrum, None)
    # Two passes under a disturbance may differ by more than either holds.
    return Floor(min(parts[0], float(np.sqrt(np.mean(residual[use] ** 2)))), "repeats", spectrum, parts[1])
