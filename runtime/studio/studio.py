"""What a page does with a session: give it files, have it fit, diagnose, add and leave out, and read what was found.

The page talks to a `Studio` and to nothing behind it. Whatever takes long runs in the session's process (work.py) and
ends in the session's folder; the page looks at `version`, which is another number after every change, and reads anew.
"""

from __future__ import annotations

import difflib
import os
import re
import shutil
import threading
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from runtime import files
from runtime.simulation.demo import record_files
from runtime.studio import commands as typed
from runtime.studio.documents import Documents
from runtime.studio.history import History, HistoryError, Kind, PlacedEffect, SessionStep, joint_errors
from runtime.studio.session import GivenFile, GivenRecording, Inputs, SessionError, StudioSession
from runtime.studio.settings import MOST_MODEL, MOST_PLANS, MOST_RECORDINGS, MOST_UPLOADED
from runtime.studio.shown import (
    EffectOffered,
    HiddenShown,
    PlanShown,
    RecordingShown,
    Row,
    StepShown,
    TriedShown,
    VerdictShown,
)
from runtime.studio.work import Work, WorkError, WorkState
from runtime.workspace.library import effects_described
from runtime.workspace.source import Source
from symbolic.model_file.checks import quote
from symbolic.model_file.exchange.importing import imported

T = TypeVar("T")

_SET = re.compile(r"(?P<of>step|recording)(?P<number>\d{1,6})-(?P<kind>joint|held|tried)(?P<joint>\d{1,4})", re.ASCII)

_FOREIGN = (".urdf", ".xml", ".mjcf")
"""Endings of files of which a model file is made."""


