"""JSON schemas: the verb schema for what --json writes, and those of model and scenario files for editors.

`python -m runtime.cli.schema` writes the latter anew from the readers' declarations; a test keeps them up to date.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from json import dumps
from pathlib import Path
from typing import Annotated, Any

import typer

from runtime import files
from runtime.cli.options import Json
from runtime.cli.output import emit
from runtime.workspace.names import UsageError

app = typer.Typer()
FOLDER = Path(__file__).parent.parent.parent / "symbolic" / "schema"
MODEL, SCENARIO = "model.schema.json", "scenario.schema.json"


@app.command("schema", epilog="Example: tendon schema diagnose")
def show_schema(
    verb: Annotated[
        str | None, typer.Argument(metavar="[VERB]", help="One verb; default: an object with the schemas of all.")
    ] = None,
    json: Json = None,
) -> None:
    """Every key with its type, unit and meaning."""
    from runtime.documents.verbs import BY_VERB, schema

    if verb is not None and verb not in BY_VERB:
        raise UsageError(f"{verb}: no schema for this verb; there is one for: {', '.join(BY_VERB)}")

    def show(document: Mapping[str, Any]) -> None:
        sys.stdout.write(dumps(document, indent=1, ensure_ascii=False) + "\n")

    emit(json, schema(verb) if verb is not None else {name: schema(name) for name in BY_VERB}, show)


def made() -> dict[str, str]:
    """Generated schemas by file name."""
    from runtime.planning.scenario_file import SCENARIO as KEYS
    from symbolic.effects import DECLARED, LIBRARY
    from symbolic.model_file.keys import file_schema, model_schema

    schemas = {
        MODEL: model_schema(LIBRARY, DECLARED),
        SCENARIO: file_schema("Tendon: scenario of a motion that is to be planned", KEYS),
    }
    return {name: dumps(schema, indent=1, ensure_ascii=False) + "\n" for name, schema in schemas.items()}


def shipped() -> dict[str, bytes]:
    """Committed schemas by file name."""
    return {name: (FOLDER / name).read_bytes() for name in (MODEL, SCENARIO)}


if __name__ == "__main__":
    for name, text in made().items():
        files.replace(FOLDER / name, text.encode())
