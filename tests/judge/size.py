"""How large a hidden effect is: the part of its torque in band that no values of the believed parameters explain."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from runtime.arrays import Array

from .bodies import Bodies, friction_columns, joint_rows
from .plant import PERIOD, Run

BAND = 45.0  # Hz
EVERY = 10
TAPS = 121
STANDSTILL = 3e-4  # rad/s


@functools.cache
def _taps(band: float) -> Array:
    return np.asarray(signal.firwin(TAPS, band, fs=1 / PERIOD))


def in_band(x: Array, band: float = BAND) -> Array:
    """x (..., N) low-passed and every tenth sample of it; the ends, where the filter is not full, are left out."""
    filtered = signal.upfirdn(_taps(band), x, 1, EVERY, axis=-1)
    first = -(-(TAPS - 1) // EVERY)
    return np.asarray(filtered)[..., first : first + (x.shape[-1] - TAPS) // EVERY + 1]


def orthogonal(
    run: Run,
    bodies: Bodies,
    believed: Sequence[str],
    outside: Array,
    gravity: Sequence[float] = (0.0, 0.0),
    free_delay: bool = False,
    band: float = BAND,
) -> Array:
    """RMS (n,) of what the believed model cannot explain of the torque that the plant really took.

    outside (n, N) is the known small disturbance, which is no part of the effect. The projection is onto the
    inertial parameters of all joints together, each joint's friction and, if free_delay, one small shift between
    torque and motion, common to all joints; standstill is left out.
    """
    middle = run.q + 0.5 * PERIOD * run.rate
    kept = ~_standing(run.rate)
    inertial = []
    for i, of_joint in enumerate(joint_rows(bodies, middle, run.rate, run.acceleration, gravity)):
        also = [np.gradient(run.tau[i], PERIOD)[None]] if free_delay else []
        inertial.append(_in_band_where_there(np.concatenate([of_joint, *also]), band))
    n, shared = len(inertial), len(inertial[0])
    own = [len(friction_columns_of(believed, run, i)) for i in range(n)]
    places = [np.r_[0:shared, shared + sum(own[:i]) : shared + sum(own[: i + 1])] for i in range(n)]
    gram, blocks, left = np.zeros((shared + sum(own),) * 2), [], []
    for i in range(n):
        friction = in_band(np.array(friction_columns_of(believed, run, i)), band)
        rows = np.concatenate([inertial[i], friction])
        used = np.any(rows != 0.0, axis=1)
        places[i] = places[i][used]
        blocks.append(rows[used][:, kept[i]])
        left.append(in_band(run.tau[i] + outside[i], band)[kept[i]])
        gram[np.ix_(places[i], places[i])] += blocks[i] @ blocks[i].T
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-30))
    inverse = np.linalg.pinv(gram / np.outer(scale, scale), rcond=1e-11, hermitian=True)
    for _ in range(3):  # each round mends what the condition of the Gram matrix cost the last
        moment = np.zeros(len(scale))
        for place, block, e in zip(places, blocks, left, strict=True):
            moment[place] += block @ e
        values = inverse @ (moment / scale) / scale
        left = [e - values[place] @ block for place, block, e in zip(places, blocks, left, strict=True)]
    return np.array([np.sqrt(np.mean(e**2)) for e in left])


def _in_band_where_there(rows: Array, band: float) -> Array:
    """As in_band, of rows many of which are zero."""
    there = np.any(rows != 0.0, axis=1)
    found = in_band(rows[there], band)
    out = np.zeros((len(rows), found.shape[1]))
    out[there] = found
    return out


def friction_columns_of(believed: Sequence[str], run: Run, joint: int) -> list[Array]:
    columns: list[Array] = []
    for effect in believed:
        columns += friction_columns(effect, run.rate[joint], run.above[joint], run.below[joint])
    return columns


def _standing(rate: Array) -> NDArray[np.bool_]:
    """Rows of in_band within 4 ms of standstill."""
    still = np.abs(rate) < STANDSTILL
    near = np.array([np.convolve(row, np.ones(9), "same") > 0 for row in still])
    half = TAPS // 2
    return near[:, half : near.shape[1] - half : EVERY]
