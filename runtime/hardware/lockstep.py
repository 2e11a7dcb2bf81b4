"""A board and an arm in step: a control period passes when the host reads, and in no other way."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Counts = NDArray[np.int32]
Float32 = NDArray[np.float32]

BOARD_FAULT = 1
"""Code of a fault that the board is told of: the arm cannot be driven."""
_MICROSECONDS = 1e6
_WORD = 0xFFFFFFFF


class Fault(RuntimeError):
    """The arm can no longer be driven: its motion is no number, a drive has failed; the message says what."""


class SteppedArm(Protocol):
    """What a board drives: encoders and motors. All may raise Fault."""

    def start(self, q: Array, rng: np.random.Generator) -> Counts:
        """Made ready; a simulated one stands at q (n,). What its encoders count (n,)."""

    def counts(self) -> Counts:
        """(n,) of the encoders now."""

    def apply(self, torque: Float32) -> None:
        """Hold these torques (n,) N m or N at the joints for one control period."""

    def enable(self, on: bool) -> None:
        """Power the drives, or take their power away."""


class Board(Protocol):
    """Something that runs the firmware's machine. All may raise LinkLost."""

    def receive(self, data: bytes) -> None:
        """Bytes from the host."""

    def send(self) -> bytes:
        """What the board has for the host now."""

    def period(self, counts: Counts, time_us: int, fault: int) -> tuple[bool, Float32]:
        """One control period: whether the drives are powered, and the torques (n,) to hold.

        time_us   when it began, modulo 2^32     fault   0, or a code: the drives have failed
        """

    def close(self) -> None:
        """Stop it; may be called twice."""


class Clock(Protocol):
    """When control periods begin."""

    def period(self) -> int:
        """Wait until one begins; µs since the first."""

    def now(self) -> float:
        """s."""


class Counted:
    """A clock that waits for nobody: time is the number of periods."""

    def __init__(self, period: float) -> None:
        self._period, self._ticks = period, 0

    def period(self) -> int:
        self._ticks += 1
        return round(self._ticks * self._period * _MICROSECONDS)

    def now(self) -> float:
        return self._ticks * self._period


class Lockstep:
    """A Link to a board that drives an arm.

    period   s, of the control step
    A fault of the arm reaches the board as a fault of its drives; `fault` keeps the words.
    """

    def __init__(self, board: Board, arm: SteppedArm, period: float, clock: Clock | None = None) -> None:
        self.board, self.arm, self.period = board, arm, period
        self.baud: int | None = None
        self.late: float | None = None
        self.fault: str | None = None
        self._clock = Counted(period) if clock is None else clock
        self._counts: Counts | None = None
        self._enabled = False

    def start(self, q: Array, rng: np.random.Generator) -> None:
        """The arm made ready for a motion from q (n,)."""
        self.fault = None
        self._counts = self.arm.start(q, rng)

    def write(self, data: bytes) -> None:
        self.board.receive(data)

    def read(self, timeout: float) -> bytes:
        """Answers come at once. What is said in between takes periods: as many as fit into the timeout."""
        if data := self.board.send():
            return data
        found = []
        for _ in range(max(1, round(timeout / self.period))):
            self._play()
            found.append(self.board.send())
        return b"".join(found)

    def now(self) -> float:
        return self._clock.now()

    def figures(self) -> Mapping[str, Any]:
        return {}

    def close(self) -> None:
        self._switch(False)
        self.board.close()

    def _play(self) -> None:
        time_us = self._clock.period() & _WORD
        try:
            self._counts = self.arm.counts()
        except Fault as fault:
            self.fault = self.fault or str(fault)
        assert self._counts is not None
        enabled, torque = self.board.period(self._counts, time_us, BOARD_FAULT if self.fault else 0)
        self._switch(enabled)
        if self.fault is None:
            try:
                self.arm.apply(torque)
            except Fault as fault:
                self.fault = str(fault)

    def _switch(self, on: bool) -> None:
        if on != self._enabled:
            self._enabled = on
            try:
                self.arm.enable(on)
            except Fault as fault:
                self.fault = self.fault or str(fault)


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
