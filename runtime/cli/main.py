"""The command line: `tendon VERB ...`, a file a verb."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from runtime.cli import (
    add,
    compare,
    demo,
    diagnose,
    effects,
    execute,
    experiment,
    export_arm,
    firmware,
    generate,
    identify,
    import_arm,
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
    verify,
)

app = typer.Typer(
    help="Models of robot arms: derive and generate code, compare with recordings, find the missing effect, add it.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
for _verb in (
    init,
    import_arm,
    inspect_recording,
    generate,
    verify,
    effects,
    add,
    identify,
    compare,
    diagnose,
    improve,
    simulate,
    experiment,
    demo,
    studio,
    optimize,
    execute,
    sweep,
    firmware,
    export_arm,
    paper,
    schema,
):
    for _command in _verb.app.registered_commands:
        if _command.callback is not None:
            _command.callback = places.guarded(_command.callback)
    app.add_typer(_verb.app)


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
    """What stands before a verb. The help is that of the program."""


def main() -> None:
    """Entry point of the `tendon` command."""
    output.open_streams()
    output.collect_seldom()
    output.leave(output.run(app, sys.argv[1:]))
