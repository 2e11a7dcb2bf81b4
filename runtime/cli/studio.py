"""The verb that serves the page for the loop: studio."""

from __future__ import annotations

import shutil
from contextlib import closing
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from runtime.cli import completion
from runtime.cli.options import AllowGaps, EffectsFile, HeldOut, Map
from runtime.cli.places import FILLED, READ
from runtime.workspace.names import UsageError, column_mapping, is_name

if TYPE_CHECKING:
    from runtime.studio.inputs import GivenReading
    from runtime.studio.studio import Studio

app = typer.Typer()

FOLDER = Path("studio-session")


@app.command(epilog="Example: tendon studio drive.toml run1.csv --held-out run2.csv")
def studio(
    model: Annotated[
        Path | None,
        typer.Argument(
            metavar="[MODEL]",
            help="Model file (TOML), URDF, MJCF, one of drive, vishard4, emps, ur10, panda, or directory of a session.",
            autocompletion=completion.models,
        ),
        READ,
    ] = None,
    recordings: Annotated[
        list[Path] | None, typer.Argument(metavar="[RECORDING...]", help="Recordings, as for tendon diagnose."), READ
    ] = None,
    held_out: HeldOut = None,
    plans: Annotated[
        list[Path] | None,
        typer.Option("--plan", metavar="FILE", help="Show a trajectory that tendon optimize --out wrote."),
        READ,
    ] = None,
    demo: Annotated[bool, typer.Option("--demo", help="Open a simulated drive with a hidden effect.")] = False,
    session: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help=f"New directory for the session; default: ./{FOLDER}, or with a number."),
        FILLED,
    ] = None,
    port: Annotated[
        int, typer.Option(metavar="N", min=0, max=65535, help="Port of the page; 0: any that is free.")
    ] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
) -> None:
    """Compare, diagnose, add effects, see the error fall.

    The page is served to this machine only. A session is a directory; tendon studio DIR opens it again.
    """
    from runtime.studio.inputs import GivenReading
    from runtime.studio.server import bound, needed, serve
    from runtime.studio.session import FILE, StudioSession
    from runtime.studio.studio import Studio, check_plan

    needed()
    column_mapping(maps)
    data = bool(recordings or held_out or demo)
    if plans and data:
        raise UsageError("--plan opens plans of MODEL without recordings; drop the plans on the page of the other")
    for path in plans or ():
        check_plan(path.name)
    opened = None
    if model is not None and (model / FILE).is_file():
        if data or session or maps or allow_gaps or plans:
            raise UsageError(f"{model}: is a session and is opened as it is; drop the other arguments")
        opened = StudioSession.open(model)
    numbered = (Path(f"{FOLDER}-{number}") for number in count(2))
    free = session or next(folder for folder in chain([FOLDER], numbered) if not folder.exists())
    with closing(bound(port)) as listening:
        made = Studio(opened or StudioSession.create(free), effects)
        if opened is None:
            try:
                reading = GivenReading(tuple(maps or ()), allow_gaps)
                _give(made, model, recordings or [], held_out or [], reading=reading, demo=demo)
                if plans:
                    made.open_plans(*plans)
            except BaseException:
                made.close()
                shutil.rmtree(made.session.folder)
                raise
        if made.inputs.complete and not made.history.steps:
            made.begin()
        elif not plans:
            made.read()
        typer.echo(f"Session: {made.session.folder}")
        serve(made, listening, lambda address: typer.echo(f"Studio: {address}"), browser)


def _give(
    studio: Studio, model: Path | None, recordings: list[Path], held_out: list[Path], reading: GivenReading, demo: bool
) -> None:
    if demo:
        if model is not None or recordings or held_out:
            raise UsageError("--demo brings a model and recordings; give none beside it")
        studio.start_demo()
        return
    if model is None and held_out:
        raise UsageError("--held-out needs a model and a recording that is fitted; give them first")
    if model is not None and is_name(model):
        studio.give_arm(model.name)
    elif model is not None:
        studio.give_model(model)
    for path in recordings:
        studio.give_recording(path, reading=reading)
    for path in held_out:
        studio.give_recording(path, held_out=True, reading=reading)
