"""Where a verb may write: no file that it reads is overwritten, and every place can be written."""

from __future__ import annotations

import os
from collections.abc import Iterable
from itertools import combinations
from pathlib import Path

from runtime.workspace.names import UsageError, shipped_or_given


def keep(read: Iterable[Path], written: Iterable[Path]) -> None:
    """Raises UsageError if a written file is also read, by any name, or is written twice."""
    # Writing to /dev/null, /dev/stdout or a pipe replaces nothing.
    targets = [path for path in written if path.is_file() or not path.exists()]
    sources = [shipped_or_given(path) for path in read]
    for target in targets:
        if any(_same(target, source) for source in sources):
            raise UsageError(f"{target}: is read here; choose another name to write to")
    for one, other in combinations(targets, 2):
        if _same(one, other):
            raise UsageError(f"{other}: is written twice; choose two names")


def check_writable(path: Path) -> None:
    """Raises UsageError if a file cannot be written."""
    if path.is_dir():
        raise UsageError(f"{path}: is a directory; expected a file to write")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: there is no directory {path.parent}; make it first")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise UsageError(f"{path}: cannot be written; check its permissions")


def check_directory(target: Path) -> None:
    """Raises UsageError if a directory is a file, or cannot be made or written into."""
    if target.exists() and not target.is_dir():
        raise UsageError(f"{target}: is a file; expected a directory to write into")
    there = next(path for path in (target, *target.absolute().parents) if path.exists())
    if not there.is_dir():
        raise UsageError(f"{target}: cannot be made, as {there} is a file; choose another directory")
    if not os.access(there, os.W_OK):
        raise UsageError(f"{target}: cannot be written; check the permissions of {there}")


def _same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:
        return os.path.realpath(one) == os.path.realpath(other)
