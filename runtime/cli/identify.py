"""The verb that fits the parameters: identify."""

from __future__ import annotations

from typing import Annotated

import typer
from msgspec.structs import replace

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
from runtime.documents.fits import IdentifyDocument, JudgedFitDocument
from runtime.estimation.settings import SKEW_RANGE
from symbolic.model_file.arm import ROTOR

app = typer.Typer()


@app.command(epilog="Example: tendon identify drive.toml run1.csv run2.csv.gz --write")
def identify(
    model: ModelFile,
    recordings: Recordings,
    write: Annotated[bool, typer.Option("--write", help="Put the fitted values into the model file.")] = False,
    skew: Annotated[
        float | None,
        typer.Option(
            min=SKEW_RANGE[0],
            max=SKEW_RANGE[1],
            help="Samples by which the torque leads the motion; estimated if not given.",
        ),
    ] = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Fit the parameters to recordings. Base inertial ones and those of the effects, with intervals."""
    from runtime.report.terminal import loop_pages, pages

    if write:
        check_own(model)
    source, data, loaded = inputs(model, recordings, effects, maps, allow_gaps)
    from runtime.diagnosis.credibility import judged
    from runtime.estimation.identify import identify as fit

    with pages.working("fitting the model"):
        found = judged(fit(loaded, data, skew=skew), data)
        document = found.document()
    written = []
    if write and found.verdict == "fitted":
        source.edits.set(document).write()
        written = _written(document)
    origin = replace(document.skew, given=skew is not None)
    emit(json, document.as_part_of(IdentifyDocument, skew=origin, written=written), loop_pages.identify)
    if written and json != "-":
        pages.say(f"Written to {source.path}: {', '.join(written)}.")
    if found.verdict == "refused":
        if write and json != "-":
            pages.say(f"Nothing written to {source.path}.")
        raise typer.Exit(NO)


def _written(document: JudgedFitDocument) -> list[str]:
    """Names of the values that a model file gets: those that the recordings determine."""
    inertial = [p.name if p.name != ROTOR else f"{ROTOR}@{p.joint}" for p in document.inertial if p.fit is not None]
    effects = [
        entry.name if entry.joint is None else f"{entry.name}@{entry.joint}"
        for entry in document.effects
        if any(p.value is not None for p in entry.parameters.values())
    ]
    return [*inertial, *effects]
