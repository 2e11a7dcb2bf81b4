"""Ctrl-C where an exception would be lost."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

Handler = Callable[[int, FrameType | None], object]


@contextmanager
def heard_in_casadi() -> Iterator[None]:
    """Raises KeyboardInterrupt, at the latest at the end, if Ctrl-C was lost within or became another error: CasADi
    takes any exception that comes while it converts an argument for "not convertible"."""
    with _noted(_own()) as came:
        try:
            yield
        except Exception:
            if came():
                raise KeyboardInterrupt from None
            raise
    if came():
        raise KeyboardInterrupt


@contextmanager
def heard_afterwards() -> Iterator[None]:
    """Ctrl-C within is heard at the end: where a process is forked, Python itself prints and forgets what is raised."""
    own = _own()
    with _noted(lambda *_: None) as came:
        yield
    if came():
        own(signal.SIGINT, None)


def _own() -> Handler:
    """What Ctrl-C does as things are."""
    found = signal.getsignal(signal.SIGINT)
    return found if callable(found) else lambda *_: None


@contextmanager
def _noted(handler: Handler) -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C has come since then, which the handler hears, too. Never where it is ignored, or heard by another
    thread."""
    before, came = signal.getsignal(signal.SIGINT), False

    def heard(number: int, frame: FrameType | None) -> None:
        nonlocal came
        came = True
        handler(number, frame)

    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield lambda: False
        return
    signal.signal(signal.SIGINT, heard)
    try:
        yield lambda: came
    finally:
        signal.signal(signal.SIGINT, before)
