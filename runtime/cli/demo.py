"""The verb that shows the main job on a simulated drive: demo."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.loop import draw_page, improved_model, invocation_of
from runtime.cli.options import Json
from runtime.cli.output import emit
from runtime.cli.places import FILLED
from runtime.workspace.source import Source

app = typer.Typer()


@app.command(epilog="Example: tendon demo")
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Recordings, improved model and report."), FILLED] = Path(
        "demo-report"
    ),
    json: Json = None,
) -> None:
    """The main job on a simulated drive. Compare, diagnose, add the hidden effect, refit, report."""
    from runtime import files
    from runtime.report.terminal import loop_pages, pages
    from runtime.simulation.demo import record_files

    out.mkdir(parents=True, exist_ok=True)
    shipped = Source.shipped("drive")
    with pages.working("recording a drive with a hidden effect"):
        paths = record_files(out)
    source = Source(out / "drive.toml", shipped.text)
    data = source.recordings(paths)
    fitted, held_out = paths[:1], tuple(paths[1:])
    invocation = invocation_of(source, Path("drive"), fitted, None, None, False, held_out, source.path)
    result, summary = improved_model(source, data[:1], data[1:], invocation)
    files.replace(source.path, result.model_text.encode())
    emit(json, summary.document, loop_pages.show)
    draw_page(out, summary, json)
