"""What the fields of a file contain before any of them is read as a signal: first values, range, a coarse picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from runtime.recordings.contents import Array, Contents, RecordedField, RecordingError
from runtime.recordings.settings import PREVIEW_FIRST, PREVIEW_PARTS, PREVIEW_TOGETHER


@dataclass(frozen=True)
class FieldPreview:
    """A field in the unit of the file. Without samples it is none of numbers.

    first           its first values
    least, largest  of all finite values
    outline         least and largest value in each of a few parts of the file, in their order
    """

    field: RecordedField
    samples: int = 0
    first: tuple[float, ...] = ()
    least: float = 0.0
    largest: float = 0.0
    outline: tuple[tuple[float, float], ...] = ()


def previews(contents: Contents) -> list[FieldPreview]:
    """Every field of a file, in its order."""
    found: dict[int, FieldPreview] = {}
    indices = sorted(range(len(contents.fields)), key=lambda k: contents.fields[k].clock)
    for _, clock in groupby(indices, key=lambda k: contents.fields[k].clock):
        members = list(clock)
        for start in range(0, len(members), PREVIEW_TOGETHER):
            for k, values in _loaded(contents, members[start : start + PREVIEW_TOGETHER]).items():
                found[k] = _preview(contents.fields[k], values)
    return [found.get(k, FieldPreview(field)) for k, field in enumerate(contents.fields)]


def _loaded(contents: Contents, together: Sequence[int]) -> dict[int, Array]:
    """The fields of one clock that are numbers, or dates and times."""
    try:
        table = contents.load({str(k): k for k in together})
    except RecordingError:
        half = len(together) // 2
        if half:
            return {**_loaded(contents, together[:half]), **_loaded(contents, together[half:])}
        try:
            return {together[0]: contents.load({"t": together[0]}).signals["t"]}
        except RecordingError:
            return {}
    return {k: table.signals[str(k)] for k in together}


def _preview(field: RecordedField, values: Array) -> FieldPreview:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return FieldPreview(field)
    parts = np.array_split(finite, min(PREVIEW_PARTS, len(finite)))
    return FieldPreview(
        field,
        len(values),
        tuple(finite[:PREVIEW_FIRST].tolist()),
        float(finite.min()),
        float(finite.max()),
        tuple((float(part.min()), float(part.max())) for part in parts),
    )
