"""A board and an arm in lockstep: one control period passes when the host reads, and only then.

The clock of the periods is injected: a count of periods for simulated arms, or real time for drives on a bus.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import sqrt
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


_SWITCH = 1e-4
"""s after which a thread of Python gives way to another; 5 ms otherwise."""
_PRIORITY = 30
"""Of 99 in real time: above all that is not, below what the system itself needs to live."""


class Precedence:
    """Before everything else on this computer, threads that are started meanwhile included.

    granted   whether the system allows it; without, a busy computer makes periods late
    """

    def __init__(self) -> None:
        self._switch = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH)
        self.granted = self._schedule("SCHED_FIFO", _PRIORITY)

    def give_up(self) -> None:
        """May be called twice."""
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
    """Of the periods so far: how late they began (s), and how many so late that others were left out."""

    periods: int = 0
    worst: float = 0.0
    squares: float = 0.0
    overruns: int = 0

    @property
    def rms(self) -> float:
        return sqrt(self.squares / self.periods) if self.periods else 0.0

    def add(self, late: float) -> None:
        self.periods += 1
        self.squares += late * late
        self.worst = max(self.worst, late)


class Pace:
    """The clock of an arm that moves in real time: a period begins every `length` s.

    now, sleep   the computer's clock, s
    A period that could not begin in time is not made up for: the next ones follow from where it began, and the
    time that is reported shows the gap.
    """

    def __init__(
        self,
        length: float,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.length, self.kept = length, Punctuality()
        self._now, self._sleep = now, sleep
        self._begin: float | None = None
        self._next = 0.0
        self._left_out = 0.0

    def period(self) -> int:
        """Wait until a period begins; µs since the first one did, as the computer's clock has it."""
        if self._begin is None:
            self._begin = self._next = self._now()
        elif (early := self._next - self._now()) > 0.0:
            self._sleep(early)
        begun = self._now()
        late = max(0.0, begun - self._next)
        self.kept.add(late)
        if late >= self.length:
            self.kept.overruns += 1
            self._next = begun
        self._next += self.length
        return round((begun - self._begin - self._left_out) * _MICROSECONDS)

    def now(self) -> float:
        """s."""
        return self._now()

    @contextmanager
    def left_out(self) -> Iterator[None]:
        """What passes inside is left out of the time that `period` reports: nothing is controlled meanwhile."""
        since = self._now()
        try:
            yield
        finally:
            self._left_out += self._now() - since
            # What is held from now on is held for a period.
            self._next = self._now() + self.length
