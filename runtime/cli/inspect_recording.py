"""The verb that checks a recording: inspect."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from msgspec.structs import replace

from runtime.cli.inputs import made_from, opened
from runtime.cli.options import AllowGaps, EffectsFile, Json, Map
from runtime.cli.output import NO, emit
from runtime.cli.places import DRAWN, READ
from runtime.workspace.names import UsageError, column_mapping

app = typer.Typer()


@app.command("inspect", epilog="Example: tendon inspect run1.mcap arm.toml")
def inspect(
    recording: Annotated[
        Path,
        typer.Argument(metavar="RECORDING", help="CSV, MCAP, ROS 2 bag, MATLAB, HDF5, Parquet, LeRobot, NumPy or BAM."),
        READ,
    ],
    model: Annotated[
        Path | None,
        typer.Argument(
            metavar="[MODEL]",
            help="Model file (TOML), for the checks that need a model.",
        ),
        READ,
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the signals over time (.svg, .png or .pdf)."), DRAWN
    ] = None,
    promised: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="What tendon experiment --json promised of this motion: say whether it was kept."
        ),
        READ,
    ] = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Exit status 1 if it cannot be used as it is."""
    from runtime.inspection.inspection import inspect as inspected
    from runtime.inspection.inspection import with_model
    from runtime.inspection.promises import promises, read_motion_document
    from runtime.report import diagnosed, recordings, terminal

    columns = column_mapping(maps)
    motion = None if promised is None else read_motion_document(promised)
    if motion is not None and model is None:
        raise UsageError("--promised: give MODEL, too; without it nothing is fitted")
    source = None
    if model is not None:
        source = opened(model, effects)
    provenance = made_from(
        "inspect", model, source, [recording], effects=effects, maps=maps or (), allow_gaps=allow_gaps
    )
    found = inspected(recording, source.recorded_arm() if source else None, columns, allow_gaps)
    if source is not None and found.recording is not None:
        with terminal.working("deriving and compiling the model"):
            loaded = source.compiled.model()
        with terminal.working("fitting"):
            found = with_model(found, loaded)
    document = replace(diagnosed.inspected(found), provenance=provenance)
    if motion is not None:
        document = replace(document, promises=promises(motion.parameters, document.parameters))
    emit(json, document, terminal.printer(recordings.inspection))
    if picture is not None and found.recording is not None:
        from runtime.inspection.signals import complete_signals
        from runtime.report.plots.motion_plots import signals_over_time
        from runtime.report.plots.style import save

        read = found.recording
        save(signals_over_time(read.t, list(complete_signals(read)), read.segments, recording.name), picture)
        if json != "-":
            from runtime.report.terminal import say

            say(f"Picture: {picture}")
    if not found.usable:
        raise typer.Exit(NO)
