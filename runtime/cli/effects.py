"""The verb that lists the library: effects."""

from __future__ import annotations

from typing import Annotated

import typer

from runtime.cli import completion
from runtime.cli.options import EffectsFile, Json
from runtime.cli.output import emit
from runtime.workspace.source import effect_document, effects_document

app = typer.Typer()


@app.command("effects", epilog="Example: tendon effects stribeck")
def show_effects(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="One effect; default: all.", autocompletion=completion.effects),
    ] = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """With NAME: equation, parameters, trace in a residual, literature."""
    from runtime.report import models, terminal

    library = effects_document(effects)
    if name is None:
        emit(json, library, terminal.printer(models.effects))
    else:
        emit(json, effect_document(library, name), terminal.printer(models.effect))
