"""The commands of the page: give files, fit, diagnose, add and leave out effects, read the results.

The page uses a `Studio` and nothing behind it. Long tasks run in the session's process (work.py) and write into the
session's folder. `version` changes with every change; the page then reads anew.
"""

from __future__ import annotations

import asyncio
import difflib
import os
import re
import shutil
import threading
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, TypeVar

from msgspec.structs import replace

from runtime import files
from runtime.recordings.contents import RecordingError, Refusal
from runtime.recordings.recording import opened
from runtime.simulation.demo import record_files
from runtime.studio.documents import ColumnOverview, Cure, PlanOverview, RecordingOverview, document
from runtime.studio.history import History, HistoryError, PlacedEffect
from runtime.studio.inputs import DescribedArm, GivenFile, GivenReading, GivenRecording, Inputs
from runtime.studio.session import READING_DIGITS, SessionError, SessionState, StudioSession
from runtime.studio.settings import LOOKS_EVERY, MOST_MODEL, MOST_PLANS, MOST_RECORDINGS, MOST_UPLOADED
from runtime.studio.terminal import commands
from runtime.studio.work import Work, WorkError, WorkState
from runtime.workspace.importing import import_document
from runtime.workspace.source import Source, effects_described
from symbolic.model_file.checks import quote
from symbolic.model_file.exchange.importing import imported, read_tree

T = TypeVar("T")

_OF_STEP = re.compile(r"step(\d{1,6})-((?:joint|held|tried)\d{1,4})", re.ASCII)
_OF_RECORDING = re.compile(rf"([0-9a-f]{{{READING_DIGITS}}})-(joint\d{{1,4}})", re.ASCII)
"""Names of signal sets."""

_ROBOT_DESCRIPTIONS = (".urdf", ".xml", ".mjcf")


