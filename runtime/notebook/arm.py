"""An arm and its recordings, as a notebook holds them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path

from runtime import files
from runtime.model.loader import Model
from runtime.model.terms import structure
from runtime.recordings.recording import Recording, read
from runtime.workspace.source import Source

PathOrText = str | PathLike[str]
Recorded = Recording | PathOrText
"""A recording, or the file in which one stands."""


@dataclass(frozen=True)
class LoadedArm:
    """A model file, its equations derived and compiled; `text` is what would be written.

    source   the file as read, and the library of effects
    told     what was said of it when it was made
    """

    source: Source
    told: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The model file, with everything that was added or identified here."""
        return self.source.text

    @cached_property
    def model(self) -> Model:
        """The generated functions on NumPy arrays, samples last: `arm.model.inverse_dynamics(q, qd, qdd)`."""
        return self.source.compiled.model()

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know of the file beside errors, a line each."""
        return (*self.told, *self.source.arm().notes)

    def with_text(self, text: str) -> LoadedArm:
        """The same arm with another model file's text; nothing is written."""
        return LoadedArm(self.source.with_text(text))

    def recordings(
        self, given: Recorded | Sequence[Recorded], columns: Mapping[str, str] | None = None, allow_gaps: bool = False
    ) -> list[Recording]:
        """One or several recordings or files, read and checked against this arm."""
        one = isinstance(given, Recording | str | PathLike)
        entries: list[Recorded] = [given] if one else list(given)  # type: ignore[arg-type,list-item]
        return [
            entry if isinstance(entry, Recording) else self.source.recordings([Path(entry)], columns, allow_gaps)[0]
            for entry in entries
        ]

    def save(self, path: PathOrText) -> None:
        """Write the model file. Raises OSError."""
        files.replace(Path(path), self.text.encode())

    def __repr__(self) -> str:
        model = self.model
        effects = ", ".join(map(str, structure(model))) or "no effects"
        kinds = ", ".join(joint.type for joint in model.joints)
        return f"{model.name}: {model.n} joint{'s' if model.n > 1 else ''} ({kinds})\n{effects}"


def load(model: PathOrText, effects: PathOrText | None = None) -> LoadedArm:
    """The arm of a model file, or by its name one that ships with Tendon: "drive", "vishard4", "emps", "ur10", "panda".

    effects   a Python file with effects of your own (`--effects`); it is run, so trust it
    Derived and compiled when it is first needed; later calls find it in the cache. Raises ValueError, OSError.
    """
    own = None if effects is None else Path(effects)
    return LoadedArm(Source.read(Path(model), own))


def recording(
    path: PathOrText,
    arm: LoadedArm | PathOrText | None = None,
    columns: Mapping[str, str] | None = None,
    allow_gaps: bool = False,
) -> Recording:
    """A recording, read into arrays in SI and checked; see runtime/README.md for the format.

    arm         whose joints' types and torque constants the units follow; None: revolute joints
    columns     signal -> header cell, for other headers: {"q1": "Position1 [deg]"} (`--map`)
    allow_gaps  split at gaps and drop rows with a NaN, instead of refusing them
    Raises ValueError with the file and the line.
    """
    if arm is None:
        return read(Path(path), None, columns, allow_gaps)
    whose = arm if isinstance(arm, LoadedArm) else load(arm)
    return whose.recordings(path, columns, allow_gaps)[0]
