"""A session: a folder that holds everything that was given and found, so that it can be opened again at any time.

    session.json     what was given, and the history of steps; replaced whole
    given/           model file and recordings, as they were given
    recordings/1/    what was read of the first recording: recording.json, joint1.npz ...
    steps/0/         model.toml (with the effects), fitted.toml (with the fitted values), shown.json, joint1.npz ...,
                     and once it is diagnosed verdict.json, report.html
    plans/1/         plan.json, page.html: the report's page of a plan that was opened
    work/            what a process is at; moved to its place when all of it is there

The folder may come from somebody else: nothing in it is run, and no name in it leads out of it.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from runtime import files
from runtime.plain_json import plain
from runtime.studio.history import History, HistoryError
from runtime.studio.settings import MOST_NAME, MOST_RECORDINGS, MOST_SESSION
from symbolic.model_file.checks import quote

SCHEMA = 1
FILE = "session.json"
_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]*", re.ASCII)


class SessionError(ValueError):
    """A folder that is no session, or something that cannot be put into one; the message says why."""


@dataclass(frozen=True)
class GivenFile:
    """A file in `given/`: its name there, what people call it, and for a command line where it came from.

    origin   a path as it was typed; None: it was sent by a browser
    """

    file: str
    name: str
    origin: str | None = None

    @property
    def typed(self) -> str:
        """What stands for it on a command line."""
        return self.name if self.origin is None else self.origin


@dataclass(frozen=True)
class GivenRecording:
    """A recording, and whether it is fitted or held out to judge on."""

    given: GivenFile
    held_out: bool = False


@dataclass(frozen=True)
class Inputs:
    """Everything that a session works on.

    like   the arm of Tendon whose model file was taken
    maps   entries of `--map`; allow_gaps: as on the command line
    effects   the name of a file of the user's own effects that belongs to it; it is no part of the folder, since it is
              code: whoever opens the session says again where it is
    """

    model: GivenFile | None = None
    like: str | None = None
    recordings: tuple[GivenRecording, ...] = ()
    maps: tuple[str, ...] = ()
    allow_gaps: bool = False
    effects: str | None = None

    @property
    def fitted(self) -> tuple[GivenRecording, ...]:
        return tuple(r for r in self.recordings if not r.held_out)

    @property
    def held_out(self) -> tuple[GivenRecording, ...]:
        return tuple(r for r in self.recordings if r.held_out)

    @property
    def complete(self) -> bool:
        """Whether there is a model and something to fit it to."""
        return self.model is not None and bool(self.fitted)


@dataclass(frozen=True)
class SessionState:
    """What session.json holds."""

    inputs: Inputs = field(default_factory=Inputs)
    history: History = field(default_factory=History)


class StudioSession:
    """A session's folder."""

    def __init__(self, folder: Path, state: SessionState) -> None:
        self.folder = folder.resolve()
        self._state = state

    @classmethod
    def create(cls, folder: Path) -> StudioSession:
        """In a folder that is not there or empty. Raises SessionError, OSError."""
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise SessionError(f"{folder}: is not empty; expected a new folder for the session, or that of one")
        session = cls(folder, SessionState())
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)  # recordings are the user's alone
        for name in ("given", "recordings", "steps"):
            (folder / name).mkdir()
        session._write()
        return session

    @classmethod
    def open(cls, folder: Path) -> StudioSession:
        """One that is there. Raises SessionError, OSError."""
        path = folder / FILE
        if not path.is_file():
            raise SessionError(f"{folder}: is no session of the studio; expected a folder with {FILE}")
        linked = next((p for p in folder.rglob("*") if p.is_symlink()), None)
        if linked is not None:
            raise SessionError(f"{linked}: is a link, which may lead out of the session; it cannot be opened")
        session = cls(folder, _read(path))
        missing = [given.file for given in session._given() if not session.given(given).is_file()]
        if missing:
            raise SessionError(f"{folder}: lacks given/{missing[0]}, which {FILE} names; the session cannot be opened")
        return session

    def claimed(self) -> int:
        """A descriptor that holds the session for one server; closed, or its process ended, another may open it.

        Raises SessionError where it is open already.
        """
        held = os.open(self.folder / ".lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(held)
            raise SessionError(f"{self.folder}: is open in another studio; close that one first") from error
        return held

    def tidy(self) -> None:
        """Take away what a process left that was ended."""
        shutil.rmtree(self.scratch, ignore_errors=True)

    @property
    def inputs(self) -> Inputs:
        return self._state.inputs

    @property
    def history(self) -> History:
        return self._state.history

    @property
    def scratch(self) -> Path:
        """Where a process writes what is not finished."""
        return self.folder / "work"

    def change(self, inputs: Inputs | None = None, history: History | None = None) -> None:
        """Write what was given, or the history, anew. Raises OSError."""
        self._state = SessionState(inputs or self.inputs, history or self.history)
        self._write()

    def started_over(self, inputs: Inputs) -> None:
        """With other inputs: the steps, which are those of the earlier ones, are put aside."""
        old = self.folder / "steps"
        if any(old.iterdir()):
            aside = self.folder / "earlier"
            aside.mkdir(exist_ok=True)
            old.rename(aside / f"steps-{1 + sum(1 for _ in aside.iterdir())}")
            old.mkdir()
        self._state = SessionState(inputs, History())
        self._write()

    # --- files ---

    def given(self, file: GivenFile) -> Path:
        """Where a given file lies."""
        return self.folder / "given" / file.file

    def step(self, number: int) -> Path:
        """The folder of a step."""
        return self.folder / "steps" / str(int(number))

    def recording(self, number: int) -> Path:
        """The folder of what was read of a recording, from 1."""
        return self.folder / "recordings" / str(int(number))

    def plan(self, number: int) -> Path:
        """The folder of a plan, from 1."""
        return self.folder / "plans" / str(int(number))

    def place_for(self, name: str) -> GivenFile:
        """A name in `given/` that is free, for a file of any name."""
        taken = {path.name for path in (self.folder / "given").iterdir()}
        wanted = safe_name(name)
        stem, dot, ending = wanted.partition(".")
        candidates = (wanted, *(f"{stem}-{k}{dot}{ending}" for k in range(2, MOST_RECORDINGS + 3)))
        free = next((c for c in candidates if c not in taken), None)
        if free is None:
            raise SessionError(f"{quote(name)}: is given too often; give it another name")
        return GivenFile(free, Path(name).name or free)

    def copied(self, path: Path) -> GivenFile:
        """A file of this machine, taken into the session. Raises OSError."""
        given = replace(self.place_for(path.name), origin=str(path))
        shutil.copyfile(path, self.given(given))
        return given

    def document(self, path: Path) -> Any:
        """What a JSON file of this session holds; None where it is not there. Raises SessionError."""
        try:
            return _json(path) if path.is_file() else None
        except (ValueError, RecursionError) as error:
            raise SessionError(f"{path}: is no JSON of a session: {error}") from error

    def _given(self) -> list[GivenFile]:
        model = [] if self.inputs.model is None else [self.inputs.model]
        return [*model, *(r.given for r in self.inputs.recordings)]

    def _write(self) -> None:
        document = {"schema": SCHEMA, "inputs": asdict(self.inputs), "history": self.history.to_json()}
        text = json.dumps(plain(document), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        files.replace(self.folder / FILE, text.encode(errors="backslashreplace"))


def safe_name(name: str) -> str:
    """A file's name of letters, digits, dots, dashes that is no hidden file, leads nowhere and keeps its endings."""
    kept = re.sub(r"[^A-Za-z0-9._-]+", "_", Path(name.replace("\\", "/")).name).lstrip("._-") or "file"
    if len(kept) <= MOST_NAME:
        return kept
    ending = "".join(Path(kept).suffixes[-2:])[-MOST_NAME // 2 :]
    return kept[: MOST_NAME - len(ending)] + ending


def _read(path: Path) -> SessionState:
    try:
        document = _json(path)
        if not isinstance(document, dict) or document.get("schema") != SCHEMA:
            raise SessionError(f"{path}: is no session of this version; expected schema {SCHEMA}")
        return SessionState(_inputs(document["inputs"]), History.of_json(document["history"]))
    except HistoryError as error:
        raise SessionError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        if isinstance(error, SessionError):
            raise
        raise SessionError(f"{path}: is no session of the studio: {error}") from error


def _json(path: Path) -> Any:
    if path.stat().st_size > MOST_SESSION:
        raise ValueError(f"it is larger than {MOST_SESSION // 1_000_000} MB")
    return json.loads(path.read_bytes())


def _inputs(document: Mapping[str, Any]) -> Inputs:
    entries = cast(list[Mapping[str, Any]], document["recordings"])
    if len(entries) > MOST_RECORDINGS:
        raise ValueError(f"{len(entries)} recordings; expected at most {MOST_RECORDINGS}")
    return Inputs(
        None if document["model"] is None else _file(document["model"]),
        _text(document["like"]),
        tuple(GivenRecording(_file(e["given"]), bool(e["held_out"])) for e in entries),
        tuple(str(entry) for entry in document["maps"]),
        bool(document["allow_gaps"]),
        _text(document["effects"]),
    )


def _file(entry: Mapping[str, Any]) -> GivenFile:
    file = str(entry["file"])
    if not _PLAIN.fullmatch(file) or file in (os.curdir, os.pardir):
        raise ValueError(f"{quote(file)} is no name of a file in given/")
    return GivenFile(file, str(entry["name"]), _text(entry["origin"]))


def _text(value: object) -> str | None:
    return None if value is None else str(value)
