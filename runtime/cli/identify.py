"""The verb that fits the parameters: identify."""

from __future__ import annotations

from typing import Annotated

import typer

from runtime.cli.loop import inputs
from runtime.cli.options import (
    AllowGaps,
    EffectsFile,
    Json,
    Map,
    ModelFile,
    Recordings,
    check_own,
)
from runtime.cli.output import NO, emit

app = typer.Typer()


@app.command(epilog="Example: tendon identify drive.toml run1.csv run2.csv.gz --write")
def identify(
    model: ModelFile,
    recordings: Recordings,
    write: Annotated[bool, typer.Option("--write", help="Put the fitted values into the model file.")] = False,
    skew: Annotated[
        float | None, typer.Option(help="Samples by which the torque leads the motion; estimated if not given.")
    ] = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Fit the parameters to recordings. Base inertial ones and those of the effects, with intervals."""
    from runtime.report.terminal import pages

    if write:
        check_own(model)
    source, data, loaded = inputs(model, recordings, effects, maps, allow_gaps)
    from runtime.diagnosis.credibility import judged
    from runtime.estimation.identify import identify as fit

    with pages.working("fitting the model"):
        found = judged(fit(loaded, data, skew=skew), data)
        document = found.to_json()
    if write and found.verdict == "fitted":
        source.replace(source.put(source.text, document))
    emit(json, document, pages.identify)
    if found.verdict == "refused":
        if write and json != "-":
            pages.say(f"Nothing written to {source.path}.")
        raise typer.Exit(NO)
