"""The verb that writes an arm for simulators: export."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.opening import opened
from runtime.cli.options import EffectsFile, Json, ModelFile
from runtime.cli.output import emit
from runtime.cli.places import READ, WRITTEN
from runtime.workspace.names import UsageError

app = typer.Typer()


class Format(StrEnum):
    """What simulators read."""

    URDF = "urdf"
    MJCF = "mjcf"


@app.command("export", epilog="Example: tendon export ur10.toml --to urdf --out ur10_identified.urdf")
def export_arm(
    model: ModelFile,
    to: Annotated[Format, typer.Option(help="URDF, or MJCF of MuJoCo.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="The new file."), WRITTEN],
    onto: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A URDF of the arm: --out is a copy of it, with the model's numbers in it."),
        READ,
    ] = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Write an arm as URDF or MJCF. With physically possible bodies and the effects that the format has a place for."""
    from runtime.report.terminal import pages
    from runtime.report.terminal.pages import working
    from runtime.workspace.exporting import export

    if onto is not None and to is not Format.URDF:
        raise UsageError(f"--onto {onto}: only a URDF can be written into; use --to urdf, or leave --onto out")
    source = opened(model, effects)
    with working("looking for physically possible bodies"):
        document = export(source.compiled, to.value, out, onto)
    emit(json, document, pages.exported)
