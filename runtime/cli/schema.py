"""The verb that writes JSON schemas of what --json prints: schema."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from json import dumps
from typing import Annotated, Any

import typer

from runtime.cli.options import Json
from runtime.cli.output import emit
from runtime.workspace.names import UsageError

app = typer.Typer()


@app.command("schema", epilog="Example: tendon schema diagnose")
def show_schema(
    verb: Annotated[str | None, typer.Argument(metavar="VERB", help="One verb; without it, all, by verb.")] = None,
    json: Json = None,
) -> None:
    """JSON schemas of what --json prints. Every key with its type, unit and meaning."""
    from runtime.documents.verbs import BY_VERB, schema

    if verb is not None and verb not in BY_VERB:
        raise UsageError(f"{verb}: no schema for this verb; there is one for: {', '.join(BY_VERB)}")

    def show(document: Mapping[str, Any]) -> None:
        sys.stdout.write(dumps(document, indent=1, ensure_ascii=False) + "\n")

    emit(json, schema(verb) if verb is not None else {name: schema(name) for name in BY_VERB}, show)
