"""Roles of the files that options name: read or written. No file that is read is overwritten.

An option carries its role: `Annotated[Path, typer.Option(...), WRITTEN]`. `guarded` checks all of them before the verb
starts; the verb itself calls `keep` for files that only it knows (a scenario's arm, generated files).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from runtime.workspace.names import UsageError
from runtime.workspace.writing import check_directory, check_writable, keep


@dataclass(frozen=True)
class Role:
    """What a verb does with the file of an option.

    writes    whether it writes the file, or files in the directory
    names     files that it writes into a directory, as far as known in advance; None: it is a file
    endings   allowed endings of the file's name; none: any
    """

    writes: bool
    names: tuple[str, ...] | None = None
    endings: tuple[str, ...] = ()


READ, WRITTEN, FILLED = Role(False), Role(True), Role(True, ())
"""A file that is read, a file that is written, a directory into which files are written."""
DRAWN = Role(True, endings=(".png", ".svg", ".pdf"))
"""A picture that is written."""


def roles(verb: Callable[..., None]) -> dict[str, Role]:
    """Roles of a verb's parameters by name, as far as they are files."""
    hints = get_type_hints(verb, include_extras=True).items()
    noted = {name: get_args(hint)[1:] for name, hint in hints if get_origin(hint) is Annotated}
    return {name: note for name, notes in noted.items() for note in notes if isinstance(note, Role)}


def guarded(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb, which first checks its files."""
    known = roles(verb)

    @wraps(verb)
    def called(**given: Any) -> None:
        check(known, given)
        verb(**given)

    return called


def check(known: Mapping[str, Role], given: Mapping[str, Any]) -> None:
    """Raises UsageError if a file cannot be written, or is also read."""
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
            if role.endings and path.suffix.lower() not in role.endings:
                *some, last = role.endings
                raise UsageError(f"{path}: expected a name that ends in {', '.join(some)} or {last}")


def _paths(value: Any) -> list[Path]:
    several = value if isinstance(value, list | tuple) else [value]
    return [Path(str(one)) for one in several if one is not None and str(one) != "-"]
