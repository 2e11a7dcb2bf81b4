"""Work of many like parts: on all processor cores, with a word to whoever listens of how far it is.

Threads do, as what takes time is compiled code, which lets other threads run meanwhile. Results come in the order of
the parts, whatever finishes first, so that an answer does not hang on the number of cores.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Progress:
    """Of one piece of work: how many of its parts are done, and how long the rest will take at that pace, s."""

    what: str
    done: int
    parts: int
    left: float


Listener = Callable[[Progress], None]
_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Within, every part that is done is told to the listener, in the thread that asked for the work."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def of_each(what: str, function: Callable[[T], R], parts: Sequence[T]) -> list[R]:
    """function(part) for each part, in their order; what: is being done, for people. An exception ends the work."""
    tell, began, found = _listener.get(), time.monotonic(), []
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        for result in pool.map(function, parts):
            found.append(result)
            if tell is not None:
                pace = (time.monotonic() - began) / len(found)
                tell(Progress(what, len(found), len(parts), pace * (len(parts) - len(found))))
    return found
