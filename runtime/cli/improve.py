"""The verb that adds what is missing, as long as it helps: improve."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.loop import draw_page, improved_model, inputs, invocation_of
from runtime.cli.options import (
    AllowGaps,
    EffectsFile,
    Json,
    Map,
    ModelFile,
    Recordings,
    Report,
    check_own,
)
from runtime.cli.output import NO, emit
from runtime.cli.places import READ, WRITTEN
from runtime.workspace.names import UsageError

app = typer.Typer()


@app.command(epilog="Example: tendon improve drive.toml run1.csv --held-out run2.csv --out better.toml --report report")
def improve(
    model: ModelFile,
    recordings: Recordings,
    held_out: Annotated[
        list[Path] | None, typer.Option("--held-out", metavar="RECORDING", help="Judge on this one, not fitted."), READ
    ] = None,
    write: Annotated[bool, typer.Option("--write", help="Replace the model file by the improved one.")] = False,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the improved model there."), WRITTEN] = None,
    report: Report = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Add what is missing, as long as it helps. Fits, diagnoses and adds; on a copy unless told to write."""
    from runtime.report.terminal import loop_pages

    if write and out:
        raise UsageError("--write and --out exclude each other: the model is written to one place")
    if write:
        check_own(model)
    for path in held_out or ():
        if path.resolve() in {p.resolve() for p in recordings}:
            raise UsageError(f"{path}: is fitted and held out; give it once")
    source, data, _ = inputs(model, [*recordings, *(held_out or ())], effects, maps, allow_gaps)
    improved = model if write else out
    invocation = invocation_of(source, model, recordings, effects, maps, allow_gaps, tuple(held_out or ()), improved)
    result, summary = improved_model(source, data[: len(recordings)], data[len(recordings) :], invocation)
    emit(json, summary.document, loop_pages.show)
    if write:
        replace(source.edits, text=result.model_text).write()
    elif out:
        from runtime import files

        files.replace(out, result.model_text.encode())
    draw_page(report, summary, json)
    if result.found.verdict == "refused":
        raise typer.Exit(NO)
