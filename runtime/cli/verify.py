"""The verb that holds generated code against SymPy: verify."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer
from msgspec import convert

from runtime.cli.opening import opened
from runtime.cli.options import EffectsFile, Json, ModelFile
from runtime.cli.output import NO, emit
from runtime.documents.generated import VerifyDocument
from runtime.progress import each

app = typer.Typer()


@app.command(epilog="Example: tendon verify vishard4 --json vectors.json")
def verify(
    model: ModelFile,
    samples: Annotated[int, typer.Option(min=1, max=100_000, help="Random inputs of each function.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is other inputs.")] = 0,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Is the generated code equal to SymPy? C double, C float and CasADi for this arm; exit 1 if not."""
    from runtime.report.terminal import pages

    source = opened(model, effects)
    arm = source.arm()
    from codegen.verify.verify import verify as verified

    with pages.working(f"comparing SymPy, C and CasADi of {arm.name}"):
        told = partial(each, "functions")
        report = verified(arm, samples, seed, source.compiled.library.values(), told)
    document = convert(report.to_json(), VerifyDocument)
    emit(json, document, pages.verify)
    if not document.equal:
        raise typer.Exit(NO)
