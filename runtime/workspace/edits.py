"""Edits of a model file, written back unless it was changed meanwhile."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from runtime import files
from runtime.documents.fits import FitDocument, FitParameters, JudgedFitDocument
from runtime.workspace.names import check_unchanged
from symbolic.model_file.arm import ROTOR, Values
from symbolic.model_file.editor import ModelText

if TYPE_CHECKING:
    from runtime.planning.trajectory import Trajectory


@dataclass(frozen=True)
class ModelEdits(ModelText):
    """The text of a model file with some edits; only `write` changes the file. original: its text as read."""

    original: str

    def set(self, fit: FitDocument | FitParameters | JudgedFitDocument) -> ModelEdits:
        """Set the values that a fit determines: base parameters, rotor inertias and parameters of effects."""

        def known(values: Mapping[str, float | None]) -> dict[str, float]:
            return {name: v for name, v in values.items() if v is not None and math.isfinite(v)}

        return self.set_values(
            effects={
                (entry.name, entry.joint): known({name: p.value for name, p in entry.parameters.items()})
                for entry in fit.effects
            },
            inertial=known({entry.name: entry.fit for entry in fit.inertial if entry.name != ROTOR}),
            rotors={entry.joint: entry.fit for entry in fit.inertial if entry.name == ROTOR and entry.fit is not None},
        )

    def mount(self, trajectory: Trajectory) -> ModelEdits:
        """Replace springs and contact by those for which a trajectory was planned."""
        arm, contact = self.arm, trajectory.contact
        springs = [name for name, effect in self.effects.items() if effect.brought and effect.scope == "joint"]
        present = arm.contact.effects if arm.contact else {}
        places: dict[tuple[str, int | None], Values | None] = {
            **{(effect, joint): None for effect in springs for joint in range(1, len(arm.joints) + 1)},
            **{(effect, None): contact.get(effect) for effect in (*present, *contact)},
        }
        places |= {(trajectory.effects.get(j, springs[0]), j): dict(v) for j, v in trajectory.springs.items()}
        edited = self
        for (effect, joint), values in places.items():
            edited = edited.place(effect, joint, values)
        return edited

    def write(self) -> None:
        """Write the model file, unless it was changed since it was read. Raises UsageError, OSError."""
        with self.written():
            pass

    @contextmanager
    def written(self) -> Iterator[None]:
        """As `write`. The file stays locked within the `with`, in which other files that belong to it are written."""
        with files.locked(self.path):
            check_unchanged(self.path, self.original)
            files.replace(self.path, self.text.encode())
            yield
