"""Options of a simulated recording. Imports nothing slow, because --help reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from runtime.setting import Checked, Setting, SettingError
from runtime.simulation.settings import LONGEST, NOISE

Noise = Annotated[float, Setting("Torque noise over the rms of the torque.", 0.0, 10.0)]
EXTRA = ("q_link", "tau_link", "temperature")
"""Signals that are recorded on request."""


@dataclass(frozen=True)
class SimulationSettings(Checked):
    """Options of a simulated recording; seconds and repeats are those of the default excitation."""

    seed: Annotated[int, Setting("Seed of motion and noise.", low=0)] = 0
    seconds: Annotated[float, Setting("Duration of the motion, s.", 2.0, LONGEST)] = 40.0
    repeats: Annotated[int, Setting("Number of equal parts of the motion.", 1, 100)] = 2
    noise: Noise = NOISE
    signals: Annotated[str, Setting(f"Also record these signals: {', '.join(EXTRA)}.", metavar="NAME,...")] = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.extra:
            if name not in EXTRA:
                raise SettingError(f'signals: found "{name}", expected some of {", ".join(EXTRA)}')

    @property
    def extra(self) -> tuple[str, ...]:
        """The requested signals."""
        return tuple(name.strip() for name in self.signals.split(",") if name.strip())
