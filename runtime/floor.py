"""The noise floor of a joint's residual: from repeated motion where there is some, else from the spectra."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from runtime.motion import Motion
from runtime.repeats import Repeats

Array = NDArray[np.float64]

_LASTING = 0.25
"""Part of the residual's variance that must come back with the motion to count as repeatable."""


@dataclass(frozen=True)
class Floor:
    """What a perfect model would leave.

    value      standard deviation of that part of the residual that no model explains; at most the residual's own
    source     "repeats" or "spectrum"
    spectrum   the same from white torque and encoder noise alone
    repeating  standard deviation of what comes back with the motion; None without repeats
    """

    value: float
    source: Literal["repeats", "spectrum"]
    spectrum: float
    repeating: float | None

    def repeatable(self, rms: float) -> bool | None:
        """Whether the residual comes back with the motion; None where no motion was repeated."""
        if self.repeating is None:
            return None
        return self.repeating**2 > _LASTING * rms**2


def spectrum_floor(motion: Motion, joint: int, inertia: float) -> float:
    """Torque noise in the band and encoder noise as an inertial torque; inertia in kg m² (kg)."""
    band = motion.band
    torque = band.torque_density[joint] * band.cutoff
    encoder = inertia**2 * band.position_density[joint] * (2 * np.pi) ** 4 * band.cutoff**5 / 5
    return float(np.sqrt(torque + encoder))


def floor(motion: Motion, repeats: Repeats, joint: int, residual: Array, inertia: float) -> Floor:
    """Floor of a residual (M,) that is zero where rows do not count."""
    spectrum = spectrum_floor(motion, joint, inertia)
    parts = repeats.pure_error(residual, motion.moving(joint))
    if parts is None:
        return Floor(spectrum, "spectrum", spectrum, None)
    used = residual[motion.moving(joint)]
    # Two passes under a disturbance may differ by more than either holds.
    value = min(parts[0], float(np.sqrt(np.mean(used**2))))
    return Floor(value, "repeats", spectrum, parts[1])
