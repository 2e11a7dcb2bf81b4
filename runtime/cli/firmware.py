"""The verb that generates and compiles the firmware of the controller: firmware."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from msgspec.json import decode
from msgspec.structs import replace

from runtime import files
from runtime.cli.inputs import opened
from runtime.cli.options import Check, EffectsFile, Json, ModelFile
from runtime.cli.output import NO, emit
from runtime.cli.places import FILLED
from runtime.documents.generated import BuildEntry, FirmwareDocument
from runtime.documents.parts import given
from runtime.workspace.generated import own_directory
from runtime.workspace.writing import check_directory

app = typer.Typer()


@app.command(epilog="Example: tendon firmware vishard4 --target cortex-m4f")
def firmware(
    model: ModelFile,
    target: Annotated[str, typer.Option(metavar="NAME", help="Target: cortex-m4f, cortex-m7 or host.")] = "cortex-m4f",
    toolchain: Annotated[
        str | None, typer.Option(metavar="NAME", help="Cross-compiler: gcc or zig; default: the first that is found.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Output directory; default: ./generated/NAME/firmware."), FILLED
    ] = None,
    check: Check = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Files in the directory that were not generated are kept;
    exit status 1 if the stack does not suffice."""
    from runtime.report.terminal import working

    source = opened(model, effects)
    name = source.arm().name
    directory = out if out is not None else own_directory(source, name) / "firmware"
    check_directory(directory)
    if check:
        with working(f"deriving {name}"):
            stale = source.compiled.firmware_tree(directory).stale()
        emit(json, FirmwareDocument(name=name, directory=str(directory), stale=stale), _show)
        if stale:
            raise typer.Exit(NO)
        return
    with working(f"deriving {name} and compiling its firmware"):
        prepared = source.compiled.controller(target, toolchain)
        tree = source.compiled.firmware_tree(directory)
    tree.write()
    built, place = decode((prepared / "image.json").read_bytes(), type=BuildEntry), directory / "build" / target
    place.mkdir(parents=True, exist_ok=True)
    for path in (*built.outputs, "image.json"):
        files.replace(place / path, (prepared / path).read_bytes())
    built = replace(built, outputs=[str(place / path) for path in built.outputs])
    document = FirmwareDocument(
        name=name,
        directory=str(directory),
        target=target,
        files=sorted(tree.files),
        kept=list(tree.kept),
        stale=[],
        build=built,
    )
    emit(json, document, _show)
    if not built.fits:
        raise typer.Exit(NO)


def _show(document: FirmwareDocument) -> None:
    from runtime.report.terminal import say

    build = given(document.build)
    if build is None:
        say(*(document.stale or [f"{document.directory}: up to date"]))
        return
    say(f"{document.directory}: {len(given(document.files) or ())} files")
    if document.kept:
        say(f"not generated, left as they are: {', '.join(document.kept)}")
    say(", ".join(build.outputs), f"compiled for {build.target} by {build.toolchain.version} ({build.toolchain.why})")
    stack = build.stack
    if stack is None:
        return
    chain = " > ".join(f"{name} {size}" for name, size in stack.chain)
    say(
        f"text {build.text:,} B, data {build.data:,} B, bss {build.bss:,} B",
        f"worst stack {stack.worst:,} B of {build.stack_size:,}: {chain}; {stack.handlers} more in a fault handler",
        *(f"the stack has no known bound: {why}" for why in stack.unknown),
        "functions for double precision, a heap or text: " + (", ".join(given(build.forbidden) or ()) or "none"),
    )
