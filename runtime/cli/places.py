"""Which files a verb reads and which it writes, said beside each option; no file that is read is ever written to.

A verb's option that names a file carries its role: `Annotated[Path, typer.Option(...), WRITTEN]`. `guarded` checks them
all before the verb does anything; what only the verb can know (a scenario's arm, the names of generated files) it gives
to `keep` itself.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import wraps
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from runtime.workspace.names import UsageError, shipped_or_given


@dataclass(frozen=True)
class Role:
    """What a verb does with the file of an option.

    writes   it, or files in it
    names    what it writes into a directory, as far as that is known beforehand; None: it is a file
    endings  that the name of the file may have, as they say its format; none: any
    """

    writes: bool
    names: tuple[str, ...] | None = None
    endings: tuple[str, ...] = ()


READ, WRITTEN, FILLED = Role(False), Role(True), Role(True, ())
"""A file that is read; one that is written; a directory that is written into."""
DRAWN = Role(True, endings=(".png", ".svg", ".pdf"))
"""A picture that is written."""


def roles(verb: Callable[..., None]) -> dict[str, Role]:
    """The roles of a verb's parameters by name; those that are no files have none."""
    hints = get_type_hints(verb, include_extras=True).items()
    noted = {name: get_args(hint)[1:] for name, hint in hints if get_origin(hint) is Annotated}
    return {name: note for name, notes in noted.items() for note in notes if isinstance(note, Role)}


def guarded(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb, which first sees to it that what it is to write can be written, and is nothing that it reads."""
    known = roles(verb)

    @wraps(verb)
    def called(**given: Any) -> None:
        check(known, given)
        verb(**given)

    return called


def check(known: Mapping[str, Role], given: Mapping[str, Any]) -> None:
    """Raises UsageError where the files that are given to a verb cannot be written, or are read, too."""
    read: list[Path] = []
    written: list[Path] = []
    for name, role in known.items():
        for path in _paths(given.get(name)):
            if not role.writes:
                read.append(path)
            elif role.names is None:
                check_writable(path)
                written.append(path)
            else:
                check_directory(path)
                written += [path / one for one in role.names]
    keep(read, written)
    for name, role in known.items():
        for path in _paths(given.get(name)):
            _check_ending(path, role.endings)


def keep(read: Iterable[Path], written: Iterable[Path]) -> None:
    """Refuse to write to a file that is read, by whatever name, and to write two things to one file."""
    targets = [path for path in written if not _is_stream(path)]
    sources = [shipped_or_given(path) for path in read]
    for target in targets:
        if any(_same(target, source) for source in sources):
            raise UsageError(f"{target}: is read here; choose another name to write to")
    for one, other in combinations(targets, 2):
        if _same(one, other):
            raise UsageError(f"{other}: is written twice; choose two names")


def check_writable(*targets: Path | str | None) -> None:
    """Refuse before any work is done where a result could not be written after it."""
    for target in targets:
        if target in (None, "-"):
            continue
        path = Path(str(target))
        if path.is_dir():
            raise UsageError(f"{path}: is a directory; expected a file to write")
        if not path.parent.is_dir():
            raise UsageError(f"{path}: there is no directory {path.parent}; make it first")
        if not os.access(path if path.exists() else path.parent, os.W_OK):
            raise UsageError(f"{path}: cannot be written; check its permissions")


def check_directory(target: Path | None) -> None:
    """Refuse a directory to write into that is something else, or in which nothing can be written."""
    if target is None:
        return
    if target.exists() and not target.is_dir():
        raise UsageError(f"{target}: is a file; expected a directory to write into")
    there = next(path for path in (target, *target.absolute().parents) if path.exists())
    if not there.is_dir():
        raise UsageError(f"{target}: cannot be made, as {there} is a file; choose another directory")
    if not os.access(there, os.W_OK):
        raise UsageError(f"{target}: cannot be written; check the permissions of {there}")


def _check_ending(path: Path, endings: tuple[str, ...]) -> None:
    if endings and path.suffix.lower() not in endings:
        raise UsageError(f"{path}: expected a name that ends in {', '.join(endings[:-1])} or {endings[-1]}")


def _paths(value: Any) -> list[Path]:
    """Of one option: none, one or several; standard output is no file."""
    several = value if isinstance(value, list | tuple) else [value]
    return [Path(str(one)) for one in several if one is not None and str(one) != "-"]


def _is_stream(path: Path) -> bool:
    """Whether nothing is replaced by writing there: /dev/null, /dev/stdout, a pipe."""
    return path.exists() and not path.is_file()


def _same(one: Path, other: Path) -> bool:
    """Whether two names are of one file: by another way to it, a symbolic link or a hard one."""
    try:
        return one.samefile(other)
    except OSError:
        return os.path.realpath(one) == os.path.realpath(other)
