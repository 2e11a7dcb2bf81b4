"""An arm as a user has it: its model file, the library of effects, and what is derived, compiled and edited of it.

The one place where equations and recordings meet: command line, notebooks and pages go through it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.documents.fits import FitDocument, JudgedFitDocument
from symbolic.model_file.checks import printable, quote

# Everything heavy (SymPy, CasADi, SciPy) is imported where it is needed, so that --help is quick.
if TYPE_CHECKING:
    from codegen.firmware.source_tree import FirmwareTree
    from runtime.model.loader import Model
    from runtime.planning.trajectory import Trajectory
    from runtime.recordings.columns import RecordedArm
    from runtime.recordings.recording import Recording
    from symbolic.described import AnyEffect
    from symbolic.effects.declaration import Effect
    from symbolic.model_file.arm import Arm, Values
    from symbolic.model_file.exchange.exporting import ExportedArm, Language
    from symbolic.model_file.exchange.tree import StatedBody


class UsageError(ValueError):
    """A command line that contradicts itself."""


ARMS = Path(__file__).parent.parent / "symbolic" / "arms"
ARM = "model file here and no arm"
SCENARIOS = Path(__file__).parent / "study"
"""Where the arms and the scenarios stand that come with the toolkit, each known by the name of its file."""


def is_name(path: Path) -> bool:
    """Whether a command line means something of the toolkit: no folder, no ending, and no file here is called so."""
    return path.name == str(path) and not path.suffix and (path.is_dir() or not path.exists())


def scenario_path(scenario: Path) -> Path:
    """A scenario file, or by its name one that comes with the toolkit. Raises UsageError."""
    return _shipped(SCENARIOS, "scenario file here and no scenario", scenario.name) if is_name(scenario) else scenario


def shipped_or_given(path: Path) -> Path:
    """The file that a name of the toolkit stands for, if it is one; else the path."""
    shipped = [folder / f"{path.name}.toml" for folder in (ARMS, SCENARIOS)] if is_name(path) else []
    return next((file for file in shipped if file.exists()), path)


def _shipped(folder: Path, kind: str, name: str) -> Path:
    names = sorted(path.stem for path in folder.glob("*.toml"))
    if name not in names:
        raise UsageError(f"{quote(name)} is no {kind} of the toolkit, which has {', '.join(names)}")
    return folder / f"{name}.toml"


@dataclass(frozen=True)
class Source:
    """A model file as read: its text, what it says, and the library that its effects come from.

    own   the library, where it is another than the one that ships
    """

    path: Path
    text: str
    own: Mapping[str, Effect] | None = None

    @classmethod
    def read(cls, model: Path, effects_file: Path | None) -> Source:
        """A model file, or by its name an arm that comes with the toolkit. Raises ModelError, UsageError."""
        from symbolic.model_file import reader

        path = _shipped(ARMS, ARM, model.name) if is_name(model) else model
        text = reader.read_text(path)
        own = effects_library(effects_file, reader.is_spatial(text)) if effects_file else None
        return cls(path, text, own)

    @classmethod
    def shipped(cls, name: str, effects_file: Path | None = None) -> Source:
        """An arm that comes with the toolkit. Raises UsageError."""
        return cls.read(_shipped(ARMS, ARM, name), effects_file)

    @cached_property
    def space(self) -> bool:
        """Whether the arm is one in space."""
        from symbolic.model_file import reader

        return reader.is_spatial(self.text)

    @cached_property
    def library(self) -> Mapping[str, Effect]:
        """The effects with their equations."""
        return effects_library(None, self.space) if self.own is None else self.own

    @cached_property
    def described(self) -> Mapping[str, AnyEffect]:
        """The same without equations where the library is the one that ships: no SymPy is loaded for it."""
        return effects_described(None, self.space) if self.own is None else self.own

    def arm(self, text: str | None = None) -> Arm:
        """The arm of the file, or of other text in its place. Raises ModelError."""
        from symbolic.model_file import reader

        return reader.parse(self.text if text is None else text, str(self.path), self.described)

    def model(self, text: str | None = None) -> Model:
        """Derived, compiled (or found in the cache) and loaded."""
        from codegen.prepare import prepare_arm, prepare_effects
        from runtime.model.loader import load_library, load_model

        effects = prepare_effects(None if self.own is None else tuple(self.own.values()), self.space)
        return load_model(prepare_arm(self.arm(text)), load_library(effects))

    def controller(self, target: str = "host", toolchain: str | None = None) -> Path:
        """The directory of the arm's firmware, built for a target of `tendon firmware`."""
        from codegen.prepare import prepare_firmware

        return prepare_firmware(self.arm(), self.library, target, toolchain)

    def firmware(self, directory: Path) -> FirmwareTree:
        """The files of the controller's firmware, for a directory."""
        from codegen.firmware.source_tree import FirmwareTree
        from symbolic.model import derive

        return FirmwareTree.of(derive(self.arm()), self.library, directory)

    def joint_number(self, said: str) -> int:
        """The joint that is meant by a number or a name, from 1. Raises UsageError."""
        from symbolic.model_file import checks

        names = [joint.name for joint in self.arm().joints]
        number = checks.joint_number(said, names)
        if number is None:
            raise UsageError(f"{self.path}: there is no joint {printable(said)}; expected {checks.known_joints(names)}")
        return number

    def add(self, text: str, effect: str, joint: int | None, values: Mapping[str, float] | None = None) -> str:
        """`text` with an effect more."""
        from symbolic.model_file import editor

        return editor.add_effect(text, str(self.path), self.described, effect, joint, values)

    def leave_out(self, text: str, effect: str, joint: int | None) -> str:
        """`text` without one of its effects."""
        from symbolic.model_file import editor

        return editor.remove_effect(text, str(self.path), self.described, effect, joint)

    def name_of_next(self, effect: str, joint: int | None) -> str:
        """Under which name the file gets an effect more: several of one kind are numbered."""
        from symbolic.model_file import editor

        return editor.name_of_next(self.text, str(self.path), self.described, effect, joint)

    def mounted(self, trajectory: Trajectory) -> str:
        """The text with the springs and the contact of a trajectory in place of its own."""
        from symbolic.model_file.editor import place_effect

        text, arm, contact = self.text, self.arm(), trajectory.contact
        springs = [name for name, effect in self.described.items() if effect.brought and effect.scope == "joint"]
        there = arm.contact.effects if arm.contact else {}
        places: dict[tuple[str, int | None], Values | None] = {
            **{(effect, joint): None for effect in springs for joint in range(1, len(arm.joints) + 1)},
            **{(effect, None): contact.get(effect) for effect in (*there, *contact)},
        }
        places |= {(trajectory.effects.get(j, springs[0]), j): dict(v) for j, v in trajectory.springs.items()}
        for (effect, joint), values in places.items():
            text = place_effect(text, str(self.path), self.described, effect, joint, values)
        return text

    def drafting(self) -> Source:
        """The same with guesses at physics that its library has not."""
        from symbolic.grammar.laws import drafts

        guesses = {effect.name: effect for effect in drafts() if effect.name not in self.library}
        return replace(self, own={**self.library, **guesses})

    def guesses(self) -> tuple[Model, Set[str]]:
        """The model with guesses in its library, and their names."""
        wider = self.drafting()
        return wider.model(), wider.library.keys() - self.library.keys()

    def declaration(self, effect: str, notes: Sequence[str], beside: str | None) -> str:
        """A file for --effects that declares an effect of this library; see symbolic/effects/source.py."""
        from symbolic.effects.source import python_source

        return python_source(self.library[effect], notes, beside)

    def put(self, text: str, fit: FitDocument | JudgedFitDocument) -> str:
        """`text` with the values of a fit."""
        from symbolic.model_file import editor
        from symbolic.model_file.arm import ROTOR

        def known(values: Mapping[str, float | None]) -> dict[str, float]:
            return {name: v for name, v in values.items() if v is not None and math.isfinite(v)}

        values = {
            (entry.name, entry.joint): known({name: p.value for name, p in entry.parameters.items()})
            for entry in fit.effects
        }
        return editor.set_values(
            text,
            str(self.path),
            self.described,
            values,
            known({entry.name: entry.fit for entry in fit.inertial if entry.name != ROTOR}),
            {entry.joint: entry.fit for entry in fit.inertial if entry.name == ROTOR and entry.fit is not None},
        )

    def recordings(
        self, paths: Sequence[Path], mapping: Mapping[str, str] | None = None, allow_gaps: bool = False
    ) -> list[Recording]:
        """Recordings of this arm, in SI."""
        from runtime.recordings import recording

        arm = self.recorded_arm()
        return [recording.read(path, arm, mapping, allow_gaps) for path in paths]

    def recorded_arm(self) -> RecordedArm:
        """The arm, as far as a reader of recordings needs it."""
        from runtime.recordings.columns import RecordedArm

        arm = self.arm()
        return RecordedArm.of(arm.joints, arm.space)

    def exported(self, language: Language, onto: Path | None = None) -> tuple[bytes, dict[str, Any]]:
        """A file of the arm for simulators, and what is in it as JSON; onto: a URDF of which it is a copy with the
        model's numbers.

        Its bodies are those of the model file where that says everything; else possible ones with the file's base
        parameters, as near to its bodies as that leaves open. Raises ModelError where a base parameter is not known.
        """
        from symbolic.model_file.exchange import exporting
        from symbolic.model_file.exchange.urdf import urdf_onto

        made, missing = self._with_bodies(language)
        if onto is not None:
            rewritten = urdf_onto(made, onto)
            return rewritten.data, exporting.document(made, missing, rewritten.kept)
        text = (exporting.urdf_text if language == "urdf" else exporting.mjcf_text)(made)
        return text.encode(), exporting.document(made, missing)

    def _with_bodies(self, language: Language) -> tuple[ExportedArm, float]:
        """The arm as it is written, and the rms of the torque that its bodies miss, as a part of the torque's."""
        import numpy as np

        from runtime.exchange.bodies import is_possible
        from symbolic.model_file.exchange import exporting

        arm = self.arm()
        bodies, rotors = exporting.reference(arm)
        stated = not arm.inertial and not any(joint.unknown for joint in arm.joints)
        missing = 0.0
        if not stated or not all(is_possible(np.array(exporting.parameters(body))) for body in bodies):
            bodies, rotors, missing = self._possible(bodies, rotors)
        return exporting.exported(arm, self.library, language, bodies, rotors), missing

    def _possible(
        self, bodies: Sequence[StatedBody], rotors: Sequence[float]
    ) -> tuple[list[StatedBody], list[float], float]:
        import numpy as np

        from runtime.exchange.bodies import ChainGeometry, base_map, project, rotors_asked
        from symbolic.model_file.exchange import exporting
        from symbolic.model_file.frames import rotation

        model, arm = self.model(), self.arm()
        axes = np.array([joint.axis for joint in arm.joints])
        chain = ChainGeometry(
            np.array([rotation(joint.origin.rpy) for joint in arm.joints]),
            np.array([joint.origin.xyz for joint in arm.joints]),
            axes / np.linalg.norm(axes, axis=1, keepdims=True),
            np.array([joint.type == "revolute" for joint in arm.joints]),
            np.array(arm.gravity),
        )
        near = np.array([exporting.parameters(body) for body in bodies])
        B, W = base_map(chain, model.regressor)
        guessed = np.array([joint.rotor_inertia is None for joint in arm.joints])
        asked = rotors_asked(B, W, model.lump_values, near, np.array(rotors), guessed)
        found = project(B, W, model.lump_values, near, asked)
        return [exporting.body_of(body) for body in found.bodies], found.rotors.tolist(), found.mismatch

    def replace(self, text: str) -> None:
        """Write the model file anew, unless someone else has changed it since it was read. Raises UsageError."""
        with self.replaced(text):
            pass

    @contextmanager
    def replaced(self, text: str) -> Iterator[None]:
        """As `replace`; nobody else replaces the file before what belongs to it is written, too, inside the `with`."""
        from runtime import files

        with files.alone(self.path):
            self.check_says(self.text)
            files.replace(self.path, text.encode())
            yield

    def check_says(self, text: str) -> None:
        """Raises UsageError where the model file says something else by now."""
        from symbolic.model_file import reader

        if reader.read_text(self.path) != text:
            raise UsageError(f"{self.path}: has changed while we were at work; nothing written, try again")


