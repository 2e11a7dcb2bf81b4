"""What a trajectory asks of the arm before it is executed: torques, costs, extremes, and whether the limits hold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from runtime.model.loader import Model
from runtime.model.terms import SURFACE, Structure, given
from runtime.planning.evaluate import Along, Effort, effort, every_instant, limited, mounted
from runtime.planning.trajectory import JointMotion, Trajectory
from runtime.wording import number, told_apart


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
        return every_instant(self.model, self.trajectory, friction=True)

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
        return (self._worst(along) for along in limited(self.dense) if not along.kept)

    def _worst(self, along: Along) -> Excess:
        k = int(np.argmax(along.excess))
        value, limit = float(along.x[k]), along.high if along.x[k] > along.high else along.low
        if along.what != "position":
            value, limit = abs(value), abs(limit)
        return Excess(along.what, along.joint + 1, float(self.motion.t[k]), value, limit, along.unit)


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
            f"the plan's {self.what} of joint {self.joint} is {told_apart(self.value, self.limit, 4)} {self.unit} at "
            f"t = {self.t:.4g} s, {more:.3g} {self.unit} beyond the limit of {number(self.limit, 4)}"
        )


def compression(plan: PlannedCycle, tip_y: float) -> float | None:
    """By how much the plate is pressed down where the end-effector's y is smallest, m; None without a plate."""
    surface = given(plan.model.library, plan.terms, SURFACE)
    return None if surface is None else max(0.0, surface - tip_y)
