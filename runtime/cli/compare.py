"""The verb that shows where a model fails: compare."""

from __future__ import annotations

import typer

from runtime.cli.loop import inputs, invocation_of, name_page, write_page
from runtime.cli.options import (
    AllowGaps,
    EffectsFile,
    Json,
    Map,
    ModelFile,
    Recordings,
    Report,
    check_directory,
    check_writable,
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

    check_writable(json)
    check_directory(report)
    source, data, loaded = inputs(model, recordings, effects, maps, allow_gaps)
    from runtime.estimation.compare import compare as compared

    with pages.working("comparing"):
        result = compared(loaded, data)
    from runtime.report.summary import ResultSummary

    summary = ResultSummary(result, invocation_of(source, model, recordings, effects, maps, allow_gaps))
    page = write_page(report, summary)
    emit(json, summary.document, loop_pages.compare)
    name_page(page, json)
