"""JSON schemas of model and scenario files for editors: generated from the readers' declarations, copied by `init`.

`python -m runtime.cli.schemas` regenerates them; a test keeps them up to date.
"""

from __future__ import annotations

import json
from pathlib import Path

from runtime import files

FOLDER = Path(__file__).parent.parent.parent / "symbolic" / "schema"
MODEL, SCENARIO = "model.schema.json", "scenario.schema.json"


def made() -> dict[str, str]:
    """Generated schemas by file name."""
    from runtime.planning.scenario_file import SCENARIO as KEYS
    from symbolic.effects import DECLARED, LIBRARY
    from symbolic.model_file.keys import file_schema, model_schema

    schemas = {
        MODEL: model_schema(LIBRARY, DECLARED),
        SCENARIO: file_schema("Tendon: scenario of a motion that is to be planned", KEYS),
    }
    return {name: json.dumps(schema, indent=1, ensure_ascii=False) + "\n" for name, schema in schemas.items()}


def shipped() -> dict[str, bytes]:
    """Committed schemas by file name."""
    return {name: (FOLDER / name).read_bytes() for name in (MODEL, SCENARIO)}


if __name__ == "__main__":
    for name, text in made().items():
        files.replace(FOLDER / name, text.encode())
