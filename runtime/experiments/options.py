"""What one may choose of a search for a motion. Nothing slow is imported here: --help reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from runtime.setting import Checked, Setting
from runtime.simulation.options import Noise
from runtime.simulation.settings import NOISE


@dataclass(frozen=True)
class ExperimentSettings(Checked):
    """Of the search, and of the recordings that are simulated on the way; noise as a part of the ordinary excitation's
    torque."""

    seed: Annotated[int, Setting("Seed of the simulated noise.", low=0)] = 0
    noise: Noise = NOISE
    time_limit: Annotated[float, Setting("Longest time for the search, s.", low=1.0)] = 60.0
