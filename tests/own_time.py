"""How much of the processor's time something takes by itself."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def takes_less_than(seconds: float) -> Iterator[None]:
    """Asserts that the block takes less of the processor's time, s, apart from what the garbage collector walks through
    of other tests."""
    gc.freeze()
    try:
        began = time.process_time()
        yield
        assert time.process_time() - began < seconds
    finally:
        gc.unfreeze()
