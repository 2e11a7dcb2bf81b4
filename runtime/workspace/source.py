"""A model file as read, the library in which its effects are declared, and the code generated from both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.workspace.names import UsageError, arm_path, shipped_arm
from symbolic.model_file import checks
from symbolic.model_file.checks import printable

if TYPE_CHECKING:
    from codegen.firmware.source_tree import FirmwareTree
    from runtime.documents.models import EffectDocument, EffectsDocument
    from runtime.model.loader import Model
    from runtime.recordings.columns import RecordedArm
    from runtime.recordings.recording import Recording
    from runtime.workspace.edits import ModelEdits
    from symbolic.described import AnyEffect
    from symbolic.effects.declaration import Effect
    from symbolic.model_file.arm import Arm
    from symbolic.model_file.likely import LikelyNumber


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
        from runtime.workspace.edits import ModelEdits

        return ModelEdits(self.path, self.text, self.effects, original=self.text)

    @property
    def compiled(self) -> CompiledArm:
        """The generated code of the arm. Raises ModelError."""
        return CompiledArm(self.arm(), self.own)

    def joint_number(self, joint: str) -> int:
        """Number (from 1) of the joint that a number or a name means. Raises UsageError."""
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
        return RecordedArm(arm.joints, arm.space, arm.torque)


def scenario_source(model: str, scenario: Path, effects_file: Path | None) -> Source:
    """The arm that a scenario file names: a model file beside it, or an arm that comes with Tendon."""
    beside = scenario.parent / model
    return Source.read(beside, effects_file) if beside.exists() else Source.shipped(model, effects_file)


@dataclass(frozen=True)
class CompiledArm:
    """What is generated from a model file. Each call derives and compiles, or finds the result in the cache.

    own   library of effects in place of Tendon's; None: Tendon's
    """

    arm: Arm
    own: Mapping[str, Effect] | None = None

    @cached_property
    def library(self) -> Mapping[str, Effect]:
        """The effects with their equations."""
        return effects_library(None, self.arm.space) if self.own is None else self.own

    def model(self) -> Model:
        """The generated functions, loaded."""
        from codegen.prepare import prepare_arm, prepare_effects
        from runtime.model.loader import Library, Model

        effects = prepare_effects(None if self.own is None else tuple(self.own.values()), self.arm.space)
        return Model(prepare_arm(self.arm), Library(effects))

    def with_likely_numbers(self) -> tuple[CompiledArm, list[LikelyNumber]]:
        """The arm with likely inertias in place of those that its file leaves out, and what was assumed; itself where
        nothing is missing."""
        from symbolic.model_file.likely import likely_arm

        unknown = any(joint.unknown for joint in self.arm.joints)
        if not unknown or (self.arm.inertial and self.model().lumps_known):
            return self, []
        arm, numbers = likely_arm(self.arm)
        return replace(self, arm=arm), list(numbers)

    def with_guesses(self) -> CompiledArm:
        """The same arm with a library that also holds drafted laws."""
        from symbolic.grammar.laws import drafts

        guesses = {effect.name: effect for effect in drafts() if effect.name not in self.library}
        return replace(self, own={**self.library, **guesses})

    def model_with_guesses(self) -> tuple[Model, Set[str]]:
        """The model whose library also holds drafted laws, and their names."""
        wider = self.with_guesses()
        return wider.model(), wider.library.keys() - self.library.keys()

    def controller(self, target: str = "host", toolchain: str | None = None, roomy: bool = False) -> Path:
        """The directory of the arm's firmware, built for a target of `tendon firmware`; roomy: for a board with the
        memory of this computer, which holds long motions."""
        from codegen.firmware.messages import ROOMY
        from codegen.prepare import prepare_firmware

        return prepare_firmware(self.arm, self.library, target, toolchain, ROOMY if roomy else ())

    def firmware_tree(self, directory: Path) -> FirmwareTree:
        """The source files of the arm's firmware, to be written into a directory."""
        from codegen.firmware.source_tree import FirmwareTree
        from codegen.open_numbers import for_others

        return FirmwareTree.of(for_others(self.arm, self.library), self.library, directory)


def effects_library(effects_file: Path | None, space: bool) -> dict[str, Effect]:
    """The effects by name, with their equations; space: as a spatial arm has them. Raises EffectsError."""
    from symbolic.effects import shipped

    own = _own_effects(effects_file, space) if effects_file else ()
    return {**shipped(space), **{effect.name: effect for effect in own}}


def effects_described(effects_file: Path | None, space: bool) -> Mapping[str, AnyEffect]:
    """The effects by name, without equations unless the user has own effects: SymPy is not imported for it."""
    if effects_file is not None:
        return effects_library(effects_file, space)
    from codegen.descriptions import described
    from runtime.model.catalogue import effects_of

    return effects_of(described(space))


def effects_document(effects_file: Path | None) -> EffectsDocument:
    """The library with every effect's declaration. Raises EffectsError."""
    from msgspec import convert

    from codegen import metadata
    from runtime.documents.models import EffectsDocument

    return convert(metadata.library(tuple(effects_library(effects_file, space=True).values())), EffectsDocument)


def effect_document(library: EffectsDocument, name: str) -> EffectDocument:
    """One effect of the library. Raises UsageError."""
    named = {effect.name: effect for effect in library.effects}
    if name not in named:
        close = checks.nearest(name, named)
        hint = f'did you mean "{close}"? ' if close else ""
        raise UsageError(f"unknown effect {checks.quote(name)}; {hint}(tendon effects lists them all)")
    return named[name]


def _own_effects(path: Path, space: bool) -> tuple[Effect, ...]:
    """The effects of a user's file. Code is generated from each at once, so that one that cannot be is refused before
    any other work. Raises EffectsError."""
    from codegen.render import effect_files
    from symbolic.effects import EffectsError, load_user_effects, said

    effects = load_user_effects(path, space)
    for effect in effects:
        try:
            effect_files((effect,))
        except ValueError as error:
            raise EffectsError(f"{path}: {error}") from error
        except Exception as error:
            raise EffectsError(f'{path}: effect "{effect.name}" cannot be generated: {said(error)}') from error
    return effects
