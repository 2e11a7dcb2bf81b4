"""Many similar calls on all cores, with progress.

The calls hold Python's interpreter lock, so processes are forked once the calls' data are in memory; they return the
results. Short work, and all work elsewhere than on Linux, runs in this process.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from math import inf, isinf
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from threading import Event
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from runtime.interruption import first_heard_by, heard_afterwards

T = TypeVar("T")
R = TypeVar("R")

_WORTH_FORKING = 1.0  # s


@contextmanager
def one_thread() -> Iterator[None]:
    """Within, the linear algebra library uses one thread, as in forked processes: with small matrices its threads wait
    for each other, and with another number of them results differ in the last bit."""
    with threadpool_limits(1, user_api="blas"):
        yield


@dataclass(frozen=True)
class Progress:
    """Progress of one piece of work; left: estimated time for the rest, s."""

    what: str
    done: int
    parts: int
    left: float


Listener = Callable[[Progress], None]
_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)
_cores: ContextVar[int | None] = ContextVar("cores", default=None)
_cut: ContextVar[Event | None] = ContextVar("cut", default=None)
_until: ContextVar[float] = ContextVar("until", default=inf)


@contextmanager
def _with(variable: ContextVar[T], value: T) -> Iterator[None]:
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


def heard_by(listener: Listener) -> AbstractContextManager[None]:
    """Within, the listener is called after every part."""
    return _with(_listener, listener)


def on_cores(count: int) -> AbstractContextManager[None]:
    """Within, work uses this number of cores."""
    return _with(_cores, count)


def within(seconds: float | None) -> AbstractContextManager[None]:
    """Within, work is late once so many seconds have passed, or those of a limit around this one; None: no limit."""
    return _with(_until, _until.get() if seconds is None else min(_until.get(), time.monotonic() + seconds))


@contextmanager
def cut_short_by_interrupt(tell: Callable[[str], object]) -> Iterator[None]:
    """Within, the first Ctrl-C makes work late at once, here and in processes that it forked; the next interrupts."""
    cut = Event()

    def heard() -> None:
        cut.set()
        tell("ending with the best so far; Ctrl-C again stops")

    with _with(_cut, cut), first_heard_by(heard):
        yield


def seconds_left() -> float:
    """s; of the time that work was given, in a forked process, too; inf if it was given none."""
    cut = _cut.get()
    return 0.0 if cut is not None and cut.is_set() else _until.get() - time.monotonic()


def is_late() -> bool:
    """Whether the time that work was given has passed."""
    return seconds_left() <= 0


def cores() -> int:
    """Number of cores that work uses: by default all that this process may use, where it can be forked; one in a
    worker of a multiprocessing pool, which may start no process."""
    if sys.platform != "linux" or multiprocessing.current_process().daemon:
        return 1
    return _cores.get() or len(os.sched_getaffinity(0))


def _left(began: float, done: int, parts: int) -> float:
    now = time.monotonic()
    return min((now - began) / done * max(parts - done, 0), max(_until.get() - now, 0.0))


@contextmanager
def steps(what: str, parts: int) -> Iterator[Callable[[], None]]:
    """Work that is no list of parts: yields a function to call after each step. Progress within a step is not heard."""
    tell, began, done = _listener.get(), time.monotonic(), 0

    def step() -> None:
        nonlocal done
        done += 1
        if tell is not None:
            tell(Progress(what, done, parts, _left(began, done, parts)))

    with _with(_listener, None):
        yield step


def each(what: str, parts: Sequence[T]) -> Iterator[T]:
    """The parts, one after the other; each is done when the next one is asked for."""
    with steps(what, len(parts)) as step:
        for part in parts:
            yield part
            step()


def of_each(what: str, function: Callable[[T], R], parts: Sequence[T]) -> list[R]:
    """function(part) for each part, in their order; what: name of the work, for people.

    The first parts are computed here until the time for the rest is known. Results must be picklable; whatever else
    `function` stores in another process is lost.
    """
    tell, began, found = _listener.get(), time.monotonic(), {}

    def done(index: int, result: R) -> float:
        found[index] = result
        left = _left(began, len(found), len(parts))
        if tell is not None:
            tell(Progress(what, len(found), len(parts), left))
        return left

    for index, part in enumerate(parts):
        if index not in found and done(index, function(part)) > _WORTH_FORKING and cores() > 1:
            with suppress(_Lost), closing(_forked(function, parts, range(index + 1, len(parts)))) as coming:
                for other, result in coming:
                    done(other, result)
    return [found[index] for index in range(len(parts))]


def of_long(function: Callable[[T], R], parts: Sequence[T]) -> Iterator[R]:
    """function(part) for each part, in their order, as many at a time as there are cores.

    No further part is begun once no further result is asked for, and none comes once the time has passed that work was
    given. On several cores progress within a part is not heard.
    """
    found: dict[int, R] = {}
    forked = cores() > 1 and len(parts) > 1
    with closing(_forked(function, parts, range(len(parts)) if forked else (), _until.get())) as coming:
        for index, part in enumerate(parts):
            with suppress(_Lost, StopIteration):
                while index not in found:
                    found.update([next(coming)])
            if index not in found and is_late():
                return
            yield found[index] if index in found else function(part)


class _Lost(Exception):
    """A process died; the results that it has not sent are computed here."""


def _forked(
    function: Callable[[T], R], parts: Sequence[T], indices: Sequence[int], until: float = inf
) -> Generator[tuple[int, R], None, None]:
    """Index and result of these parts as they come, from one process for each core; none after `until`, s of the
    monotonic clock."""
    workers: dict[Connection, BaseProcess] = {}
    waiting = list(reversed(indices))
    running = 0
    try:
        # The state of the linear algebra library's threads is copied: there must be only one.
        with one_thread(), heard_afterwards():
            for _ in range(min(cores(), len(indices))):
                here, there = multiprocessing.Pipe()
                worker = multiprocessing.get_context("fork").Process(target=_work, args=(function, parts, here, there))
                worker.start()
                there.close()
                workers[here] = worker
        ready = list(workers)
        while True:
            for connection in ready[: len(waiting)]:
                connection.send(waiting.pop())
                running += 1
            if not running:
                return
            left = None if isinf(until) else max(until - time.monotonic(), 0.0)
            ready = [connection for connection in wait(list(workers), left) if isinstance(connection, Connection)]
            if not ready:
                return
            for connection in ready:
                index, result, error = connection.recv()
                if error is not None:
                    raise error
                running -= 1
                yield index, result
    except (EOFError, ConnectionError) as ended:
        raise _Lost from ended
    finally:
        for connection, process in workers.items():
            process.kill()
            process.join()
            connection.close()


def _work(function: Callable[[T], Any], parts: Sequence[T], parent: Connection, own: Connection) -> None:
    """The loop of a forked process: parts by the indices that it receives, until its parent is gone."""
    cut = _cut.get()
    signal.signal(signal.SIGINT, signal.SIG_DFL if cut is None else lambda *_: cut.set())
    parent.close()
    _listener.set(None)
    _cores.set(1)
    with suppress(EOFError, ConnectionError):
        while True:
            index = own.recv()
            try:
                own.send((index, function(parts[index]), None))
            except Exception as error:
                own.send((index, None, error))
