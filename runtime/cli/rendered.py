"""Everything that `generate` and `add` write, rendered before the first file is touched."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from runtime.cli.places import check_directory, keep
from runtime.documents.generated import GenerateDocument
from runtime.workspace.edits import check_unchanged
from runtime.workspace.names import ARMS, UsageError
from runtime.workspace.source import Source

NOTE, SHIPPED = ".model", "tendon: "
"""Beside generated files, from which model file they are; one that ships is said by its name."""


@dataclass(frozen=True)
class Rendered:
    """Everything that `generate` writes, complete before the first file is touched.

    source      the model file, with the text from which everything was derived
    made_from      its path from the directory, or the name under which it ships
    """

    name: str
    source: Source
    made_from: str
    directory: Path
    beside: Path
    files: dict[str, str]
    effect_files: dict[str, str]

    def stale(self) -> list[str]:
        from codegen import disk

        return disk.stale(self.files, self.directory) + disk.stale(self.effect_files, self.beside)

    def write(self) -> None:
        """One process at a time, and only of what the model file says by then: another one may have added to it
        meanwhile and have written what belongs to that. Raises UsageError, OSError."""
        from codegen import disk
        from runtime import files

        with files.alone(self._lock()):
            if self.source.path.is_file():  # a pipe says what it says once
                check_unchanged(self.source.path, self.source.text)
            disk.write(self.files, self.directory)
            disk.write(self.effect_files, self.beside)
            files.replace(self.directory / NOTE, f"{self.made_from}\n".encode())

    def _lock(self) -> Path:
        """What is locked: the folder, which may not be there yet, or a file in it where nothing can stand beside it."""
        folder = Path(os.path.realpath(self.directory))
        folder.parent.mkdir(parents=True, exist_ok=True)
        return folder if os.access(folder.parent, os.W_OK) else folder / NOTE

    def document(self, stale: list[str]) -> GenerateDocument:
        """As `tendon generate --json`; stale: files that are out of date."""
        import json

        functions = json.loads(self.files["metadata.json"])["functions"]
        return GenerateDocument(
            name=self.name,
            directory=str(self.directory),
            effects_directory=str(self.beside),
            files=sorted(self.files),
            effects_files=sorted(self.effect_files),
            operations={name: function["operations"] for name, function in functions.items()},
            stale=stale,
        )


def render_all(source: Source, out: Path | None, effects: Path | None) -> Rendered:
    """All files of an arm; effects: the file of its user's own. Raises UsageError where one would replace either."""
    from codegen import render
    from runtime.report.terminal.pages import working
    from symbolic.model import derive

    arm = source.arm()
    directory = out if out is not None else own_directory(source, arm.name)
    beside = directory.parent / "effects"
    if directory.resolve() == beside.resolve():
        raise UsageError(f"{directory}: the library of effects goes there; choose another --out")
    check_directory(directory)
    check_directory(beside)
    library = source.compiled.library
    with working(f"deriving {arm.name}"):
        model = derive(arm)
        files = render.arm_files(model) | render.controller_files(model, library)
        effect_files = render.effect_files(tuple(library.values()))
    places = [*(directory / name for name in files), *(beside / name for name in effect_files)]
    keep([source.path, *([effects] if effects else [])], places)
    return Rendered(arm.name, source, _origin(source, directory), directory, beside, files, effect_files)


def own_directory(source: Source, name: str) -> Path:
    """Where an arm's files go by default. Raises UsageError where those of another model file of the same name are,
    and that is still there."""
    directory = Path("generated") / name
    note = directory / NOTE
    other = note.read_text(encoding="utf-8").strip() if note.is_file() else None
    if other is None or other == _origin(source, directory):
        return directory
    if other.startswith(SHIPPED) or (directory / other).is_file():
        shown = other if other.startswith(SHIPPED) else os.path.relpath(directory / other)
        raise UsageError(
            f"{directory}: holds what was generated from {shown}, which has the same name; give one of them another, "
            "or choose another --out"
        )
    return directory


def _origin(source: Source, directory: Path) -> str:
    if source.path.resolve().parent == ARMS.resolve():
        return f"{SHIPPED}{source.path.stem}"
    return Path(os.path.relpath(source.path.resolve(), directory.resolve())).as_posix()
