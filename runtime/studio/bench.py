"""A session as its process has it: what was given, read and fitted, kept from one task to the next."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from runtime.diagnosis.diagnose import begin as begun
from runtime.diagnosis.search import Search
from runtime.diagnosis.steps import Step
from runtime.inspection.inspection import Inspection, inspect
from runtime.loop.held_out import HeldOut, left
from runtime.model.loader import Model
from runtime.plain_json import plain
from runtime.recordings.recording import Recording
from runtime.studio.session import Inputs, SessionError, StudioSession
from runtime.workspace.names import column_mapping
from runtime.workspace.source import Source

Found = dict[str, Any]


@dataclass(frozen=True)
class Tell:
    """Whom to tell what is being done.

    parts   hears at the beginning of which parts the work consists    part   each of them, as it begins
    said    a line of what was found
    """

    parts: Callable[[Sequence[str]], None]
    part: Callable[[str], None]
    said: Callable[[str], None]


class Bench:
    """A session as its process has it: what was given, read and fitted."""

    def __init__(self, folder: Path, effects: Path | None) -> None:
        self.folder = folder.resolve()
        self.effects = effects
        self._inputs: Inputs | None = None
        self._opened: Opened | None = None

    def opened(self) -> Opened:
        """What was given, as it is now."""
        session = StudioSession.open(self.folder)
        if self._opened is None or session.inputs != self._inputs:
            self._inputs, self._opened = session.inputs, Opened(session, self.effects)
        self._opened.session = session
        return self._opened


class Opened:
    """Given files, read: a model file and its recordings, and the steps that were fitted in this process."""

    def __init__(self, session: StudioSession, effects: Path | None) -> None:
        self.session = session
        self.effects = effects
        self.searches: dict[int, Search] = {}
        self.steps: dict[int, Step] = {}
        self._held: dict[int, HeldOut] = {}
        self._with: dict[tuple[int, str, int | None], Step] = {}

    @property
    def inputs(self) -> Inputs:
        return self.session.inputs

    @cached_property
    def source(self) -> Source:
        if self.inputs.model is None:
            raise SessionError("there is no model yet; give one")
        return Source.read(self.session.given(self.inputs.model), self.effects)

    @cached_property
    def inspections(self) -> list[Inspection]:
        arm = None if self.inputs.model is None else self.source.recorded_arm()
        columns = column_mapping(self.inputs.maps)
        paths = [self.session.given(r.given) for r in self.inputs.recordings]
        return [inspect(path, arm, columns, self.inputs.allow_gaps) for path in paths]

    def recordings(self, held: bool) -> list[Recording]:
        """Those that are fitted, or those that are held out. Raises SessionError."""
        found = []
        for given, inspection in zip(self.inputs.recordings, self.inspections, strict=True):
            if given.held_out == held:
                if inspection.problem is not None or inspection.recording is None:
                    raise SessionError(inspection.problem or f"{given.given.name}: cannot be read")
                found.append(inspection.recording)
        return found

    def model(self, text: str) -> Model:
        """The compiled model of a text of the model file."""
        return self.source.with_text(text).compiled.model()

    def text(self, number: int) -> str:
        """The model file of a step, before the fit."""
        return (self.session.step(number) / "model.toml").read_text(encoding="utf-8")

    def fitted_text(self, number: int) -> str:
        """The same with the values of the fit."""
        return (self.session.step(number) / "fitted.toml").read_text(encoding="utf-8")

    def values_found(self, number: int) -> dict[tuple[str, int | None], dict[str, float]]:
        """Of the effects that a step's diagnosis has named."""
        document = self.session.document(self.session.step(number) / "found.json") or {"values": []}
        entries = document["values"]
        return {(e["effect"], e["joint"]): {k: v for k, v in e["values"].items() if v is not None} for e in entries}

    def search(self, number: int, text: str) -> Search:
        """A model fitted, as a diagnosis begins."""
        if number not in self.searches:
            search = begun(self.model(text), self.recordings(False), self.recordings(True))
            self.searches[number], self.steps[number] = search, search.steps[0]
        return self.searches[number]

    def fitted(self, number: int) -> Step:
        """A step's model, fitted."""
        return self.steps[number] if number in self.steps else self.search(number, self.text(number)).steps[0]

    def held(self, number: int) -> HeldOut | None:
        """What a step's model leaves of what was held out; None where nothing was."""
        if number not in self._held and self.inputs.held_out:
            self._held[number] = left(self.fitted(number).identification, self.recordings(True))
        return self._held.get(number)

    def fitted_with(self, number: int, effect: str, joint: int | None) -> Step:
        """A step's model with an effect more, fitted: from what its diagnosis found, where it has named it."""
        place = number, effect, joint
        if place not in self._with:
            edits = self.source.with_text(self.text(number)).edits
            text = edits.add(effect, joint, self.values_found(number).get((effect, joint))).text
            self._with[place] = begun(self.model(text), self.recordings(False)).steps[0]
        return self._with[place]


def empty(folder: Path) -> Path:
    """A new folder."""
    folder.mkdir(parents=True)
    return folder


def write(path: Path, document: Any) -> None:
    """A document as JSON."""
    path.write_text(json.dumps(plain(document), ensure_ascii=False, allow_nan=False), encoding="utf-8")
