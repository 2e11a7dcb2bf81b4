"""The command line: `tendon VERB ...`. The only place that sees both the equations and the recordings."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from runtime import boundary, embedded, executed, measured, planned, swept
from runtime.boundary import EffectsFile, Json, ModelFile, UsageError, emit
from runtime.study import verb

# The matrices here are small: threads of the linear algebra library would only wait for each other. This
# must be said before NumPy is imported; who says otherwise in the environment is heard.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Everything heavy (SymPy, CasADi, SciPy) is imported by the verb that needs it, so that --help is quick.
if TYPE_CHECKING:
    from runtime.loader import Model
    from runtime.recording import Recording
    from symbolic.arm import Arm, Values
    from symbolic.effects.declaration import Effect

app = typer.Typer(
    help="Models of robot arms: derive and generate code, compare with recordings, find the missing effect, add it.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
app.add_typer(measured.app)
app.add_typer(planned.app)
app.add_typer(executed.app)
app.add_typer(swept.app)
app.add_typer(embedded.app)
app.add_typer(verb.app)


def main() -> None:
    """Entry point of the `tendon` command."""
    sys.exit(boundary.run(app, sys.argv[1:]))


# --- models and recordings ---


@dataclass(frozen=True)
class Source:
    """A model file as read: its text, what it says, and the library that its effects come from."""

    path: Path
    text: str
    library: Mapping[str, Effect]
    own_effects: bool

    @classmethod
    def read(cls, path: Path, effects_file: Path | None) -> Source:
        from symbolic import model_file

        library = effects_library(effects_file)
        return cls(path, model_file.read_text(path), library, effects_file is not None)

    @classmethod
    def shipped(cls, name: str, effects_file: Path | None = None) -> Source:
        """An arm that comes with the toolkit. Raises UsageError."""
        import symbolic

        arms = Path(symbolic.__file__).parent / "arms"
        names = sorted(path.stem for path in arms.glob("*.toml"))
        if name not in names:
            raise UsageError(f'"{name}" is no model file here and no arm of the toolkit, which has {", ".join(names)}')
        return cls.read(arms / f"{name}.toml", effects_file)

    def arm(self, text: str | None = None) -> Arm:
        from symbolic import model_file

        return model_file.parse(self.text if text is None else text, str(self.path), self.library)

    def model(self, text: str | None = None) -> Model:
        """Derived, compiled (or found in the cache) and loaded."""
        from codegen.workspace import prepare_arm, prepare_effects
        from runtime.loader import load_library, load_model

        effects = prepare_effects(tuple(self.library.values()) if self.own_effects else None)
        return load_model(prepare_arm(self.arm(text)), load_library(effects))

    def controller(self, target: str = "host", toolchain: str | None = None) -> Path:
        """The directory of the arm's firmware, built for a target of `tendon firmware`."""
        from codegen.workspace import prepare_firmware

        return prepare_firmware(self.arm(), self.library, target, toolchain)

    def firmware(self, directory: Path) -> embedded.Tree:
        """The files of the controller's firmware, for a directory."""
        from codegen.firmware import FirmwareTree
        from symbolic.model import derive

        return FirmwareTree.of(derive(self.arm()), self.library, directory)

    def add(self, text: str, effect: str, joint: int | None, values: Mapping[str, float] | None = None) -> str:
        """`text` with an effect more."""
        from symbolic import model_edit

        return model_edit.add_effect(text, str(self.path), self.library, effect, joint, values)

    def mounted(self, springs: Mapping[int, Values], contact: Mapping[str, Values]) -> str:
        """The text with the springs (by joint) and the contact (by effect) of a trajectory in place of its own."""
        from symbolic.model_edit import place_effect

        text, arm = self.text, self.arm()
        there = arm.contact.effects if arm.contact else {}
        places: dict[tuple[str, int | None], Values | None] = {
            **{("parallel_spring", joint): springs.get(joint) for joint in range(1, len(arm.joints) + 1)},
            **{(effect, None): contact.get(effect) for effect in (*there, *contact)},
        }
        for (effect, joint), values in places.items():
            text = place_effect(text, str(self.path), self.library, effect, joint, values)
        return text

    def drafting(self) -> Source:
        """The same with guesses at physics that its library has not."""
        from symbolic.effects.drafts import drafts

        guesses = {effect.name: effect for effect in drafts() if effect.name not in self.library}
        return replace(self, library={**self.library, **guesses}, own_effects=True)

    def guesses(self) -> tuple[Model, Set[str]]:
        """The model with guesses in its library, and their names."""
        wider = self.drafting()
        return wider.model(), wider.library.keys() - self.library.keys()

    def declaration(self, effect: str, notes: Sequence[str], beside: str | None) -> str:
        """A file for --effects that declares an effect of this library; see symbolic/effects/source.py."""
        from symbolic.effects.source import python_source

        return python_source(self.library[effect], notes, beside)

    def put(self, text: str, identification: Mapping[str, Any]) -> str:
        """`text` with the values of an identification, as its to_json() gives them."""
        from symbolic import model_edit

        def known(values: Mapping[str, float | None]) -> dict[str, float]:
            return {name: v for name, v in values.items() if v is not None and math.isfinite(v)}

        values = {
            (entry["effect"], entry["joint"]): known({name: p["value"] for name, p in entry["parameters"].items()})
            for entry in identification["effects"]
        }
        inertial = known({entry["name"]: entry["fit"] for entry in identification["inertial"]})
        return model_edit.set_values(text, str(self.path), self.library, values, inertial)

    def recordings(
        self, paths: Sequence[Path], mapping: Mapping[str, str] | None = None, allow_gaps: bool = False
    ) -> list[Recording]:
        """Recordings of this arm, in SI."""
        from runtime import recording

        joints = [{"type": joint.type, "torque_constant": joint.torque_constant} for joint in self.arm().joints]
        return [recording.read(path, {"joints": joints}, mapping, allow_gaps) for path in paths]

    def replace(self, text: str) -> None:
        """Write the model file anew, unless someone else has changed it since it was read."""
        from runtime import files
        from symbolic import model_file

        if model_file.read_text(self.path) != self.text:
            raise UsageError(f"{self.path}: has changed while we were at work; nothing written, try again")
        files.replace(self.path, text.encode())


