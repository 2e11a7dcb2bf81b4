"""Builds the site: `make site`, or `python .site/maker/build.py [FOLDER]`; its pages open without a server."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from json import dumps
from pathlib import Path
from typing import Any

import tomlkit
from gather import CONFIGURATION, ROOT, gather, navigation, on_site
from listings import cards, llms_txt, with_cards
from references import DOCUMENTS, KEYS, PAGES, SOURCES

from runtime.documents.verbs import BY_VERB, schema

HERE = Path(__file__).resolve().parent
ROOM = HERE.parent
WORKER = "https://unpkg.com/iframe-worker/shim"
"""What the builder fetches so that the search works without a server; the site has worker.js for it."""
SCHEMAS = ROOT / "symbolic" / "schema"


def build(folder: Path) -> Path:
    """Gather and build into a folder; the site's first page. Raises SystemExit with what was said of a broken page."""
    folder.mkdir(parents=True, exist_ok=True)
    nav = navigation(PAGES)
    pages = folder / "pages"
    gather(pages, nav, PAGES)
    for name in ("site.css", "logo.svg", "worker.js"):
        shutil.copy(ROOM / name, pages / name)
    shutil.copytree(SCHEMAS, pages / "schema")
    for verb in BY_VERB:
        (pages / "schema" / f"{verb}.json").write_text(dumps(schema(verb), indent=1), encoding="utf-8")
    (pages / "llms.txt").write_text(llms_txt(nav, pages), encoding="utf-8")
    home = pages / "README.md"
    home.write_text(with_cards(home.read_text(encoding="utf-8"), cards(nav, pages)), encoding="utf-8")
    configured(folder, nav)
    shutil.rmtree(folder / "site", ignore_errors=True)
    command = [sys.executable, "-m", "zensical", "build", "--clean", "--strict", "-f", "zensical.toml"]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if run.returncode:
        raise SystemExit(f"{run.stdout}{run.stderr}")
    site = folder / "site"
    for made in site.rglob("*.html"):
        ours = os.path.relpath(site / "worker.js", made.parent)
        made.write_text(linked_documents(made.read_text(encoding="utf-8").replace(WORKER, ours)), encoding="utf-8")
    for page in pages.rglob("*.md"):
        shutil.copy(page, site / page.relative_to(pages))
    for page, made_for_readers in SOURCES.items():
        (site / page).write_text(made_for_readers(), encoding="utf-8")
    return site / "index.html"


def linked_documents(html: str) -> str:
    """A page on which the documents in the types of attributes lead to their keys."""

    def link(match: re.Match[str]) -> str:
        known = match[1] in DOCUMENTS
        return f'<a href="{KEYS.replace(".md", ".html")}#{match[1].lower()}">{match[0]}</a>' if known else match[0]

    return re.sub(r'<span class="n">([A-Z]\w+)</span>', link, html)


def configured(folder: Path, nav: list[dict[str, Any]]) -> None:
    """Write the configuration with its navigation filled in, and with where the sources stand."""
    settings = tomlkit.parse(CONFIGURATION.read_text(encoding="utf-8"))
    project: Any = settings["project"]
    project["nav"] = placed(nav)
    python = project["plugins"]["mkdocstrings"]["handlers"]["python"]
    python["paths"] = [str(ROOT), str(ROOT / "runtime" / "import_name")]
    python["options"]["extensions"] = [str(HERE / "docstrings.py")]
    (folder / "zensical.toml").write_text(tomlkit.dumps(settings), encoding="utf-8")


def placed(nav: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The navigation with the pages' paths on the site."""
    return [
        {
            section: [
                {title: on_site(path) for title, path in entry.items()} if isinstance(entry, dict) else on_site(entry)
                for entry in entries
            ]
            for section, entries in part.items()
        }
        for part in nav
    ]


if __name__ == "__main__":
    where = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOM / "built"
    print(f"Site: {build(where.resolve())}")
