"""A wish to stop an arm that moves (Ctrl-C, a closed terminal, SIGTERM): heard between two reads, no exception."""

from __future__ import annotations

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

    def heard(number: int, _frame: FrameType | None) -> None:
        nonlocal pressed, ended
        if number == signal.SIGINT:
            pressed += 1
        else:
            ended = True
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
