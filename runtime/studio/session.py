"""A session: a folder that holds everything that was given and found, so that it can be opened again at any time.

    session.json     inputs and history; replaced as a whole
    given/           copies of the model file and the recordings
    recordings/      what was read: run.csv.columns.json of the columns of a recording, and for each way in which it was
                     read a folder with recording.json, joint1.npz ...
    steps/0/         model.toml, fitted.toml (with the fitted values), overview.json, joint1.npz ...,
                     and after its diagnosis verdict.json, report.html
    plans/1/         plan.json, page.html: the report's page of a trajectory
    work/            results of the running task; moved to their places once they are complete

A folder may come from somebody else: nothing in it is executed, and no name in it leads out of it.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
import shutil
from pathlib import Path
from typing import Literal, TypeVar

import msgspec
from msgspec.structs import replace

from runtime import files
from runtime.documents.parts import Document
from runtime.plain_json import plain
from runtime.studio.history import History, HistoryError, SessionStep
from runtime.studio.inputs import GivenFile, GivenRecording, Inputs
from runtime.studio.settings import MOST_NAME, MOST_RECORDINGS, MOST_SESSION, MOST_UNDONE
from symbolic.model_file.checks import quote

FILE = "session.json"
READING_DIGITS = 16
"""Hexadecimal digits in the name of a folder of what was read."""

SCHEMA: Literal[2] = 2
"""Version of that file."""

T = TypeVar("T")


class SessionError(ValueError):
    """A folder that is no session, or something that cannot be put into one; the message says why."""


class SessionState(Document, frozen=True, kw_only=True):
    """What session.json holds.

    inputs    as they are; the current step may have been fitted to others
    earlier   the inputs since then, to which undo returns, the next one last; later: those to which redo returns
    """

    schema: Literal[2]
    inputs: Inputs
    history: History
    earlier: tuple[Inputs, ...] = ()
    later: tuple[Inputs, ...] = ()

    @property
    def fitted(self) -> bool:
        """Whether the current step was fitted to the inputs as they are."""
        return self.history.here is not None and self.history.here.inputs == self.inputs

    @property
    def undoable(self) -> bool:
        here = self.history.here
        return bool(self.earlier) or (here is not None and here.parent is not None)

    @property
    def redoable(self) -> bool:
        return bool(self.history.undone or self.later)

    def given(self, inputs: Inputs) -> SessionState:
        """With other inputs. The steps stay."""
        earlier = (*self.earlier, self.inputs)[-MOST_UNDONE:]
        history = replace(self.history, undone=())
        return replace(self, inputs=inputs, history=history, earlier=earlier, later=())

    def with_steps(self, *steps: SessionStep) -> SessionState:
        """With further steps, the last of which becomes the current one."""
        return self._at(self.history.with_steps(*steps))

    def at(self, number: int) -> SessionState:
        """At any step, with its inputs."""
        return self._at(self.history.at(number))

    def undo(self) -> SessionState:
        """Without the last change of the inputs; where there is none, back to the step that the current one changes."""
        if self.earlier:
            later = (*self.later, self.inputs)
            return replace(self, inputs=self.earlier[-1], earlier=self.earlier[:-1], later=later)
        return self._at(self.history.undo())

    def redo(self) -> SessionState:
        """To what was undone last."""
        if self.history.undone:
            return self._at(self.history.redo())
        if not self.later:
            raise HistoryError("there is nothing to redo")
        earlier = (*self.earlier, self.inputs)
        return replace(self, inputs=self.later[-1], earlier=earlier, later=self.later[:-1])

    def _at(self, history: History) -> SessionState:
        assert history.here is not None
        return replace(self, inputs=history.here.inputs, history=history, earlier=(), later=())


def beginning(inputs: Inputs) -> SessionState:
    """Inputs without steps."""
    return SessionState(schema=SCHEMA, inputs=inputs, history=History())


class StudioSession:
    """A session's folder."""

    def __init__(self, folder: Path, state: SessionState) -> None:
        self.folder = folder.resolve()
        self.scratch = self.folder / "work"  # of results that are not complete
        self._state = state

    @classmethod
    def create(cls, folder: Path) -> StudioSession:
        """In a folder that does not exist or is empty. Raises SessionError, OSError."""
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise SessionError(f"{folder}: is not empty; expected a new folder for the session, or that of one")
        session = cls(folder, beginning(Inputs()))
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)  # recordings are the user's alone
        for name in ("given", "recordings", "steps"):
            (folder / name).mkdir()
        session.change(session.state)
        return session

    @classmethod
    def open(cls, folder: Path) -> StudioSession:
        """An existing session. Raises SessionError, OSError."""
        path = folder / FILE
        if not path.is_file():
            raise SessionError(f"{folder}: is no session of the studio; expected a folder with {FILE}")
        linked = next((p for p in folder.rglob("*") if p.is_symlink()), None)
        if linked is not None:
            raise SessionError(f"{linked}: is a link, which may lead out of the session; it cannot be opened")
        session = cls(folder, read(path, SessionState))
        every = [session.inputs, *session.state.earlier, *session.state.later]
        for inputs in (*every, *(step.inputs for step in session.history.steps)):
            given = [recording.given for recording in inputs.recordings]
            described = None if inputs.described is None else inputs.described.file
            for file in (*given, *filter(None, [inputs.model, described])):
                if not session.given(file).is_file():
                    lost = f"lacks given/{file.file}, which {FILE} names"
                    raise SessionError(f"{folder}: {lost}; the session is incomplete")
        return session

    def locked(self) -> int:
        """A file descriptor that holds the session's lock until it is closed or the process ends.

        Raises SessionError where another studio holds it.
        """
        lock = os.open(self.folder / ".lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(lock)
            raise SessionError(f"{self.folder}: is open in another studio; close that one first") from error
        return lock

    @property
    def state(self) -> SessionState:
        return self._state

    @property
    def inputs(self) -> Inputs:
        return self._state.inputs

    @property
    def history(self) -> History:
        return self._state.history

    def change(self, state: SessionState) -> None:
        """Write another state. Raises OSError."""
        self._state = state
        text = json.dumps(plain(state), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        files.replace(self.folder / FILE, text.encode(errors="replace"))

    def restart(self, inputs: Inputs) -> None:
        """With other inputs and an empty history; the folders of the steps move to `earlier/`."""
        old = self.folder / "steps"
        if any(old.iterdir()):
            aside = self.folder / "earlier"
            aside.mkdir(exist_ok=True)
            old.rename(aside / f"steps-{1 + sum(1 for _ in aside.iterdir())}")
            old.mkdir()
        self.change(beginning(inputs))

    def given(self, file: GivenFile) -> Path:
        """The path of a given file."""
        return self.folder / "given" / file.file

    def step(self, number: int) -> Path:
        """The folder of a step, from 0."""
        return self.folder / "steps" / str(number)

    def recording(self, given: GivenRecording) -> Path:
        """The folder of what was read of a recording in the way in which it is read now, for the model there is now."""
        model = None if self.inputs.model is None else self.inputs.model.file
        key = json.dumps(plain([given.given.file, given.reading, model, self.inputs.effects]))
        return self.folder / "recordings" / hashlib.sha256(key.encode()).hexdigest()[:READING_DIGITS]

    def columns(self, file: GivenFile) -> Path:
        """The document of what the columns of a recording contain, however it is read."""
        return self.folder / "recordings" / f"{file.file}.columns.json"

    def plan(self, number: int) -> Path:
        """The folder of a plan, from 1."""
        return self.folder / "plans" / str(number)

    def place_for(self, name: str) -> GivenFile:
        """A free name in `given/` for a file of any name."""
        taken = {path.name for path in (self.folder / "given").iterdir()}
        wanted = safe_name(name)
        stem, dot, ending = wanted.partition(".")
        candidates = (wanted, *(f"{stem}-{k}{dot}{ending}" for k in range(2, MOST_RECORDINGS + 3)))
        free = next((c for c in candidates if c not in taken), None)
        if free is None:
            raise SessionError(f"{quote(name)}: is given too often; give it another name")
        return GivenFile(free, Path(name).name or free)

    def copied(self, path: Path) -> GivenFile:
        """A copy of a file of this machine in `given/`. Raises OSError."""
        given = replace(self.place_for(path.name), origin=str(path))
        shutil.copyfile(path, self.given(given))
        return given


def read(path: Path, kind: type[T]) -> T:
    """A JSON document of a session. Raises SessionError: the file may be anyone's."""
    try:
        if path.stat().st_size > MOST_SESSION:
            raise SessionError(f"{path}: is larger than {MOST_SESSION // 1_000_000} MB")
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise SessionError(f"{path}: is no document of a session of this version: {reason}") from error


def safe_name(name: str) -> str:
    """A file name of letters, digits, dots, dashes and underscores, without folders, that keeps its endings."""
    kept = re.sub(r"[^A-Za-z0-9._-]+", "_", Path(name.replace("\\", "/")).name).lstrip("._-") or "file"
    if len(kept) <= MOST_NAME:
        return kept
    ending = "".join(Path(kept).suffixes[-2:])[-MOST_NAME // 2 :]
    return kept[: MOST_NAME - len(ending)] + ending
