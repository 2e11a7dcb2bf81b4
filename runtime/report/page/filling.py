"""Pages from templates: every text is escaped, and a page is written whole or not at all."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, UndefinedError
from markupsafe import Markup

from runtime import files
from runtime.report.page import NAME
from runtime.report.signals import EMBEDDED_SCRIPTS, STATIC

_SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)
"""What is run; a script with a type is data."""


def filled(template: str, holes: Mapping[str, Any]) -> str:
    """A template of this room; the same bytes for the same holes."""
    page = _environment().get_template(template).render(holes, **_style())
    first = '<meta charset="utf-8">'
    return page.replace(first, f'{first}\n<meta http-equiv="Content-Security-Policy" content="{policy(page)}">', 1)


def part(template: str, macro: str, *holes: Any) -> Markup:
    """What a macro of a template of this room makes of its arguments, for the middle of another page.

    Raises ValueError where something that it shows is not among them.
    """
    try:
        made: Markup = getattr(_environment().get_template(template).module, macro)(*holes)
    except UndefinedError as error:
        raise ValueError(f"{macro}: {error}") from error
    return made


def stylesheet() -> str:
    """The report's style, for a page that shows the same parts."""
    return _environment().get_template("report.css.j2").render(**_style())


def script() -> str:
    """What sets the arm's picture in motion."""
    return _environment().get_template("arm_motion.js.j2").render()


def looking() -> Markup:
    """What draws signals whose numbers are in the page."""
    return Markup("\n".join((STATIC / name).read_text(encoding="utf-8") for name in EMBEDDED_SCRIPTS))


def _style() -> dict[str, Markup]:
    """What the report's style takes from that of the signals."""
    texts = {"colours": "colours.css", "signals_style": "signals.css"}
    return {name: Markup((STATIC / file).read_text(encoding="utf-8")) for name, file in texts.items()}


@cache
def _environment() -> Environment:
    return Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def policy(page: str) -> str:
    """What a browser may do with a page: show it and run its own scripts, known by what they say; load nothing, send
    nothing. Source: W3C, Content Security Policy Level 3."""
    scripts = [hashlib.sha256(text.encode()).digest() for text in _SCRIPT.findall(page)]
    known = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in scripts) or "'none'"
    # Figures are drawn with styles of their own.
    return (
        f"default-src 'none'; script-src {known}; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
        "form-action 'none'"
    )


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
