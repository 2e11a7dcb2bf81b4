"""What a designed motion promised of a recording, beside what the recording tells."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from runtime.documents.experiments import FirstMotionDocument
from runtime.documents.recordings import DeterminedParameter, PromiseEntry
from runtime.recordings.contents import RecordingError


def read_motion_document(path: Path) -> FirstMotionDocument:
    """What `tendon experiment --json` wrote of a motion. Raises RecordingError."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=FirstMotionDocument)
    except (OSError, msgspec.MsgspecError) as error:
        raise RecordingError(
            f"{path}: expected what tendon experiment MODEL --json FILE writes of a motion; {error}"
        ) from error


def promises(promised: Sequence[DeterminedParameter], told: Sequence[DeterminedParameter]) -> list[PromiseEntry]:
    """The parameters that both know, in the order of the promise."""
    found = {p.name: p for p in told}
    return [
        PromiseEntry(
            name=p.name,
            promised=p.told,
            told=found[p.name].told,
            promised_width=_width(p),
            width=_width(found[p.name]),
            unit=p.unit,
        )
        for p in promised
        if p.name in found
    ]


def _width(parameter: DeterminedParameter) -> float | None:
    return None if parameter.interval is None else parameter.interval[1] - parameter.interval[0]
