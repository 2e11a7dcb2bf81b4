"""What the tasks of a session share: its files as read, the models fitted to them, and messages about progress."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, TextIO

from runtime.diagnosis.stages import begin as begun
from runtime.diagnosis.steps import Step, Trail, errors_elsewhere
from runtime.documents.parts import Document
from runtime.documents.provenance import InputFile, Provenance
from runtime.fit_warnings import suspicions
from runtime.identification.drive_gains import with_gains
from runtime.identification.fitting import fit_motion
from runtime.inspection.guesses import guesses
from runtime.inspection.inspection import Inspection, inspect
from runtime.loop.improve import HeldOut, left
from runtime.model.loader import Model
from runtime.model.terms import structure
from runtime.plain_json import plain
from runtime.progress import Progress
from runtime.recordings.columns import RecordedArm
from runtime.recordings.preview import FieldPreview, previews
from runtime.recordings.recording import Recording
from runtime.report.summary import Invocation
from runtime.studio.describe import map_entries
from runtime.studio.documents import ValuesFound, document
from runtime.studio.history import PlacedEffect
from runtime.studio.inputs import GivenFile, GivenRecording, Inputs
from runtime.studio.session import SessionError, StudioSession
from runtime.studio.settings import MOST_CURES, PROGRESS_EVERY
from runtime.workspace.names import UsageError, column_mapping
from runtime.workspace.source import Source


class Reporter:
    """Messages to the server about the progress of a task, a line of JSON each."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._time, self._doing = 0.0, ""
        self._parts: tuple[str, ...] = ()
        self._at, self._share = 0, 0.0

    def message(self, **fields: Any) -> None:
        self._out.write(json.dumps(plain(fields), allow_nan=False) + "\n")
        self._out.flush()

    def parts(self, *parts: str) -> None:
        """The parts of the task, in words."""
        self._parts, self._at, self._share = parts, 0, 0.0
        self.message(parts=parts)

    def part(self, what: str) -> None:
        """The part that begins; its duration is not known yet."""
        self._at = self._parts.index(what)
        self._share = max(self._share, self._at / len(self._parts))
        self.message(at=self._at, share=self._share, doing="", left=None)

    def progress(self, progress: Progress) -> None:
        """Of the current part, at most every PROGRESS_EVERY. A part may consist of several jobs, each of which starts
        at zero: the share of the whole never falls."""
        now, last = time.monotonic(), progress.done >= progress.parts
        if now - self._time >= PROGRESS_EVERY or progress.what != self._doing or last:
            self._time, self._doing = now, progress.what
            inside = min(progress.done / progress.parts, 1.0)
            self._share = max(self._share, (self._at + inside) / max(len(self._parts), 1))
            self.message(at=self._at, share=self._share, doing=progress.what, left=progress.left)

    def line(self, text: str) -> None:
        """An intermediate result, for people."""
        self.message(said=text)


