"""A session: a folder that holds everything that was given and found, so that it can be opened again at any time.

    session.json     inputs and history; replaced as a whole
    given/           copies of the model file and the recordings
    recordings/1/    what was read of the first recording: recording.json, joint1.npz ...
    steps/0/         model.toml, fitted.toml (with the fitted values), overview.json, joint1.npz ...,
                     and after its diagnosis verdict.json, report.html
    plans/1/         plan.json, page.html: the report's page of a trajectory
    work/            results of the running task; moved to their places once they are complete

A folder may come from somebody else: nothing in it is executed, and no name in it leads out of it.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import shlex
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from runtime import files
from runtime.documents.parts import Document
from runtime.model.terms import Term
from runtime.plain_json import plain
from runtime.report.summary import Invocation, reading
from runtime.studio.settings import MOST_NAME, MOST_RECORDINGS, MOST_SESSION
from symbolic.model_file.checks import quote

FILE = "session.json"

T = TypeVar("T")
Kind = Literal["given", "added", "without"]
"""How a step was made: the model as given, effects added, or an effect left out."""
Verdict = Literal["effect", "clean", "unexplained", "refused"]
JointNumber = Annotated[int, Meta(ge=1)]
Magnitude = Annotated[float, Meta(ge=0)]


class SessionError(ValueError):
    """A folder that is no session, or something that cannot be put into one; the message says why."""


class HistoryError(ValueError):
    """A move in the history that is not possible, or a step that does not exist; the message says which."""


# Inputs


class GivenFile(Document, frozen=True):
    """A file in `given/`: its name there, its original name, and its path as typed; None: a browser sent it."""

    file: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_][A-Za-z0-9._-]*\Z")]
    name: str
    origin: str | None = None

    @property
    def typed(self) -> str:
        """The file on a command line."""
        return self.name if self.origin is None else self.origin


class GivenRecording(Document, frozen=True):
    """A recording, and whether it is held out: not fitted, only compared."""

    given: GivenFile
    held_out: bool = False


class Inputs(Document, frozen=True, kw_only=True):
    """What a session works on.

    like       the shipped arm whose model file was taken
    maps       entries of `--map`; allow_gaps: as on the command line
    effects    name of the file of the user's own effects. The file is code and no part of the folder: whoever opens
               the session names it again
    """

    model: GivenFile | None = None
    like: str | None = None
    recordings: Annotated[tuple[GivenRecording, ...], Meta(max_length=MOST_RECORDINGS)] = ()
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
        """Whether there is a model and a recording to fit it to."""
        return self.model is not None and bool(self.fitted)


# History


class PlacedEffect(Document, frozen=True):
    """An effect of a model file: its name there, and its joint (1-based), None: of the whole arm."""

    effect: Annotated[str, Meta(pattern=r"^[A-Za-z_][A-Za-z0-9_]*\Z")]  # it stands in commands
    joint: JointNumber | None

    def __str__(self) -> str:
        return self.effect if self.joint is None else f"{self.effect}@{self.joint}"


class JointError(Document, frozen=True, kw_only=True):
    """The residual of a joint's torque with a fitted model, and its noise floor.

    called                 number and name, as headings have it
    rms, floor             in `unit`; relative, relative_floor: parts of the torque's rms
    held, held_floor       relative error and noise floor of the held-out recordings; None without any
    """

    joint: JointNumber
    called: str
    unit: str
    rms: Magnitude
    relative: Magnitude
    floor: Magnitude
    relative_floor: Magnitude
    held: Magnitude | None = None
    held_floor: Magnitude | None = None

    @property
    def floors(self) -> float | None:
        """The error in noise floors; None where there is no floor."""
        return self.rms / self.floor if self.floor else None


class SessionStep(Document, frozen=True, kw_only=True):
    """A fitted model.

    number    of the step, from 0; parent: the step that it changes, None for the model as given
    changed   the effects that were added or left out
    verdict   of its diagnosis; None before that
    """

    number: int
    parent: int | None
    kind: Kind
    changed: tuple[PlacedEffect, ...]
    joints: tuple[JointError, ...]
    verdict: Verdict | None = None

    @property
    def title(self) -> str:
        """The change in a few words."""
        names = ", ".join(map(str, self.changed))
        return {"given": "as given, fitted", "added": f"+ {names}", "without": f"without {names}"}[self.kind]


class History(Document, frozen=True):
    """Steps in the order in which they were made. Steps that were undone stay.

    current   number of the step that is shown; None before the first
    undone    numbers of the steps that redo returns to, the next one last
    """

    steps: tuple[SessionStep, ...] = ()
    current: int | None = None
    undone: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for number, step in enumerate(self.steps):
            if step.number != number or (step.parent is None) != (number == 0) or not -1 < (step.parent or 0) <= number:
                raise HistoryError(f"step {number} has a wrong number or follows no earlier step")
        if (self.current is None) != (not self.steps):
            raise HistoryError("the number of the current step is missing")
        for number in (*self.undone, *(() if self.current is None else (self.current,))):
            self.step(number)

    def step(self, number: int) -> SessionStep:
        """Raises HistoryError where there is no such step."""
        if not 0 <= number < len(self.steps):
            raise HistoryError(f"there is no step {number}; expected 0 to {len(self.steps) - 1}")
        return self.steps[number]

    @property
    def here(self) -> SessionStep | None:
        """The current step."""
        return None if self.current is None else self.steps[self.current]

    def path(self, number: int) -> tuple[SessionStep, ...]:
        """From the model as given to a step."""
        found = [self.step(number)]
        while (parent := found[0].parent) is not None:
            found.insert(0, self.steps[parent])
        return tuple(found)

    def with_step(self, step: SessionStep) -> History:
        """With a further step, which becomes the current one."""
        return History((*self.steps, step), step.number)

    def judged(self, number: int, verdict: Verdict) -> History:
        """With the verdict of a step's diagnosis."""
        step = replace(self.step(number), verdict=verdict)
        return replace(self, steps=(*self.steps[:number], step, *self.steps[number + 1 :]))

    def undo(self) -> History:
        """Back to the step that the current one changes."""
        here = self.here
        if here is None or here.parent is None:
            raise HistoryError("there is nothing to undo")
        return replace(self, current=here.parent, undone=(*self.undone, here.number))

    def redo(self) -> History:
        """To the step that was undone last."""
        if not self.undone:
            raise HistoryError("there is nothing to redo")
        return replace(self, current=self.undone[-1], undone=self.undone[:-1])

    def at(self, number: int) -> History:
        """At any step."""
        return replace(self, current=self.step(number).number, undone=())


