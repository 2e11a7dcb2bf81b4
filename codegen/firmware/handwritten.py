"""The firmware's C that is the same for every arm: written by hand in tree/, copied as it stands."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

TREE = Path(__file__).resolve().parent / "tree"
BOARD_SIDE = ("src/main.c",)
"""Of src/: what calls a board. The rest is the machine, which of a board knows its ceilings alone."""


@functools.cache
def handwritten_files() -> Mapping[str, str]:
    """Relative path in the firmware's tree -> text, in order."""
    found = {path.relative_to(TREE).as_posix(): path for path in TREE.rglob("*.[ch]")}
    return MappingProxyType({path: found[path].read_text(encoding="utf-8") for path in sorted(found)})


def machine_sources() -> dict[str, str]:
    """Those of the machine, which call no board."""
    files = handwritten_files()
    return {path: files[path] for path in files if path.startswith("src/") and path not in BOARD_SIDE}
