"""What is generated from an arm: source code, its comparison with SymPy, firmware; and the library of effects."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import overload

from msgspec.structs import replace

from runtime.documents.generated import BuildEntry, ComparedFunction, FirmwareDocument, GenerateDocument, VerifyDocument
from runtime.documents.models import EffectDocument, EffectParameter, EffectsDocument
from runtime.documents.parts import given
from runtime.notebook.arm import LoadedArm, PathOrText
from runtime.notebook.results import MadeResult
from runtime.notebook.verbs import Recordings, read_both
from runtime.report import models
from runtime.workspace.generated import firmware_of, render_all, verified
from runtime.workspace.source import effect_document, effects_document
from runtime.workspace.watching import missed_joints, propose_monitor


class GenerationResult(MadeResult[GenerateDocument]):
    """Generated code that was written."""

    _sections = staticmethod(models.generated)
    _in_short = staticmethod(models.generated_lines)

    @property
    def directory(self) -> Path:
        """Where the arm's files are."""
        return Path(self.made.directory)

    @property
    def operations(self) -> dict[str, dict[str, int]]:
        """Operations of each generated function by kind: `operations["inverse_dynamics"]["arithmetic"]`."""
        return self.made.operations


class VerificationResult(MadeResult[VerifyDocument]):
    """Generated code compared with SymPy."""

    _sections = staticmethod(models.verification)
    _in_short = staticmethod(models.verification_lines)

    @property
    def equal(self) -> bool:
        """Whether everything is equal."""
        return self.made.equal

    @property
    def cases(self) -> list[ComparedFunction]:
        """Each function on each target at its worst sample: `.function`, `.target`, `.equal`, `.ratio` of the error to
        what is allowed."""
        return self.made.cases


@dataclass(frozen=True, repr=False)
class FirmwareResult(MadeResult[FirmwareDocument]):
    """The controller's firmware, written and compiled; `.arm` has the floors of its monitor."""

    arm: LoadedArm

    _sections = staticmethod(models.firmware)
    _in_short = staticmethod(models.firmware_lines)

    @property
    def directory(self) -> Path:
        """Where its source tree is."""
        return Path(self.made.directory)

    @property
    def build(self) -> BuildEntry:
        """What was compiled: `.outputs`, paths of files; `.text`, `.data`, `.bss`, `.stack_size` in bytes; `.stack`."""
        build = given(self.made.build)
        assert build is not None
        return build

    @property
    def fits(self) -> bool:
        """Whether the stack suffices and nothing forbidden is in it."""
        return self.build.fits


class LibraryResult(MadeResult[EffectsDocument]):
    """The library of effects: `library["stribeck"]` is one of them, `list(library)` has their names."""

    _sections = staticmethod(models.effects)

    @staticmethod
    def _in_short(document: EffectsDocument) -> list[str]:
        return [f"{effect.name}: {effect.summary}" for effect in document.effects]

    @property
    def effects(self) -> list[EffectDocument]:
        """The effects: `.name`, `.scope`, `.summary`, `.equation`, `.parameters`, `.trace`, `.source`."""
        return self.made.effects

    def __getitem__(self, name: str) -> EffectResult:
        return EffectResult(effect_document(self.made, name))

    def __iter__(self) -> Iterator[str]:
        return (effect.name for effect in self.made.effects)

    def __len__(self) -> int:
        return len(self.made.effects)


class EffectResult(MadeResult[EffectDocument]):
    """An effect of the library."""

    _sections = staticmethod(models.effect)

    @staticmethod
    def _in_short(document: EffectDocument) -> list[str]:
        return [f"{document.name}: {document.summary}", document.equation]

    @property
    def equation(self) -> str:
        """Its torque."""
        return self.made.equation

    @property
    def parameters(self) -> list[EffectParameter]:
        """`.name`, `.unit`, `.meaning`, `.role`, `.bounds`."""
        return self.made.parameters


def generate(arm: LoadedArm, directory: PathOrText | None = None, open: bool = False) -> GenerationResult:
    """Write the arm's C and CasADi code into a directory, and the library of effects beside it, into `effects`, of arms
    in space `effects_space`, with effects of your own `effects_own`.

    directory   None: generated/NAME     Raises ValueError, OSError.
    open        also where a link's numbers are open or D is not positive definite; an open rotor is taken as 0
    """
    rendered = render_all(arm.source, None if directory is None else Path(directory), None, even_open=open)
    rendered.write()
    return GenerationResult(rendered.document().as_part_of(GenerateDocument, stale=[]))


def verify(arm: LoadedArm, samples: int = 20, seed: int = 0) -> VerificationResult:
    """Compare the arm's C double, C float and CasADi with SymPy; `result.equal` is the answer.

    samples   random inputs of each function     seed   of these inputs
    """
    return VerificationResult(verified(arm.source, samples, seed))


def firmware(
    arm: LoadedArm,
    directory: PathOrText | None = None,
    target: str = "cortex-m4f",
    toolchain: str | None = None,
    monitor: Recordings = (),
) -> FirmwareResult:
    """Write the controller's firmware into a directory and compile it; `result.fits` says whether the stack suffices.

    directory   None: generated/NAME/firmware; files of yours in it stay
    target      cortex-m4f, cortex-m7 or host     toolchain   gcc or zig; None: the first that is found
    monitor     recordings of the arm while its model holds: the firmware watches the model by the floors that they show
    Raises ValueError, OSError, BuildError.
    """
    data, _ = read_both(arm, monitor)
    watched = arm.with_text(propose_monitor(arm.source, arm.model, data).text) if data else arm
    document = firmware_of(watched.source, None if directory is None else Path(directory), target, toolchain)
    if data:
        document = replace(document, missed=missed_joints(arm.model, data))
    return FirmwareResult(document, watched)


@overload
def effects(name: None = None, own: PathOrText | None = None) -> LibraryResult: ...
@overload
def effects(name: str, own: PathOrText | None = None) -> EffectResult: ...
def effects(name: str | None = None, own: PathOrText | None = None) -> LibraryResult | EffectResult:
    """The library of effects, or one effect: its equation, parameters, how it shows and its source.

    own   a Python file with effects of your own, which are in it, too; it is run, so trust it
    """
    library = LibraryResult(effects_document(None if own is None else Path(own)))
    return library if name is None else library[name]