class Studio:
    """A session and its tasks.

    effects   a file of the user's own effects, whose Python is executed
    Raises SessionError where the session was made with such a file and none is given, or is open already.
    """

    def __init__(self, session: StudioSession, effects: Path | None = None) -> None:
        if session.inputs.effects is not None and effects is None:
            raise SessionError(f"{session.folder}: was made with effects of your own; open it with --effects")
        self.session = session
        self._effects = effects
        self.version = 0  # another number after every change of inputs, history or task
        self._lock = threading.RLock()  # results arrive in another thread than clicks
        self._session_lock: int | None = session.locked()
        shutil.rmtree(session.scratch, ignore_errors=True)  # of a process that was killed
        self._work = Work(session.folder, effects, self._changed, self._finished)
        self._plan_files: tuple[GivenFile, ...] = ()
        self._arrivals = asyncio.Lock()

    def close(self) -> None:
        """End the process of the session. The folder stays and may be opened again."""
        self._work.close()
        if self._session_lock is not None:
            os.close(self._session_lock)
            self._session_lock = None

    @property
    def inputs(self) -> Inputs:
        return self.session.inputs

    @property
    def history(self) -> History:
        return self.session.history

    @property
    def state(self) -> SessionState:
        """Inputs and steps, and what of them can be undone."""
        return self.session.state

    @property
    def work(self) -> WorkState | None:
        """The last task."""
        return self._work.state

    def paused(self) -> AbstractContextManager[None]:
        """Within, the task neither advances nor ends: all that is read belongs together."""
        return self._work.paused()

    # Inputs; each raises SessionError. Steps stay, and undo takes the change back

    def give_arm(self, name: str) -> None:
        """The model file of an arm that ships with Tendon."""
        self._check_idle()
        self._give_model(replace(self.session.copied(Source.shipped(name).path), origin=None), like=name)

    def give_model(self, path: Path) -> None:
        """A model file (TOML) of this machine, or a URDF or MJCF, from which one is made."""
        self._check_idle()
        self._give_model(self.session.copied(path))

    def give_recording(self, path: Path, held_out: bool = False, reading: GivenReading | None = None) -> None:
        """A recording of this machine."""
        self._check_idle()
        self._give_recording(self.session.copied(path), held_out, reading or GivenReading())

    def open_plans(self, *paths: Path) -> None:
        """Trajectories on this machine, as `tendon optimize --out` writes them. Raises WorkError, too."""
        for path in paths:
            check_plan(path.name)
        self._open_plans([self.session.copied(path) for path in paths])

    async def receive(self, role: str, name: str, chunks: AsyncIterator[bytes]) -> None:
        """A file from a browser, as "model", "fitted", "held_out" or "plan". Raises WorkError, too.

        Files are taken one after another, in the order in which they came, each once no task is running. A recording
        is read before this returns.
        """
        if role not in ("model", "fitted", "held_out", "plan"):
            raise SessionError("a file is sent as model, as fitted, as held_out or as plan")
        if role == "plan":
            check_plan(name)
        async with self._arrivals:
            await self._idle()
            await self._receive_now(role, name, chunks)

    async def _receive_now(self, role: str, name: str, chunks: AsyncIterator[bytes]) -> None:
        file = await self._received(name, chunks, MOST_UPLOADED if role in ("fitted", "held_out") else MOST_MODEL)
        if role == "plan":
            self._open_plans([file])
            return
        if role == "model":
            await asyncio.to_thread(self._give_model, file)
        else:
            await asyncio.to_thread(self._give_recording, file, role == "held_out", GivenReading())
        self.read()
        await self._idle()

    def close_plan(self, number: int) -> None:
        """Delete the folder of a plan."""
        self._check_idle()
        shutil.rmtree(self.session.plan(number), ignore_errors=True)
        self._changed()

    def hold_out(self, file: str, held_out: bool) -> None:
        """Whether a recording, by its name in `given/`, is held out."""
        self._take(self.inputs.changed(file, held_out=held_out))

    def remove_recording(self, file: str) -> None:
        """Remove a recording, by its name in `given/`, from the inputs."""
        kept = tuple(r for r in self.inputs.recordings if r.given.file != file)
        self._take(replace(self.inputs, recordings=kept))

    def read_as(self, file: str, reading: GivenReading) -> None:
        """How a recording, by its name in `given/`, is read. Others are read as before."""
        self._take(self.inputs.changed(file, reading=reading))

    def choose_ends(self, base: str | None, tip: str | None) -> None:
        """Links between which the arm of the robot description lies; None: the root, and the only end."""
        described = self.inputs.described
        if described is None:
            raise SessionError("the model was not made from a robot description")
        self._check_idle()
        self._take(self._made(replace(self.inputs, described=replace(described, base=base, tip=tip))))

    def state_torque_constants(self, constants: Mapping[int, float]) -> None:
        """Torque constants of joints at their outputs, N m/A, which the model file lacks; of its copy here."""
        if self.inputs.model is None:
            raise SessionError("there is no model yet; give one")
        try:
            edits = Source.read(self.session.given(self.inputs.model), self._effects).edits
            text = edits.set_torque_constants(constants).text
        except ValueError as error:
            raise SessionError(self._without_path(error)) from error
        model = replace(self.session.place_for(self.inputs.model.name), origin=self.inputs.model.origin)
        files.replace(self.session.given(model), text.encode())
        self._take(replace(self.inputs, model=model, constants={**self.inputs.constants, **constants}))

    def cure(self, cure: Cure) -> None:
        """Read recordings in the way in which what looks wrong with them is put right."""
        inputs = self.inputs
        for file, maps in cure.readings.items():
            given = inputs.of(file)
            if given is not None:
                inputs = inputs.changed(file, reading=given.reading.but(maps, cure.gaps))
        self._take(inputs)

    # A new start; it cannot be undone, and the folders of the steps stay

    def start_afresh(self) -> None:
        """Without model, recordings and steps."""
        self._restart(Inputs())

    def start_demo(self) -> None:
        """A simulated drive that lacks an effect, and two recordings of it, one held out; nothing else."""
        self._check_idle()
        place = self.session.scratch
        place.mkdir(exist_ok=True)
        model = replace(self.session.copied(Source.shipped("drive").path), origin=None)
        recorded = [replace(self.session.copied(path), origin=None) for path in record_files(place)]
        shutil.rmtree(place)
        given = tuple(GivenRecording(file, held_out) for file, held_out in zip(recorded, (False, True), strict=True))
        self._restart(Inputs(model=model, like="drive", recordings=given, effects=self._effects_named))

    # Tasks; each raises WorkError while another one is running

    def read(self) -> None:
        """Read the recordings that were not read yet in the way in which they are read now; no task where there are
        none."""
        if any(self.recording(given) is None for given in self.inputs.recordings):
            self._work.begin("read", "reading the recordings", {})

    def begin(self) -> None:
        """Read the recordings, and fit the model as given and the steps that lead to the current one."""
        self._work.begin("begin", "reading and fitting", {})

    def diagnose(self) -> None:
        """Search for the effects that the current model lacks."""
        self._ask("diagnose", "looking for missing effects")

    def add(self, *effects: PlacedEffect) -> None:
        """Add effects to the current model and fit it, from the values that its diagnosis found."""
        self._ask("fit", f"adding {', '.join(map(str, effects))}", kind="added", changed=effects)

    def without(self, effect: PlacedEffect) -> None:
        """Fit the current model without one of its effects, to see its share."""
        self._ask("fit", f"fitting without {effect}", kind="without", changed=(effect,))

    def try_values(self, effect: PlacedEffect, values: Mapping[str, float]) -> None:
        """The residual of the current model with other values of an effect: ValuesAnswer."""
        self._ask("tried", f"trying {effect}", effect=effect, values=values)

    def hide(self, effect: PlacedEffect, values: Mapping[str, float]) -> None:
        """Whether an effect would be named in the recorded motion: HiddenEffectAnswer. Missing values are moderate."""
        self._ask("hidden", f"hiding {effect}", effect=effect, values=values)

    def design(self, *rivals: PlacedEffect) -> None:
        """The motion that distinguishes effects, or one from the model as it is: MotionAnswer."""
        self._ask("experiment", f"designing a motion for {', '.join(map(str, rivals))}", rivals=rivals)

    def replay(self) -> None:
        """How far the current model's motion is off, driven as the arm was: ReplayAnswer."""
        self._ask("replayed", "driving the model by the recorded torques")

    def cancel(self) -> None:
        """End the task without a result."""
        self._work.cancel()

    # The history; each raises HistoryError

    def undo(self) -> None:
        self._move(SessionState.undo)

    def redo(self) -> None:
        self._move(SessionState.redo)

    def go_to(self, number: int) -> None:
        self._move(lambda state: state.at(number))

    # Results

    def recording(self, given: GivenRecording) -> RecordingOverview | None:
        """What was read of a recording; None before that."""
        return document(self.session.recording(given) / "recording.json", RecordingOverview)

    def columns(self, file: GivenFile) -> list[ColumnOverview]:
        """What the columns of a recording contain; none before it was read."""
        return document(self.session.columns(file), list[ColumnOverview]) or []

    def answer(self, number: int, name: str, kind: type[T]) -> T | None:
        """A document of a step, as "overview", "library", "verdict", "tried"; None where there is none."""
        path = self.file(number, f"{name}.json")
        return None if path is None else document(path, kind)

    def file(self, number: int, name: str) -> Path | None:
        """A file of a step, as motion.csv or report.html; None where there is none. Raises HistoryError."""
        path = self.session.step(self.history.step(number).number) / name
        return path if path.is_file() else None

    def model_text(self, number: int | None) -> str:
        """The model file of a step with the fitted values; None: as it was given."""
        if number is not None:
            return (self.session.step(self.history.step(number).number) / "fitted.toml").read_text(encoding="utf-8")
        model = self.inputs.model
        return "" if model is None else self.session.given(model).read_text(encoding="utf-8")

    def difference(self, number: int, against: int | None) -> list[str]:
        """The lines in which a step's model file differs from that of another step, or from the given one."""
        before, after = (self.model_text(k).splitlines() for k in (against, number))
        return list(difflib.unified_diff(before, after, lineterm=""))[2:]

    def commands(self, number: int) -> list[str]:
        """Command lines that do the same in a terminal."""
        return commands(self.history.path(number))

    def signals(self, name: str) -> Path | None:
        """The file of a signal set by its name; None where there is none."""
        if known := _OF_STEP.fullmatch(name):
            path = self.session.step(int(known[1])) / f"{known[2]}.npz"
        elif known := _OF_RECORDING.fullmatch(name):
            path = self.session.folder / "recordings" / known[1] / f"{known[2]}.npz"
        else:
            return None
        return path if path.is_file() else None

    def plans(self) -> dict[int, PlanOverview]:
        """The open plans, by number from 1."""
        home = self.session.folder / "plans"
        numbers = sorted(int(p.name) for p in home.iterdir() if p.name.isdecimal()) if home.is_dir() else []
        found = {k: document(self.session.plan(k) / "plan.json", PlanOverview) for k in numbers}
        return {number: plan for number, plan in found.items() if plan is not None}

    # Behind it

    def _ask(self, task: str, what: str, **arguments: Any) -> None:
        """Begin a task on the current step."""
        if self.history.current is None:
            raise HistoryError("there is no step yet; give a model and a recording first")
        if not self.state.fitted:
            raise HistoryError("the inputs have changed since this step was fitted; fit the steps again, or undo that")
        self._work.begin(task, what, {"step": self.history.current, **arguments})

    def _move(self, move: Callable[[SessionState], SessionState]) -> None:
        self._check_idle()
        with self._lock:
            self.session.change(move(self.state))
        self._changed()

    def _changed(self) -> None:
        self.version += 1

    def _finished(self, work: WorkState) -> None:
        """Move the results of a task to their places."""
        found, scratch = work.result, self.session.scratch
        with self._lock:
            for step in () if found is None else found.steps:
                target = self.session.step(step.number)
                shutil.rmtree(target, ignore_errors=True)  # of a server that was killed before it wrote the history
                (scratch / f"step{step.number}").rename(target)
            if found is not None and found.steps:
                self.session.change(self.state.with_steps(*found.steps))
            if found is not None and found.answered is not None:
                for path in (scratch / "answer").iterdir():
                    path.replace(self.session.step(found.answered) / path.name)
                if found.verdict is not None:
                    judged = self.history.judged(found.answered, found.verdict)
                    self.session.change(replace(self.state, history=judged))
            for k in range(0 if found is None else found.plans):
                target = self.session.plan(max(self.plans(), default=0) + 1)
                target.parent.mkdir(exist_ok=True)
                (scratch / f"plan{k}").rename(target)
            for file in self._plan_files:
                self.session.given(file).unlink(missing_ok=True)
            self._plan_files = ()
            shutil.rmtree(scratch, ignore_errors=True)

    @property
    def _effects_named(self) -> str | None:
        return None if self._effects is None else str(self._effects)

    def _without_path(self, error: ValueError) -> str:
        return str(error).replace(f"{self.session.folder / 'given'}{os.sep}", "")

    def _give_model(self, file: GivenFile, like: str | None = None) -> None:
        """Take a model file or a robot description that lies in given/, if it is one."""
        path, inputs = self.session.given(file), replace(self.inputs, like=like, constants={}, described=None)
        try:
            if path.suffix.lower() in _ROBOT_DESCRIPTIONS:
                described = DescribedArm(file=file, links=tuple(read_tree(path).links))
                self._check_idle()
                self._take(self._made(replace(inputs, described=described)))
                return
            Source.read(path, self._effects).arm()
            self._check_idle()
        except ValueError as error:
            path.unlink()
            raise SessionError(self._without_path(error)) from error
        self._take(replace(inputs, model=file, effects=self._effects_named))

    def _made(self, inputs: Inputs) -> Inputs:
        """With the model file that follows from a robot description, base and tip; without one if none does."""
        described = inputs.described
        assert described is not None
        path = self.session.given(described.file)
        try:
            library = effects_described(self._effects, space=True)
            made = imported(path, library, described.base, described.tip)
        except ValueError as error:
            problem = replace(described, made=None, problem=self._without_path(error))
            return replace(inputs, model=None, described=problem)
        model = self.session.place_for(f"{made.arm.name}.toml")
        files.replace(self.session.given(model), made.text.encode())
        done = replace(described, made=import_document(made, model.name), problem="")
        return replace(inputs, model=model, constants={}, described=done, effects=self._effects_named)

    def _give_recording(self, file: GivenFile, held_out: bool, reading: GivenReading) -> None:
        """Take a recording that lies in given/, if it is one; whether its columns are understood is seen later."""
        path = self.session.given(file)
        try:
            if len(self.inputs.recordings) >= MOST_RECORDINGS:
                raise SessionError(f"{quote(file.name)}: a session takes at most {MOST_RECORDINGS} recordings")
            opened(path, Refusal(file.name))
            self._check_idle()
        except (SessionError, RecordingError) as error:
            path.unlink()
            raise SessionError(str(error)) from error
        given = GivenRecording(file, held_out, reading)
        self._take(replace(self.inputs, recordings=(*self.inputs.recordings, given)))

    def _take(self, inputs: Inputs) -> None:
        self._check_idle()
        with self._lock:
            self.session.change(self.state.given(inputs))
        self._changed()

    def _restart(self, inputs: Inputs) -> None:
        self._check_idle()
        with self._lock:
            self.session.restart(inputs)
        self._changed()

    def _open_plans(self, given: Sequence[GivenFile]) -> None:
        try:
            if len(self.plans()) + len(given) > MOST_PLANS:
                raise SessionError(f"a session has at most {MOST_PLANS} plans; close some of them")
            names = {file.file: file.name for file in given}
            with self.paused():
                self._work.begin("open_plans", f"opening {', '.join(names.values())}", {"names": names})
                self._plan_files = tuple(given)
        except (SessionError, WorkError):
            for file in given:
                self.session.given(file).unlink(missing_ok=True)
            raise

    async def _idle(self) -> None:
        """Until no task is running."""
        while self._work.busy:
            await asyncio.sleep(LOOKS_EVERY)

    def _check_idle(self) -> None:
        if self._work.busy:
            raise SessionError("a task is running; wait for it, or cancel it")

    async def _received(self, name: str, chunks: AsyncIterator[bytes], most: int) -> GivenFile:
        """A file from a browser, in given/; nothing of it stays unless all of it arrives."""
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
    """Raises SessionError for a file whose name is not that of a trajectory."""
    if Path(name).suffix.lower() != ".json":
        raise SessionError(f"{quote(name)}: expected a trajectory (.json of tendon optimize --out)")
