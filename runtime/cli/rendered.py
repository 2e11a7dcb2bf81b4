"""Everything that `generate` and `add` write, rendered before the first file is touched."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.cli.places import check_directory, keep
from runtime.workspace import Source, UsageError


@dataclass(frozen=True)
class Rendered:
    """Everything that `generate` writes, complete before the first file is touched."""

    name: str
    directory: Path
    beside: Path
    files: dict[str, str]
    effect_files: dict[str, str]

    def stale(self) -> list[str]:
        from codegen import disk

        return disk.stale(self.files, self.directory) + disk.stale(self.effect_files, self.beside)

    def write(self) -> None:
        from codegen import disk

        disk.write(self.files, self.directory)
        disk.write(self.effect_files, self.beside)

    def document(self) -> dict[str, Any]:
        import json

        functions = json.loads(self.files["metadata.json"])["functions"]
        return {
            "name": self.name,
            "directory": str(self.directory),
            "effects_directory": str(self.beside),
            "files": sorted(self.files),
            "effects_files": sorted(self.effect_files),
            "operations": {name: function["operations"] for name, function in functions.items()},
        }


def render_all(source: Source, text: str, out: Path | None, effects: Path | None) -> Rendered:
    """All files of an arm; effects: the file of its user's own. Raises UsageError where one would replace either."""
    from codegen import render
    from runtime.report.terminal.pages import working
    from symbolic.model import derive

    arm = source.arm(text)
    directory = out if out is not None else Path("generated") / arm.name
    beside = directory.parent / "effects"
    if directory.resolve() == beside.resolve():
        raise UsageError(f"{directory}: the library of effects goes there; choose another --out")
    check_directory(directory)
    check_directory(beside)
    with working(f"deriving {arm.name}"):
        model = derive(arm)
        files = render.arm_files(model) | render.controller_files(model, source.library)
        effect_files = render.effect_files(tuple(source.library.values()))
    places = [*(directory / name for name in files), *(beside / name for name in effect_files)]
    keep([source.path, *([effects] if effects else [])], places)
    return Rendered(arm.name, directory, beside, files, effect_files)
