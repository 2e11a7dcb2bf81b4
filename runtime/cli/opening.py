"""The model file that a verb is given, opened; what its reader has to say beside errors is said once."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from runtime.workspace.source import Source


def opened(model: Path, effects: Path | None) -> Source:
    """The model file read and checked. Raises ModelError, UsageError."""
    source = Source.read(model, effects)
    tell(source)
    return source


def tell(source: Source) -> None:
    """The notes of a model file, a line each on standard error: standard output may be JSON alone."""
    for note in source.arm().notes:
        print(note, file=sys.stderr)


def check_hidden(source: Source, option: str, texts: Sequence[str]) -> None:
    """What stands behind --hide or --set, before the model is built. Raises SimulationError."""
    if not texts:
        return
    from runtime.simulation.simulate import hidden_in

    arm = source.arm()
    for text in texts:
        hidden_in(text, source.effects, [joint.name for joint in arm.joints], arm.name, option)
