"""What one may choose of a search for a motion. Nothing slow is imported here: --help reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from runtime.experiments.settings import SPEEDING_UP
from runtime.setting import Checked, SearchSettings, Setting
from runtime.simulation.options import Noise
from runtime.simulation.settings import NOISE


@dataclass(frozen=True)
class ExperimentSettings(SearchSettings):
    """Of the search, and of the recordings that are simulated on the way; noise as a part of the ordinary excitation's
    torque."""

    seed: Annotated[int, Setting("Seed of the simulated noise.", low=0)] = 0
    noise: Noise = NOISE


@dataclass(frozen=True)
class FirstMotionSettings(Checked):
    """Of a motion that is not made for rivals."""

    seconds: Annotated[float, Setting("About how long the motion is, s.", 20.0, 900.0)] = 120.0
    speed: Annotated[float, Setting("Part of the joints' largest speeds that is used.", 0.02, 1.0)] = 1.0
    tip_speed: Annotated[float, Setting("Largest speed of the tip, m/s.", 0.01, 20.0)] = 1.5
    speeding_up: Annotated[
        float, Setting("Time from rest to a joint's largest speed, s: no acceleration is larger.", 0.02, 5.0)
    ] = SPEEDING_UP


EXPORT_RATES = {"joint_trajectory": 100.0, "urscript": 125.0, "lerobot": 30.0}
"""Hz; of a format's points: enough for ROS 2, which interpolates; a UR's older controllers; LeRobot's usual frames."""

UNITS = ("deg", "rad", "normalised")
"""Of LeRobot's positions, as a robot's configuration says."""


@dataclass(frozen=True)
class MotionOptions(Checked):
    """Of a motion for other programs."""

    rate: Annotated[
        float | None,
        Setting(
            "Points a second; default: of CSV the controller's, "
            + ", ".join(f"{name} {rate:g}" for name, rate in EXPORT_RATES.items())
            + ".",
            1.0,
            10_000.0,
        ),
    ] = None
    speed: Annotated[float, Setting("Pace: 0.2 makes the motion five times as slow.", 0.01, 2.0)] = 1.0
    unit: Annotated[
        str, Setting("LeRobot's positions: deg, rad or normalised (-100 to 100 over the model file's range).")
    ] = "deg"
    lookahead: Annotated[float, Setting("servoj's lookahead time, s.", 0.03, 0.2)] = 0.1
    gain: Annotated[float, Setting("servoj's gain.", 100.0, 2000.0)] = 300.0

    def rate_of(self, name: str, usual: float = 1000.0) -> float:
        """Hz of a format; usual: of one without a rate of its own."""
        return EXPORT_RATES.get(name, usual) if self.rate is None else self.rate
