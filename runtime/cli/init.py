"""The verb that begins a model file: init."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from runtime.cli.opening import opened
from runtime.cli.options import EffectsFile, Json
from runtime.cli.output import emit
from runtime.cli.places import READ, WRITTEN
from runtime.workspace import UsageError

app = typer.Typer()


@app.command(epilog="Example: tendon init --like drive --out my_drive.toml")
def init(
    like: Annotated[
        Path,
        typer.Option(
            metavar="MODEL", help="It begins as a copy of this: drive, vishard4, emps, ur10, panda, or a file."
        ),
        READ,
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="The new model file."), WRITTEN],
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Begin a model file for an arm of your own. With the comments that say what each number is."""
    from runtime import files
    from runtime.report.terminal.pages import say

    if out.exists():
        raise UsageError(f"{out}: is there already; choose another name")
    source = opened(like, effects)
    arm = source.arm()
    files.replace(out, source.text.encode())
    document = {"out": str(out), "like": str(like), "name": arm.name, "joints": len(arm.joints)}

    def show(_: Any) -> None:
        joints = "1 joint" if len(arm.joints) == 1 else f"{len(arm.joints)} joints"
        say(f"{out}: {arm.name}, {joints}, as in {like}; change in it what is different at your arm")

    emit(json, document, show)
