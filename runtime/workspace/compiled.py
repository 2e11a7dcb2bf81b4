"""Generated code of an arm, prepared and loaded."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.workspace.library import effects_library

if TYPE_CHECKING:
    from codegen.firmware.source_tree import FirmwareTree
    from runtime.model.loader import Model
    from symbolic.effects.declaration import Effect
    from symbolic.model_file.arm import Arm


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
        from runtime.model.loader import load_library, load_model

        effects = prepare_effects(None if self.own is None else tuple(self.own.values()), self.arm.space)
        return load_model(prepare_arm(self.arm), load_library(effects))

    def with_guesses(self) -> CompiledArm:
        """The same arm with a library that also holds drafted laws."""
        from symbolic.grammar.laws import drafts

        guesses = {effect.name: effect for effect in drafts() if effect.name not in self.library}
        return replace(self, own={**self.library, **guesses})

    def model_with_guesses(self) -> tuple[Model, Set[str]]:
        """The model whose library also holds drafted laws, and their names."""
        wider = self.with_guesses()
        return wider.model(), wider.library.keys() - self.library.keys()

    def controller(self, target: str = "host", toolchain: str | None = None) -> Path:
        """The directory of the arm's firmware, built for a target of `tendon firmware`."""
        from codegen.prepare import prepare_firmware

        return prepare_firmware(self.arm, self.library, target, toolchain)

    def firmware_tree(self, directory: Path) -> FirmwareTree:
        """The source files of the arm's firmware, to be written into a directory."""
        from codegen.firmware.source_tree import FirmwareTree
        from symbolic.model import derive

        return FirmwareTree.of(derive(self.arm), self.library, directory)
