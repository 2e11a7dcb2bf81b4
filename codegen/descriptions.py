"""Descriptions of the shipped effects without their equations, so that a model file can be read without SymPy.

The committed file is generated from the declarations by `python -m codegen.descriptions`; a test keeps it up to date.
It is used while the hash of the sources matches; otherwise the declarations are read.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parent.parent / "symbolic" / "effects" / "described.json"
SOURCES = ("symbolic/effects/*.py", "symbolic/described.py", "symbolic/units.py", "symbolic/primitives.py")
"""Sources of the declarations, besides codegen/metadata.py, which describes them."""


def described(space: bool) -> list[dict[str, object]]:
    """`effects` of effects.json, for planar or for spatial arms."""
    page = _page()
    found: list[dict[str, object]] = page[_key(space)] if page.get("sources") == _sources() else _declared(space)
    return found


def text() -> str:
    """The content of the committed file."""
    return json.dumps({"sources": _sources(), **{_key(space): _declared(space) for space in (False, True)}}) + "\n"


@functools.cache
def _page() -> Mapping[str, Any]:
    page: Mapping[str, Any] = json.loads(PAGE.read_text(encoding="utf-8")) if PAGE.is_file() else {}
    return page


def _key(space: bool) -> str:
    return "space" if space else "plane"


def _declared(space: bool) -> list[dict[str, object]]:
    from codegen import metadata
    from symbolic.effects import shipped

    effects: list[dict[str, object]] = json.loads(metadata.text(metadata.library(tuple(shipped(space).values()))))[
        "effects"
    ]
    return effects


@functools.cache
def _sources() -> str:
    """A hash of everything that declares and describes."""
    root, digest = Path(__file__).parent.parent, hashlib.sha256()
    for path in (*(p for pattern in SOURCES for p in sorted(root.glob(pattern))), root / "codegen" / "metadata.py"):
        # In a wheel the same sources import from the package tendon.
        text = path.read_bytes().replace(b"from tendon.", b"from ")
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + text + b"\0")
    return digest.hexdigest()


if __name__ == "__main__":
    PAGE.write_text(text(), encoding="utf-8")
