"""Verbs of generated code: generate, add (an effect to the model file) and verify."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from json import loads
from pathlib import Path
from typing import Annotated

import typer
from msgspec import convert

from runtime.cli.inputs import check_own, opened
from runtime.cli.options import Check, EffectsFile, GeneratedDir, Json, ModelFile
from runtime.cli.output import NO, emit
from runtime.cli.places import check_directory, keep
from runtime.documents.generated import AddDocument, GeneratedFiles, GenerateDocument, VerifyDocument
from runtime.progress import each
from runtime.workspace.names import ARMS, UsageError, check_unchanged
from runtime.workspace.source import Source

app = typer.Typer()


@app.command(epilog="Example: tendon generate vishard4")
def generate(
    model: ModelFile,
    out: GeneratedDir = None,
    check: Check = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """The library of effects is written beside it, into
    ../effects."""
    source = opened(model, effects)
    rendered = render_all(source, out, effects)
    stale = rendered.stale() if check else []
    if not check:
        rendered.write()

    def show(document: GenerateDocument) -> None:
        from runtime.report.terminal import say

        if check:
            say(*(stale or [f"{rendered.directory}: up to date"]))
            return
        say(f"{rendered.directory}: {len(rendered.files)} files; effects in {rendered.beside}")
        count = document.operations["inverse_dynamics"]
        say("inverse dynamics: " + ", ".join(f"{value} {name}" for name, value in count.items() if value))

    emit(json, rendered.document().as_part_of(GenerateDocument, stale=stale), show)
    if stale:
        raise typer.Exit(NO)


@app.command(epilog="Example: tendon add drive.toml stribeck --joint 1")
def add(
    model: ModelFile,
    effect: Annotated[str, typer.Argument(metavar="EFFECT", help="Name of the effect; tendon effects lists them.")],
    joint: Annotated[
        str | None,
        typer.Option(
            metavar="JOINT", help="Number (from 1) or name of the joint; none for effects of the arm or the contact."
        ),
    ] = None,
    out: GeneratedDir = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """A second torque_ripple is added beside the first."""
    check_own(model)
    source = opened(model, effects)
    number = None if joint is None else source.joint_number(joint)
    name = source.edits.name_of_next(effect, number)
    edits = source.edits.add(effect, number)
    rendered = render_all(source.with_text(edits.text), out, effects)  # raises before anything is written
    with edits.written():
        rendered.write()
    added = name if number is None else f"{name}@{number}"
    document = rendered.document().as_part_of(AddDocument, model=str(model), added=added)

    def show(_: AddDocument) -> None:
        from runtime.report.terminal import say

        say(f"{model}: {added} added; {rendered.directory} regenerated")

    emit(json, document, show)


@app.command(epilog="Example: tendon verify vishard4 --json vectors.json")
def verify(
    model: ModelFile,
    samples: Annotated[int, typer.Option(metavar="N", min=1, max=100_000, help="Random inputs of each function.")] = 20,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Seed of the inputs.")] = 0,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """In C double, C float and CasADi; exit status 1 if it differs."""
    from runtime.report import models, terminal

    source = opened(model, effects)
    arm = source.arm()
    from codegen.verify.verify import verify as verified

    with terminal.working(f"comparing SymPy, C and CasADi of {arm.name}"):
        report = verified(arm, samples, seed, source.compiled.library.values(), partial(each, "functions"))
    document = convert(report.to_json(), VerifyDocument)
    emit(json, document, terminal.printer(models.verification))
    if not document.equal:
        raise typer.Exit(NO)


NOTE, SHIPPED = ".model", "tendon: "
"""File beside generated code that names the model file; one that comes with Tendon is named with this prefix."""


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
        functions = loads(self.files["metadata.json"])["functions"]
        return GeneratedFiles(
            name=self.name,
            directory=str(self.directory),
            effects_directory=str(self.beside),
            files=sorted(self.files),
            effects_files=sorted(self.effect_files),
            operations={name: function["operations"] for name, function in functions.items()},
        )


def render_all(source: Source, out: Path | None, effects: Path | None) -> Rendered:
    """All generated files of an arm; effects: the user's file of effects.

    Raises UsageError where a generated file would replace one of the two files that are read.
    """
    from codegen import render
    from runtime.report.terminal import working
    from symbolic.model import derive

    arm = source.arm()
    directory = out if out is not None else own_directory(source, arm.name)
    beside = directory.parent / "effects"
    if directory.resolve() == beside.resolve():
        raise UsageError(f"{directory}: the library of effects is written there; choose another --out")
    check_directory(directory)
    check_directory(beside)
    library = source.compiled.library
    with working(f"deriving {arm.name}"):
        model = derive(arm)
        files = render.arm_files(model) | render.controller_files(model, library)
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
