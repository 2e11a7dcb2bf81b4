"""The model file of an arm, as read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.workspace.compiled import CompiledArm
from runtime.workspace.edits import ModelEdits
from runtime.workspace.library import effects_described, effects_library
from runtime.workspace.names import UsageError, arm_path, shipped_arm
from symbolic.model_file.checks import printable

if TYPE_CHECKING:
    from runtime.model.loader import Model
    from runtime.recordings.columns import RecordedArm
    from runtime.recordings.recording import Recording
    from symbolic.described import AnyEffect
    from symbolic.effects.declaration import Effect
    from symbolic.model_file.arm import Arm


@dataclass(frozen=True)
class Source:
    """A model file: its text, what it says, and the library in which its effects are declared.

    own   library of effects in place of Tendon's; None: Tendon's
    """

    path: Path
    text: str
    own: Mapping[str, Effect] | None = None

    @classmethod
    def read(cls, model: Path, effects_file: Path | None) -> Source:
        """A model file, or by its name an arm that comes with Tendon. Raises ModelError, UsageError."""
        from symbolic.model_file import reader

        path = arm_path(model)
        text = reader.read_text(path)
        own = effects_library(effects_file, reader.is_spatial(text)) if effects_file else None
        return cls(path, text, own)

    @classmethod
    def shipped(cls, name: str, effects_file: Path | None = None) -> Source:
        """An arm that comes with Tendon. Raises UsageError."""
        return cls.read(shipped_arm(name), effects_file)

    def with_text(self, text: str) -> Source:
        """The same file with another text; nothing is written."""
        return replace(self, text=text)

    @cached_property
    def effects(self) -> Mapping[str, AnyEffect]:
        """The library of effects, without equations where it is Tendon's."""
        from symbolic.model_file import reader

        return effects_described(None, reader.is_spatial(self.text)) if self.own is None else self.own

    def arm(self) -> Arm:
        """What the file says. Raises ModelError."""
        from symbolic.model_file import reader

        return reader.parse(self.text, str(self.path), self.effects)

    @property
    def edits(self) -> ModelEdits:
        """Edits of the file, none yet."""
        return ModelEdits(self.path, self.text, self.text, self.effects)

    @property
    def compiled(self) -> CompiledArm:
        """The generated code of the arm. Raises ModelError."""
        return CompiledArm(self.arm(), self.own)

    def joint_number(self, joint: str) -> int:
        """Number (from 1) of the joint that a number or a name means. Raises UsageError."""
        from symbolic.model_file import checks

        names = [joint.name for joint in self.arm().joints]
        number = checks.joint_number(joint, names)
        if number is None:
            raise UsageError(
                f"{self.path}: there is no joint {printable(joint)}; expected {checks.known_joints(names)}"
            )
        return number

    def recordings(
        self, paths: Sequence[Path], columns: Mapping[str, str] | None = None, allow_gaps: bool = False
    ) -> list[Recording]:
        """Recordings of this arm, in SI. Raises RecordingError."""
        from runtime.recordings import recording

        arm = self.recorded_arm()
        return [recording.read(path, arm, columns, allow_gaps) for path in paths]

    def recorded_arm(self) -> RecordedArm:
        """The arm, as far as a reader of recordings needs it."""
        from runtime.recordings.columns import RecordedArm

        arm = self.arm()
        return RecordedArm.of(arm.joints, arm.space)


def scenario_source(model: str, scenario: Path, effects_file: Path | None) -> Source:
    """The arm that a scenario file names: a model file beside it, or an arm that comes with Tendon."""
    beside = scenario.parent / model
    return Source.read(beside, effects_file) if beside.exists() else Source.shipped(model, effects_file)


def open_model(path: Path | str, effects_file: Path | None = None) -> Model:
    """The compiled model of a model file."""
    return Source.read(Path(path), effects_file).compiled.model()
