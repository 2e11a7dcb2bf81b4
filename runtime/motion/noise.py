"""White noise of the instruments: its density, uncertain instants, and whether a measured rate is used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.motion.clock import EvenGrid, Stretch
from runtime.motion.filters import differentiator, welch
from runtime.motion.settings import (
    DENSITY_SEGMENT,
    ENOUGH_FOR_NOISE,
    FOLLOWS_RATE,
    LOWEST_CUTOFF,
    RATE_BETTER,
    RATE_DELAYED,
    RATE_FOLLOWS,
    RATE_OWN,
    RATE_SCALE,
    SEGMENT_HALVES,
    TIMING_BLOCK,
    TIMING_BLOCKS,
    TIMING_DIFFERENCES,
    WHITE_FROM,
    WHITE_TO,
)
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]


def white_density(x: Array, rate: float) -> float:
    """One-sided density of the white noise in x, near half the sampling rate, where no joint moves.

    Medians over time and frequency, so that shocks and single lines do not count as noise.
    """
    f, density = welch(x[:ENOUGH_FOR_NOISE], rate, DENSITY_SEGMENT, "median")
    inside = (f > WHITE_FROM * rate) & (f < WHITE_TO * rate)
    return float(np.median(density[inside]))


@dataclass(frozen=True)
class SampleNoise:
    """How white noise of samples is measured on a grid to which they were brought: `passed` is the part of its density
    that interpolation leaves where it is looked for."""

    stretch: Stretch
    rate: float
    passed: float

    @classmethod
    def on(cls, stretch: Stretch, rate: float) -> SampleNoise:
        if stretch.places is None:
            return cls(stretch, rate, 1.0)
        samples = stretch.samples.stop - stretch.samples.start
        white = np.random.default_rng(samples).standard_normal(samples)
        return cls(stretch, rate, white_density(stretch.of(white), rate) * rate / 2)

    def density(self, x: Array) -> float:
        """One-sided density of the samples' white noise in x, of the whole recording."""
        return white_density(self.stretch.of(x[self.stretch.samples]), self.rate) / self.passed

    def mistimed(self, q: Array) -> bool:
        """Whether the instants at which positions q (n, N) were read are uncertain: their noise follows the rate.

        A position that is read at another time than its stamp says is off by the rate times that error; an encoder's
        error is the same at all rates.
        """
        read = self.stretch.of(q[:, self.stretch.samples][:, :ENOUGH_FOR_NOISE])
        return float(np.median([_follows_rate(x) for x in read])) > FOLLOWS_RATE


def _follows_rate(x: Array) -> float:
    """Correlation over blocks of samples of the noise of positions x (N,), squared, with their squared rate."""
    half = TIMING_DIFFERENCES // 2 + 1
    # High differences of a motion vanish; those of white noise do not.
    noise, rate = np.diff(x, TIMING_DIFFERENCES) ** 2, (x[2 * half :] - x[: -2 * half]) ** 2
    count = min(len(noise), len(rate)) // TIMING_BLOCK
    if count < TIMING_BLOCKS:
        return 0.0
    blocks = np.array(
        [part[: count * TIMING_BLOCK].reshape(count, TIMING_BLOCK).mean(axis=1) for part in (noise, rate)]
    )
    apart = blocks - blocks.mean(axis=1, keepdims=True)
    size = np.sqrt(np.sum(apart**2, axis=1))
    return float(apart[0] @ apart[1] / (size[0] * size[1])) if size.all() else 0.0


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
    return tuple(_judged(i, recordings, grids, cutoff=cutoff, density=density) for i, (cutoff, density) in each)


def _judged(
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
    own = max(_rate_density(r, g, joint) for r, g in zip(recordings, grids, strict=True))
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


def _rate_density(recording: Recording, clock: EvenGrid, joint: int) -> float:
    return 0.0 if recording.qd is None else SampleNoise.on(clock.longest, 1 / clock.period).density(recording.qd[joint])


def _in_band(left: Array, rate: float, cutoff: float, density: float) -> tuple[float, float]:
    """Densities near the cut-off: of what two rates differ by, and of the noise of differentiated positions."""
    f, power = welch(left, rate, DENSITY_SEGMENT, "median")
    near = (f > cutoff / 2) & (f < cutoff)
    if not near.any():
        near = np.arange(len(f)) == int(np.argmin(np.abs(f - cutoff)))
    return float(np.median(power[near])), density * float(np.median((2 * np.pi * f[near]) ** 2))
