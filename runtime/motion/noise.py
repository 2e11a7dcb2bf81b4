"""White noise of the instruments: its density, the step of an encoder, uncertain instants, and measured rates.

A tachometer, or an encoder that times its own steps, is quieter than differences of positions; most rates that a
controller logs are such differences, filtered, and late by as much. Their noise decides which rate is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from runtime.arrays import Array
from runtime.motion.clock import EvenGrid, Stretch, interpolated
from runtime.motion.filters import differentiator, welch
from runtime.motion.settings import FILTERED, FOLLOWS_RATE, LOWEST_CUTOFF, WHITE_BAND
from runtime.recordings.recording import Recording
from runtime.recordings.settings import RATE_SCALE

ENOUGH_FOR_NOISE: Final = 200_000
"""samples; from so many the instruments' noise is known, and a longer recording costs no more; time."""


def _density(x: Array, rate: float) -> tuple[Array, Array]:
    """Frequencies (F,) Hz and one-sided density (F,) of x (N,); medians over time, as shocks are no noise."""
    return welch(x, rate, 1024, "median")


def white_density(x: Array, rate: float) -> float:
    """One-sided density of the white noise in x (N,), near half the sampling rate, where no joint moves; a median over
    frequency, as single lines are no noise."""
    f, density = _density(x[:ENOUGH_FOR_NOISE], rate)
    return float(np.median(density[(f > WHITE_BAND[0] * rate) & (f < WHITE_BAND[1] * rate)]))


def resolution(q: Array) -> float:
    """The step of an encoder, of which nearly all differences of its angles q (N,) are multiples; 0 without one.

    Printed digits round each position: a tenth of a step is permitted, and one difference in twenty may be an error.
    One in fifty must be a single step (up to the middle between one and two), or the step is a chance divisor.
    """
    steps = np.abs(np.diff(q[:ENOUGH_FOR_NOISE]))
    steps = steps[steps > 1e-12 * (np.ptp(q) + 1e-300)]
    if not len(steps):
        return 0.0
    # The least differences of all may be errors of printing.
    least = float(np.quantile(steps, 0.001))
    size = float(np.median(steps[steps < 1.5 * least]))
    multiples = steps / size
    fits = np.abs(multiples - np.round(multiples)) < 0.1
    return size if fits.mean() > 0.95 and (multiples < 1.5).mean() > 0.02 else 0.0


@dataclass(frozen=True)
class SampleNoise:
    """White noise of a stretch's samples, measured on its even grid (rate in Hz); `passed` is the part of its density
    that the interpolation leaves, `fall` the ratio by which it then falls towards half the rate."""

    stretch: Stretch
    rate: float
    passed: float
    fall: float

    @classmethod
    def on(cls, stretch: Stretch, rate: float) -> SampleNoise:
        """For a stretch; what interpolation leaves is measured on simulated noise."""
        if stretch.places is None:
            return cls(stretch, rate, 1.0, 1.0)
        samples = stretch.samples.stop - stretch.samples.start
        white = np.random.default_rng(samples).standard_normal(samples)
        left = interpolated(stretch.places, white, np.arange(stretch.size))
        return cls(stretch, rate, white_density(left, rate) * rate / 2, _fall(left))

    def density(self, x: Array) -> float:
        """One-sided density of the white noise in a signal x of the whole recording."""
        return white_density(self.stretch.on_grid(x), self.rate) / self.passed

    def filtered(self, x: Array) -> bool:
        """Whether a signal x of the whole recording was low-passed before it was recorded: what stands near half the
        sampling rate is then no measure of its noise below."""
        return _fall(self.stretch.on_grid(x)) > FILTERED * self.fall

    def jittered(self, q: Array) -> bool:
        """Whether the instants at which positions q (n, N) were read are uncertain: their noise then follows the rate,
        as an error of the instant times the rate. An encoder's own error is the same at all rates."""
        read = self.stretch.on_grid(q)[:, :ENOUGH_FOR_NOISE]
        return float(np.median([_follows_rate(x) for x in read])) > FOLLOWS_RATE


def _fall(x: Array) -> float:
    """Ratio of the density of x (N,) at the lower to that at the upper end of the band of its white noise."""
    (low, high), (f, density) = WHITE_BAND, _density(x[:ENOUGH_FOR_NOISE], 1.0)
    third = (high - low) / 3
    lower = np.median(density[(f > low) & (f < low + third)])
    upper = np.median(density[(f > high - third) & (f < high)])
    return float(lower / upper) if upper > 0 else 1.0


