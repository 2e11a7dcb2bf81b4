"""The band in which model and measurement are compared, chosen from the data.

A cut-off too high lets the encoder's noise, twice differentiated, into the regressors, and a memory
effect is then found that is not there; one too low throws away what would tell effects apart. The
cut-off is where the noise of q̈, times the inertia, has a quarter of the torque noise's variance inside
the band: then whatever smooths accelerations cannot pass for physics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from runtime.motion.filters import differentiator
from runtime.motion.settings import (
    CUTOFF_OF_SAMPLING,
    DENSITY_SEGMENT,
    ENCODER_SHARE,
    ENOUGH_FOR_NOISE,
    EXCITATION_CAUTION,
    EXCITATION_WINDOW_S,
    HIGHEST_CUTOFF,
    LOWEST_CUTOFF,
    SEGMENT_HALVES,
    STEP_OF_ALL,
    STEP_ONE,
    STEP_QUANTILE,
    STEP_ROUNDED,
    STEP_SINGLE,
    WHITE_FROM,
    WHITE_TO,
)
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Band:
    """cutoff Hz; reason for people; noise densities one-sided per joint (unit²/Hz) of torque and position;
    resolution (n,) the positions' step, rad (m), 0 where they have none."""

    cutoff: float
    reason: str
    torque_density: Array
    position_density: Array
    resolution: Array

    def torque_floor(self) -> Array:
        """Standard deviation of white torque noise inside the band, (n,)."""
        return np.sqrt(self.torque_density * self.cutoff)


def white_density(x: Array, rate: float) -> float:
    """One-sided density of the white noise in x, near half the sampling rate, where no joint moves.

    Medians over time and frequency, so that shocks and single lines do not count as noise.
    """
    f, density = welch(x[:ENOUGH_FOR_NOISE], rate, nperseg=min(DENSITY_SEGMENT, len(x)), average="median")
    inside = (f > WHITE_FROM * rate) & (f < WHITE_TO * rate)
    return float(np.median(density[inside]))


def resolution(q: Array) -> float:
    """The step of which nearly all differences of q (N,) are multiples; 0 if there is none."""
    steps = np.abs(np.diff(q[:ENOUGH_FOR_NOISE]))
    steps = steps[steps > 1e-12 * (np.ptp(q) + 1e-300)]
    if not len(steps):
        return 0.0
    # Printed digits round each position, hence each step by a little.
    least = float(np.quantile(steps, STEP_QUANTILE))
    size = float(np.median(steps[steps < STEP_ONE * least]))
    multiples = steps / size
    fits = np.abs(multiples - np.round(multiples)) < STEP_ROUNDED
    return size if fits.mean() > STEP_OF_ALL and (multiples < STEP_ONE).mean() > STEP_SINGLE else 0.0


def excitation(qdd: Array, rate: float, density: float) -> Array:
    """Part (F,) of accelerations qdd (N,) that is motion, evenly from 0 to half the sampling rate (Wiener's filter);
    the rest is noise of positions of this density."""
    f, power = welch(qdd[:ENOUGH_FOR_NOISE], rate, nperseg=min(len(qdd), round(EXCITATION_WINDOW_S * rate)) // 2 * 2)
    noise = density * (2 * np.pi * f) ** 4
    part = np.clip(1 - EXCITATION_CAUTION * noise / np.maximum(power, 1e-300), 0.0, 1.0)
    return np.where(f < LOWEST_CUTOFF, 1.0, part)


def rigid_inertia(recordings: Sequence[Recording]) -> Array | None:
    """(n,) kg m² (kg), what the rigid-body torque of the user's own model asks for an acceleration, beside what it asks
    for a posture; None where not all recordings have that torque."""
    n = len(recordings[0].q)
    moment, square = np.zeros(n), np.zeros(n)
    for r in recordings:
        if r.tau_rigid is None:
            return None
        derive = differentiator(LOWEST_CUTOFF, 1 / r.dt)
        for s in (s for s in r.segments if s.stop - s.start > SEGMENT_HALVES * derive.half):
            parts = [derive(row) for row in r.q[:, s]]
            q, qdd = (np.array([part[k] for part in parts]) for k in (0, 2))
            moving = beyond_posture(q, qdd)
            moment += np.sum(moving * r.tau_rigid[:, s.start + derive.half : s.stop - derive.half], axis=1)
            square += np.sum(moving**2, axis=1)
    inertia: Array = np.abs(moment) / np.maximum(square, 1e-300)
    return np.maximum(inertia, 1e-12)


def beyond_posture(q: Array, x: Array) -> Array:
    """What of signals x (k, N) no torque of the posture q (n, N) can be: no constant, and no wave of a joint's angle or
    of a link's, as gravity makes them."""
    angles = np.vstack([q, np.cumsum(q, axis=0)[1:]])
    base = np.vstack([np.ones((1, q.shape[1])), np.cos(angles), np.sin(angles)])
    left: Array = x - np.linalg.lstsq(base.T, x.T, rcond=None)[0].T @ base
    return left


def choose_band(recordings: Sequence[Recording], inertia: Array) -> Band:
    """Cut-off for all joints of all recordings together.

    inertia (n,): D_ii of the model, kg m² (kg).
    """
    rate = min(1 / r.dt for r in recordings)
    n = len(inertia)
    torque, position, step = np.zeros(n), np.zeros(n), np.zeros(n)
    longest = [(r, max(r.segments, key=lambda s: s.stop - s.start)) for r in recordings]
    for i in range(n):
        step[i] = max(resolution(r.q[i, s]) for r, s in longest)
        torque[i] = np.median([white_density(r.tau[i, s], 1 / r.dt) for r, s in longest])
        position[i] = np.median([white_density(r.q[i, s], 1 / r.dt) for r, s in longest])
    with np.errstate(divide="ignore"):
        balance = (5 * ENCODER_SHARE * torque / (inertia**2 * position)) ** (1 / 4) / (2 * np.pi)
    joint = int(np.argmin(balance))
    ceiling = min(HIGHEST_CUTOFF, CUTOFF_OF_SAMPLING * rate)
    cutoff = float(np.clip(balance[joint], LOWEST_CUTOFF, ceiling))
    cutoff = float(f"{cutoff:.3g}")
    if balance[joint] >= ceiling:
        reason = f"the position is clean enough for the whole band up to {cutoff:g} Hz"
    elif balance[joint] <= LOWEST_CUTOFF:
        reason = f"above {cutoff:g} Hz the encoder of joint {joint + 1} tells nothing about the torque"
    else:
        who = f"the encoder noise of joint {joint + 1}"
        reason = f"above {cutoff:g} Hz {who}, as an inertial torque, would rival the torque noise"
    return Band(cutoff, reason, torque, position, step)
