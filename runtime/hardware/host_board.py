"""The machine of the firmware as compiled for this computer."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np

from runtime.hardware.lockstep import Counts, Float32

_CHUNK = 4096


class HostBoard:
    """A board within this process.

    directory   of codegen.prepare.prepare_firmware for the host: lib.so
    _name       of the arm, which is that of other boards' images; the machine has the same names for every arm
    n           its joints
    """

    def __init__(self, directory: Path, _name: str, n: int) -> None:
        self._library = ctypes.CDLL(str(directory / "lib.so"))
        size = self._function("tendon_machine_size", ctypes.c_uint32)()
        # Of doubles, so that it is aligned for everything.
        self._memory = (ctypes.c_double * (-(-size // 8)))()
        self._receive = self._function("tendon_machine_receive")
        self._step = self._function("tendon_machine_step")
        self._send = self._function("tendon_machine_send", ctypes.c_uint32)
        self._is_enabled = self._function("tendon_machine_enabled", ctypes.c_bool)
        self._counts: Counts = np.zeros(n, dtype=np.int32)
        self._torque: Float32 = np.zeros(n, dtype=np.float32)
        self._out = (ctypes.c_uint8 * _CHUNK)()
        # Pointers made once: a call then costs little more than the C behind it.
        self._machine = ctypes.byref(self._memory)
        self._pointers = tuple(ctypes.c_void_p(array.ctypes.data) for array in (self._counts, self._torque))
        self._function("tendon_machine_start")(self._machine)

    def receive(self, data: bytes) -> None:
        self._receive(self._machine, data, ctypes.c_uint32(len(data)))

    def send(self) -> bytes:
        count = self._send(self._machine, self._out, _CHUNK)
        return ctypes.string_at(self._out, count) if count else b""

    def period(self, counts: Counts, time_us: int, fault: int) -> tuple[bool, Float32]:
        self._counts[:] = counts
        read, write = self._pointers
        self._step(self._machine, read, ctypes.c_uint32(time_us), ctypes.c_uint32(fault), write)
        return self._is_enabled(self._machine), self._torque

    def close(self) -> None:
        """Nothing to stop: the memory goes with this object."""

    def _function(self, name: str, result: type | None = None) -> ctypes._NamedFuncPointer:
        function = getattr(self._library, name)
        function.restype = result
        return function
