"""The verb that puts an effect into a model file: add."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.opening import opened
from runtime.cli.options import EffectsFile, Json, ModelFile, check_own
from runtime.cli.output import emit
from runtime.cli.places import FILLED
from runtime.cli.rendered import render_all
from runtime.documents.generated import AddDocument

app = typer.Typer()


@app.command(epilog="Example: tendon add drive.toml stribeck --joint 1")
def add(
    model: ModelFile,
    effect: Annotated[str, typer.Argument(metavar="EFFECT", help="As tendon effects lists it.")],
    joint: Annotated[
        str | None,
        typer.Option(metavar="JOINT", help="From 1, or a name of the model's; not for effects of the arm or contact."),
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Default: ./generated/NAME."), FILLED] = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Put an effect into the model file and regenerate. Another torque_ripple is put beside those that are there."""
    check_own(model)
    source = opened(model, effects)
    number = None if joint is None else source.joint_number(joint)
    name = source.edits.name_of_next(effect, number)
    edits = source.edits.add(effect, number)
    rendered = render_all(source.with_text(edits.text), out, effects)  # what cannot be generated is not written either
    with edits.written():
        rendered.write()
    added = name if number is None else f"{name}@{number}"
    made = rendered.document([])
    document = AddDocument(
        model=str(model),
        added=added,
        name=made.name,
        directory=made.directory,
        effects_directory=made.effects_directory,
        files=made.files,
        effects_files=made.effects_files,
        operations=made.operations,
    )

    def show(_: AddDocument) -> None:
        from runtime.report.terminal.pages import say

        say(f"{model}: {added} added; {rendered.directory} regenerated")

    emit(json, document, show)
