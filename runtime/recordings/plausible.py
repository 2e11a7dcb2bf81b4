"""What the columns alone tell of wrong data: a time in another unit, a passive joint, samples given twice."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from runtime.recordings.settings import FASTEST_STEP, SLOWEST_STEP, SMALLEST

Array = NDArray[np.float64]

_FINER = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of a clock and their length in s, the coarsest first."""


def slow_clock(step: float, cell: str) -> str | None:
    """What is wrong with a time, read from `cell`, of which the median step is `step` s, and the cure, if any."""
    if not step > SLOWEST_STEP:
        return None
    unit = next((name for name, size in _FINER.items() if size * step <= SLOWEST_STEP), None)
    cure = f'if t is in {unit}, pass --map t="{cell} [{unit}]"' if unit else "write t in seconds"
    return f"the median step of t is {step:.4g} s; expected at most {SLOWEST_STEP:g} s between samples; {cure}"


def fast_clock(step: float, cell: str) -> str | None:
    """The same of one that is too short to be filtered: its filters would be longer than any recording."""
    if not step < FASTEST_STEP:
        return None
    return (
        f"the median step of t is {step:.4g} s; expected at least {FASTEST_STEP:g} s between samples; "
        f'if t is in s, pass --map t="{cell} [s]", else write t in seconds'
    )


def unpowered(tau: Array) -> NDArray[np.bool_]:
    """(n,) joints whose torque never changes by as much as a sensor tells: passive ones, or those of which no torque is
    recorded. tau (n, N)."""
    quiet: NDArray[np.bool_] = np.ptp(tau, axis=1) < SMALLEST
    return quiet


def given_twice(samples: Sequence[tuple[Array, Array]]) -> tuple[int, int] | None:
    """Indices of the first two of these positions and torques (n, N) each that are the same; None if none are."""
    for one, other in combinations(range(len(samples)), 2):
        pairs = list(zip(samples[one], samples[other], strict=True))
        if all(x.shape == y.shape and np.array_equal(x, y) for x, y in pairs):
            return one, other
    return None
