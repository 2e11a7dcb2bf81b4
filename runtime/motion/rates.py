"""Measured rates: used where they are quieter than the derivative of the positions, and where they are what they say.

A tachometer, or an encoder that times its own steps, is quieter than differences of positions; most rates that a
controller logs are such differences, filtered, and late by as much. Their noise decides, and what they have in common
with the positions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from runtime.motion.clock import EvenGrid
from runtime.motion.filters import differentiator
from runtime.motion.settings import (
    DENSITY_SEGMENT,
    ENOUGH_FOR_NOISE,
    RATE_BETTER,
    RATE_DELAYED,
    RATE_FOLLOWS,
    RATE_OWN,
    RATE_SCALE,
    SEGMENT_HALVES,
)
from runtime.motion.white_noise import SampleNoise
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MeasuredRate:
    """What is made of a joint's measured rate.

    used     it takes the place of the derivative of the positions, and its own derivative that of the second
    density  one-sided, of its white noise, (unit/s)²/Hz
    why      for people
    wrong    it contradicts the positions: the recording should be looked at
    """

    used: bool
    density: float
    why: str
    wrong: bool = False


def judged(
    recordings: Sequence[Recording], grids: Sequence[EvenGrid], cutoff: float, position_density: Array
) -> tuple[MeasuredRate | None, ...]:
    """By joint; None where not all recordings have a rate, or none is long enough to tell.

    cutoff Hz up to which it is compared; position_density (n,) of the positions' noise, unit²/Hz.
    """
    return tuple(_of_joint(i, recordings, grids, cutoff, float(density)) for i, density in enumerate(position_density))


def _of_joint(
    joint: int, recordings: Sequence[Recording], grids: Sequence[EvenGrid], cutoff: float, density: float
) -> MeasuredRate | None:
    if any(r.qd is None or np.isnan(r.qd[joint]).any() for r in recordings):
        return None
    found = [_compared(r, g, joint, cutoff) for r, g in zip(recordings, grids, strict=True)]
    pairs = [p for p in found if p is not None]
    if not pairs:
        return None
    measured, derived = (np.concatenate([p[k] for p in pairs], axis=-1) for k in (0, 1))
    theta = np.linalg.lstsq(derived.T, measured, rcond=None)[0]
    scale, early, left = float(theta[0]), float(theta[1]), measured - theta @ derived
    own = max(p[2] for p in pairs)
    period = grids[0].period
    words = f"qd{joint + 1}"
    if left @ left > (1 - RATE_FOLLOWS) * measured @ measured:
        return MeasuredRate(False, own, f"{words} does not follow the derivative of q{joint + 1}: it is not used", True)
    if not 1 / (1 + RATE_SCALE) < scale < 1 + RATE_SCALE:
        why = f"{words} is {scale:.3g} times the derivative of q{joint + 1}: is its unit right? It is not used"
        return MeasuredRate(False, own, why, True)
    between, of_position = _in_band(left, 1 / period, cutoff, density)
    if own > RATE_BETTER * of_position:
        return MeasuredRate(False, own, f"{words} is no quieter than the derivative of q{joint + 1}: not used")
    late = -early / scale
    if abs(late) > RATE_DELAYED * period:
        why = f"{words} is {late:.2g} s later than the derivative of q{joint + 1}, as a filter makes it: not used"
        return MeasuredRate(False, own, why)
    if between < RATE_OWN * of_position:
        return MeasuredRate(False, own, f"{words} has the noise of q{joint + 1}, whose difference it is: not used")
    quieter = float(np.sqrt(of_position / own)) if own > 0 else float("inf")
    return MeasuredRate(True, own, f"{words} is {quieter:.2g} times quieter than the derivative of q{joint + 1}: used")


def _compared(recording: Recording, clock: EvenGrid, joint: int, cutoff: float) -> tuple[Array, Array, float] | None:
    """Of the longest stretch the measured rate (N,), the first and second derivatives of the positions (2, N), all
    smoothed alike, and the density of the measured one's white noise."""
    derive, stretch = differentiator(cutoff, 1 / clock.period), clock.longest
    if stretch.size <= SEGMENT_HALVES * derive.half or recording.qd is None:
        return None
    position, rate = (stretch.of(x[joint, stretch.samples])[:ENOUGH_FOR_NOISE] for x in (recording.q, recording.qd))
    _, qd, qdd = derive(position)
    return derive(rate)[0], np.array([qd, qdd]), SampleNoise.on(stretch, 1 / clock.period).density(recording.qd[joint])


def _in_band(left: Array, rate: float, cutoff: float, density: float) -> tuple[float, float]:
    """Densities near the cut-off: of what two rates differ by, and of the noise of differentiated positions."""
    f, power = welch(left, rate, nperseg=min(DENSITY_SEGMENT, len(left)), average="median")
    near = (f > cutoff / 2) & (f < cutoff)
    if not near.any():
        near = np.arange(len(f)) == int(np.argmin(np.abs(f - cutoff)))
    return float(np.median(power[near])), density * float(np.median((2 * np.pi * f[near]) ** 2))
