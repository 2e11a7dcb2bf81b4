"""The HTML page: sections and figures as elements, with every text escaped."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, UndefinedError
from markupsafe import Markup, escape

from runtime import files
from runtime.report.page import NAME
from runtime.report.sections import Group, Section
from runtime.report.signals import EMBEDDED_SCRIPTS, STATIC

if TYPE_CHECKING:
    from runtime.report.page.page_figures import Drawn

_SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)
"""Scripts that are run; one with a type is data."""


@dataclass(frozen=True)
class ReportPage:
    """A report: its head, its groups of sections, and the figures that these name.

    kind, tag   colour and words of the badge          short      sections at the head
    made        when, and by which version; "" where that is unknown
    drawings    elements of figures by name            document   the result as JSON, embedded for other programs
    """

    title: str
    model: str
    kind: str
    tag: str
    headline: str
    short: Sequence[Section]
    groups: Sequence[Group]
    drawings: Mapping[str, Markup]
    document: Mapping[str, Any]
    made: str = ""

    def html(self) -> str:
        """The page; the same bytes for the same content."""
        drawn = "".join(self.drawings.values())
        sources = {"<arm-motion": script, "<tendon-signals": signal_scripts}
        scripts = [source() for element, source in sources.items() if element in drawn]
        template = _environment().get_template("page.html.j2")
        made = template.render(page=self, scripts=map(Markup, scripts), document=embedded(self.document), **_style())
        first = '<meta charset="utf-8">'
        known = f'<meta http-equiv="Content-Security-Policy" content="{policy(made)}">'
        return made.replace(first, f"{first}\n{known}", 1)

    def write(self, directory: Path) -> Path:
        """Write the page into a directory, which is made if it is not there. Raises OSError."""
        directory = Path(directory)
        directory.mkdir(parents=True, exist_ok=True)
        path = directory / NAME
        files.replace(path, self.html().encode("utf-8", "backslashreplace"))
        return path


def fragment(sections: Sequence[Section], level: int = 3) -> Markup:
    """Sections as HTML to embed in a page, without figures; level: of the headings."""
    return part("sections.html.j2", "shown", sections, {}, level)


def figure(drawn: Drawn) -> Markup:
    """A figure with its caption."""
    caption = escape(drawn.caption)
    return Markup(f"<figure>\n{drawn.svg}\n<figcaption>{caption}</figcaption>\n</figure>")


def add_figures(drawings: dict[str, Markup], figures: Sequence[Drawn], prefix: str) -> tuple[str, ...]:
    """The names under which figures are put among the drawings of a page."""
    names = tuple(f"{prefix}-{k}" for k in range(len(figures)))
    drawings.update({name: figure(one) for name, one in zip(names, figures, strict=True)})
    return names


def part(template: str, macro: str, *holes: Any) -> Markup:
    """The output of a template's macro for its arguments, to embed in a page.

    Raises ValueError if a value that it shows is missing.
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
    """The script that animates the arm."""
    return _environment().get_template("arm_motion.js.j2").render()


def signal_scripts() -> Markup:
    """The scripts that draw embedded signals."""
    return Markup("\n".join((STATIC / name).read_text(encoding="utf-8") for name in EMBEDDED_SCRIPTS))


def _style() -> dict[str, Markup]:
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
    """Content security policy: a browser runs the page's own scripts, known by their hashes, and loads nothing.

    Source: W3C, Content Security Policy Level 3.
    """
    scripts = [hashlib.sha256(text.encode()).digest() for text in _SCRIPT.findall(page)]
    known = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in scripts) or "'none'"
    # SVG figures have inline styles.
    return (
        f"default-src 'none'; script-src {known}; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
        "form-action 'none'"
    )


def embedded(document: Mapping[str, Any]) -> str:
    """JSON for a script element; `<` is escaped, so that no text ends the element."""
    return json.dumps(document, indent=1, allow_nan=False).replace("<", "\\u003c")
