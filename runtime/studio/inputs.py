"""What a session works on: a model file and recordings, each with how it is read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from runtime.documents.models import ImportDocument
from runtime.documents.parts import Document
from runtime.studio.settings import MOST_RECORDINGS


class GivenFile(Document, frozen=True):
    """A file in `given/`: its name there, its original name, and its path as typed; None: a browser sent it."""

    file: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_][A-Za-z0-9._-]*\Z")]
    name: str
    origin: str | None = None

    @property
    def typed(self) -> str:
        """The file on a command line."""
        return self.name if self.origin is None else self.origin


class GivenReading(Document, frozen=True):
    """How a recording is read: entries of `--map`, and whether it is split at gaps, as on the command line."""

    maps: tuple[str, ...] = ()
    allow_gaps: bool = False

    def but(self, maps: Sequence[str] = (), allow_gaps: bool = False) -> GivenReading:
        """With further entries, each in the place of an earlier one of the same signal."""
        signals = {_signal(entry) for entry in maps}
        kept = (entry for entry in self.maps if _signal(entry) not in signals)
        return GivenReading((*kept, *maps), self.allow_gaps or allow_gaps)


def _signal(entry: str) -> str:
    return entry.partition("=")[0].strip()


class GivenRecording(Document, frozen=True):
    """A recording, and whether it is held out: not fitted, only compared."""

    given: GivenFile
    held_out: bool = False
    reading: GivenReading = GivenReading()


class DescribedArm(Document, frozen=True, kw_only=True):
    """A URDF or MJCF from which a model file is made, or cannot be made before base and tip are chosen.

    links      its links
    base, tip  those that were chosen; None: the root, and the only end
    made       what was made of it
    problem    why nothing was; "" otherwise
    """

    file: GivenFile
    links: tuple[str, ...]
    base: str | None = None
    tip: str | None = None
    made: ImportDocument | None = None
    problem: str = ""


class Inputs(Document, frozen=True, kw_only=True):
    """What a session works on.

    like       the shipped arm whose model file was taken
    described  the robot description from which the model file is made
    constants  joint -> torque constant at its output, N m/A, that was stated here and not in the file that was given
    effects    name of the file of the user's own effects. The file is code and no part of the folder: whoever opens
               the session names it again
    """

    model: GivenFile | None = None
    like: str | None = None
    described: DescribedArm | None = None
    constants: dict[int, float] = msgspec.field(default_factory=dict)
    recordings: Annotated[tuple[GivenRecording, ...], Meta(max_length=MOST_RECORDINGS)] = ()
    effects: str | None = None

    @property
    def fitted(self) -> tuple[GivenRecording, ...]:
        return tuple(r for r in self.recordings if not r.held_out)

    @property
    def held_out(self) -> tuple[GivenRecording, ...]:
        return tuple(r for r in self.recordings if r.held_out)

    @property
    def complete(self) -> bool:
        """Whether there is a model and a recording to fit it to."""
        return self.model is not None and bool(self.fitted)

    def of(self, file: str) -> GivenRecording | None:
        """The recording with a name in `given/`."""
        return next((r for r in self.recordings if r.given.file == file), None)

    def changed(self, file: str, **values: Any) -> Inputs:
        """With other values of the recording with a name in `given/`."""
        every = (replace(r, **values) if r.given.file == file else r for r in self.recordings)
        return replace(self, recordings=tuple(every))