# The folder


class SessionState(Document, frozen=True, kw_only=True):
    """What session.json holds."""

    schema: Literal[1] = 1
    inputs: Inputs
    history: History


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
        session = cls(folder, SessionState(inputs=Inputs(), history=History()))
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)  # recordings are the user's alone
        for name in ("given", "recordings", "steps"):
            (folder / name).mkdir()
        session.change()
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
        given = [recording.given for recording in session.inputs.recordings]
        for file in (*given, *filter(None, [session.inputs.model])):
            if not session.given(file).is_file():
                raise SessionError(f"{folder}: lacks given/{file.file}, which {FILE} names; the session is incomplete")
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
    def inputs(self) -> Inputs:
        return self._state.inputs

    @property
    def history(self) -> History:
        return self._state.history

    def change(self, inputs: Inputs | None = None, history: History | None = None) -> None:
        """Write other inputs or another history. Raises OSError."""
        self._state = SessionState(inputs=inputs or self.inputs, history=history or self.history)
        text = json.dumps(plain(self._state), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        files.replace(self.folder / FILE, text.encode(errors="replace"))

    def restart(self, inputs: Inputs) -> None:
        """With other inputs and an empty history; the folders of the steps move to `earlier/`."""
        old = self.folder / "steps"
        if any(old.iterdir()):
            aside = self.folder / "earlier"
            aside.mkdir(exist_ok=True)
            old.rename(aside / f"steps-{1 + sum(1 for _ in aside.iterdir())}")
            old.mkdir()
        shutil.rmtree(self.folder / "recordings", ignore_errors=True)
        self.change(inputs, History())

    def given(self, file: GivenFile) -> Path:
        """The path of a given file."""
        return self.folder / "given" / file.file

    def step(self, number: int) -> Path:
        """The folder of a step, from 0."""
        return self.folder / "steps" / str(number)

    def recording(self, number: int) -> Path:
        """The folder of what was read of a recording, from 1."""
        return self.folder / "recordings" / str(number)

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


# The same in a terminal


def invocation(inputs: Inputs, about: str = "") -> Invocation:
    """The command line with the inputs of a session."""
    assert inputs.model is not None
    return Invocation(
        model=Path(f"{inputs.like}.toml" if inputs.like else inputs.model.typed),
        recordings=tuple(Path(r.given.typed) for r in inputs.fitted),
        held_out=tuple(Path(r.given.typed) for r in inputs.held_out),
        effects=None if inputs.effects is None else Path(inputs.effects),
        maps=inputs.maps,
        allow_gaps=inputs.allow_gaps,
        about=about,
        like=inputs.like,
    )


def commands(inputs: Inputs, path: Sequence[SessionStep]) -> list[str]:
    """Command lines that lead from the model as given to the last step of a path."""
    given = invocation(inputs)
    added, removed = changes(path)
    held = [part for r in given.held_out for part in ("--held-out", str(r))]
    own = [] if given.effects is None else ["--effects", str(given.effects)]
    data = [*map(str, given.recordings), *reading(inputs.maps, inputs.allow_gaps), *held]
    return [
        *([given.copy()] if given.like else []),
        shlex.join(["tendon", "improve", str(given.model), *data, "--report", "report", *own]),
        *(f"# remove {effect} from {quote(str(given.model))}" for effect in removed),
        *(given.add(Term(effect.effect, effect.joint)) for effect in added),
        given.identify(),
    ]


def changes(path: Sequence[SessionStep]) -> tuple[list[PlacedEffect], list[PlacedEffect]]:
    """The effects that the last step of a path has and the first has not, and the reverse."""
    added: list[PlacedEffect] = []
    removed: list[PlacedEffect] = []
    for step in path:
        own, opposite = (removed, added) if step.kind == "without" else (added, removed)
        for effect in step.changed:
            if effect in opposite:
                opposite.remove(effect)
            else:
                own.append(effect)
    return added, removed
