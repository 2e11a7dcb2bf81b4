"""What both emulators share: the line by which an emulated board measures and drives the simulated arm.

The board waits for `0xA5, counts i32 each, time_us u32, fault u32`, which is its control period, and answers
`0x5A, enabled u8, torque float each`, little-endian.
"""

from __future__ import annotations

import struct

import numpy as np

from runtime.hardware.link import LinkLost
from runtime.hardware.lockstep import Counts, Float32

_PERIOD, _ANSWER = 0xA5, 0x5A
PATIENCE = 30.0
"""s of real time that an emulator may take for one answer on a busy machine, before it counts as hung."""


class PlantLine:
    """Packets for an arm of n joints."""

    def __init__(self, n: int) -> None:
        self._question = struct.Struct(f"<B{n}iII")
        self._head = struct.Struct("<BB")
        self.size = self._head.size + 4 * n

    def period(self, counts: Counts, time_us: int, fault: int) -> bytes:
        return self._question.pack(_PERIOD, *counts.tolist(), time_us, fault)

    def answer(self, data: bytes) -> tuple[bool, Float32]:
        """Whether the drives are powered, and the torques. Raises LinkLost for anything else."""
        if len(data) != self.size or data[0] != _ANSWER:
            raise LinkLost(f"the emulated board answered {len(data)} bytes to a control period; expected {self.size}")
        return bool(data[1]), np.frombuffer(data, np.dtype("<f4"), offset=self._head.size)
