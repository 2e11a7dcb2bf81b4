"""The verb that fits the parameters: identify."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

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
    from runtime.report.terminal import pages

    if write:
        check_own(model)
    source, data, loaded = inputs(model, recordings, effects, maps, allow_gaps)
    from runtime.diagnosis.credibility import judged
    from runtime.estimation.identify import identify as fit

    with pages.working("fitting the model"):
        found = judged(fit(loaded, data, skew=skew), data)
        document = found.to_json()
    document["skew"] |= {"given": skew is not None}
    if write and found.verdict == "fitted":
        source.replace(source.put(source.text, document))
    written = _written(document) if write and found.verdict == "fitted" else []
    emit(json, {**document, "written": written}, pages.identify)
    if written and json != "-":
        pages.say(f"Written to {source.path}: {', '.join(written)}.")
    if found.verdict == "refused":
        if write and json != "-":
            pages.say(f"Nothing written to {source.path}.")
        raise typer.Exit(NO)


def _written(document: Mapping[str, Any]) -> list[str]:
    """Names of the values that a model file gets: those that a recording told."""
    inertial = [
        p["name"] if p["name"] != ROTOR else f"{ROTOR}@{p['joint']}" for p in document["inertial"] if _told(p["fit"])
    ]
    effects = [
        (entry["name"] if entry["joint"] is None else f"{entry['name']}@{entry['joint']}")
        for entry in document["effects"]
        if any(_told(p["value"]) for p in entry["parameters"].values())
    ]
    return [*inertial, *effects]


def _told(value: float | None) -> bool:
    return value is not None and math.isfinite(value)
