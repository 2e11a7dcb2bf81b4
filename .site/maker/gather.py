"""Gathers the pages of the site from the repository into one folder, which keeps the repository's paths.

Links between pages hold as they stand. A link to a file that is no page becomes the file's name: the site has no
source browser. Dotfolders lose their dot, as the site's builder leaves them out.
"""

from __future__ import annotations

import os
import re
import shutil
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
CONFIGURATION = ROOT / ".site" / "zensical.toml"
PICTURES = ".images"
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
_SOURCE = re.compile(r'(src|href)="([^"]+)"')
_ROW = re.compile(r"^\|.*$", re.MULTILINE)
_CODE = re.compile(r"`[^`]+`")
_FENCED = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)

Makers = Mapping[str, Callable[[], str]]
"""Path of a page that is made when the site is built -> what makes its text."""


def navigation(makers: Makers) -> list[dict[str, Any]]:
    """The configured navigation with its patterns filled in: section -> its pages, a path or {title: path} each."""
    nav: list[dict[str, Any]] = tomllib.loads(CONFIGURATION.read_text(encoding="utf-8"))["project"]["nav"]
    named = {path for _, path in pages(nav)}

    def filled(entry: Any) -> list[Any]:
        if isinstance(entry, dict) or "*" not in entry:
            return [entry]
        found = (path.relative_to(ROOT).as_posix() for path in sorted(ROOT.glob(entry)))
        return [path for path in found if path not in named]

    made = [{name: [page for e in entries for page in filled(e)]} for s in nav for name, entries in s.items()]
    made = [section for section in made if any(section.values())]
    missing = [path for _, path in pages(made) if path not in makers and not (ROOT / path).is_file()]
    if missing:
        raise SystemExit(f"{CONFIGURATION}: nav names {', '.join(missing)}; there is no such file")
    return made


def pages(nav: list[dict[str, Any]]) -> Iterator[tuple[str, str]]:
    """Section and path of every page."""
    for section in nav:
        for title, entries in section.items():
            for entry in entries:
                yield title, next(iter(entry.values())) if isinstance(entry, dict) else entry


def on_site(path: str) -> str:
    """Path of a page or picture of the repository on the site."""
    return "/".join(part.removeprefix(".") if part not in (".", "..") else part for part in path.split("/"))


def gather(folder: Path, nav: list[dict[str, Any]], makers: Makers) -> None:
    """Write all pages of the navigation, and the pictures, into a new folder."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(ROOT / PICTURES, folder / on_site(PICTURES))
    known = {path for _, path in pages(nav)}
    for path in sorted(known):
        text = makers[path]() if path in makers else (ROOT / path).read_text(encoding="utf-8")
        target = folder / on_site(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(linked(text, path, known), encoding="utf-8")


def linked(text: str, path: str, known: set[str]) -> str:
    """A page's text with its links turned to the site; fenced blocks stay."""
    parts = _FENCED.split(text)
    return "".join(part if k % 2 else _turned(part, path, known) for k, part in enumerate(parts))


def _turned(text: str, path: str, known: set[str]) -> str:
    def link(match: re.Match[str]) -> str:
        picture, label, target = match.groups()
        if "://" in target or target.startswith(("#", "mailto:")):
            return match[0]
        file, _, anchor = target.partition("#")
        aim = _aim(path, file)
        if aim not in known and not (ROOT / aim).exists():
            raise SystemExit(f"{path}: links to {target}; there is no such file")
        if aim not in known and not aim.startswith(PICTURES):
            named = label.strip("`") == os.path.basename(aim)
            return f"`{aim}`" if named else label if "`" in label or aim in label else f"{label} (`{aim}`)"
        return f"{picture}[{label}]({_way(path, aim)}{'#' * bool(anchor)}{anchor})"

    def source(match: re.Match[str]) -> str:
        attribute, target = match.groups()
        inside = "://" not in target and not target.startswith("#")
        return f'{attribute}="{_way(path, _aim(path, target))}"' if inside else match[0]

    # In code, the site's builder needs no backslash before the bar that ends a cell elsewhere, and would show it.
    plain = _ROW.sub(lambda row: _CODE.sub(lambda code: code[0].replace("\\|", "|"), row[0]), text)
    return _SOURCE.sub(source, _LINK.sub(link, plain))


def _aim(path: str, target: str) -> str:
    """The file of the repository to which a relative link of a page leads."""
    return (ROOT / path).parent.joinpath(target).resolve().relative_to(ROOT).as_posix()


def _way(path: str, aim: str) -> str:
    """The relative link from a page of the site to another file of it."""
    return os.path.relpath(on_site(aim), os.path.dirname(on_site(path)) or ".")