def effects_library(effects_file: Path | None, space: bool) -> dict[str, Effect]:
    """The effects by name, as a planar arm or one in space has them: the library, and the user's own after it."""
    from symbolic.effects import shipped

    own = _own_effects(effects_file, space) if effects_file else ()
    return {**shipped(space), **{effect.name: effect for effect in own}}


def _own_effects(path: Path, space: bool) -> tuple[Effect, ...]:
    """Those of a user's file, as far as code can be made of them: that is found out before anything else is done."""
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


def effects_described(effects_file: Path | None, space: bool) -> Mapping[str, AnyEffect]:
    """The same without equations, unless the user has effects of his own: no SymPy is loaded for it."""
    if effects_file is not None:
        return effects_library(effects_file, space)
    from codegen.descriptions import described
    from runtime.model.catalogue import effects_of

    return effects_of(described(space))


def scenario_source(model: str, scenario: Path, effects_file: Path | None) -> Source:
    """The arm that a scenario file names: a model file beside it, or one that comes with the toolkit."""
    beside = scenario.parent / model
    return Source.read(beside, effects_file) if beside.exists() else Source.shipped(model, effects_file)


def open_model(path: Path | str, effects_file: Path | None = None) -> Model:
    """The model of a model file, ready to evaluate: for notebooks, and as every verb does it."""
    return Source.read(Path(path), effects_file).model()


def mapping(entries: Sequence[str] | None) -> dict[str, str]:
    """`--map name=column`, several times, and `--columns name,name` as a dictionary; what is mapped by itself stands
    before what a list of columns says of it, and a later sign or unit of a field before an earlier one.
    """
    from runtime.recordings.columns import in_order

    given = entries or ()
    lists = [entry for entry in given if "=" not in entry and "," in entry]
    ordered = _named(entry for columns in lists for entry in in_order(columns))
    return ordered | _named(entry for entry in given if entry not in lists)


def _named(entries: Iterable[str]) -> dict[str, str]:
    result: dict[str, str] = {}
    for entry in entries:
        name, equals, column = entry.partition("=")
        if not equals or not name.strip() or not column.strip():
            raise UsageError(f'--map {entry}: expected NAME=COLUMN, for example --map q1="Position1 [deg]"')
        if _field(result.get(name.strip(), column)) != _field(column):
            raise UsageError(f"--map {name.strip()}: given twice")
        result[name.strip()] = column.strip()
    return result


def _field(column: str) -> str:
    """A field without sign and unit: who types a cure behind what was typed before corrects it."""
    from runtime.recordings.contents import without_unit

    return without_unit(column.strip().removeprefix("-"))
