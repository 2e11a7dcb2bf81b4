"""What one may choose of a search for a motion. Nothing slow is imported here: --help reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from runtime.setting import Checked, Setting
from runtime.simulation.options import Noise
from runtime.simulation.settings import NOISE

GIVEN_BUDGET = 25.0
"""s; of the diagnosis of recordings at hand."""


@dataclass(frozen=True)
class ExperimentSettings(Checked):
    """Of the search, and of the recordings that are simulated on the way; noise as a part of the ordinary excitation's
    torque."""

    seed: Annotated[int, Setting("Seed of the simulated noise.", low=0)] = 0
    noise: Noise = NOISE
    time_limit: Annotated[float, Setting("Longest time for the search, s.", low=1.0)] = 60.0


@dataclass(frozen=True)
class FirstMotionSettings(Checked):
    """Of a motion that is not made for rivals."""

    seconds: Annotated[float, Setting("About how long the motion is, s.", 20.0, 900.0)] = 120.0
    speed: Annotated[float, Setting("Part of the joints' largest speeds that is used.", 0.02, 1.0)] = 1.0
    tip_speed: Annotated[float, Setting("Largest speed of the tip, m/s.", 0.01, 20.0)] = 1.5
