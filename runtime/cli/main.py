"""The command line: `tendon VERB ...`. `verbs` lists the verbs and the modules that declare them."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from runtime.cli import output
from runtime.cli.verbs import Verbs
from runtime.version import VERSION

app = typer.Typer(
    cls=Verbs,
    subcommand_metavar="VERB ...",
    help="Models of robot arms: derive them, generate code, fit them to recordings, find missing physical effects.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)


def _version(wanted: bool) -> None:
    if not wanted:
        return
    typer.echo(f"tendon {VERSION}")
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
