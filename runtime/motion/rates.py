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

from runtime.motion.clock import EvenGrid
from runtime.motion.filters import differentiator
from runtime.motion.fourier import welch
from runtime.motion.settings import (
    DENSITY_SEGMENT,
    ENOUGH_FOR_NOISE,
    LOWEST_CUTOFF,
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
    recordings: Sequence[Recording], grids: Sequence[EvenGrid], cutoffs: Array, position_density: Array
) -> tuple[MeasuredRate | None, ...]:
    """By joint; None where not all recordings have a rate, or none is long enough to tell.

    cutoffs (n,) Hz up to which it is compared; position_density (n,) of the positions' noise, unit²/Hz.
    """
    each = enumerate(zip(cutoffs.tolist(), position_density.tolist(), strict=True))
    return tuple(_of_joint(i, recordings, grids, cutoff=cutoff, density=density) for i, (cutoff, density) in each)


def _of_joint(
    joint: int, recordings: Sequence[Recording], grids: Sequence[EvenGrid], cutoff: float, density: float
) -> MeasuredRate | None:
    if any(r.qd is None or np.isnan(r.qd[joint]).any() for r in recordings):
        return None
    # Scale and delay are told where the positions' noise is nothing, or it would make the rate seem too small.
    slow = _compared(recordings, grids, joint, LOWEST_CUTOFF)
    quick = _compared(recordings, grids, joint, cutoff)
    if slow is None or quick is None:
        return None
    theta = np.linalg.lstsq(slow[1].T, slow[0], rcond=None)[0]
    if not np.isfinite(theta).all():  # of positions that hardly change, a rate is any multiple
        return None
    scale, late, period = float(theta[0]), -float(theta[1] / (theta[0] or 1.0)), grids[0].period
    own = max(_density(r, g, joint) for r, g in zip(recordings, grids, strict=True))
    between, of_position = _in_band(quick[0] - theta @ quick[1], 1 / period, cutoff, density)
    rate, derivative = f"qd{joint + 1}", f"the derivative of q{joint + 1}"
    left = slow[0] - theta @ slow[1]
    if left @ left > (1 - RATE_FOLLOWS) * slow[0] @ slow[0]:
        return MeasuredRate(False, own, f"{rate} does not follow {derivative}: it is not used", wrong=True)
    if not 1 / (1 + RATE_SCALE) < scale < 1 + RATE_SCALE:
        why = f"{rate} is {scale:.3g} times {derivative}: is its unit right? It is not used"
        return MeasuredRate(False, own, why, wrong=True)
    if own > RATE_BETTER * of_position:
        return MeasuredRate(False, own, f"{rate} is no quieter than {derivative}: not used")
    if abs(late) > RATE_DELAYED * period:
        return MeasuredRate(False, own, f"{rate} is {late:.2g} s later than {derivative}, as if filtered: not used")
    if between < RATE_OWN * of_position:
        return MeasuredRate(False, own, f"{rate} has the noise of q{joint + 1}, whose difference it is: not used")
    quieter = float(np.sqrt(of_position / own)) if own > 0 else float("inf")
    return MeasuredRate(True, own, f"{rate} is {quieter:.2g} times quieter than {derivative}: used")


def _compared(
    recordings: Sequence[Recording], grids: Sequence[EvenGrid], joint: int, cutoff: float
) -> tuple[Array, Array] | None:
    """Of the longest stretches the measured rate (N,), and the first and second derivatives of the positions (2, N),
    all smoothed alike; None if all are too short."""
    measured, derived = [], []
    for recording, clock in zip(recordings, grids, strict=True):
        derive, stretch = differentiator(cutoff, 1 / clock.period), clock.longest
        if recording.qd is not None and stretch.size > SEGMENT_HALVES * derive.half:
            rows = np.array([recording.q[joint, stretch.samples], recording.qd[joint, stretch.samples]])
            position, rate = stretch.of(rows)[:, :ENOUGH_FOR_NOISE]
            derived.append(np.array(derive(position)[1:]))
            measured.append(derive(rate)[0])
    return (np.concatenate(measured), np.concatenate(derived, axis=1)) if measured else None


def _density(recording: Recording, clock: EvenGrid, joint: int) -> float:
    return 0.0 if recording.qd is None else SampleNoise.on(clock.longest, 1 / clock.period).density(recording.qd[joint])


def _in_band(left: Array, rate: float, cutoff: float, density: float) -> tuple[float, float]:
    """Densities near the cut-off: of what two rates differ by, and of the noise of differentiated positions."""
    f, power = welch(left, rate, DENSITY_SEGMENT, "median")
    near = (f > cutoff / 2) & (f < cutoff)
    if not near.any():
        near = np.arange(len(f)) == int(np.argmin(np.abs(f - cutoff)))
    return float(np.median(power[near])), density * float(np.median((2 * np.pi * f[near]) ** 2))
