"""A board and an arm in lockstep: one control period passes when the host reads, and only then.

The clock of the periods is injected: a count of periods for simulated arms, or real time for drives on a bus.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import sqrt
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.hardware.link import BoardLink

Counts = NDArray[np.int32]
Float32 = NDArray[np.float32]

BOARD_FAULT = 1
"""Fault code that the board receives when the arm cannot be driven."""
_MICROSECONDS = 1e6
_WORD = 0xFFFFFFFF


class Fault(RuntimeError):
    """The arm cannot be driven any more, for instance because a drive failed; the message says why."""


class SteppedArm(Protocol):
    """The encoders and motors of an arm that a board drives. All methods may raise Fault."""

    def start(self, q: Array, rng: np.random.Generator) -> Counts:
        """Prepares a run; a simulated arm is placed at q (n,). Returns the encoder counts (n,)."""

    def counts(self) -> Counts:
        """Encoder counts (n,) now."""

    def apply(self, torque: Float32) -> None:
        """Applies joint torques (n,) in N m or N for one control period."""

    def enable(self, on: bool) -> None:
        """Switches the drives on or off."""


class Board(Protocol):
    """A board that runs the firmware's state machine. All methods may raise LinkLost."""

    def receive(self, data: bytes) -> None:
        """Passes bytes from the host to the board."""

    def send(self) -> bytes:
        """Takes the bytes that the board has for the host."""

    def period(self, counts: Counts, time_us: int, fault: int) -> tuple[bool, Float32]:
        """Runs one control period: whether the drives are on, and the torques (n,) to apply.

        time_us   start of the period, modulo 2^32     fault   0, or the code of a fault of the drives
        """

    def close(self) -> None:
        """Stops the board; may be called twice."""


class Clock(Protocol):
    """The clock of the control periods."""

    def period(self) -> int:
        """Waits until a period begins; µs since the first."""

    def now(self) -> float:
        """Time in s."""


class Counted:
    """A clock without waiting, for simulation: its time is the number of periods."""

    def __init__(self, period: float) -> None:
        self._period, self._ticks = period, 0

    def period(self) -> int:
        self._ticks += 1
        return round(self._ticks * self._period * _MICROSECONDS)

    def now(self) -> float:
        return self._ticks * self._period


class Lockstep(BoardLink):
    """A BoardLink to a board that drives an arm in lockstep.

    period   control period, s
    A fault of the arm is passed to the board as a fault of its drives; `fault` keeps the message.
    """

    def __init__(self, board: Board, arm: SteppedArm, period: float, clock: Clock | None = None) -> None:
        self.board, self.arm, self.period = board, arm, period
        self._clock = Counted(period) if clock is None else clock
        self._counts: Counts | None = None
        self._enabled = False

    def start(self, q: Array, rng: np.random.Generator) -> None:
        """Prepares the arm for a motion from q (n,)."""
        self.fault = None
        self._counts = self.arm.start(q, rng)

    def write(self, data: bytes) -> None:
        self.board.receive(data)

    def read(self, timeout: float) -> bytes:
        """Returns waiting bytes at once; else runs as many control periods as fit into the timeout."""
        if data := self.board.send():
            return data
        found = []
        for _ in range(max(1, round(timeout / self.period))):
            self._play()
            found.append(self.board.send())
        return b"".join(found)

    def now(self) -> float:
        return self._clock.now()

    def close(self) -> None:
        self._switch(False)
        self.board.close()

    def _play(self) -> None:
        time_us = self._clock.period() & _WORD
        with self._faults_kept():
            self._counts = self.arm.counts()
        assert self._counts is not None
        enabled, torque = self.board.period(self._counts, time_us, BOARD_FAULT if self.fault else 0)
        self._switch(enabled)
        if self.fault is None:
            with self._faults_kept():
                self.arm.apply(torque)

    def _switch(self, on: bool) -> None:
        if on != self._enabled:
            self._enabled = on
            with self._faults_kept():
                self.arm.enable(on)

    @contextmanager
    def _faults_kept(self) -> Iterator[None]:
        try:
            yield
        except Fault as fault:
            self.fault = self.fault or str(fault)


_SWITCH = 1e-4
"""Switch interval of Python's threads in s; 5 ms by default."""
_PRIORITY = 30
"""Real-time priority out of 99: above all ordinary processes, below the system's own."""


class Precedence:
    """Real-time priority of this process, including threads started later.

    granted   whether the system allows it; if not, periods are late on a busy computer
    """

    def __init__(self) -> None:
        self._switch = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH)
        self.granted = self._schedule("SCHED_FIFO", _PRIORITY)

    def give_up(self) -> None:
        """Back to ordinary priority; may be called twice."""
        sys.setswitchinterval(self._switch)
        if self.granted:
            self._schedule("SCHED_OTHER", 0)

    def _schedule(self, policy: str, priority: int) -> bool:
        try:
            os.sched_setscheduler(0, getattr(os, policy), os.sched_param(priority))
        except (AttributeError, OSError):
            return False
        return True


@dataclass
class Punctuality:
    """How late (s) the periods began so far; overruns: periods so late that others were skipped."""

    periods: int = 0
    worst: float = 0.0
    squares: float = 0.0
    overruns: int = 0

    @property
    def rms(self) -> float:
        return sqrt(self.squares / self.periods) if self.periods else 0.0


class Pace:
    """Real-time clock: a period begins every `length` s.

    now, sleep   the computer's clock, injected by tests
    A late period is not caught up: the next ones are counted from its start, and the reported time shows the gap.
    """

    def __init__(
        self, length: float, now: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self.length, self.kept = length, Punctuality()
        self._now, self._sleep = now, sleep
        self._begin: float | None = None
        self._next = 0.0
        self._left_out = 0.0

    def period(self) -> int:
        """Waits until a period begins; µs since the first one, by the computer's clock."""
        if self._begin is None:
            self._begin = self._next = self._now()
        elif (early := self._next - self._now()) > 0.0:
            self._sleep(early)
        begun = self._now()
        late = max(0.0, begun - self._next)
        self.kept.periods += 1
        self.kept.squares += late * late
        self.kept.worst = max(self.kept.worst, late)
        if late >= self.length:
            self.kept.overruns += 1
            self._next = begun
        self._next += self.length
        return round((begun - self._begin - self._left_out) * _MICROSECONDS)

    def now(self) -> float:
        return self._now()

    @contextmanager
    def left_out(self) -> Iterator[None]:
        """Time that passes inside does not count in `period`, because nothing is controlled meanwhile."""
        since = self._now()
        try:
            yield
        finally:
            self._left_out += self._now() - since
            # The next period begins a full period from now.
            self._next = self._now() + self.length
