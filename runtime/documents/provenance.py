"""What a result was made from and when: version, files with their hashes, and the command; and a report made again."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from hashlib import file_digest, sha256
from pathlib import Path
from typing import Annotated

from msgspec import UnsetType, field

from runtime.documents.parts import Document, key
from runtime.version import VERSION


class InputFile(Document, frozen=True, kw_only=True):
    """A file that was read."""

    typed: Annotated[str, key("its name as it was typed")]
    path: Annotated[str, key("its full name")]
    sha256: Annotated[str | None, key("SHA-256 of its bytes, hexadecimal; null if it is no file: a pipe, or arrays")]

    @classmethod
    def of(cls, typed: Path, path: Path | None = None) -> InputFile:
        """path: where it is; default: as typed. Raises OSError."""
        there = (path or typed).resolve()
        return cls(typed=str(typed), path=str(there), sha256=digest(there))


class Provenance(Document, frozen=True, kw_only=True):
    """What a result was made from, and when."""

    verb: Annotated[str, key("the verb that made it")]
    command: Annotated[str | None, key("the command line; null in a notebook and in the studio")]
    folder: Annotated[str, key("the working directory")]
    date: Annotated[str, key("when, UTC, ISO 8601; SOURCE_DATE_EPOCH in its place if the environment sets it")]
    version: Annotated[str, key("version of Tendon")]
    model: Annotated[InputFile | None, key("model file; null if there was none")]
    model_text: Annotated[str | None, key("its text")]
    recordings: Annotated[list[InputFile], key("recordings that were fitted or inspected")]
    held_out: Annotated[list[InputFile], key("recordings that were held out")]
    effects: Annotated[InputFile | None, key("file of the user's own effects; null without one")]
    maps: Annotated[list[str], key("entries of --map and --columns")]
    allow_gaps: Annotated[bool, key("whether recordings were split at gaps")]
    further: Annotated[list[InputFile], key("a scenario, a trajectory or a motion that was read")] = field(
        default_factory=list
    )

    @classmethod
    def of(
        cls,
        verb: str,
        model: InputFile | None,
        text: str | None,
        recordings: Iterable[InputFile] = (),
        held_out: Iterable[InputFile] = (),
        *,
        command: str | None = None,
        effects: InputFile | None = None,
        maps: Iterable[str] = (),
        allow_gaps: bool = False,
        further: Iterable[InputFile] = (),
    ) -> Provenance:
        """Of a result of this version that is made now in the working directory."""
        return cls(
            verb=verb,
            command=command,
            folder=str(Path.cwd()),
            date=now(),
            version=VERSION,
            model=model,
            model_text=text,
            recordings=list(recordings),
            held_out=list(held_out),
            effects=effects,
            maps=list(maps),
            allow_gaps=allow_gaps,
            further=list(further),
        )

    @property
    def files(self) -> Iterator[tuple[str, InputFile]]:
        """Every file with its part in the result."""
        if self.model is not None:
            yield "model", self.model
        read = "replayed" if self.verb == "replay" else "fitted"
        yield from ((read, file) for file in self.recordings)
        yield from (("held out", file) for file in self.held_out)
        yield from (("also read", file) for file in self.further)
        if self.effects is not None:
            yield "effects", self.effects


class ReportDocument(Document, frozen=True, kw_only=True):
    """The page made again: `tendon report --json`."""

    page: Annotated[str, key("path of the page")]
    plots: Annotated[bool, key("whether the result was computed again from its files, so that the page has its plots")]
    why_not: Annotated[list[str], key("why it was not, a sentence each; empty if it was")]


Origin = Annotated[Provenance | UnsetType, key("what it was made from, and when; absent where no verb made it")]


def digest(path: Path) -> str | None:
    """SHA-256 of a file, or of the names and hashes of the files in a folder; None for a pipe. Raises OSError."""
    if path.is_dir():
        below: Sequence[Path] = sorted(file for file in path.rglob("*") if file.is_file())
        lines = "".join(f"{digest(file)}  {file.relative_to(path).as_posix()}\n" for file in below)
        return sha256(lines.encode()).hexdigest()
    if not path.is_file():
        return None
    with path.open("rb") as opened:
        return file_digest(opened, "sha256").hexdigest()


def now() -> str:
    """The date for a result; SOURCE_DATE_EPOCH holds seconds since 1970 (reproducible-builds.org)."""
    fixed = os.environ.get("SOURCE_DATE_EPOCH", "")
    moment = datetime.fromtimestamp(int(fixed), UTC) if re.fullmatch("[0-9]{1,11}", fixed) else datetime.now(UTC)
    return moment.isoformat(timespec="seconds").replace("+00:00", "Z")
