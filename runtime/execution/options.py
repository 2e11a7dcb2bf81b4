"""Options of an execution; --help imports this."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from runtime.setting import Checked, Setting
from runtime.simulation.options import Noise
from runtime.simulation.settings import NOISE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from runtime.planning.trajectory import Trajectory

TRIALS, TRIALS_ON_A_REAL_ARM = 3, 1
"""Defaults."""


@dataclass(frozen=True)
class ExecutionSettings(Checked):
    """Trials of a trajectory on an arm. A real arm is simulated first with the same settings."""

    trials: Annotated[
        int | None,
        Setting(
            f"Number of trials, each from rest; default: {TRIALS} simulated, {TRIALS_ON_A_REAL_ARM} on a real arm, "
            "1 of a motion's file.",
            1,
            100,
        ),
    ] = None
    cycles: Annotated[
        int, Setting("Recorded cycles of a periodic motion, after one that is not recorded.", 1, 10_000)
    ] = 3
    seed: Annotated[int, Setting("Seed of the simulated noise.", low=0)] = 0
    noise: Noise = NOISE
    friction_compensation: Annotated[
        bool | None, Setting("Whether the controller compensates friction; default: as planned.")
    ] = None
    tracking_limit: Annotated[
        float | None, Setting("Tracking error that causes a safe stop; default: 0.5 rad, 0.1 m.", low=0.0)
    ] = None
    speed: Annotated[
        float, Setting("Pace: 0.2 plays the motion five times as slowly; limits are checked again.", 0.01, 2.0)
    ] = 1.0
    approach: Annotated[bool, Setting("First move a real arm slowly to the start of the trajectory.")] = False

    def compensates(self, trajectory: Trajectory, controller: Mapping[str, float] | None) -> bool:
        """Whether friction is compensated on this trajectory. controller: that of the model; none of it at c_u = 0."""
        asked = trajectory.friction if self.friction_compensation is None else self.friction_compensation
        return asked and controller is not None and controller["friction_scale"] > 0.0
