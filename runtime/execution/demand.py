"""What a trajectory asks of the arm before it is executed: torques, costs, extremes, and whether the limits hold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from runtime.model.loader import Model
from runtime.model.terms import SURFACE, Structure, given
from runtime.planning.evaluate import Effort, at_times, effort, mounted
from runtime.planning.trajectory import JointMotion, Trajectory

Array = NDArray[np.float64]

RATE = 4000.0  # Hz
_SLACK = {"position": 1e-6, "speed": 5e-3, "torque": 5e-3}
"""Of a limit: what exceeds it by less is let pass. An optimization keeps limits at its nodes, not between them."""


@dataclass(frozen=True)
class PlannedCycle:
    """A trajectory along one cycle, on its arm with what the model knows of it and nothing hidden."""

    model: Model
    trajectory: Trajectory

    @cached_property
    def terms(self) -> Structure:
        """The arm's effects with the springs and the contact that the trajectory brings."""
        return mounted(self.model, self.trajectory)

    @cached_property
    def planned(self) -> Effort:
        """As it was planned: without friction if that was left out."""
        return effort(self.model, self.trajectory)

    @cached_property
    def modelled(self) -> Effort:
        """With everything that the model knows."""
        return self.planned if self.trajectory.friction else effort(self.model, self.trajectory, friction=True)

    @cached_property
    def dense(self) -> Effort:
        """The same at even times, ends included."""
        t = np.linspace(0.0, self.trajectory.duration, round(self.trajectory.duration * RATE) + 1)
        # Just before the end: the end of a periodic motion is its beginning.
        t[-1] = np.nextafter(t[-1], 0.0)
        return at_times(self.model, self.trajectory, t, friction=True)

    @property
    def motion(self) -> JointMotion:
        """Positions, rates and accelerations of one cycle, (n, N) each."""
        return self.dense.motion

    @cached_property
    def tip_y(self) -> float:
        """Smallest y of the end-effector, m."""
        return float(self.dense.tip[1].min())

    def exceeded(self) -> Iterator[Excess]:
        """Where the plan asks for more than a joint's limits allow, the worst of each kind and joint."""
        m = self.motion
        for i, joint in enumerate(self.model.joints):
            if joint.position_limits is not None:
                low, high = joint.position_limits
                yield from self._excess("position", i, m.q[i], low, high, joint.position_unit)
            if joint.speed_limit is not None:
                speed, unit = np.abs(m.qd[i]), f"{joint.position_unit}/s"
                yield from self._excess("speed", i, speed, 0.0, joint.speed_limit, unit)
            if joint.torque_limit is not None:
                torque = np.abs(self.dense.tau[i])
                yield from self._excess("torque", i, torque, 0.0, joint.torque_limit, joint.force_unit)

    def _excess(self, what: str, joint: int, x: Array, low: float, high: float, unit: str) -> Iterator[Excess]:
        over = np.maximum(x - high, low - x)
        k = int(np.argmax(over))
        if over[k] > _SLACK[what] * max(abs(low), abs(high)):
            limit = high if x[k] > high else low
            yield Excess(what, joint + 1, float(self.motion.t[k]), float(x[k]), float(limit), unit)


@dataclass(frozen=True)
class Excess:
    """joint (1-based); t s; value and limit in `unit`."""

    what: str
    joint: int
    t: float
    value: float
    limit: float
    unit: str

    def __str__(self) -> str:
        more = abs(self.value - self.limit)
        return (
            f"the plan's {self.what} of joint {self.joint} is {self.value:.4g} {self.unit} at t = {self.t:.4g} s, "
            f"{more:.3g} {self.unit} beyond the limit of {self.limit:.4g}"
        )


def compression(plan: PlannedCycle, tip_y: float) -> float | None:
    """By how much the plate is pressed down where the end-effector's y is smallest, m; None without a plate."""
    surface = given(plan.model.library, plan.terms, SURFACE)
    return None if surface is None else max(0.0, surface - tip_y)
