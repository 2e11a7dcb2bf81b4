"""Pages that list the others: the cards of the first page, and llms.txt after https://llmstxt.org."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from gather import on_site, pages


def llms_txt(nav: list[dict[str, Any]], folder: Path) -> str:
    """Every page of the navigation with its first sentence, under its section; the links lead to the Markdown."""
    home = (folder / "README.md").read_text(encoding="utf-8")
    lines = ["# Tendon", "", f"> {first_paragraph(home)}"]
    section = ""
    for title, path in pages(nav):
        if title != section:
            lines += ["", f"## {title}", ""]
            section = title
        text = (folder / on_site(path)).read_text(encoding="utf-8")
        lines.append(f"- [{heading(text)}]({on_site(path)}): {summary(text)}")
    schemas = [(path, json.loads(path.read_bytes())) for path in sorted(folder.glob("schema/*"))]
    titles = [(path, made.get("title", f"what `tendon {path.stem} --json` writes")) for path, made in schemas]
    lines += ["", "## JSON schemas", "", *(f"- [{p.name}]({p.relative_to(folder)}): {title}." for p, title in titles)]
    return "\n".join(lines) + "\n"


def heading(text: str) -> str:
    """Title of a page."""
    found = re.search(r"^# (.*)$", text, re.MULTILINE)
    assert found, "a page without a title"
    return found[1]


def summary(text: str) -> str:
    """The first sentence of a page."""
    return re.split(r"(?<=[.?!:]) (?=[A-Z`])", first_paragraph(text), maxsplit=1)[0]


def first_paragraph(text: str) -> str:
    """The first paragraph of a page, without its marks."""
    blocks = text[text.index("# ") :].split("\n\n")[1:]
    prose = next(block for block in blocks if not re.match(r"#|\||```|<|- |!|:::|> ", block))
    return re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", " ".join(prose.split())).replace("**", "")


def cards(nav: list[dict[str, Any]], folder: Path) -> str:
    """What one may want to do, a card for each task page and for the gallery."""
    shown = [path for section, path in pages(nav) if section in ("Tasks", "Gallery")]
    found = [(path, (folder / on_site(path)).read_text(encoding="utf-8")) for path in shown]
    lines = [f"- **[{heading(text)}]({on_site(path)})**\n\n    {summary(text)}\n" for path, text in found]
    return "\n".join(["## What do you want to do?\n", '<div class="grid cards" markdown>\n', *lines, "</div>\n\n"])


def with_cards(home: str, made: str) -> str:
    """The first page with the cards ahead of its first heading."""
    head, mark, rest = home.partition("\n## ")
    return f"{head}\n{made}{mark.lstrip()}{rest}"
