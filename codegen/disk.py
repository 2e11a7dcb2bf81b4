"""Writes generated files to the disk, a folder as a whole or not at all, and lists stale files."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

_TEXTS = ("", ".c", ".h", ".py", ".ld", ".md", ".txt", ".cmake", ".hpp", ".pyi", ".toml", ".rs")
"""Suffixes of files with a banner."""
_HERE, _EXCHANGE = -100, 2
"""AT_FDCWD and RENAME_EXCHANGE of Linux's renameat2."""


def write(files: Mapping[str, str], directory: Path) -> None:
    """Replaces the folder atomically by one with these files. Raises OSError and then leaves the folder unchanged.

    Files with the banner that are no longer generated are deleted, all others stay. Where two folders cannot be
    exchanged atomically (an older system, the working directory, a mount), each file is replaced separately.
    """
    target = Path(os.path.realpath(directory))
    target.parent.mkdir(parents=True, exist_ok=True)
    with alone_in(target.parent):
        if stale(files, target):
            _replace_all(files, target)


def _replace_all(files: Mapping[str, str], target: Path) -> None:
    if _is_moved_by_none(target) and os.access(target.parent, os.W_OK):
        with scratch(target.parent, f".{target.name}.making-") as own:
            made = own / "tree"
            made.mkdir()
            _fill(made, files, target)
            if not target.exists():
                made.rename(target)
                return
            made.chmod(target.stat().st_mode & 0o7777)
            if _exchange(made, target):
                return
    for path, text in files.items():
        _replace(target / path, text.encode())
    for path in _orphans(files, target):
        (target / path).unlink()


def stale(files: Mapping[str, str], directory: Path) -> list[str]:
    """One line per file that is missing, differs, or is no longer generated; empty if all is up to date."""
    lines = []
    for path, text in files.items():
        target = directory / path
        if not target.is_file():
            lines.append(f"{target}: missing")
        elif target.read_bytes() != text.encode():
            lines.append(f"{target}: out of date")
    return lines + [f"{directory / path}: no longer generated" for path in _orphans(files, directory)]


@contextlib.contextmanager
def scratch(parent: Path, prefix: str) -> Iterator[Path]:
    """A temporary folder in `parent`, deleted afterwards unless it was renamed. Raises OSError.

    It is locked while its process lives. Unlocked folders with the same prefix belong to killed processes and are
    deleted.
    """
    for left in parent.glob(f"{prefix}*"):
        if (found := _claimed(left)) is not None:
            shutil.rmtree(left, ignore_errors=True)
            os.close(found)
    while True:
        own = Path(tempfile.mkdtemp(dir=parent, prefix=prefix))
        # Between these two lines another process may have deleted it as unlocked.
        if (held := _claimed(own)) is not None:
            break
    try:
        yield own
    finally:
        shutil.rmtree(own, ignore_errors=True)
        os.close(held)


@contextlib.contextmanager
def alone_in(parent: Path) -> Iterator[None]:
    """Locks a folder against other processes that rename in it."""
    descriptor = os.open(parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def named(error: OSError, path: Path) -> OSError:
    """The error with the file's name, which a write to a full disk does not report."""
    return error if error.filename else OSError(error.errno, error.strerror or str(error), str(path))


def _claimed(folder: Path) -> int | None:
    """A descriptor that holds the lock of a folder; None if another process holds it or the folder is gone."""
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(descriptor), os.lstat(folder)):
            return descriptor
    except OSError:
        pass
    os.close(descriptor)
    return None


def _is_moved_by_none(target: Path) -> bool:
    try:
        return not Path.cwd().is_relative_to(target)
    except OSError:
        return False


def _fill(made: Path, files: Mapping[str, str], before: Path) -> None:
    """Fills `made` with these files, and with hard links to the files of `before` that stay."""
    for path, text in files.items():
        data, there, new = text.encode(), before / path, made / path
        new.parent.mkdir(parents=True, exist_ok=True)
        if there.is_file() and not there.is_symlink() and there.read_bytes() == data:
            _link(there, new)
        else:
            _write(new, data, there)
    gone = set(_orphans(files, before))
    for folder, folders, names in os.walk(before):
        inside = Path(folder).relative_to(before)
        for name in folders:
            if (Path(folder) / name).is_symlink():
                names.append(name)
            else:
                (made / inside / name).mkdir(parents=True, exist_ok=True)
                shutil.copystat(Path(folder) / name, made / inside / name)
        for name in names:
            if (inside / name).as_posix() not in files.keys() | gone:
                _link(Path(folder) / name, made / inside / name)


def _link(there: Path, new: Path) -> None:
    try:
        os.link(there, new, follow_symlinks=False)
    except OSError:  # a system without links
        shutil.copy2(there, new, follow_symlinks=False)


def _write(path: Path, data: bytes, shown: Path) -> None:
    """Writes a new file with permissions from the user's umask."""
    try:
        with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666), "wb") as file:
            file.write(data)
    except OSError as error:
        raise named(OSError(error.errno, error.strerror), shown) from error


def _replace(target: Path, data: bytes) -> None:
    if target.is_file() and target.read_bytes() == data:
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    with scratch(target.parent, f".{target.name}.making-") as own:
        _write(own / target.name, data, target)
        os.replace(own / target.name, target)


def _exchange(one: Path, other: Path) -> bool:
    """Exchanges two folders atomically; False if the system cannot."""
    swap = getattr(ctypes.CDLL(None), "renameat2", None)
    return swap is not None and swap(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE) == 0


def _orphans(files: Mapping[str, str], directory: Path) -> list[str]:
    """Files with the banner, in the folders of `files`, that are no longer generated."""
    found = []
    for folder in sorted({(directory / path).parent for path in files}):
        for path in sorted(folder.glob("*")) if folder.is_dir() else []:
            name = path.relative_to(directory).as_posix()
            if name not in files and has_banner(path):
                found.append(name)
    return found


def has_banner(path: Path) -> bool:
    """Whether a file's banner says that it is generated or copied from Tendon."""
    from codegen.pages import BANNER, MARK  # which loads the templates

    if path.suffix not in _TEXTS or not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(200)
    return BANNER.encode() in head or MARK.encode() in head
