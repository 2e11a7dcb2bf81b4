"""The command line: `tendon VERB ...`. The only place that sees both the equations and the recordings."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from runtime import boundary
from runtime.boundary import AllowGaps, EffectsFile, Json, Map, ModelFile, Recordings, Report, UsageError, emit

# Everything heavy (SymPy, CasADi, SciPy) is imported by the verb that needs it, so that --help is quick.
if TYPE_CHECKING:
    from runtime.improve import Improvement
    from runtime.loader import Model
    from runtime.recording import Recording
    from symbolic.arm import Arm
    from symbolic.effects.declaration import Effect

app = typer.Typer(
    help="Models of robot arms: derive and generate code, compare with recordings, find the missing effect, add it.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)


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

    def arm(self, text: str | None = None) -> Arm:
        from symbolic import model_file

        return model_file.parse(self.text if text is None else text, str(self.path), self.library)

    def model(self, text: str | None = None) -> Model:
        """Derived, compiled (or found in the cache) and loaded."""
        from codegen.workspace import prepare_arm, prepare_effects
        from runtime.loader import load_library, load_model

        effects = prepare_effects(tuple(self.library.values()) if self.own_effects else None)
        return load_model(prepare_arm(self.arm(text)), load_library(effects))

    def add(self, text: str, effect: str, joint: int | None, values: Mapping[str, float] | None = None) -> str:
        """`text` with an effect more."""
        from symbolic import model_edit

        return model_edit.add_effect(text, str(self.path), self.library, effect, joint, values)

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


def open_model(path: Path | str, effects_file: Path | None = None) -> Model:
    """The model of a model file, ready to evaluate: for notebooks, and as every verb does it."""
    return Source.read(Path(path), effects_file).model()


def read_recordings(
    arm: Arm, paths: Sequence[Path], mapping: Mapping[str, str] | None = None, allow_gaps: bool = False
) -> list[Recording]:
    """Recordings of this arm, in SI."""
    from runtime import recording

    joints = [{"type": joint.type, "torque_constant": joint.torque_constant} for joint in arm.joints]
    return [recording.read(path, {"joints": joints}, mapping, allow_gaps) for path in paths]


def _inputs(
    model: Path, recordings: list[Path], effects: Path | None, maps: list[str] | None, allow_gaps: bool
) -> tuple[Source, list[Recording], Model]:
    """Everything that a user can have wrong is checked before the first work that takes time."""
    from runtime.terminal import working

    mapping = boundary.mapping(maps)
    source = Source.read(model, effects)
    data = read_recordings(source.arm(), recordings, mapping, allow_gaps)
    with working("deriving and compiling the model"):
        return source, data, source.model()


# --- verbs ---


@app.command(epilog="Example: tendon generate symbolic/arms/vishard4.toml")
def generate(
    model: ModelFile,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Default: ./generated/NAME.")] = None,
    check: Annotated[bool, typer.Option("--check", help="Write nothing; exit 1 if the files are stale.")] = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Derive the equations and emit C and CasADi, and the library of effects beside it (../effects)."""
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
        files = render.arm_files(derive(arm))
        effect_files = render.effect_files(tuple(source.library.values()))
    return Rendered(arm.name, directory, beside, files, effect_files)


