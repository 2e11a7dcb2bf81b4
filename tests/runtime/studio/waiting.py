"""Waiting for a condition, as long as a busy machine may need."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable

from runtime.studio.studio import Studio

PATIENCE = 240.0
"""s after which a condition will not come true any more."""


async def chunks(*content: bytes) -> AsyncIterator[bytes]:
    """A file as it arrives."""
    for part in content:
        yield part
        await asyncio.sleep(0)  # others have their turn


def until(condition: Callable[[], object]) -> None:
    """Until it holds."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def done(studio: Studio) -> None:
    """Until the task has ended, without an error."""
    until(lambda: studio.work is None or studio.work.state != "running")
    assert studio.work is not None
    assert studio.work.error is None, studio.work.error
    assert studio.work.state == "done"


def failed(studio: Studio) -> str:
    """The error of the task once it has failed: one line without the session's path."""
    until(lambda: studio.work is None or studio.work.state != "running")
    assert studio.work is not None
    assert studio.work.error is not None
    assert studio.work.state == "failed"
    assert "\n" not in studio.work.error
    assert str(studio.session.folder) not in studio.work.error
    assert "mistake" not in studio.work.error
    return studio.work.error
