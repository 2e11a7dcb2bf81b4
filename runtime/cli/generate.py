"""The verb that derives and emits: generate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.opening import opened
from runtime.cli.options import EffectsFile, Json, ModelFile
from runtime.cli.output import NO, emit
from runtime.cli.places import FILLED
from runtime.cli.rendered import render_all
from runtime.documents.generated import GenerateDocument

app = typer.Typer()


@app.command(epilog="Example: tendon generate vishard4")
def generate(
    model: ModelFile,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Default: ./generated/NAME."), FILLED] = None,
    check: Annotated[bool, typer.Option("--check", help="Write nothing; exit 1 if the files are stale.")] = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Derive the equations, emit C and CasADi. The library of effects goes beside it, into ../effects."""
    source = opened(model, effects)
    rendered = render_all(source, out, effects)
    stale = rendered.stale() if check else []
    if not check:
        rendered.write()

    def show(document: GenerateDocument) -> None:
        from runtime.report.terminal.pages import say

        if check:
            say(*(stale or [f"{rendered.directory}: up to date"]))
            return
        say(f"{rendered.directory}: {len(rendered.files)} files; effects in {rendered.beside}")
        count = document.operations["inverse_dynamics"]
        say("inverse dynamics: " + ", ".join(f"{value} {name}" for name, value in count.items() if value))

    emit(json, rendered.document(stale), show)
    if stale:
        raise typer.Exit(NO)
