"""Files that are replaced completely or not at all, by one process at a time."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import secrets
import stat
import time
from collections.abc import Iterator
from pathlib import Path

LONGEST_WAIT = 30.0
"""s; other processes hold a lock for some seconds at most; a choice."""
_STEP = 0.01
"""s between two attempts to get a lock; a choice."""
_LONGEST_NAME = 100
"""bytes of a file's name in the name of its temporary file; file systems take 255 in all."""


def replace(path: Path | str, data: bytes) -> None:
    """Write `data` to `path` through a temporary file beside it, so that no reader sees half of it.

    Keeps permission bits, follows symbolic links, and writes directly into what is not a regular file (/dev/stdout).
    Removes temporary files of killed processes. Raises OSError with the file's name; then nothing is left.
    """
    target = Path(os.path.realpath(path))
    try:
        mode = target.stat().st_mode if target.exists() else None
        if mode is not None and not stat.S_ISREG(mode):
            target.write_bytes(data)
        else:
            _sweep(target)
            _put(target, data, mode)
    except OSError as error:
        # A full disk does not say which file did not fit.
        raise error if error.filename else OSError(error.errno, error.strerror, str(path)) from error


@contextlib.contextmanager
def locked(path: Path | str) -> Iterator[None]:
    """Lock a file, so that no other process that locks it replaces it between reading and writing.

    Raises TimeoutError if the lock is held too long, and OSError.
    """
    target = Path(os.path.realpath(path))
    lock = target.with_name(f".{_short(target)}.lock")
    end = time.monotonic() + LONGEST_WAIT
    while (held := _lock(lock)) is None:
        if time.monotonic() > end:
            raise TimeoutError(
                0, f"another process is writing to it; try again, or delete {lock} if none is", str(path)
            )
        time.sleep(_STEP)
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(held)


def _put(target: Path, data: bytes, mode: int | None) -> None:
    beside, descriptor = _beside(target)
    try:
        with open(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
            if mode is not None:
                os.chmod(beside, stat.S_IMODE(mode))
            os.replace(beside, target)
    except BaseException:
        with contextlib.suppress(OSError):
            beside.unlink()
        raise


def _beside(target: Path) -> tuple[Path, int]:
    """A new file beside another, locked while this process lives."""
    while True:
        path = target.with_name(f".{_short(target)}.{secrets.token_hex(6)}")
        # 0o666 is narrowed by the user's umask, as for any new file.
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        if _claimed(descriptor, path):
            return path, descriptor
        os.close(descriptor)


def _sweep(target: Path) -> None:
    """Remove temporary files that are not locked: the processes that wrote them were killed."""
    left = re.compile(re.escape(f".{_short(target)}.") + "[0-9a-f]{12}")
    with contextlib.suppress(OSError), os.scandir(target.parent) as entries:
        for name in [entry.name for entry in entries if left.fullmatch(entry.name)]:
            with contextlib.suppress(OSError):
                descriptor = os.open(target.with_name(name), os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
                if _claimed(descriptor, target.with_name(name)):
                    target.with_name(name).unlink()
                os.close(descriptor)


def _lock(path: Path) -> int | None:
    """A descriptor that holds the lock; None if another process has it."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    if _claimed(descriptor, path):
        return descriptor
    os.close(descriptor)
    return None


def _claimed(descriptor: int, path: Path) -> bool:
    """Whether this process now holds the lock of a file that still has this name."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return os.path.samestat(os.fstat(descriptor), os.lstat(path))
    except (BlockingIOError, FileNotFoundError):
        return False


def _short(target: Path) -> str:
    return os.fsdecode(os.fsencode(target.name)[:_LONGEST_NAME])
