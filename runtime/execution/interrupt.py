"""A wish to stop an arm that moves (Ctrl-C, a closed terminal, SIGTERM): heard between two reads, no exception."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_MOST = 2
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def listening() -> Iterator[Callable[[], int]]:
    """How often Ctrl-C was pressed since then. What is pressed after the second time interrupts as it always does.

    The end of a terminal (SIGHUP) and SIGTERM are one wish, however often they are told.
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


def _let_go(streams: list[int]) -> None:
    """What is said to a terminal that is gone is heard by nobody, and is no error that could cost a recording."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in streams:
        os.dup2(nowhere, stream)
    os.close(nowhere)
