"""The generated code of a model file as source files: rendered completely, then compared or written."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from json import loads
from pathlib import Path

from msgspec import UNSET, convert
from msgspec.json import decode
from msgspec.structs import replace

from runtime.documents.generated import BuildEntry, FirmwareDocument, GeneratedFiles, OpenEntry, VerifyDocument
from runtime.progress import each
from runtime.workspace.names import ARMS, UsageError, check_unchanged
from runtime.workspace.source import Source
from runtime.workspace.writing import check_directory, keep

NOTE, SHIPPED = ".model", "tendon: "
"""File beside generated code that names the model file; one that comes with Tendon is named with this prefix."""

EFFECTS = ("effects", "effects_space", "effects_own", "effects_space_own")
"""Folders of the library of effects: of planar arms, of arms in space, where gravity and payload have other arguments,
and both with effects of the user's own."""


@dataclass(frozen=True)
class Rendered:
    """Everything that `generate` writes, complete before the first file is written.

    source      model file with the text from which everything was derived
    made_from   its path relative to the directory, or its name if it comes with Tendon
    beside      directory of the library of effects
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
        """Write all files, unless another process changed the model file meanwhile. Raises UsageError, OSError."""
        from codegen import disk
        from runtime import files

        # The directory is locked, or a file in it where the parent directory cannot be written.
        folder = Path(os.path.realpath(self.directory))
        folder.parent.mkdir(parents=True, exist_ok=True)
        with files.locked(folder if os.access(folder.parent, os.W_OK) else folder / NOTE):
            if self.source.path.is_file():  # a pipe can be read only once
                check_unchanged(self.source.path, self.source.text)
            disk.write(self.files, self.directory)
            disk.write(self.effect_files, self.beside)
            files.replace(self.directory / NOTE, f"{self.made_from}\n".encode())

    def document(self) -> GeneratedFiles:
        described = loads(self.files["metadata.json"])
        return GeneratedFiles(
            name=self.name,
            directory=str(self.directory),
            effects_directory=str(self.beside),
            files=sorted(self.files),
            effects_files=sorted(self.effect_files),
            open=convert(described["open"], list[OpenEntry]),
            operations={name: function["operations"] for name, function in described["functions"].items()},
        )


def render_all(
    source: Source, out: Path | None, effects: Path | None, rust: bool = False, even_open: bool = False
) -> Rendered:
    """All generated files of an arm.

    effects     the user's file of effects     rust   with a module in Rust, which is kept up to date once it is there
    even_open   also where numbers of links are open or D is not positive definite
    Raises ModelError otherwise, and UsageError where a generated file would replace one of the two that are read.
    """
    from codegen import disk, render
    from codegen.open_numbers import for_others
    from codegen.package.package import package_files
    from codegen.rust.rust_code import rust_files

    arm = source.arm()
    directory = out if out is not None else own_directory(source, arm.name)
    beside = directory.parent / EFFECTS[arm.space + 2 * (source.own is not None)]
    if directory.resolve() in [(directory.parent / name).resolve() for name in EFFECTS]:
        raise UsageError(f"{directory}: the library of effects is written there; choose another --out")
    check_directory(directory)
    check_directory(beside)
    library = source.compiled.library
    model = for_others(arm, library, even_open)
    files = package_files(model, library)
    if rust or disk.has_banner(directory / f"{arm.name}.rs"):
        files |= rust_files(model)
    effect_files = render.effect_files(tuple(library.values()))
    places = [*(directory / name for name in files), *(beside / name for name in effect_files)]
    keep([source.path, *([effects] if effects else [])], places)
    return Rendered(
        name=arm.name,
        source=source,
        made_from=_origin(source, directory),
        directory=directory,
        beside=beside,
        files=files,
        effect_files=effect_files,
    )


def verified(source: Source, samples: int, seed: int) -> VerifyDocument:
    """The arm's C double, C float and CasADi compared with SymPy at random inputs."""
    from codegen.verify.verify import verify

    report = verify(source.arm(), samples, seed, source.compiled.library.values(), partial(each, "functions"))
    return convert(report.to_json(), VerifyDocument)


def firmware_directory(source: Source, out: Path | None) -> Path:
    """Where the firmware goes. Raises UsageError."""
    directory = out if out is not None else own_directory(source, source.arm().name) / "firmware"
    check_directory(directory)
    return directory


def firmware_of(source: Source, out: Path | None, target: str, toolchain: str | None) -> FirmwareDocument:
    """Write the controller's firmware and compile it for a target of `tendon firmware`. Raises ValueError."""
    from runtime import files
    from runtime.workspace.watching import monitor_entry

    directory = firmware_directory(source, out)
    prepared = source.compiled.controller(target, toolchain)
    tree = source.compiled.firmware_tree(directory)
    tree.write()
    built, place = decode((prepared / "image.json").read_bytes(), type=BuildEntry), directory / "build" / target
    place.mkdir(parents=True, exist_ok=True)
    for path in (*built.outputs, "image.json"):
        files.replace(place / path, (prepared / path).read_bytes())
    return FirmwareDocument(
        name=source.arm().name,
        directory=str(directory),
        target=target,
        files=sorted(tree.files),
        kept=list(tree.kept),
        stale=[],
        open=[OpenEntry(**number._asdict()) for number in tree.open],
        build=replace(built, outputs=[str(place / path) for path in built.outputs]),
        monitor=UNSET if (entry := monitor_entry(source)) is None else entry,
    )


def own_directory(source: Source, name: str) -> Path:
    """Default directory of an arm's generated files. Raises UsageError if it holds those of another model file."""
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
