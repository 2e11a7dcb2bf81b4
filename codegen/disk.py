"""The way of generated files to the disk: whole or not at all, and which of them are stale."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

from codegen.pages import BANNER, MARK

_TEXTS = ("", ".c", ".h", ".py", ".ld", ".md", ".txt", ".cmake")
"""Endings of files that carry a banner."""


def write(files: Mapping[str, str], directory: Path) -> None:
    """Replaces each file at once, and removes files with the banner that are no longer generated."""
    for path, text in files.items():
        target = directory / path
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.is_file() and target.read_bytes() == text.encode():
            continue
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(text.encode())
            os.chmod(temporary, 0o644)
            os.replace(temporary, target)
        except BaseException:
            os.unlink(temporary)
            raise
    for path in _orphans(files, directory):
        (directory / path).unlink()


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
    if path.suffix not in _TEXTS or not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(200)
    return BANNER.encode() in head or MARK.encode() in head
