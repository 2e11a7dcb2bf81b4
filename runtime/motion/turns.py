"""Where a joint rests or turns: what its dry friction is there, nobody knows, and the band's filter spreads it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.motion.filters import LowPass
from runtime.motion.settings import (
    STANDSTILL_BLUR,
    STANDSTILL_PERIODS,
    STANDSTILL_S,
    STANDSTILL_SHARP_HZ,
    STICKING_OVER_NOISE,
    TURNING_OVER_NOISE,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def moving(qd: Array, dt: float, low_pass: LowPass, standstill: float, quiet: float) -> Mask:
    """(M,) in-band rows of a joint's rate qd (N,) at steps of dt that no rest and no turn spoils.

    standstill: the rate below which it rests; quiet: torque noise in the band over dry friction.
    """
    return ~spoiled(*resting(qd, standstill), dt, low_pass, quiet)


def resting(rate: Array, standstill: float) -> tuple[Mask, Mask]:
    """(N,) samples at which a rate (N,) is below `standstill`, and those between which it turns and is not."""
    still = np.abs(rate) < standstill
    turning = np.append((np.diff(np.sign(rate)) != 0) & ~(still[1:] & still[:-1]), False)
    return still, turning


def spoiled(still: Mask, turning: Mask, dt: float, low_pass: LowPass, quiet: float) -> Mask:
    """(M,) in-band rows that samples (N,) at rest or turning, at steps of dt, spoil.

    What sticks holds any torque below its friction, and where it turns the instant is not known within a sample: what
    either may leak into a row must be small against the noise there.
    quiet: torque noise in the band over dry friction.
    """
    cutoff, centres = low_pass.cutoff, low_pass.centres(len(still))
    blurred = min(STANDSTILL_S * (STANDSTILL_SHARP_HZ / cutoff) ** STANDSTILL_BLUR, STANDSTILL_PERIODS / cutoff)
    reach = max(1, round(max(STANDSTILL_S, blurred) / dt))
    count = np.concatenate([[0], np.cumsum(still)])
    lo = np.clip(centres - reach, 0, len(still))
    hi = np.clip(centres + reach + 1, 0, len(still))
    stuck = low_pass.reach(still) >= STICKING_OVER_NOISE * quiet
    turned = low_pass.reach(turning) >= TURNING_OVER_NOISE * quiet
    return (count[hi] > count[lo]) | stuck | turned


def dry_friction(q: Array, qd: Array, qdd: Array, tau: Array) -> float:
    """N m (N), about: the jump of a torque where a joint turns, beside what is smooth in its own motion, (M,) each."""
    if not len(q):
        return 0.0
    columns = np.array([np.sign(qd), qd, qdd, np.ones_like(q), np.sin(q), np.cos(q)])
    size = np.linalg.norm(columns, axis=1)
    found = np.linalg.lstsq((columns / size[:, None]).T, tau, rcond=1e-9)[0]
    return max(float(found[0] / size[0]), 0.0)
