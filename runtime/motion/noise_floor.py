"""The noise floor of a joint's residual: from repeated motion where there is some, else from the spectra."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from runtime.motion.motion import Motion
from runtime.motion.repeats import Repeats
from runtime.motion.settings import LASTING

Array = NDArray[np.float64]


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
        return self.repeating**2 > LASTING * rms**2


def floor(motion: Motion, repeats: Repeats, joint: int, residual: Array, read: Array) -> Floor:
    """Floor of a residual (M,) that is zero where rows do not count.

    read (M,): what another reading of the encoders would change in the predicted torque.
    """
    use = motion.moving(joint)
    torque = motion.band.torque_density[joint] * motion.cutoff(joint)
    left = float(np.mean(motion.noise_left(joint)[use])) if use.any() else 1.0
    spectrum = float(np.sqrt(torque * left + np.mean(read[use] ** 2))) if use.any() else float(np.sqrt(torque))
    parts = repeats.pure_error(residual, use)
    if parts is None:
        return Floor(spectrum, "spectrum", spectrum, None)
    # Two passes under a disturbance may differ by more than either holds.
    return Floor(min(parts[0], float(np.sqrt(np.mean(residual[use] ** 2)))), "repeats", spectrum, parts[1])
