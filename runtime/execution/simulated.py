"""The arm of `--on simulation`: a plant with encoders on its motors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.execution.controller import Controller
from runtime.execution.loop import Fault
from runtime.execution.plant import Plant

Array = NDArray[np.float64]
Counts = NDArray[np.int32]
_MOST = 2.0**31
"""Counts that an encoder's register holds."""


class SimulatedArm:
    """What a controller sees of a plant: counts; and what it does to it: torques held for a period."""

    def __init__(self, plant: Plant, controller: Controller) -> None:
        self.plant, self.controller = plant, controller
        self._offset: Array = np.zeros(plant.model.n)

    def start(self, q: Array, rng: np.random.Generator) -> Counts:
        """At rest at q (n,); the encoders' steps lie elsewhere after every start. Their counts there."""
        self.plant.reset(q)
        # No one can place an arm more finely than its encoders tell.
        self._offset = rng.uniform(0.0, 1.0, len(q)) * self.controller.position_per_count
        return self.counts()

    def counts(self) -> Counts:
        place = self.plant.q + self._offset
        if not (np.abs(place) < _MOST * self.controller.position_per_count).all():
            raise Fault(f"the simulated motion has left all bounds; an effect is too stiff for {self.plant.step:.2g} s")
        return self.controller.counts(place)

    def apply(self, torque: ArrayLike) -> None:
        """Hold these torques for one control period."""
        self.plant.advance(torque)