class Studio:
    """A session and its work.

    effects   a file of the user's own effects, whose Python is run
    Raises SessionError where the session was made with such a file and none is given, or is open already.
    """

    def __init__(self, session: StudioSession, effects: Path | None = None) -> None:
        if session.inputs.effects is not None and effects is None:
            raise SessionError(f"{session.folder}: was made with effects of your own; open it with --effects")
        self.session = session
        self._effects = effects
        self._documents = Documents(session)
        self._version = 0
        self._lock = threading.RLock()  # what a process found is taken in another thread than a click is
        self._held: int | None = session.claimed()
        session.tidy()
        self._work = Work(session.folder, effects, self._changed, self._finished)
        self._opening: tuple[GivenFile, ...] = ()

    def close(self) -> None:
        """End the process of the session. The folder stays, and may be opened again."""
        self._work.close()
        if self._held is not None:
            os.close(self._held)
            self._held = None

    @property
    def version(self) -> int:
        """Another number after every change of inputs, history or work."""
        return self._version

    @property
    def inputs(self) -> Inputs:
        """What was given."""
        return self.session.inputs

    @property
    def history(self) -> History:
        """The steps, and which is the current one."""
        return self.session.history

    @property
    def work(self) -> WorkState | None:
        """What is being worked on, or was last."""
        return self._work.state

    def unchanged(self) -> AbstractContextManager[None]:
        """While it is held the work neither gets on nor ends: all that is read is of one moment."""
        return self._work.unchanged()

    # --- what is given; all of it raises SessionError ---

    def give_arm(self, name: str) -> None:
        """The model file of an arm of Tendon."""
        self._give_model(replace(self.session.copied(Source.shipped(name).path), origin=None), like=name)

    def give_model(self, path: Path) -> None:
        """A model file (TOML) of this machine, or a URDF or MJCF, which is made one."""
        self._give_model(self.session.copied(path))

    def give_demo(self) -> None:
        """A simulated drive that lacks an effect, and two recordings of it, one held out."""
        self.give_arm("drive")
        for path, held_out in zip(record_files(self.session.folder / "given"), (False, True), strict=True):
            self._give_recording(GivenFile(path.name, path.name, str(path)), held_out)

    def give_recording(self, path: Path, held_out: bool = False) -> None:
        """A recording of this machine."""
        self._give_recording(self.session.copied(path), held_out)

    async def send_model(self, name: str, chunks: AsyncIterator[bytes]) -> None:
        """A model file, or a URDF or MJCF that is made one, from a browser."""
        self._give_model(await self._received(name, chunks, MOST_MODEL))

    async def send_recording(self, name: str, chunks: AsyncIterator[bytes], held_out: bool = False) -> None:
        """A recording from a browser."""
        self._give_recording(await self._received(name, chunks, MOST_UPLOADED), held_out)

    def open_plans(self, *paths: Path) -> None:
        """Open trajectories on this machine, as `tendon optimize --out` writes them. Raises WorkError, too."""
        for path in paths:
            check_plan(path.name)
        self._open_plans([self.session.copied(path) for path in paths])

    async def send_plan(self, name: str, chunks: AsyncIterator[bytes]) -> None:
        """A trajectory from a browser. Raises WorkError, too."""
        check_plan(name)
        self._not_busy()
        self._open_plans([await self._received(name, chunks, MOST_MODEL)])

    def remove_plan(self, number: int) -> None:
        """Close a plan: its folder is deleted."""
        self._not_busy()
        shutil.rmtree(self.session.plan(number), ignore_errors=True)
        self._changed()

    def hold_out(self, number: int, held_out: bool) -> None:
        """Whether a recording, from 1, is held out."""
        given = list(self.inputs.recordings)
        given[number - 1] = replace(given[number - 1], held_out=held_out)
        self._start_over(replace(self.inputs, recordings=tuple(given)))

    def take_back(self, number: int) -> None:
        """Do without a recording, from 1."""
        given = self.inputs.recordings
        self._start_over(replace(self.inputs, recordings=(*given[: number - 1], *given[number:])))

    def read_as(self, maps: Sequence[str], allow_gaps: bool) -> None:
        """How recordings are read: entries of `--map`, in their order, and whether gaps split them."""
        self._start_over(replace(self.inputs, maps=tuple(maps), allow_gaps=allow_gaps))

    # --- work: each begins a task, and raises WorkError while another one is under way ---

    def begin(self) -> None:
        """Look at the recordings, and fit the model as given: step 0."""
        self._work.begin("begin", "reading and fitting", {})

    def diagnose(self) -> None:
        """Look for what the current model lacks."""
        self._work.begin("diagnose", "looking for missing effects", {"step": self._here().number})

    def add(self, *effects: PlacedEffect) -> None:
        """Add effects to the current model and fit it: those that its diagnosis names begin at the values found."""
        self._fit("added", effects)

    def without(self, effect: PlacedEffect) -> None:
        """Fit the current model without one of its effects, to see its share."""
        self._fit("without", (effect,))

    def try_values(self, effect: PlacedEffect, values: Mapping[str, float]) -> None:
        """What the current model would leave with other values of one of its effects: see `tried`."""
        self._ask("tried", f"trying {effect}", effect=effect.effect, joint=effect.joint, values=dict(values))

    def hide(self, effect: PlacedEffect, values: Mapping[str, float]) -> None:
        """Would an effect be seen in the recorded motion? Values that are not stated are moderate: see `hidden`."""
        self._ask("hidden", f"hiding {effect}", effect=effect.effect, joint=effect.joint, values=dict(values))

    def design(self, *rivals: PlacedEffect) -> None:
        """The motion that tells effects apart, or one from the model as it is: see `experiment`."""
        named = [{"effect": r.effect, "joint": r.joint} for r in rivals]
        self._ask("experiment", f"designing a motion for {', '.join(map(str, rivals))}", rivals=named)

    def cancel(self) -> None:
        """End what is being worked on; nothing of it stays."""
        self._work.cancel()

    # --- the history; raises HistoryError ---

    def undo(self) -> None:
        """Back to the step before."""
        self._move(History.undo)

    def redo(self) -> None:
        """Forward to what was undone last."""
        self._move(History.redo)

    def go_to(self, number: int) -> None:
        """To any step."""
        self._move(lambda history: history.at(number))

    # --- what was found ---

    def recordings(self) -> list[RecordingShown]:
        """What was read, in the order of `inputs.recordings`, as far as it was looked at."""
        places = (self.session.recording(number) for number in range(1, len(self.inputs.recordings) + 1))
        found = (self._documents.read(place / "recording.json", RecordingShown) for place in places)
        return [document for document in found if document is not None]

    def shown(self, number: int) -> StepShown:
        """A fitted model."""
        return self._known(number, "shown.json", StepShown)

    def verdict(self, number: int) -> VerdictShown | None:
        """The diagnosis of a step; None: not asked for."""
        return self._documents.read(self.session.step(number) / "verdict.json", VerdictShown)

    def library(self, number: int) -> list[EffectOffered]:
        """The effects that may be added to a step's model."""
        return self._known(number, "library.json", list[EffectOffered])

    def tried(self, number: int) -> TriedShown | None:
        """The answer to `try_values` at a step; None: not asked for."""
        return self._documents.read(self.session.step(number) / "tried.json", TriedShown)

    def hidden(self, number: int) -> HiddenShown | None:
        """The answer to `hide` at a step; None: not asked for."""
        return self._documents.read(self.session.step(number) / "hidden.json", HiddenShown)

    def experiment(self, number: int) -> Row | None:
        """The answer to `design` at a step, as `tendon experiment --json`; None: not asked for."""
        return self._documents.read(self.session.step(number) / "experiment.json", Row)

    def motion(self, number: int) -> Path | None:
        """The motion that was designed at a step, for the arm; None where there is none."""
        path = self.session.step(self.history.step(number).number) / "motion.csv"
        return path if path.is_file() else None

    def model_text(self, number: int) -> str:
        """The model file of a step, with the fitted values."""
        return (self.session.step(self.history.step(number).number) / "fitted.toml").read_text(encoding="utf-8")

    def given_text(self) -> str:
        """The model file as it was given."""
        model = self.inputs.model
        return "" if model is None else self.session.given(model).read_text(encoding="utf-8")

    def difference(self, number: int) -> str:
        """What a step changes in the model file that was given, as a unified difference."""
        name = "model.toml" if self.inputs.model is None else self.inputs.model.name
        lines = self.given_text().splitlines(keepends=True), self.model_text(number).splitlines(keepends=True)
        return "".join(difflib.unified_diff(*lines, name, f"{name}, step {number}"))

    def commands(self, number: int) -> list[str]:
        """What does the same in a terminal, line by line."""
        return typed.commands(self.inputs, self.history.path(number))

    def signals(self, name: str) -> Path | None:
        """The file of a signal set by its name; None where there is none."""
        known = _SET.fullmatch(name)
        if known is None:
            return None
        homes = {"recording": self.session.recording, "step": self.session.step}
        path = homes[known["of"]](int(known["number"])) / f"{known['kind']}{known['joint']}.npz"
        return path if path.is_file() else None

    def report(self, number: int) -> Path | None:
        """The report of a step's diagnosis; None before it."""
        path = self.session.step(self.history.step(number).number) / "report.html"
        return path if path.is_file() else None

    def plans(self) -> dict[int, PlanShown]:
        """The plans that are open, by number from 1."""
        home = self.session.folder / "plans"
        numbers = sorted(int(p.name) for p in home.iterdir() if p.name.isdecimal()) if home.is_dir() else []
        found = {k: self._documents.read(self.session.plan(k) / "plan.json", PlanShown) for k in numbers}
        return {number: plan for number, plan in found.items() if plan is not None}

    def plan_page(self, number: int) -> Path | None:
        """The report's page of a plan; None where there is no such plan."""
        path = self.session.plan(number) / "page.html"
        return path if path.is_file() else None

    # --- behind it ---

    def _here(self) -> SessionStep:
        here = self.history.here
        if here is None:
            raise HistoryError("there is no step yet; give a model and a recording first")
        return here

    def _fit(self, kind: Kind, effects: Sequence[PlacedEffect]) -> None:
        changed = [{"effect": e.effect, "joint": e.joint} for e in effects]
        what = f"{'adding' if kind == 'added' else 'fitting without'} {', '.join(map(str, effects))}"
        step, number = self._here().number, len(self.history.steps)
        self._work.begin("fit", what, {"step": step, "number": number, "kind": kind, "changed": changed})

    def _ask(self, task: str, what: str, **asked: Any) -> None:
        self._work.begin(task, what, {"step": self._here().number, **asked})

    def _move(self, move: Callable[[History], History]) -> None:
        with self._lock:
            self.session.change(history=move(self.history))
        self._changed()

    def _changed(self) -> None:
        self._version += 1

    def _finished(self, work: WorkState) -> None:
        """Take what a process found into the session."""
        found = work.result or {}
        with self._lock:
            if work.state == "done" and found.get("step") is not None:
                self._take(found["step"])
            elif work.state == "done" and work.task == "diagnose":
                self._put("verdict", int(found["judged"]))
                self.session.change(history=self.history.judged(int(found["judged"]), str(found["verdict"])))
            elif work.state == "done" and "answered" in found:
                self._put("answer", int(found["answered"]))
            elif work.state == "done" and work.task == "open_plans":
                for made in found["opened"]:
                    target = self.session.plan(max(self.plans(), default=0) + 1)
                    target.parent.mkdir(exist_ok=True)
                    (self.session.scratch / made).rename(target)
            for file in self._opening:
                self.session.given(file).unlink(missing_ok=True)
            self._opening = ()
            self.session.tidy()

    def _put(self, made: str, number: int) -> None:
        """What a process has made of a step, into its folder."""
        for path in (self.session.scratch / made).iterdir():
            path.replace(self.session.step(number) / path.name)

    def _take(self, found: Mapping[str, Any]) -> None:
        """A step that a process has fitted."""
        number = len(self.history.steps)
        target = self.session.step(number)
        shutil.rmtree(target, ignore_errors=True)  # of a server that was killed before it had written the history
        (self.session.scratch / "step").rename(target)
        changed = tuple(PlacedEffect(e["effect"], e["joint"]) for e in found["changed"])
        step = SessionStep(number, found["parent"], found["kind"], changed, joint_errors(found["joints"]))
        self.session.change(history=self.history.with_step(step))

    def _known(self, number: int, name: str, kind: type[T]) -> T:
        path = self.session.step(self.history.step(number).number) / name
        document = self._documents.read(path, kind)
        if document is None:
            raise SessionError(f"{path}: is missing")
        return document

    def _give_model(self, file: GivenFile, like: str | None = None) -> None:
        """A model file that is there, once it is known to be one."""
        path = self.session.given(file)
        try:
            made = self._imported(file) if path.suffix.lower() in _FOREIGN else file
            Source.read(self.session.given(made), self._effects).arm()
        except ValueError as error:
            path.unlink()
            raise SessionError(str(error).replace(f"{path.parent}{os.sep}", "")) from error
        effects = None if self._effects is None else str(self._effects)
        self._start_over(replace(self.inputs, model=made, like=like, effects=effects))

    def _imported(self, file: GivenFile) -> GivenFile:
        """The model file of a URDF or MJCF."""
        made = imported(self.session.given(file), effects_described(self._effects, space=True))
        model = self.session.place_for(f"{made.arm.name}.toml")
        files.replace(self.session.given(model), made.text.encode())
        return model

    def _give_recording(self, file: GivenFile, held_out: bool) -> None:
        if len(self.inputs.recordings) >= MOST_RECORDINGS:
            raise SessionError(f"{quote(file.name)}: a session takes at most {MOST_RECORDINGS} recordings")
        self._start_over(replace(self.inputs, recordings=(*self.inputs.recordings, GivenRecording(file, held_out))))

    def _start_over(self, inputs: Inputs) -> None:
        """With other inputs nothing that was found holds any more."""
        self._not_busy()
        with self._lock:
            shutil.rmtree(self.session.folder / "recordings", ignore_errors=True)
            self.session.started_over(inputs)
        self._changed()

    def _open_plans(self, given: Sequence[GivenFile]) -> None:
        try:
            if len(self.plans()) + len(given) > MOST_PLANS:
                raise SessionError(f"a session has at most {MOST_PLANS} plans; close some of them")
            names = [{"file": file.file, "name": file.name} for file in given]
            self._work.begin("open_plans", f"opening {', '.join(file.name for file in given)}", {"files": names})
        except (SessionError, WorkError):
            for file in given:
                self.session.given(file).unlink(missing_ok=True)
            raise
        self._opening = tuple(given)

    def _not_busy(self) -> None:
        if self._work.busy:
            raise SessionError("something is being worked on; wait for it, or cancel it")

    async def _received(self, name: str, chunks: AsyncIterator[bytes], most: int) -> GivenFile:
        """A file that is sent, once all of it is there."""
        file, size = self.session.place_for(name), 0
        path = self.session.given(file)
        try:
            with path.open("xb") as out:
                async for chunk in chunks:
                    size += len(chunk)
                    if size > most:
                        raise SessionError(f"{quote(name)}: is larger than {most // 1_000_000} MB; expected less")
                    out.write(chunk)
        except BaseException:
            path.unlink(missing_ok=True)
            raise
        return file


def check_plan(name: str) -> None:
    """Raises SessionError for a file that is no trajectory by its name."""
    if Path(name).suffix.lower() != ".json":
        raise SessionError(f"{quote(name)}: expected a trajectory (.json of tendon optimize --out)")
