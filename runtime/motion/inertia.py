"""The inertia that a recording itself shows, before any model is fitted: what a file says of it may be a guess."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from runtime.motion.clock import grid
from runtime.motion.filters import differentiator
from runtime.motion.settings import (
    ENOUGH_FOR_NOISE,
    INERTIA_GUESSED,
    INERTIA_SEEN,
    LOWEST_CUTOFF,
    MOST_INERTIA_ROWS,
    SEGMENT_HALVES,
)
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]


def believable(stated: Array, recordings: Sequence[Recording]) -> Array:
    """(n,) kg m² (kg): the stated inertias, those excepted that are far below what the recordings show, or unknown
    (NaN): there what they show, or if they show none the most that their torque can be for.

    One that is too large costs bandwidth and no more. What a recording shows may be too small itself, where something
    delays or withholds a torque.
    """
    motion = _slow_motion(recordings)
    if motion is None:
        return np.where(np.isfinite(stated), stated, 1.0)
    seen = _asked_at_all(motion)
    _, _, qdd, tau = motion
    with np.errstate(over="ignore"):  # a joint that is not accelerated may be as heavy as can be
        most = np.linalg.norm(tau, axis=1) / np.maximum(np.linalg.norm(qdd, axis=1), 1e-300)
    known = np.where(np.isfinite(stated), stated, most)
    return np.where(np.isfinite(seen) & ~(INERTIA_GUESSED * stated > seen), seen, known)


def shown(recordings: Sequence[Recording]) -> Array:
    """(n,) as `asked`, of every joint, below the lowest cut-off; NaN where no stretch is long enough."""
    motion = _slow_motion(recordings)
    return np.full(len(recordings[0].q), np.nan) if motion is None else _asked_at_all(motion)


def _asked_at_all(motion: tuple[Array, Array, Array, Array]) -> Array:
    q, qd, qdd, tau = motion
    return np.array([asked(i, q, qd, qdd=qdd, tau=row) for i, row in enumerate(tau)])


def _slow_motion(recordings: Sequence[Recording]) -> tuple[Array, Array, Array, Array] | None:
    parts = [p for r in recordings if (p := _smooth(r)) is not None]
    if not parts:
        return None
    q, qd, qdd, tau = (np.concatenate(signals, axis=1) for signals in zip(*parts, strict=True))
    return q, qd, qdd, tau


def _smooth(recording: Recording) -> tuple[Array, Array, Array, Array] | None:
    """q, qd, qdd, tau (n, M) below the lowest cut-off, thinned out; None if no stretch is long enough."""
    clock = grid(recording)
    derive, stretch = differentiator(LOWEST_CUTOFF, 1 / clock.period), clock.longest
    if stretch.size <= SEGMENT_HALVES * derive.half:
        return None
    window = slice(0, ENOUGH_FOR_NOISE)
    thin = max(1, min(stretch.size, ENOUGH_FOR_NOISE) // MOST_INERTIA_ROWS)
    position = stretch.of(recording.q[:, stretch.samples])[:, window]
    torque = stretch.of(recording.tau[:, stretch.samples])[:, window]
    parts = [derive(row) for row in position]
    q, qd, qdd = (np.array([p[k][::thin] for p in parts]) for k in range(3))
    return q, qd, qdd, np.array([derive(row)[0][::thin] for row in torque])


def asked(joint: int, q: Array, qd: Array, qdd: Array, tau: Array) -> float:
    """kg m² (kg), what a joint's torque tau (M,) asks for its acceleration, of all signals (n, M), beside friction,
    gravity and what the other joints' accelerations ask; NaN where that explains too little of it to be told."""
    turns = [f(row) for row in q for f in (np.sin, np.cos)]
    others = [row for k, row in enumerate(qdd) if k != joint]
    rest = np.array([qd[joint], np.sign(qd[joint]), np.ones(q.shape[1]), *turns, *others])
    y = np.array([qdd[joint], tau])
    beside = y - np.linalg.lstsq(rest.T, y.T, rcond=None)[0].T @ rest
    own, cross, whole = (float(a @ b) for a, b in (beside[[0, 0]], beside, beside[[1, 1]]))
    if own <= 0 or cross <= 0 or cross**2 < INERTIA_SEEN * own * whole:
        return float("nan")
    return cross / own
