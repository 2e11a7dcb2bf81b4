"""Edits of a model file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.documents.fits import FitDocument, JudgedFitDocument
from runtime.workspace.names import UsageError

if TYPE_CHECKING:
    from runtime.planning.trajectory import Trajectory
    from symbolic.described import AnyEffect
    from symbolic.model_file.arm import Values


@dataclass(frozen=True)
class ModelEdits:
    """The text of a model file with some edits. Each edit returns a new object; only `write` changes the file.

    original, text   the file as read, and with the edits
    effects          library in which the file's effects are declared
    The edits raise ModelError.
    """

    path: Path
    original: str
    text: str
    effects: Mapping[str, AnyEffect]

    def add(self, effect: str, joint: int | None = None, values: Mapping[str, float] | None = None) -> ModelEdits:
        """Add an effect at a joint (from 1), or of the arm or the contact; its unknown values are left out."""
        from symbolic.model_file import editor

        text = editor.add_effect(self.text, str(self.path), self.effects, effect=effect, joint=joint, values=values)
        return replace(self, text=text)

    def remove(self, effect: str, joint: int | None = None) -> ModelEdits:
        """Remove an effect."""
        from symbolic.model_file import editor

        return replace(
            self, text=editor.remove_effect(self.text, str(self.path), self.effects, effect=effect, joint=joint)
        )

    def name_of_next(self, effect: str, joint: int | None = None) -> str:
        """The name under which `add` would add an effect: several of one kind are numbered."""
        from symbolic.model_file import editor

        return editor.name_of_next(self.text, str(self.path), self.effects, effect=effect, joint=joint)

    def set(self, fit: FitDocument | JudgedFitDocument) -> ModelEdits:
        """Set the values that a fit determines: base parameters, rotor inertias and parameters of effects."""
        from symbolic.model_file import editor
        from symbolic.model_file.arm import ROTOR

        def known(values: Mapping[str, float | None]) -> dict[str, float]:
            return {name: v for name, v in values.items() if v is not None and math.isfinite(v)}

        values = {
            (entry.name, entry.joint): known({name: p.value for name, p in entry.parameters.items()})
            for entry in fit.effects
        }
        text = editor.set_values(
            self.text,
            str(self.path),
            self.effects,
            effects=values,
            inertial=known({entry.name: entry.fit for entry in fit.inertial if entry.name != ROTOR}),
            rotors={entry.joint: entry.fit for entry in fit.inertial if entry.name == ROTOR and entry.fit is not None},
        )
        return replace(self, text=text)

    def mount(self, trajectory: Trajectory) -> ModelEdits:
        """Replace springs and contact by those for which a trajectory was planned."""
        from symbolic.model_file import reader
        from symbolic.model_file.editor import place_effect

        where = str(self.path)
        arm, contact = reader.parse(self.text, where, self.effects), trajectory.contact
        springs = [name for name, effect in self.effects.items() if effect.brought and effect.scope == "joint"]
        present = arm.contact.effects if arm.contact else {}
        places: dict[tuple[str, int | None], Values | None] = {
            **{(effect, joint): None for effect in springs for joint in range(1, len(arm.joints) + 1)},
            **{(effect, None): contact.get(effect) for effect in (*present, *contact)},
        }
        places |= {(trajectory.effects.get(j, springs[0]), j): dict(v) for j, v in trajectory.springs.items()}
        text = self.text
        for (effect, joint), values in places.items():
            text = place_effect(text, where, self.effects, effect=effect, joint=joint, values=values)
        return replace(self, text=text)

    def write(self) -> None:
        """Write the model file, unless it was changed since it was read. Raises UsageError, OSError."""
        with self.written():
            pass

    @contextmanager
    def written(self) -> Iterator[None]:
        """As `write`. The file stays locked within the `with`, in which other files that belong to it are written."""
        from runtime import files

        with files.locked(self.path):
            check_unchanged(self.path, self.original)
            files.replace(self.path, self.text.encode())
            yield


def check_unchanged(path: Path, text: str) -> None:
    """Raises UsageError if the model file has another text by now."""
    from symbolic.model_file import reader

    if reader.read_text(path) != text:
        raise UsageError(f"{path}: was changed by someone else meanwhile; nothing was written, try again")