def _follows_rate(x: Array) -> float:
    """Correlation over blocks of samples of the squared noise of positions x (N,) with their squared rate.

    Sixth differences of a motion vanish (5 Hz at 500 samples a second leave 1e-7), those of white noise do not. A
    block's noise is known to a fifth; fewer than ten blocks show no correlation.
    """
    order, block, least = 6, 64, 10
    half = order // 2 + 1
    noise, rate = np.diff(x, order) ** 2, (x[2 * half :] - x[: -2 * half]) ** 2
    count = min(len(noise), len(rate)) // block
    if count < least:
        return 0.0
    blocks = np.array([part[: count * block].reshape(count, block).mean(axis=1) for part in (noise, rate)])
    return float(np.corrcoef(blocks)[0, 1]) if np.ptp(blocks, axis=1).all() else 0.0


@dataclass(frozen=True)
class MeasuredRate:
    """A joint's measured rate.

    density  one-sided, of its white noise, (unit/s)²/Hz
    use      "used": it replaces the derivative of the positions, and its own derivative the second one; else why not
    """

    density: float
    use: Literal["used", "unrelated", "other unit", "no quieter", "filtered", "difference"]

    @property
    def used(self) -> bool:
        """Whether it replaces the derivative of the positions."""
        return self.use == "used"


def measured_rate(
    joint: int, recordings: Sequence[Recording], grids: Sequence[EvenGrid], cutoff: float, density: float
) -> MeasuredRate | None:
    """How a joint's (0-based) measured rate is used; None where a recording has none, or all are too short to compare.

    cutoff: Hz up to which it is compared; density: of the positions' noise, unit²/Hz.
    """
    measured = [r.qd[joint] for r in recordings if r.qd is not None]
    if len(measured) < len(recordings) or any(np.isnan(qd).any() for qd in measured):
        return None
    # Scale and delay are fitted where the positions have no noise; it would make the rate seem too small.
    slow, quick = (_compared(recordings, grids, joint, up_to) for up_to in (LOWEST_CUTOFF, cutoff))
    if slow is None or quick is None:
        return None
    theta = np.linalg.lstsq(slow[1].T, slow[0], rcond=None)[0]
    if not np.isfinite(theta).all():  # of positions that hardly change, a rate is any multiple
        return None
    scale, late, period = float(theta[0]), -float(theta[1] / (theta[0] or 1.0)), grids[0].period
    own = max(SampleNoise.on(g.longest, 1 / g.period).density(qd) for qd, g in zip(measured, grids, strict=True))
    between, of_position = _near_cutoff(quick[0] - theta @ quick[1], 1 / period, cutoff, density)
    left = slow[0] - theta @ slow[1]
    if left @ left > 0.5 * slow[0] @ slow[0]:
        return MeasuredRate(own, "unrelated")
    # Another unit would make every friction wrong by as much.
    if not 1 / RATE_SCALE < scale < RATE_SCALE:
        return MeasuredRate(own, "other unit")
    # Half the noise changes a cut-off by a sixth: less does not justify a second instrument.
    if own > 0.5 * of_position:
        return MeasuredRate(own, "no quieter")
    # A difference to the reading before is half a period late.
    if abs(late) > period / 4:
        return MeasuredRate(own, "filtered")
    # It has the noise of the positions.
    return MeasuredRate(own, "difference" if between < of_position / 2 else "used")


def _compared(
    recordings: Sequence[Recording], grids: Sequence[EvenGrid], joint: int, cutoff: float
) -> tuple[Array, Array] | None:
    """Of the longest stretches the measured rate (N,), and the first and second derivatives of the positions (2, N),
    all smoothed alike; None if all are too short."""
    measured, derived = [], []
    for recording, clock in zip(recordings, grids, strict=True):
        derive, stretch = differentiator(cutoff, 1 / clock.period), clock.longest
        if recording.qd is not None and derive.fits(stretch.size):
            rows = np.array([recording.q[joint], recording.qd[joint]])
            position, rate = stretch.on_grid(rows)[:, :ENOUGH_FOR_NOISE]
            derived.append(np.array(derive(position)[1:]))
            measured.append(derive(rate)[0])
    return (np.concatenate(measured), np.concatenate(derived, axis=1)) if measured else None


def _near_cutoff(left: Array, rate: float, cutoff: float, density: float) -> tuple[float, float]:
    """Densities near the cut-off: of the difference of two rates, left (N,), and of the noise of differentiated
    positions."""
    f, power = _density(left, rate)
    near = (f > cutoff / 2) & (f < cutoff)
    if not near.any():
        near = np.arange(len(f)) == int(np.argmin(np.abs(f - cutoff)))
    return float(np.median(power[near])), density * float(np.median((2 * np.pi * f[near]) ** 2))
