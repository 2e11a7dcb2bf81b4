"""Whether a motion keeps a joint's limits at every instant, also between the nodes of the program that planned it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from runtime.model.loader import Model
from runtime.planning.evaluate import Effort, at_times
from runtime.planning.settings import LEAST_POSITION_EXCESS, LEAST_SPEED_EXCESS, LEAST_TORQUE_EXCESS
from runtime.planning.solve import Miss
from runtime.planning.task import limit_label
from runtime.planning.trajectory import Trajectory

Array = NDArray[np.float64]
Limited = Literal["position", "speed", "torque"]

RATE = 4000.0  # Hz
_LEAST: dict[Limited, float] = {
    "position": LEAST_POSITION_EXCESS,
    "speed": LEAST_SPEED_EXCESS,
    "torque": LEAST_TORQUE_EXCESS,
}


@dataclass(frozen=True)
class Along:
    """A limited quantity of a joint (0-based) along a motion: x (N,) between low and high, in `unit`."""

    what: Limited
    joint: int
    x: Array
    low: float
    high: float
    unit: str

    @property
    def excess(self) -> Array:
        """(N,) by how much it is above its upper limit, or else below the lower one; negative within."""
        return np.maximum(self.x - self.high, self.low - self.x)

    @property
    def kept(self) -> bool:
        """Whether it goes beyond by no more than what is let pass."""
        return not self.excess.max() > _LEAST[self.what] * max(abs(self.low), abs(self.high))

    def missed(self, t: Array) -> Miss:
        """The limit as the constraint that is missed where it is exceeded most, of times t (N,)."""
        k = int(np.argmax(self.excess))
        return Miss(f"t = {t[k]:.4g} s", limit_label(self.what, self.joint), float(self.excess[k]), self.unit)


def every_instant(model: Model, trajectory: Trajectory, friction: bool | None = None) -> Effort:
    """Torques of one cycle at RATE, ends included; friction: None for as it was planned."""
    t = np.linspace(0.0, trajectory.duration, round(trajectory.duration * RATE) + 1)
    # Just before the end: the end of a periodic motion is its beginning.
    t[-1] = np.nextafter(t[-1], 0.0)
    return at_times(model, trajectory, t, friction=friction)


def limited(seen: Effort) -> Iterator[Along]:
    """Whatever the model file limits, joint by joint."""
    m = seen.motion
    for i, joint in enumerate(seen.model.joints):
        if joint.position_limits is not None:
            yield Along("position", i, m.q[i], *joint.position_limits, joint.position_unit)
        if joint.speed_limit is not None:
            yield Along("speed", i, m.qd[i], -joint.speed_limit, joint.speed_limit, f"{joint.position_unit}/s")
        if joint.torque_limit is not None:
            yield Along("torque", i, seen.tau[i], -joint.torque_limit, joint.torque_limit, joint.force_unit)
