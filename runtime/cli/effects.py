"""The verb that lists the library: effects."""

from __future__ import annotations

from typing import Annotated

import typer
from msgspec import convert

from runtime.cli import completion
from runtime.cli.options import EffectsFile, Json
from runtime.cli.output import emit
from runtime.documents.models import EffectsDocument
from runtime.workspace.names import UsageError
from runtime.workspace.source import effects_library

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
    from codegen import metadata
    from runtime.report import models, terminal

    library = effects_library(effects, space=True)
    document = convert(metadata.library(tuple(library.values())), EffectsDocument)
    if name is None:
        emit(json, document, terminal.printer(models.effects))
        return
    if name not in library:
        from symbolic.model_file.checks import nearest, quote

        close = nearest(name, library)
        hint = f'did you mean "{close}"? ' if close else ""
        raise UsageError(f"unknown effect {quote(name)}; {hint}(tendon effects lists them all)")
    emit(json, next(effect for effect in document.effects if effect.name == name), terminal.printer(models.effect))
