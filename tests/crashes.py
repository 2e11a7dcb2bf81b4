"""Crash points: a verb is killed at each of the calls by which it changes files, one after another."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

_CHANGES = ("os.rename", "os.link", "os.symlink", "os.remove", "os.mkdir", "os.rmdir", "os.chmod", "os.truncate")
_SURVIVED = 77


def _is_change(event: str, arguments: tuple[Any, ...], folder: str) -> bool:
    """Whether Python is about to change something in a folder."""
    if event == "open":
        path, _, flags = arguments
        changes = isinstance(flags, int) and bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC))
        return changes and folder in str(path)
    return event in _CHANGES and any(folder in str(argument) for argument in arguments)


def killed_at(point: int, work: Callable[[], object], folder: Path) -> bool:
    """Runs `work` in a process of its own that is killed before its change number `point` (from 0) in a folder; whether
    it came that far."""
    child = os.fork()
    if child == 0:
        left = point

        def hook(event: str, arguments: tuple[Any, ...]) -> None:
            nonlocal left
            if _is_change(event, arguments, str(folder)):
                if left == 0:
                    os.kill(os.getpid(), signal.SIGKILL)
                left -= 1

        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        sys.addaudithook(hook)
        try:
            work()
        finally:
            os._exit(_SURVIVED)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        assert os.WTERMSIG(status) == signal.SIGKILL
        return True
    assert os.WEXITSTATUS(status) == _SURVIVED
    return False
