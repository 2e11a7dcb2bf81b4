"""The user's cache of compiled code: entries by the hash of what they are made of, each with a digest of what it is.

Code is loaded from there: the folder is the user's alone, and an entry that is not as it was written is made anew.
"""

from __future__ import annotations

import compileall
import contextlib
import hashlib
import os
import py_compile
import secrets
import shutil
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path

from codegen import disk

DIGEST = ".sha256"
"""In every entry, its files with their digests, as sha256sum writes them."""
_MAKING = ".making-"


class BuildError(RuntimeError):
    """No compiler, or it refused, or nothing can be kept; the message says what to do."""


def cache_directory() -> Path:
    """$TENDON_CACHE, else $XDG_CACHE_HOME/tendon, else ~/.cache/tendon; where nothing can be written there, a folder of
    the user's own among the temporary ones. It is there, and no other user can write to it. Raises BuildError."""
    if own := os.environ.get("TENDON_CACHE"):
        return _of_this_user(Path(own))
    try:
        usual = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "tendon"
        usual.parent.mkdir(parents=True, exist_ok=True)
        usual.mkdir(mode=0o700, exist_ok=True)
        foreign = usual.stat().st_uid != os.getuid()
    except (OSError, RuntimeError):  # RuntimeError: a user without a home
        return _temporary()
    return _temporary() if foreign or not os.access(usual, os.W_OK | os.X_OK) else _of_this_user(usual)


def _temporary() -> Path:
    folder = Path(tempfile.gettempdir()) / f"tendon-{os.getuid()}"
    if folder.is_symlink():
        raise _refused(folder, "it is not this user's alone")
    return _of_this_user(folder)


def _of_this_user(folder: Path) -> Path:
    """The folder, made if it is not there. Raises BuildError where others own it or may write to it."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        facts = folder.stat()
    except OSError as error:
        raise _refused(folder, error.strerror or str(error)) from error
    if not stat.S_ISDIR(facts.st_mode):
        raise _refused(folder, "it is no folder")
    if facts.st_uid != os.getuid():
        raise _refused(folder, "it is not this user's alone, but another's")
    if facts.st_mode & 0o022:
        raise BuildError(
            f"the cache {folder}: others may write to it, and code is loaded from there: it is not this user's alone; "
            "set TENDON_CACHE to a folder of your own, or delete it"
        )
    return folder


def _refused(folder: Path, reason: str) -> BuildError:
    return BuildError(f"cannot write the cache {folder}: {reason}; set TENDON_CACHE to a folder that can be written")


def entry(name: str, fill: Callable[[Path], None]) -> Path:
    """The cache's directory `name`, filled by `fill` where it is not there or not whole; other processes see it whole
    or not at all. Raises BuildError."""
    final = cache_directory() / name
    if is_whole(final):
        return final
    try:
        with disk.scratch(final.parent, _MAKING) as scratch:
            fill(scratch)
            _seal(scratch)
            with disk.alone_in(final.parent):
                # Where another process was first, what it made is the same.
                if not is_whole(final):
                    _remove(final)
                    scratch.rename(final)
                    _to_disk(final.parent)
    except OSError as error:
        raise _refused(final.parent, error.strerror or str(error)) from error
    return final


def is_whole(folder: Path) -> bool:
    """Whether an entry has every file that was put into it, as it was put there."""
    try:
        if folder.is_symlink() or folder.stat().st_uid != os.getuid():
            return False
        lines = (folder / DIGEST).read_text(encoding="utf-8").splitlines()
        stated = [line.partition("  ") for line in lines]
        return bool(stated) and all(_digest(folder / path) == digest for digest, _, path in stated)
    except (OSError, ValueError):
        return False


def _seal(folder: Path) -> None:
    """Writes down what an entry holds, with the bytecode of its modules; all of it is on the disk when this returns."""
    unchecked = py_compile.PycInvalidationMode.UNCHECKED_HASH
    compileall.compile_dir(folder, quiet=2, invalidation_mode=unchecked)
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    lines = [f"{_digest(path)}  {path.relative_to(folder).as_posix()}\n" for path in paths]
    (folder / DIGEST).write_text("".join(lines), encoding="utf-8")
    for path in (*paths, folder / DIGEST, folder):
        _to_disk(path)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _remove(damaged: Path) -> None:
    """What stands in an entry's place goes at once: it may be any kind of file."""
    aside = damaged.with_name(f"{_MAKING}{secrets.token_hex(4)}")
    with contextlib.suppress(FileNotFoundError):
        damaged.rename(aside)
        if aside.is_dir() and not aside.is_symlink():
            shutil.rmtree(aside, ignore_errors=True)
        else:
            aside.unlink()
