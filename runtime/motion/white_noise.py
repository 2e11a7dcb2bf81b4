"""The density of an instrument's white noise, measured where no joint moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.motion.clock import Stretch
from runtime.motion.fourier import welch
from runtime.motion.settings import DENSITY_SEGMENT, ENOUGH_FOR_NOISE, WHITE_FROM, WHITE_TO

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