class LoadedSession:
    """The files of a session as read, and the models that were fitted to them in this process."""

    def __init__(self, session: StudioSession, effects: Path | None, before: LoadedSession | None = None) -> None:
        """before: the same session with other inputs; what was read for it is not read again."""
        self.session = session
        self.effects = effects
        places = {session.recording(given) for given in session.inputs.recordings}
        read = {} if before is None else before._inspections
        self._inspections: dict[Path, Inspection] = {p: found for p, found in read.items() if p in places}
        self._previews: dict[str, list[FieldPreview]] = {} if before is None else before._previews
        self._trails: dict[int, Trail] = {}
        self._held_out: dict[int, HeldOut] = {}
        self._with: dict[tuple[int, PlacedEffect], Step] = {}

    @property
    def inputs(self) -> Inputs:
        return self.session.inputs

    @cached_property
    def source(self) -> Source:
        if self.inputs.model is None:
            raise SessionError("there is no model yet; give one")
        return Source.read(self.session.given(self.inputs.model), self.effects)

    def inspection(self, given: GivenRecording) -> Inspection:
        """What a recording contains, read in its own way."""
        place = self.session.recording(given)
        if place not in self._inspections:
            arm = None if self.inputs.model is None else self.source.recorded_arm()
            path, how = self.session.given(given.given), given.reading
            try:
                found = inspect(path, arm, column_mapping(how.maps), how.allow_gaps)
            except UsageError as error:  # of entries that contradict each other: the page still shows the columns
                found = replace(inspect(path, arm, {}, how.allow_gaps), recording=None, problem=str(error))
            if found.problem is not None:
                found = replace(found, problem=found.problem.replace(f"{path.parent}{os.sep}", ""))
            self._inspections[place] = found
        return self._inspections[place]

    def previews(self, given: GivenRecording) -> list[FieldPreview]:
        """What the columns of a recording contain."""
        file = given.given.file
        if file not in self._previews:
            self._previews[file] = previews(self.inspection(given).contents)
        return self._previews[file]

    def arm(self, given: GivenRecording) -> RecordedArm:
        """The arm of a recording; without a model as many joints as the file names."""
        if self.inputs.model is not None:
            return self.source.recorded_arm()
        found = self.inspection(given).recording
        return RecordedArm.without_model(1 if found is None else len(found.q))

    def provenance(self, verb: str, step: int, given: Invocation) -> Provenance:
        """What a result about a step is made from: the session's copies of the files. Raises OSError."""
        assert self.inputs.model is not None

        def file(one: GivenFile) -> InputFile:
            return InputFile.of(Path(one.typed), self.session.given(one))

        return Provenance.of(
            verb,
            file(self.inputs.model),
            self.text(step),
            [file(one.given) for one in self.inputs.fitted],
            [file(one.given) for one in self.inputs.held_out],
            effects=None if self.effects is None else InputFile.of(self.effects),
            maps=given.maps,
            allow_gaps=given.allow_gaps,
        )

    def guesses(self, given: GivenRecording) -> dict[str, str]:
        """Signal -> column as entries of `--map` name it, which names and values suggest.

        Where the recording cannot be read otherwise it is read so, and what then looks wrong, as a sign, is put right.
        """
        arm = self.arm(given)
        found = {signal: str(column) for signal, column in guesses(self.previews(given), arm).items()}
        if self.inspection(given).recording is not None:
            return found
        driven = [replace(joint, torque_constant=joint.torque_constant or 1.0) for joint in arm.joints]
        path, arm = self.session.given(given.given), replace(arm, joints=driven)
        for _ in range(MOST_CURES):  # of a joint an inspection says one thing at a time
            read = inspect(path, arm, found, allow_gaps=True)
            cures = (entry.partition("=") for suspicion in read.found for entry in map_entries(suspicion))
            cured = found | {signal: column for signal, _, column in cures}
            if cured == found:
                break
            found = cured
        return found

    def recordings(self, held_out: bool) -> list[Recording]:
        """The fitted or the held-out recordings. Raises SessionError."""
        return self._with_gains[held_out]

    @cached_property
    def _with_gains(self) -> tuple[list[Recording], list[Recording]]:
        """Both, with torques of drives whose gains are identified."""
        fitted, held = self._read(False), self._read(True)
        if any(recording.gains_open for recording in fitted):
            found = with_gains(self.source.compiled.model(), [*fitted, *held], len(fitted))
            return found[: len(fitted)], found[len(fitted) :]
        return fitted, held

    def _read(self, held_out: bool) -> list[Recording]:
        found = []
        for given in self.inputs.held_out if held_out else self.inputs.fitted:
            inspection = self.inspection(given)
            if inspection.problem is not None or inspection.recording is None:
                raise SessionError(inspection.problem or f"{given.given.name}: cannot be read")
            found.append(inspection.recording)
        return found

    def model(self, text: str) -> Model:
        """The compiled model of a model file's text."""
        return self.source.with_text(text).compiled.model()

    def text(self, number: int) -> str:
        """The model file of a step, before the fit."""
        return (self.session.step(number) / "model.toml").read_text(encoding="utf-8")

    def fitted_text(self, number: int) -> str:
        """The model file of a step with the fitted values."""
        return (self.session.step(number) / "fitted.toml").read_text(encoding="utf-8")

    def values_found(self, number: int) -> dict[PlacedEffect, dict[str, float]]:
        """Of the effects that a step's diagnosis names."""
        entries = document(self.session.step(number) / "found.json", list[ValuesFound]) or []
        return {e.placed: {k: v for k, v in e.values.items() if v is not None} for e in entries}

    def trail(self, number: int) -> Trail:
        """The fitted model from which a step's diagnosis starts."""
        if number not in self._trails:
            step = self.session.history.step(number)
            self.begin(number, self.text(number), None if step.kind == "given" else step.parent)
        return self._trails[number]

    def begin(self, number: int, text: str, parent: int | None) -> Trail:
        """The same of a step whose model file and parent are known; parent: None of a model as given.

        A model with other effects is fitted to the rows of the model that it follows, so that errors are compared on
        the same ones.
        """
        model = self.model(text)
        if parent is None:
            trail = begun(model, self.recordings(False), self.recordings(True))
        else:
            before = self.trail(parent)
            step = _on_rows_of(before, model)
            wrong = before.suspicions or suspicions(step.fit)
            trail = Trail(model, before.motion, before.held_out, before.names, wrong, step)
        self._trails[number] = trail
        return trail

    def fitted(self, number: int) -> Step:
        """A step's model, fitted."""
        return self.trail(number).last

    def held_out(self, number: int) -> HeldOut | None:
        """The residuals of a step's model on the held-out recordings; None without any."""
        if number not in self._held_out and self.inputs.held_out:
            self._held_out[number] = left(self.fitted(number).fit, self.recordings(True))
        return self._held_out.get(number)

    def fitted_with(self, number: int, placed: PlacedEffect) -> Step:
        """A step's model with a further effect, fitted from the values that the step's diagnosis found."""
        if (number, placed) not in self._with:
            edits = self.source.with_text(self.text(number)).edits
            text = edits.add(placed.effect, placed.joint, self.values_found(number).get(placed)).text
            self._with[number, placed] = _on_rows_of(self.trail(number), self.model(text))
        return self._with[number, placed]

    def new_folder(self, name: str) -> Path:
        """A new folder for results."""
        folder = self.session.scratch / name
        folder.mkdir(parents=True)
        return folder


def _on_rows_of(before: Trail, model: Model) -> Step:
    fit = fit_motion(model, before.motion, structure(model))
    held = None if before.held_out is None else errors_elsewhere(fit, before.held_out)
    return Step.of(fit, held_out=held)


def write(path: Path, found: Document | Sequence[Document]) -> None:
    path.write_text(json.dumps(plain(found), ensure_ascii=False, allow_nan=False), encoding="utf-8")
