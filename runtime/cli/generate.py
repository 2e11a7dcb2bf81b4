"""Verbs of generated code: generate, add (an effect to the model file) and verify."""

from __future__ import annotations

from typing import Annotated

import typer
from msgspec.structs import astuple

from runtime.cli import completion
from runtime.cli.inputs import check_own, opened
from runtime.cli.options import Check, EffectsFile, GeneratedDir, Json, ModelFile
from runtime.cli.output import NO, emit
from runtime.documents.generated import AddDocument, GenerateDocument
from runtime.workspace.generated import render_all, verified
from symbolic.model_file.checks import open_lines

app = typer.Typer()


@app.command(epilog="Example: tendon generate vishard4")
def generate(
    model: ModelFile,
    out: GeneratedDir = None,
    check: Check = False,
    effects: EffectsFile = None,
    rust: Annotated[bool, typer.Option("--rust", help="Also the equations as a module in Rust, NAME.rs.")] = False,
    even_open: Annotated[
        bool, typer.Option("--open", help="Also where a link's numbers are open or D is not positive definite.")
    ] = False,
    json: Json = None,
) -> None:
    """The library of effects is written beside it, into ../effects
    (of arms in space effects_space, with effects of your own effects_own).
    A rotor that the model file leaves open is taken as 0."""
    from runtime.report import models, terminal

    source = opened(model, effects)
    with terminal.working(f"deriving {source.arm().name}"):
        rendered = render_all(source, out, effects, rust, even_open)
    stale = rendered.stale() if check else []
    if not check:
        rendered.write()

    def show(document: GenerateDocument) -> None:
        if check:
            terminal.say(*(stale or [f"{rendered.directory}: up to date"]))
        else:
            terminal.show(models.generated(document))

    emit(json, rendered.document().as_part_of(GenerateDocument, stale=stale), show)
    if stale:
        raise typer.Exit(NO)


@app.command(epilog="Example: tendon add drive.toml stribeck --joint 1")
def add(
    model: ModelFile,
    effect: Annotated[
        str,
        typer.Argument(
            metavar="EFFECT",
            help="Name of the effect; tendon effects lists them.",
            autocompletion=completion.effects,
        ),
    ],
    joint: Annotated[
        str | None,
        typer.Option(
            metavar="JOINT", help="Number (from 1) or name of the joint; none for effects of the arm or the contact."
        ),
    ] = None,
    out: GeneratedDir = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """A second torque_ripple is added beside the first."""
    from runtime.report.terminal import working

    check_own(model)
    source = opened(model, effects)
    number = None if joint is None else source.joint_number(joint)
    name = source.edits.name_of_next(effect, number)
    edits = source.edits.add(effect, number)
    with working(f"deriving {source.arm().name}"):
        # Raises before anything is written. That an effect is added does not wait for the links' numbers.
        rendered = render_all(source.with_text(edits.text), out, effects, even_open=True)
    with edits.written():
        rendered.write()
    added = name if number is None else f"{name}@{number}"
    document = rendered.document().as_part_of(AddDocument, model=str(model), added=added)

    def show(document: AddDocument) -> None:
        from runtime.report.terminal import say

        say(f"{model}: {added} added; {rendered.directory} regenerated", *open_lines(map(astuple, document.open)))

    emit(json, document, show)


@app.command(epilog="Example: tendon verify vishard4 --json vectors.json")
def verify(
    model: ModelFile,
    samples: Annotated[int, typer.Option(metavar="N", min=1, max=100_000, help="Random inputs of each function.")] = 20,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Seed of the inputs.")] = 0,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """In C double, C float and CasADi; exit status 1 if it differs."""
    from runtime.report import models, terminal

    source = opened(model, effects)
    with terminal.working(f"comparing SymPy, C and CasADi of {source.arm().name}"):
        document = verified(source, samples, seed)
    emit(json, document, terminal.printer(models.verification))
    if not document.equal:
        raise typer.Exit(NO)