@app.command("effects", epilog="Example: tendon effects stribeck")
def show_effects(
    name: Annotated[str | None, typer.Argument(help="One effect; without it, all of them.")] = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """The library of physical effects: equations, parameters, what they leave in a residual."""
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


@app.command(epilog="Example: tendon identify drive.toml run1.csv run2.csv.gz --write")
def identify(
    model: ModelFile,
    recordings: Recordings,
    write: Annotated[bool, typer.Option("--write", help="Put the fitted values into the model file.")] = False,
    skew: Annotated[
        float | None, typer.Option(help="Samples by which the torque leads the motion; estimated if not given.")
    ] = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Fit the base inertial parameters and the effects' parameters to recordings."""
    from runtime import terminal

    boundary.check_writable(json, model if write else None)
    source, data, loaded = _inputs(model, recordings, effects, maps, allow_gaps)
    from runtime.identify import identify as fit

    with terminal.working("fitting the model"):
        document = fit(loaded, data, skew=skew).to_json()
    if write:
        source.replace(source.put(source.text, document))
    emit(json, document, terminal.identify)


@app.command(epilog="Example: tendon compare drive.toml run1.csv")
def compare(
    model: ModelFile,
    recordings: Recordings,
    report: Report = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Where does the model fail? The residual of each joint, its noise floor, and what it follows."""
    from runtime import terminal

    boundary.check_writable(json)
    boundary.check_directory(report)
    _, data, loaded = _inputs(model, recordings, effects, maps, allow_gaps)
    from runtime.compare import compare as compared

    with terminal.working("comparing"):
        result = compared(loaded, data)
    page = _report(report, result)
    emit(json, result.to_json(), terminal.compare)
    _name_page(page, json)


@app.command(epilog="Example: tendon diagnose drive.toml run1.csv --report report")
def diagnose(
    model: ModelFile,
    recordings: Recordings,
    report: Report = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Which physical effect is missing? Exit 1 if the answer is "unexplained" or "refused"."""
    from runtime import terminal

    boundary.check_writable(json)
    boundary.check_directory(report)
    _, data, loaded = _inputs(model, recordings, effects, maps, allow_gaps)
    from runtime.diagnose import diagnose as diagnosed

    with terminal.working("looking for missing effects"):
        result = diagnosed(loaded, data)
    page = _report(report, result)
    document = result.to_json()
    emit(json, document, terminal.diagnosis)
    _name_page(page, json)
    if document["verdict"] in ("unexplained", "refused"):
        raise typer.Exit(boundary.NO)


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


@app.command(epilog="Example: tendon improve drive.toml run1.csv --held-out run2.csv --out better.toml --report report")
def improve(
    model: ModelFile,
    recordings: Recordings,
    held_out: Annotated[
        list[Path] | None, typer.Option("--held-out", metavar="RECORDING", help="Judge on this one, not fitted.")
    ] = None,
    write: Annotated[bool, typer.Option("--write", help="Replace the model file by the improved one.")] = False,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the improved model there.")] = None,
    report: Report = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Fit, diagnose, add the missing effect, and again until nothing passes. On a copy unless told to write."""
    from runtime import terminal

    if write and out:
        raise UsageError("--write and --out exclude each other: the model is written to one place")
    boundary.check_writable(json, out, model if write else None)
    boundary.check_directory(report)
    for path in held_out or ():
        if path.resolve() in {p.resolve() for p in recordings}:
            raise UsageError(f"{path}: is fitted and held out; give it once")
    source, data, _ = _inputs(model, [*recordings, *(held_out or ())], effects, maps, allow_gaps)
    result = _improved(source, data[: len(recordings)], data[len(recordings) :])
    page = _report(report, result)
    if write:
        source.replace(result.model_text)
    elif out:
        from runtime import files

        files.replace(out, result.model_text.encode())
    emit(json, result.to_json(), terminal.improvement)
    _name_page(page, json)


def _improved(source: Source, fitted: list[Recording], held_out: list[Recording]) -> Improvement:
    from runtime import terminal
    from runtime.improve import improve as improved

    with terminal.working("fitting and looking for missing effects"):
        return improved(source.text, source.model, source.add, source.put, fitted, held_out, terminal.step)


def _report(directory: Path | None, result: Any) -> str | None:
    """The page's path, if one was asked for."""
    if directory is None:
        return None
    from runtime.report import write_report

    return str(write_report(directory, result))


def _name_page(page: str | None, json: str | None) -> None:
    if page and json != "-":
        from runtime.terminal import say

        say(f"Report: {page}")


@app.command(epilog="Example: tendon verify symbolic/arms/vishard4.toml --json vectors.json")
def verify(
    model: ModelFile,
    samples: Annotated[int, typer.Option(min=1, max=100_000, help="Random inputs of each function.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is other inputs.")] = 0,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """SymPy against generated C (double, float) and CasADi for this arm. Exit 1 if unequal."""
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


@app.command(epilog="Example: tendon simulate drive.toml --out run.csv.gz --hide stribeck@1:torque=0.6,speed=0.15")
def simulate(
    model: ModelFile,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Recording to write; compressed if it ends in .gz.")],
    hide: Annotated[
        list[str] | None,
        typer.Option(metavar="EFFECT@JOINT[:KEY=VALUE,...]", help="An effect that the model file does not have."),
    ] = None,
    motion: Annotated[Path | None, typer.Option(metavar="FILE", help="CSV with t,q1,... to follow.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is another motion and other noise.")] = 0,
    seconds: Annotated[float, typer.Option(min=2.0, max=3600.0, help="Length of the motion.")] = 40.0,
    repeats: Annotated[int, typer.Option(min=1, max=100, help="Equal parts that it consists of.")] = 2,
    noise: Annotated[float, typer.Option(min=0.0, max=10.0, help="Torque noise, part of the torque's rms.")] = 0.03,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Make a recording of the model itself, with a hidden effect if wanted, to try a diagnosis on."""
    from runtime import terminal

    boundary.check_writable(json, out)
    source = Source.read(model, effects)
    source.arm()
    with terminal.working("deriving and compiling the model"):
        loaded = source.model()
    from runtime import recording
    from runtime import simulate as simulation

    hidden = [simulation.parse_hidden(text, loaded) for text in hide or ()]
    path = None if motion is None else simulation.read_motion(motion, loaded.n)
    with terminal.working("simulating"):
        made, values = simulation.simulate(loaded, hidden, seed, path, seconds, repeats, noise)
    recording.write(out, made)
    secret = {h.term for h in hidden}
    present = [
        {"effect": term.effect, "joint": term.joint, "hidden": term in secret, "values": dict(v)}
        for term, v in values.items()
    ]
    document = {"out": str(out), "samples": len(made.t), "seconds": len(made.t) * made.dt, "seed": seed}
    emit(json, {**document, "effects": present}, terminal.simulation)


@app.command(epilog="Example: tendon demo")
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Recordings, improved model and report.")] = Path(
        "demo-report"
    ),
    json: Json = None,
) -> None:
    """The main job on a simulated drive with a hidden effect: compare, diagnose, add, refit, report."""
    import symbolic
    from runtime import files, terminal
    from runtime.demo import record_files

    boundary.check_writable(json)
    boundary.check_directory(out)
    out.mkdir(parents=True, exist_ok=True)
    shipped = Source.read(Path(symbolic.__file__).parent / "arms" / "drive.toml", None)
    with terminal.working("recording a drive with a hidden effect"):
        paths = record_files(out)
    source = Source(out / "drive.toml", shipped.text, shipped.library, own_effects=False)
    data = read_recordings(source.arm(), paths)
    result = _improved(source, data[:1], data[1:])
    page = _report(out, result)
    files.replace(source.path, result.model_text.encode())
    emit(json, result.to_json(), terminal.improvement)
    _name_page(page, json)
