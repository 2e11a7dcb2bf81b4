"""The density of an instrument's white noise, measured where no joint moves, and how it grows with the rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.motion.clock import Stretch
from runtime.motion.fourier import welch
from runtime.motion.settings import (
    DENSITY_SEGMENT,
    ENOUGH_FOR_NOISE,
    FOLLOWS_RATE,
    TIMING_BLOCK,
    TIMING_BLOCKS,
    TIMING_DIFFERENCES,
    WHITE_FROM,
    WHITE_TO,
)

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
