"""Options of an execution; --help imports this."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from runtime.setting import Checked, Setting
from runtime.simulation.options import Noise
from runtime.simulation.settings import NOISE

if TYPE_CHECKING:
    from runtime.planning.trajectory import Trajectory

TRIALS, TRIALS_ON_A_REAL_ARM = 3, 1
"""Defaults."""


@dataclass(frozen=True)
class ExecutionSettings(Checked):
    """Trials of a trajectory on an arm. A real arm is simulated first with the same settings."""

    trials: Annotated[
        int | None,
        Setting(f"Each from rest. {TRIALS} on the simulated arm, {TRIALS_ON_A_REAL_ARM} on a real one.", 1, 100),
    ] = None
    cycles: Annotated[int, Setting("Of a periodic motion, after one that runs it in.", 1, 10_000)] = 3
    seed: Annotated[int, Setting("Another seed is other noise.", low=0)] = 0
    noise: Noise = NOISE
    friction_compensation: Annotated[
        bool | None, Setting("By the controller; if not given, where the motion was planned with friction.")
    ] = None
    tracking_limit: Annotated[
        float | None, Setting("rad or m; a larger error is a safe stop. 0.5 rad, 0.1 m.", low=0.0)
    ] = None
    approach: Annotated[bool, Setting("Drive a real arm slowly to the trajectory's start first.")] = False

    def compensates(self, trajectory: Trajectory) -> bool:
        """Whether friction is compensated on this trajectory."""
        return trajectory.friction if self.friction_compensation is None else self.friction_compensation
