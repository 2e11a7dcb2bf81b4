"""The command line: `tendon VERB ...`. Each module here declares a verb, or a few that belong together."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from runtime.cli import (
    diagnose,
    effects,
    exchange,
    execute,
    experiment,
    firmware,
    generate,
    identify,
    improve,
    init,
    inspect_recording,
    optimize,
    output,
    paper,
    places,
    schema,
    simulate,
    studio,
    sweep,
)

app = typer.Typer(
    help="Models of robot arms: derive them, generate code, fit them to recordings, find missing physical effects.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
for _verbs in (
    init,
    exchange,
    inspect_recording,
    generate,
    firmware,
    effects,
    identify,
    diagnose,
    improve,
    simulate,
    experiment,
    studio,
    optimize,
    execute,
    sweep,
    paper,
    schema,
):
    for _command in _verbs.app.registered_commands:
        if _command.callback is not None:
            _command.callback = places.guarded(_command.callback)
    app.add_typer(_verbs.app)


def _version(wanted: bool) -> None:
    if not wanted:
        return
    from importlib.metadata import PackageNotFoundError, version

    try:
        typer.echo(f"tendon {version('tendon')}")
    except PackageNotFoundError:
        typer.echo("tendon, not installed: run from its folder")
    raise typer.Exit()


@app.callback()
def of_all_verbs(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Options before a verb."""


def main() -> None:
    """Entry point of the `tendon` command."""
    output.open_streams()
    output.collect_seldom()
    output.leave(output.run(app, sys.argv[1:]))
