"""Pages from templates: every text is escaped, and a page is written whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from runtime import files
from runtime.report.page import NAME


def filled(template: str, holes: Mapping[str, Any]) -> str:
    """A template of this room; the same bytes for the same holes."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(holes)


def embedded(document: Mapping[str, Any]) -> str:
    """JSON for a script element: `<` would let a text of the user's end it."""
    return json.dumps(document, indent=1, allow_nan=False).replace("<", "\\u003c")


def written(directory: Path, page: str) -> Path:
    """The page's file, in a directory that is made if it is not there. Raises OSError."""
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / NAME
    files.replace(path, page.encode("utf-8"))
    return path
