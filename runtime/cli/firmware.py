"""The verb that generates and compiles the firmware of the controller: firmware."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.inputs import opened
from runtime.cli.options import Check, EffectsFile, Json, ModelFile
from runtime.cli.output import NO, emit
from runtime.cli.places import FILLED
from runtime.documents.generated import FirmwareDocument
from runtime.documents.parts import given
from runtime.workspace.generated import firmware_directory, firmware_of

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
    from runtime.report import models
    from runtime.report.terminal import printer, working

    source = opened(model, effects)
    name = source.arm().name
    if check:
        directory = firmware_directory(source, out)
        with working(f"deriving {name}"):
            stale = source.compiled.firmware_tree(directory).stale()
        document = FirmwareDocument(name=name, directory=str(directory), stale=stale)
    else:
        with working(f"deriving {name} and compiling its firmware"):
            document = firmware_of(source, out, target, toolchain)
    emit(json, document, printer(models.firmware))
    build = given(document.build)
    if document.stale or (build is not None and not build.fits):
        raise typer.Exit(NO)
