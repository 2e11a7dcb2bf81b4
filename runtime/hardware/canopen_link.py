"""An arm with CiA 402 drives on a CAN bus: the machine as compiled for this computer drives it, in real time."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from runtime.hardware import can_bus, canopen_arm
from runtime.hardware.canopen_arm import CanopenArm
from runtime.hardware.host_board import HostBoard
from runtime.hardware.lockstep import Fault, Lockstep
from runtime.hardware.pace import Pace, Precedence
from runtime.model.loader import Model

LATE = 0.01
"""s between two control steps at most. A computer is less punctual than a microcontroller's timer: what stops that
after half a period would stop this for nothing."""


def check(url: str, model: Model) -> None:
    """What can be said of an address before the bus is touched. Raises LinkError."""
    address = can_bus.parse(url)
    # Without a rate there is nothing to say of the load; what a controller lacks is named where its settings are made.
    if model.controller is not None:
        canopen_arm.check(model, address, model.controller["rate"])


class CanopenLink(Lockstep):
    """A Link to the drives of a model, set up and without power yet.

    url         canopen://CHANNEL?interface=NAME&bitrate=NUMBER
    directory   of the arm's firmware, built for this computer
    pace, patience   see CanopenArm; None: real time
    Raises LinkError, Fault.
    """

    arm: CanopenArm

    def __init__(
        self, url: str, model: Model, directory: Path, pace: Pace | None = None, patience: float | None = None
    ) -> None:
        assert model.controller is not None
        period = 1.0 / model.controller["rate"]
        pace = pace or Pace(period)
        address = can_bus.parse(url)
        with ExitStack() as stack:
            self._precedence = Precedence()
            stack.callback(self._precedence.give_up)
            arm = stack.enter_context(CanopenArm(model, address, pace, patience))
            super().__init__(HostBoard(directory, model.name, model.n), arm, period, pace)
            self.late = LATE
            self.start(np.zeros(model.n), np.random.default_rng(0))
            self._open = stack.pop_all()

    def figures(self) -> Mapping[str, Any]:
        return {"drives": {**self.arm.figures(), "real_time": self._precedence.granted}}

    def close(self) -> None:
        try:
            with self._open:
                super().close()
        except Fault as fault:
            # What was recorded is kept all the same.
            self.fault = self.fault or str(fault)
