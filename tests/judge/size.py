"""How large a hidden effect is: the part of its torque in band that no values of the believed parameters explain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from .bodies import Body, friction_columns, inertial_columns
from .plant import PERIOD, Run

Array = NDArray[np.float64]

BAND = 45.0  # Hz
EVERY = 5
TAPS = signal.firwin(121, BAND, fs=1 / PERIOD)
STANDSTILL = 3e-4  # rad/s


def in_band(x: Array) -> Array:
    """x (..., N) low-passed and every fifth sample of it; the ends, where the filter is not full, are left out."""
    return np.asarray(signal.oaconvolve(x, np.broadcast_to(TAPS, (*x.shape[:-1], len(TAPS))), "valid", axes=-1))[
        ..., ::EVERY
    ]


def orthogonal(
    run: Run, bodies: Sequence[Body], believed: Sequence[str], outside: Array, gravity: tuple[float, float] = (0.0, 0.0)
) -> Array:
    """RMS (n,) of what the believed model cannot explain of the torque that the plant really took.

    outside (n, N) is the known small disturbance, which is no part of the effect. The projection is onto the
    inertial parameters of all joints together and each joint's friction; standstill is left out.
    """
    n = len(run.q)
    middle = run.q + 0.5 * PERIOD * run.rate
    inertial = inertial_columns(bodies, middle, run.rate, run.acceleration, gravity)
    kept = ~_standing(run.rate)
    blocks, targets, own = [], [], []
    for i in range(n):
        frictions = friction_columns_of(believed, run, i)
        blocks.append(in_band(np.concatenate([inertial[i], frictions]))[:, kept[i]])
        targets.append(in_band(run.tau[i] + outside[i])[kept[i]])
        own.append(len(frictions))
    shared = inertial.shape[1]
    width = shared + sum(own)
    rows = sum(len(x) for x in targets)
    A = np.zeros((rows, width))
    row, column = 0, shared
    for block, count in zip(blocks, own, strict=True):
        A[row : row + block.shape[1], :shared] = block[:shared].T
        A[row : row + block.shape[1], column : column + count] = block[shared:].T
        row, column = row + block.shape[1], column + count
    norms = np.linalg.norm(A, axis=0)
    A = A[:, norms > 1e-9 * norms.max()]
    A /= np.linalg.norm(A, axis=0)
    b = np.concatenate(targets)
    gram = A.T @ A
    left = b - A @ np.linalg.lstsq(gram, A.T @ b, rcond=1e-11)[0]
    left -= A @ np.linalg.lstsq(gram, A.T @ left, rcond=1e-11)[0]
    edges = np.cumsum([0] + [len(x) for x in targets])
    return np.array([np.sqrt(np.mean(left[edges[i] : edges[i + 1]] ** 2)) for i in range(n)])


def friction_columns_of(believed: Sequence[str], run: Run, joint: int) -> list[Array]:
    columns: list[Array] = []
    for effect in believed:
        columns += friction_columns(effect, run.rate[joint], run.above[joint], run.below[joint])
    return columns


def _standing(rate: Array) -> NDArray[np.bool_]:
    """Rows of in_band within 4 ms of standstill."""
    still = np.abs(rate) < STANDSTILL
    near = np.array([np.convolve(row, np.ones(9), "same") > 0 for row in still])
    half = len(TAPS) // 2
    return near[:, half : near.shape[1] - half : EVERY]
