"""Ctrl-C while an arm moves: a wish to stop it, heard between two reads, and not an exception anywhere."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_MOST = 2


@contextmanager
def listening() -> Iterator[Callable[[], int]]:
    """How often Ctrl-C was pressed since then. What is pressed after the second time interrupts as it always does."""
    count = 0

    def heard(_signal: int, _frame: FrameType | None) -> None:
        nonlocal count
        count += 1
        if count > _MOST:
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield lambda: 0
        return
    before = signal.signal(signal.SIGINT, heard)
    try:
        yield lambda: count
    finally:
        signal.signal(signal.SIGINT, before)
