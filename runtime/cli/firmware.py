"""The verb that generates and compiles the firmware of the controller: firmware."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from runtime.cli.inputs import TypedInputs, check_own, opened
from runtime.cli.options import AllowGaps, Check, EffectsFile, Json, Map, ModelFile
from runtime.cli.output import NO, emit
from runtime.cli.places import FILLED, READ
from runtime.documents.generated import FirmwareDocument
from runtime.documents.parts import given
from runtime.workspace.generated import firmware_directory, firmware_of
from runtime.workspace.names import UsageError

if TYPE_CHECKING:
    from runtime.documents.generated import MissedEntry
    from runtime.model.loader import Model
    from runtime.recordings.recording import Recording
    from runtime.workspace.edits import ModelEdits
    from runtime.workspace.source import Source

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
    monitor: Annotated[
        list[Path] | None,
        typer.Option(
            "--monitor",
            metavar="RECORDING",
            help="Recording of the arm while its model holds: each joint's noise floor goes into the model file, and "
            "the firmware watches the model.",
        ),
        READ,
    ] = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Files in the directory that were not generated are kept;
    exit status 1 if the stack does not suffice."""
    from msgspec.structs import replace

    from codegen.toolchain.cross import HOST, named_target
    from runtime.report import models
    from runtime.report.terminal import printer, say, working

    if target != HOST:
        named_target(target)
    if check and monitor:
        raise UsageError("--check writes nothing and --monitor writes floors; leave one of them out")
    watched: ModelEdits | None = None
    if monitor:
        check_own(model)
        typed = TypedInputs(model, monitor, effects=effects, maps=maps, allow_gaps=allow_gaps)
        given_source, data, loaded = typed.read()
        watched, missed = _with_floors(given_source, data, loaded)
        source = given_source.with_text(watched.text)
    else:
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
    if watched is not None:
        watched.write()
        document = replace(document, missed=missed)
    emit(json, document, printer(models.firmware))
    if watched is not None and json != "-":
        say(f"Written to {source.path}: the floors of the monitor.")
        if (stated := source.arm().monitor) is not None and not stated.statistics:
            say("With statistics = true under [monitor] the board also adds up what identify --statistics needs.")
    build = given(document.build)
    if document.stale or (build is not None and not build.fits):
        raise typer.Exit(NO)


def _with_floors(source: Source, data: list[Recording], loaded: Model) -> tuple[ModelEdits, list[MissedEntry]]:
    """The model file with the floors that recordings show, and the joints whose model misses something.

    Raises ControllerError, RecordingError, UsageError.
    """
    from runtime.report.terminal import working
    from runtime.workspace.watching import missed_joints, propose_monitor

    with working("measuring the floors of the monitor"):
        return propose_monitor(source, loaded, data), missed_joints(loaded, data)
