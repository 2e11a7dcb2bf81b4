"""The arm of `--on simulation` and of the emulators: a plant with encoders on its motors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.hardware.lockstep import Counts, Fault, Float32
from runtime.hardware.settings import Settings
from runtime.simulation.plant import Plant

Array = NDArray[np.float64]
_MOST = 2.0**31
"""Counts that an encoder's register holds."""


class SimulatedArm:
    """What a board sees of a plant: counts; and what it does to it: torques held for a period.

    It is held where a trial starts until the drives are powered for the first time.
    """

    def __init__(self, plant: Plant, settings: Settings) -> None:
        self.plant = plant
        self._per_count: Array = np.array(settings.drive["position_per_count"])
        self._zero = settings.zero
        self._offset: Array = np.zeros(plant.model.n)
        self._held = True

    def start(self, q: Array, rng: np.random.Generator) -> Counts:
        """At rest at q (n,); the encoders' steps lie elsewhere after every start. Their counts there."""
        self.plant.reset(q)
        # No one can place an arm more finely than its encoders tell.
        self._offset = rng.uniform(0.0, 1.0, len(q)) * self._per_count
        self._held = True
        return self.counts()

    def counts(self) -> Counts:
        """(n,) what the encoders count. Raises Fault: the motion has left all bounds."""
        steps = np.floor((self.plant.q + self._offset) / self._per_count)
        if not (np.abs(steps) < _MOST).all():
            raise Fault(f"the simulated motion has left all bounds; an effect is too stiff for {self.plant.step:.2g} s")
        return steps.astype(np.int32) + self._zero

    def apply(self, torque: Float32) -> None:
        """Hold these torques for one control period."""
        if not self._held:
            self.plant.advance(torque)

    def enable(self, on: bool) -> None:
        self._held = self._held and not on
