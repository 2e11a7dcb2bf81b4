"""Ctrl-C and other signals where an exception would be lost, or would leave an arm moving."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

Handler = Callable[[int, FrameType | None], object]
_MOST = 2
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def listening() -> Iterator[Callable[[], int]]:
    """Counts wishes to stop an arm that moves, without an exception: yields a function that returns their number.

    Ctrl-C counts each time and raises KeyboardInterrupt from the third time on. SIGTERM and the end of the terminal
    (SIGHUP) count once together.
    """
    pressed, ended = 0, False
    terminals = [stream for stream in (1, 2) if os.isatty(stream)]

    def heard(number: int, _frame: FrameType | None) -> None:
        nonlocal pressed, ended
        if number == signal.SIGINT:
            pressed += 1
        else:
            ended = True
        if number == signal.SIGHUP:
            _let_go(terminals)
        if pressed > _MOST:
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield lambda: 0
        return
    before = {number: signal.signal(number, heard) for number in _SIGNALS}
    try:
        yield lambda: pressed + ended
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def heard_at_last() -> Iterator[None]:
    """Ctrl-C within raises KeyboardInterrupt, and again shortly after where that was dropped: by a finalizer, by the
    callback of a weak reference, as an import has, or by C that takes any exception for an answer."""

    def heard(*_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        raise KeyboardInterrupt

    def again(*_: object) -> None:
        # What tidies up after the first is not disturbed.
        if not came_of_ctrl_c(sys.exception()):
            heard()

    own = threading.current_thread() is threading.main_thread() and _own() is signal.default_int_handler
    if sys.platform == "win32" or not own:
        yield
        return
    kept = {signal.SIGINT: signal.signal(signal.SIGINT, heard), signal.SIGALRM: signal.signal(signal.SIGALRM, again)}
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in kept.items():
            signal.signal(number, handler)


def came_of_ctrl_c(error: BaseException | None) -> bool:
    """Whether an exception is Ctrl-C's, or was raised while that was handled."""
    return error is not None and (
        isinstance(error, KeyboardInterrupt) or came_of_ctrl_c(error.__cause__ or error.__context__)
    )


def _let_go(streams: list[int]) -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in streams:
        os.dup2(nowhere, stream)
    os.close(nowhere)


@contextmanager
def heard_in_casadi() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end if Ctrl-C came within and was lost or became another error: CasADi takes any
    exception during the conversion of an argument for "not convertible"."""
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
    """Handle Ctrl-C at the end, not within: while a process is forked, Python prints exceptions and drops them."""
    own = _own()
    with _noted(lambda *_: None) as came:
        yield
    if came():
        own(signal.SIGINT, None)


@contextmanager
def first_heard_by(listener: Callable[[], object]) -> Iterator[None]:
    """The first Ctrl-C within calls the listener, and the next one interrupts."""
    before = _own()

    def heard(*_: object) -> None:
        signal.signal(signal.SIGINT, before)
        listener()

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    kept = signal.signal(signal.SIGINT, heard)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, kept)


def _own() -> Handler:
    found = signal.getsignal(signal.SIGINT)
    return found if callable(found) else lambda *_: None


@contextmanager
def _noted(handler: Handler) -> Iterator[Callable[[], bool]]:
    """Install a handler and yield whether Ctrl-C has come; never where it is ignored or in another thread."""
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
