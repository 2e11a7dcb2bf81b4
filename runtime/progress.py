"""Work of many like parts, with a word to whoever listens of how far it is.

One part after another: what takes time is small calls from Python, and threads only wait for each other there.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
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
    """Within, every part that is done is told to the listener."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def of_each(what: str, function: Callable[[T], R], parts: Sequence[T]) -> list[R]:
    """function(part) for each part, in their order; what: is being done, for people."""
    tell, began, found = _listener.get(), time.monotonic(), []
    for part in parts:
        found.append(function(part))
        if tell is not None:
            pace = (time.monotonic() - began) / len(found)
            tell(Progress(what, len(found), len(parts), pace * (len(parts) - len(found))))
    return found
