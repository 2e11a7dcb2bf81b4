"""The way of generated files to the disk: a folder is replaced whole or not at all, and what is stale in it."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

_TEXTS = ("", ".c", ".h", ".py", ".ld", ".md", ".txt", ".cmake")
"""Endings of files that carry a banner."""
_HERE, _EXCHANGE = -100, 2
"""AT_FDCWD and RENAME_EXCHANGE of Linux's renameat2."""


def write(files: Mapping[str, str], directory: Path) -> None:
    """Replaces the folder at once by one with these files; those with the banner that are no longer generated go, all
    others stay. What is up to date is not touched. Raises OSError, and then leaves the folder as it was.

    Where folders cannot change names at once (an older system, the folder in which the user stands, a mount), each file
    is replaced by itself.
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
    """One line a file that is missing, differs, or is no longer generated; empty where all is up to date."""
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
    """A folder of this process alone in `parent`, gone afterwards unless it was renamed.

    It is locked while its process lives: those of the same prefix that are not locked were left by a process that was
    killed, and go first. Raises OSError.
    """
    for left in parent.glob(f"{prefix}*"):
        if (found := _claimed(left)) is not None:
            shutil.rmtree(left, ignore_errors=True)
            os.close(found)
    while True:
        own = Path(tempfile.mkdtemp(dir=parent, prefix=prefix))
        # None where another process took it for one that was left, between these two lines.
        if (held := _claimed(own)) is not None:
            break
    try:
        yield own
    finally:
        shutil.rmtree(own, ignore_errors=True)
        os.close(held)


@contextlib.contextmanager
def alone_in(parent: Path) -> Iterator[None]:
    """One after the other changes names in a folder: what a user has in it is not copied while another exchanges it."""
    descriptor = os.open(parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def named(error: OSError, path: Path) -> OSError:
    """The same error with the file's name: a write to a full disk does not say where."""
    return error if error.filename else OSError(error.errno, error.strerror or str(error), str(path))


def _claimed(folder: Path) -> int | None:
    """A descriptor that holds the lock of a folder; None where another process has it, or it has gone."""
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
    """Whether nobody is led astray where the folder becomes another: this process, and the shell that called it."""
    try:
        return not Path.cwd().is_relative_to(target)
    except OSError:
        return False


def _fill(made: Path, files: Mapping[str, str], before: Path) -> None:
    """A tree with these files, and with those of the tree before that stay: they are the same files under two names."""
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
    """A new file with the permissions that the user's umask leaves."""
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
    """Two folders change names at once; False where the system cannot do it."""
    swap = getattr(ctypes.CDLL(None), "renameat2", None)
    return swap is not None and swap(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE) == 0


def _orphans(files: Mapping[str, str], directory: Path) -> list[str]:
    """Files with the banner, in the folders of `files`, that generation would not write."""
    found = []
    for folder in sorted({(directory / path).parent for path in files}):
        for path in sorted(folder.glob("*")) if folder.is_dir() else []:
            name = path.relative_to(directory).as_posix()
            if name not in files and has_banner(path):
                found.append(name)
    return found


def has_banner(path: Path) -> bool:
    """Whether a file says of itself that it is generated, or copied from Tendon."""
    from codegen.pages import BANNER, MARK  # which loads the templates

    if path.suffix not in _TEXTS or not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(200)
    return BANNER.encode() in head or MARK.encode() in head
