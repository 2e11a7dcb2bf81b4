"""The verb that shows where a model fails: compare."""

from __future__ import annotations

import typer

from runtime.cli.loop import draw_page, inputs, invocation_of
from runtime.cli.options import (
    AllowGaps,
    EffectsFile,
    Json,
    Map,
    ModelFile,
    Recordings,
    Report,
)
from runtime.cli.output import emit

app = typer.Typer()


@app.command(epilog="Example: tendon compare drive.toml run1.csv")
def compare(
    model: ModelFile,
    recordings: Recordings,
    report: Report = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Where does the model fail. The residual of each joint, its noise floor, and what it follows."""
    from runtime.report.terminal import loop_pages, pages

    source, data, loaded = inputs(model, recordings, effects, maps, allow_gaps)
    from runtime.estimation.compare import compare as compared

    with pages.working("comparing"):
        result = compared(loaded, data)
    from runtime.report.summary import ResultSummary

    summary = ResultSummary(result, invocation_of(source, model, recordings, effects, maps, allow_gaps))
    emit(json, summary.document, loop_pages.show)
    draw_page(report, summary, json)
