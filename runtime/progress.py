"""Work of many like parts, on all cores, with a word to whoever listens of how far it is.

What takes time is small calls from Python, for which threads only wait for each other: processes are forked once all
that the parts read is there, and send back what they found. Where that is not safe (outside Linux), or not worth it,
one part follows another.
"""

from __future__ import annotations

import os
import pickle
import selectors
import signal
import sys
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, NoReturn, TypeVar

from threadpoolctl import threadpool_limits

from runtime.interruption import heard_afterwards

T = TypeVar("T")
R = TypeVar("R")

_WORTH_FORKING = 1.0  # s


@contextmanager
def one_thread() -> Iterator[None]:
    """Within, the linear algebra library works in one thread, also where it was loaded before this package could say
    so: with small matrices on all cores its threads wait for each other."""
    with threadpool_limits(1, user_api="blas"):
        yield


@dataclass(frozen=True)
class Progress:
    """Of one piece of work: how many of its parts are done, and how long the rest will take at that pace, s."""

    what: str
    done: int
    parts: int
    left: float


Listener = Callable[[Progress], None]
_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)
_cores: ContextVar[int | None] = ContextVar("cores", default=None)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Within, every part that is done is told to the listener."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def on_cores(count: int) -> Iterator[None]:
    """Within, work is done on so many cores."""
    token = _cores.set(count)
    try:
        yield
    finally:
        _cores.reset(token)


def cores() -> int:
    """On how many cores work is done: all that this process may use, where it can be forked."""
    chosen = _cores.get()
    if sys.platform != "linux":
        return 1
    return len(os.sched_getaffinity(0)) if chosen is None else chosen


@contextmanager
def steps(what: str, parts: int) -> Iterator[Callable[[], None]]:
    """Work that is no list of like parts: gives what is called as each of them is done. What the parts tell of
    themselves is not heard within."""
    tell, began, done = _listener.get(), time.monotonic(), 0

    def step() -> None:
        nonlocal done
        done += 1
        if tell is not None:
            tell(Progress(what, done, parts, (time.monotonic() - began) / done * max(parts - done, 0)))

    token = _listener.set(None)
    try:
        yield step
    finally:
        _listener.reset(token)


def each(what: str, parts: Sequence[T]) -> Iterator[T]:
    """The parts, one after the other here; each counts as done when the next one is asked for."""
    with steps(what, len(parts)) as step:
        for part in parts:
            yield part
            step()


def of_each(what: str, function: Callable[[T], R], parts: Sequence[T]) -> list[R]:
    """function(part) for each part, in their order; what: is being done, for people.

    The first parts are done here, until it is known how long the rest takes; `function` may keep what it computes, but
    what it computes elsewhere is lost, all but its result, which must be one that can be pickled.
    """
    tell, began, found = _listener.get(), time.monotonic(), {}

    def done(index: int, result: R) -> float:
        found[index] = result
        left = (time.monotonic() - began) / len(found) * (len(parts) - len(found))
        if tell is not None:
            tell(Progress(what, len(found), len(parts), left))
        return left

    for index, part in enumerate(parts):
        if index not in found and done(index, function(part)) > _WORTH_FORKING and cores() > 1:
            with suppress(_Lost):
                for other, result in _forked(function, parts, range(index + 1, len(parts))):
                    done(other, result)
    return [found[index] for index in range(len(parts))]


def of_long(function: Callable[[T], R], parts: Sequence[T]) -> Iterator[R]:
    """function(part) for each part, in their order, where each is known to be worth a process: as many at once as there
    are cores, and none any more once no further one is asked for. What the parts tell of themselves is not heard on
    several cores."""
    found: dict[int, R] = {}
    forked = cores() > 1 and len(parts) > 1
    with closing(_forked(function, parts, range(len(parts)) if forked else ())) as coming:
        for index, part in enumerate(parts):
            with suppress(_Lost, StopIteration):
                while index not in found:
                    found.update([next(coming)])
            yield found[index] if index in found else function(part)


class _Lost(Exception):
    """A process ended before it was done; what it has not sent is computed here."""


def _forked(
    function: Callable[[T], R], parts: Sequence[T], indices: Sequence[int]
) -> Generator[tuple[int, R], None, None]:
    """Index and result of these parts as they come, from one process a core."""
    todo, give = os.pipe()
    workers: dict[int, int] = {}
    try:
        # A thread each: what the linear algebra library has of them is copied as it stands.
        with one_thread(), heard_afterwards():
            for _ in range(min(cores(), len(indices))):
                pid, results = _worker(function, parts, todo, give)
                workers[pid] = results
        os.close(todo)
        todo = -1
        with selectors.DefaultSelector() as selector:
            for results in workers.values():
                selector.register(results, selectors.EVENT_READ)
            yield from _gathered(selector, give, list(indices))
    finally:
        for descriptor in (todo, give):
            if descriptor >= 0:
                os.close(descriptor)
        for pid, results in workers.items():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            os.close(results)


def _gathered(selector: selectors.BaseSelector, give: int, waiting: list[int]) -> Iterator[tuple[int, Any]]:
    """Hands out indices, one for every result that comes and some ahead, and gives on what comes."""
    open_ones = 0

    def hand_out() -> None:
        nonlocal open_ones
        if waiting:
            os.write(give, waiting.pop(0).to_bytes(4, "little"))
            open_ones += 1

    for _ in range(2 * len(selector.get_map())):
        hand_out()
    while open_ones:
        for key, _ in selector.select():
            try:
                index, result, error = pickle.loads(_read(key.fd, int.from_bytes(_read(key.fd, 8), "little")))
            except EOFError as ended:
                raise _Lost from ended
            if error is not None:
                raise error
            open_ones -= 1
            hand_out()
            yield index, result


def _read(descriptor: int, count: int) -> bytes:
    """So many bytes of a pipe; EOFError where it ends before."""
    found = b""
    while len(found) < count:
        piece = os.read(descriptor, count - len(found))
        if not piece:
            raise EOFError
        found += piece
    return found


def _worker(function: Callable[[T], R], parts: Sequence[T], todo: int, give: int) -> tuple[int, int]:
    """A process that does the parts whose indices it reads, until there are no more; its id and its results."""
    read, write = os.pipe()
    with warnings.catch_warnings():
        # Other threads of this process (a spinner, a timer) hold nothing that the parts need.
        warnings.simplefilter("ignore", DeprecationWarning)
        pid = os.fork()
    if not pid:
        os.close(give)
        os.close(read)
        _work(function, parts, todo, write)
    os.close(write)
    return pid, read


def _work(function: Callable[[T], R], parts: Sequence[T], todo: int, write: int) -> NoReturn:
    """What a process does that was forked: nothing of what its parent would do next."""
    status = 1
    try:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
        _listener.set(None)
        _cores.set(1)
        while token := os.read(todo, 4):
            _send(write, function, parts, int.from_bytes(token, "little"))
        status = 0
    finally:
        os._exit(status)


def _send(write: int, function: Callable[[T], R], parts: Sequence[T], index: int) -> None:
    try:
        message = pickle.dumps((index, function(parts[index]), None))
    except Exception as error:
        message = pickle.dumps((index, None, error))
    message = len(message).to_bytes(8, "little") + message
    while message:
        message = message[os.write(write, message) :]
