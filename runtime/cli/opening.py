"""The model file that a verb is given, opened; what its reader has to say beside errors is said once."""

from __future__ import annotations

import sys
from pathlib import Path

from runtime.workspace import Source


def opened(model: Path, effects: Path | None) -> Source:
    """The model file read and checked. Raises ModelError, UsageError."""
    source = Source.read(model, effects)
    tell(source)
    return source


def tell(source: Source) -> None:
    """The notes of a model file, a line each on standard error: standard output may be JSON alone."""
    for note in source.arm().notes:
        print(note, file=sys.stderr)
