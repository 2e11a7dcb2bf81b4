"""Pages with holes: the templates of every room, filled with finished strings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jinja2

_PAGES = jinja2.Environment(
    loader=jinja2.PrefixLoader(
        {folder.parent.name: jinja2.FileSystemLoader(folder) for folder in Path(__file__).parent.glob("*/templates")}
    ),
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    autoescape=False,
)


def page(name: str, /, **holes: Any) -> str:
    """A page, named ROOM/FILE for codegen/ROOM/templates/FILE, with its holes filled; every hole must be given."""
    return _PAGES.get_template(name).render(**holes)
