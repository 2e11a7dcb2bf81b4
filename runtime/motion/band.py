"""The band in which model and measurement are compared, chosen from the data.

A cut-off too high lets the encoder's noise, twice differentiated, into the regressors, and a memory
effect is then found that is not there; one too low throws away what would tell effects apart. The
cut-off is where the noise of q̈, times the inertia, has a quarter of the torque noise's variance inside
the band: then whatever smooths accelerations cannot pass for physics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runtime.motion.clock import grid
from runtime.motion.filters import differentiator
from runtime.motion.fourier import welch
from runtime.motion.rates import MeasuredRate, judged
from runtime.motion.settings import (
    CUTOFF_OF_SAMPLING,
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
)
from runtime.motion.white_noise import SampleNoise
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LineAbove:
    """A line of a joint's (0-based) torque over the motor's angle: order, periods a revolution; Hz at the middle
    speed of the motor; RMS, N m (N)."""

    joint: int
    order: float
    frequency: float
    rms: float


@dataclass(frozen=True)
class Band:
    """cutoff Hz; reason for people; noise densities one-sided per joint (unit²/Hz) of torque and position;
    resolution (n,) the positions' step, rad (m), 0 where they have none; rates: what is made of measured rates, by
    joint; None where there are none; above: lines of the torque over the motor's angle that it does not hold; held:
    torques at uneven instants are commands, each held until the next."""

    cutoff: float
    reason: str
    torque_density: Array
    position_density: Array
    resolution: Array
    rates: tuple[MeasuredRate | None, ...] = ()
    above: tuple[LineAbove, ...] = ()
    held: bool = False

    def rate_noise(self, joint: int) -> float | None:
        """One-sided density of a joint's (0-based) measured rate, (unit/s)²/Hz; None where it is not used."""
        rate = self.rates[joint] if self.rates else None
        return rate.density if rate is not None and rate.used else None

    def torque_floor(self) -> Array:
        """Standard deviation of white torque noise inside the band, (n,)."""
        return np.sqrt(self.torque_density * self.cutoff)


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


def excitation(qdd: Array, rate: float, density: float, derivative: int) -> Array:
    """Part (F,) of accelerations qdd (N,) that is motion, evenly from 0 to half the sampling rate (Wiener's filter);
    the rest is white noise of this density of what they are the first or second derivative of."""
    f, power = welch(qdd[:ENOUGH_FOR_NOISE], rate, min(len(qdd), round(EXCITATION_WINDOW_S * rate)) // 2 * 2)
    noise = density * (2 * np.pi * f) ** (2 * derivative)
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
        clock = grid(r)
        derive = differentiator(LOWEST_CUTOFF, 1 / clock.period)
        for s in (s for s in clock.stretches if s.size > SEGMENT_HALVES * derive.half):
            parts = [derive(row) for row in s.of(r.q[:, s.samples])]
            q, qdd = (np.array([part[k] for part in parts]) for k in (0, 2))
            moving = beyond_posture(q, qdd)
            moment += np.sum(moving * s.of(r.tau_rigid[:, s.samples])[:, derive.half : -derive.half], axis=1)
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
    grids = [grid(r) for r in recordings]
    rate = min(1 / g.spacing for g in grids)
    n = len(inertia)
    torque, position, step = np.zeros(n), np.zeros(n), np.zeros(n)
    noise = [SampleNoise.on(g.longest, 1 / g.period) for g in grids]
    for i in range(n):
        step[i] = max(resolution(r.q[i, g.longest.samples]) for r, g in zip(recordings, grids, strict=True))
        torque[i] = np.median([d.density(r.tau[i]) for r, d in zip(recordings, noise, strict=True)])
        position[i] = np.median([d.density(r.q[i]) for r, d in zip(recordings, noise, strict=True)])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        balance = (5 * ENCODER_SHARE * torque / (inertia**2 * position)) ** (1 / 4) / (2 * np.pi)
    # A torque that never changes has no noise to be rivalled: the joint is passive, and left out of the fit.
    balance[(torque == 0) | np.isnan(balance)] = np.inf
    ceiling = min(HIGHEST_CUTOFF, CUTOFF_OF_SAMPLING * rate)
    band = Band(*_cut(balance, ceiling), torque, position, step)
    band = replace(band, rates=judged(recordings, grids, band.cutoff, position))
    quiet = [i for i in range(n) if band.rate_noise(i) is not None]
    if not quiet:
        return band
    density = np.array([band.rate_noise(i) for i in quiet], dtype=float)
    with np.errstate(divide="ignore"):
        balance[quiet] = (3 * ENCODER_SHARE * torque[quiet] / (inertia[quiet] ** 2 * density)) ** (1 / 2) / (2 * np.pi)
    cutoff, reason = _cut(balance, ceiling)
    return replace(band, cutoff=cutoff, reason=reason) if cutoff > band.cutoff else band


def _cut(balance: Array, ceiling: float) -> tuple[float, str]:
    """The cut-off and its reason; balance (n,): Hz, above which a joint's encoder, as an inertial torque, rivals the
    torque noise."""
    joint = int(np.argmin(balance))
    cutoff = float(f"{np.clip(balance[joint], LOWEST_CUTOFF, ceiling):.3g}")
    if balance[joint] >= ceiling:
        return cutoff, f"the position is clean enough for the whole band up to {cutoff:g} Hz"
    if balance[joint] <= LOWEST_CUTOFF:
        return cutoff, f"above {cutoff:g} Hz the encoder of joint {joint + 1} tells nothing about the torque"
    who = f"the encoder noise of joint {joint + 1}"
    return cutoff, f"above {cutoff:g} Hz {who}, as an inertial torque, would rival the torque noise"


def lowered(band: Band, cutoff: float) -> Band | None:
    """A narrower band of the same recordings; None where nothing of the motion would be left in it."""
    if band.cutoff <= LOWEST_CUTOFF:
        return None
    cutoff = float(f"{max(cutoff, LOWEST_CUTOFF):.3g}")
    return replace(
        band, cutoff=cutoff, reason=f"above {cutoff:g} Hz most of the measured accelerations is the encoders' noise"
    )