def effects_library(effects_file: Path | None) -> dict[str, Effect]:
    """The effects by name: the library, and the user's own after it."""
    from symbolic.effects import LIBRARY, load_user_effects

    own = load_user_effects(effects_file) if effects_file else ()
    return {**LIBRARY, **{effect.name: effect for effect in own}}


def check_draft(target: Path | None, effects_file: Path | None) -> None:
    """Refuse a file for a guess that is there and was not written as one, or that the call itself reads."""
    from symbolic.effects.source import BANNER

    if target is None:
        return
    boundary.check_writable(target)
    if effects_file is not None and target.resolve() == effects_file.resolve():
        raise UsageError(f"{target}: is read by --effects; choose another name for --draft")
    if target.exists() and not target.read_bytes().startswith(BANNER.encode()):
        raise UsageError(f"{target}: is there already and is no draft; choose another name")


def open_model(path: Path | str, effects_file: Path | None = None) -> Model:
    """The model of a model file, ready to evaluate: for notebooks, and as every verb does it."""
    return Source.read(Path(path), effects_file).model()


@app.command(epilog="Example: tendon generate symbolic/arms/vishard4.toml")
def generate(
    model: ModelFile,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Default: ./generated/NAME.")] = None,
    check: Annotated[bool, typer.Option("--check", help="Write nothing; exit 1 if the files are stale.")] = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Derive the equations, emit C and CasADi. The library of effects goes beside it, into ../effects."""
    boundary.check_writable(json)
    source = Source.read(model, effects)
    rendered = _render(source, source.text, out)
    stale = rendered.stale() if check else []
    if not check:
        rendered.write()

    def show(document: Mapping[str, Any]) -> None:
        from runtime.terminal import say

        if check:
            say(*(stale or [f"{rendered.directory}: up to date"]))
            return
        say(f"{rendered.directory}: {len(rendered.files)} files; effects in {rendered.beside}")
        count = document["operations"]["inverse_dynamics"]
        say("inverse dynamics: " + ", ".join(f"{value} {name}" for name, value in count.items() if value))

    emit(json, {**rendered.document(), "stale": stale}, show)
    if stale:
        raise typer.Exit(boundary.NO)


@dataclass(frozen=True)
class Rendered:
    """Everything that `generate` writes, complete before the first file is touched."""

    name: str
    directory: Path
    beside: Path
    files: dict[str, str]
    effect_files: dict[str, str]

    def stale(self) -> list[str]:
        from codegen import render

        return render.stale(self.files, self.directory) + render.stale(self.effect_files, self.beside)

    def write(self) -> None:
        from codegen import render

        render.write(self.files, self.directory)
        render.write(self.effect_files, self.beside)

    def document(self) -> dict[str, Any]:
        import json

        functions = json.loads(self.files["metadata.json"])["functions"]
        return {
            "name": self.name,
            "directory": str(self.directory),
            "effects_directory": str(self.beside),
            "files": sorted(self.files),
            "effects_files": sorted(self.effect_files),
            "operations": {name: function["operations"] for name, function in functions.items()},
        }


def _render(source: Source, text: str, out: Path | None) -> Rendered:
    from codegen import render
    from runtime.terminal import working
    from symbolic.model import derive

    arm = source.arm(text)
    directory = out if out is not None else Path("generated") / arm.name
    beside = directory.parent / "effects"
    if directory.resolve() == beside.resolve():
        raise UsageError(f"{directory}: the library of effects goes there; choose another --out")
    boundary.check_directory(directory)
    boundary.check_directory(beside)
    with working(f"deriving {arm.name}"):
        model = derive(arm)
        files = render.arm_files(model) | render.controller_files(model, source.library)
        effect_files = render.effect_files(tuple(source.library.values()))
    return Rendered(arm.name, directory, beside, files, effect_files)


@app.command(epilog="Example: tendon verify symbolic/arms/vishard4.toml --json vectors.json")
def verify(
    model: ModelFile,
    samples: Annotated[int, typer.Option(min=1, max=100_000, help="Random inputs of each function.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is other inputs.")] = 0,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Is the generated code equal to SymPy? C double, C float and CasADi for this arm; exit 1 if not."""
    from runtime import terminal

    boundary.check_writable(json)
    source = Source.read(model, effects)
    arm = source.arm()
    from codegen.verify import verify as verified

    with terminal.working(f"comparing SymPy, C and CasADi of {arm.name}"):
        document = verified(arm, samples, seed, source.library.values()).to_json()
    emit(json, document, terminal.verify)
    if not document["equal"]:
        raise typer.Exit(boundary.NO)


@app.command("effects", epilog="Example: tendon effects stribeck")
def show_effects(
    name: Annotated[str | None, typer.Argument(help="One effect; without it, all of them.")] = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """The library of physical effects. Equations, parameters, what they leave in a residual."""
    from codegen import metadata
    from runtime import terminal

    boundary.check_writable(json)
    library = effects_library(effects)
    document = metadata.library(tuple(library.values()))
    if name is None:
        emit(json, document, terminal.effects)
        return
    if name not in library:
        from symbolic.checks import nearest, quote

        close = nearest(name, library)
        hint = f'did you mean "{close}"? ' if close else ""
        raise UsageError(f"unknown effect {quote(name)}; {hint}(tendon effects lists them all)")
    emit(json, next(e for e in document["effects"] if e["name"] == name), terminal.effect)


@app.command(epilog="Example: tendon add drive.toml stribeck --joint 1")
def add(
    model: ModelFile,
    effect: Annotated[str, typer.Argument(metavar="EFFECT", help="As tendon effects lists it.")],
    joint: Annotated[int | None, typer.Option(help="Counted from 1; not for effects of the arm or contact.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Default: ./generated/NAME.")] = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Put an effect into the model file and regenerate."""
    boundary.check_writable(json, model)
    source = Source.read(model, effects)
    text = source.add(source.text, effect, joint)
    rendered = _render(source, text, out)  # what cannot be generated is not written either
    source.replace(text)
    rendered.write()
    added = effect if joint is None else f"{effect}@{joint}"
    document = {"model": str(model), "added": added, **rendered.document()}

    def show(_: Any) -> None:
        from runtime.terminal import say

        say(f"{model}: {added} added; {rendered.directory} regenerated")

    emit(json, document, show)
