"""Real time on a computer that has other things to do: periods that begin when they should, and how well they did."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import sqrt

_MICROSECONDS = 1e6
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
