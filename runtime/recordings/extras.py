"""Packages that only some formats need: asked for by name where they lack."""

from __future__ import annotations

import sys
from importlib.util import find_spec

from runtime.recordings.errors import Refusal


def require(package: str, extra: str, what: str, refuse: Refusal) -> None:
    """Refuses a file for which a package lacks, and says how to get it. what: the format or the part of it."""
    if find_spec(package) is None:
        refuse(
            f"{what} needs {package}, the extra `{extra}` (pip install -e '.[{extra}]'); "
            f"run: {sys.executable} -m pip install {package}"
        )
