"""The verbs that work on recordings: identify, compare, diagnose, improve, simulate, experiment, demo."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from runtime import boundary
from runtime.boundary import AllowGaps, EffectsFile, Json, Map, ModelFile, Recordings, Report, UsageError, emit

if TYPE_CHECKING:
    from runtime.cli import Source
    from runtime.diagnose import Diagnosis
    from runtime.improve import Improvement
    from runtime.loader import Model
    from runtime.origin import Origin
    from runtime.recording import Recording
    from runtime.story import Story

app = typer.Typer()


def _source(model: Path, effects: Path | None) -> Source:
    # The command line knows both ends; these verbs only the recordings' end.
    from runtime.cli import Source

    return Source.read(model, effects)


def _inputs(
    model: Path, recordings: list[Path], effects: Path | None, maps: list[str] | None, allow_gaps: bool
) -> tuple[Source, list[Recording], Model]:
    """Everything that a user can have wrong is checked before the first work that takes time."""
    from runtime.terminal import working

    mapping = boundary.mapping(maps)
    source = _source(model, effects)
    data = source.recordings(recordings, mapping, allow_gaps)
    with working("deriving and compiling the model"):
        return source, data, source.model()


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
    """Fit the parameters to recordings. Base inertial ones and those of the effects, with intervals."""
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
    """Where does the model fail. The residual of each joint, its noise floor, and what it follows."""
    from runtime import terminal, terminal_results

    boundary.check_writable(json)
    boundary.check_directory(report)
    source, data, loaded = _inputs(model, recordings, effects, maps, allow_gaps)
    from runtime.compare import compare as compared

    with terminal.working("comparing"):
        result = compared(loaded, data)
    from runtime.story import Story

    story = Story(result, _origin(source, model, recordings, effects, maps, allow_gaps))
    page = _report(report, story)
    emit(json, story.document, terminal_results.compare)
    _name_page(page, json)


@app.command(epilog="Example: tendon diagnose drive.toml run1.csv --report report")
def diagnose(
    model: ModelFile,
    recordings: Recordings,
    report: Report = None,
    draft: Annotated[
        Path | None,
        typer.Option(metavar="FILE.py", help="If unexplained: declare a guess at what is missing, for --effects."),
    ] = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Which physical effect is missing? Exit 1 if the answer is "unexplained" or "refused"."""
    from runtime import terminal, terminal_results
    from runtime.cli import check_draft

    boundary.check_writable(json)
    boundary.check_directory(report)
    check_draft(draft, effects)
    source, data, loaded = _inputs(model, recordings, effects, maps, allow_gaps)
    from runtime.diagnose import diagnose as diagnosed

    with terminal.working("looking for missing effects"):
        result = diagnosed(loaded, data, wider=source.guesses)
    from runtime.story import Story

    story = Story(result, _origin(source, model, recordings, effects, maps, allow_gaps), drafted=draft is not None)
    page = _report(report, story)
    document = story.document
    if draft is not None:
        reading = [*(x for entry in maps or () for x in ("--map", entry)), *(["--allow-gaps"] if allow_gaps else [])]
        document = document | _drafted(source, result, draft, effects, recordings, reading)
    emit(json, document, terminal_results.diagnosis)
    _name_page(page, json)
    if result.verdict in ("unexplained", "refused"):
        raise typer.Exit(boundary.NO)


def _drafted(
    source: Source, result: Diagnosis, target: Path, effects: Path | None, recordings: list[Path], reading: list[str]
) -> dict[str, Any]:
    """What a diagnosis says of the guess that was asked for; its file is written if there is one.

    reading   the options with which the recordings were read
    """
    from runtime import draft, files, terminal

    if result.verdict != "unexplained":
        return {"draft_reason": draft.needless(result)}
    with terminal.working("trying guesses at what is missing"):
        wider = source.drafting()
        found = draft.propose(result, *source.guesses())
    if found is None:
        return {"draft_reason": draft.none_found(result)}
    beside = None if effects is None else os.path.relpath(effects.resolve(), target.resolve().parent)
    notes = draft.notes(found, source.path.name, [path.name for path in recordings])
    files.replace(target, wider.declaration(found.term.effect, notes, beside).encode())
    following = draft.next_steps(found, source.path, recordings, reading, target)
    return {"draft": {**found.to_json(), "file": str(target), "next": following}}


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
    """Add what is missing, as long as it helps. Fits, diagnoses and adds; on a copy unless told to write."""
    from runtime import terminal_results

    if write and out:
        raise UsageError("--write and --out exclude each other: the model is written to one place")
    boundary.check_writable(json, out, model if write else None)
    boundary.check_directory(report)
    for path in held_out or ():
        if path.resolve() in {p.resolve() for p in recordings}:
            raise UsageError(f"{path}: is fitted and held out; give it once")
    source, data, _ = _inputs(model, [*recordings, *(held_out or ())], effects, maps, allow_gaps)
    improved = model if write else out
    origin = _origin(source, model, recordings, effects, maps, allow_gaps, tuple(held_out or ()), improved)
    result, story = _improved(source, data[: len(recordings)], data[len(recordings) :], origin)
    page = _report(report, story)
    if write:
        source.replace(result.model_text)
    elif out:
        from runtime import files

        files.replace(out, result.model_text.encode())
    emit(json, story.document, terminal_results.improvement)
    _name_page(page, json)


def _improved(
    source: Source, fitted: list[Recording], held_out: list[Recording], origin: Origin
) -> tuple[Improvement, Story]:
    from runtime import terminal
    from runtime.held_out import floors
    from runtime.improve import improve as improved
    from runtime.story import Story

    with terminal.working("fitting and looking for missing effects") as tell:
        result = improved(source.text, source.model, source.add, source.put, fitted, held_out, tell, source.guesses)
        return result, Story(result, origin, floors(result.steps[-1].identification, held_out))


def _origin(
    source: Source,
    model: Path,
    recordings: list[Path],
    effects: Path | None,
    maps: list[str] | None,
    allow_gaps: bool,
    held_out: tuple[Path, ...] = (),
    improved: Path | None = None,
) -> Origin:
    """What was typed, for the commands that follow from a result, and what the model file says of itself."""
    from runtime.origin import Origin, about

    read = tuple(recordings), held_out, effects, tuple(maps or ()), allow_gaps
    return Origin(model, *read, improved, about(source.text))


def _report(directory: Path | None, story: Story) -> str | None:
    """The page's path, if one was asked for."""
    if directory is None:
        return None
    from runtime.report import write_report
    from runtime.terminal import working

    with working("drawing the report"):
        return str(write_report(directory, story))


def _name_page(page: str | None, json: str | None) -> None:
    if page and json != "-":
        from runtime.terminal import say

        say(f"Report: {page}")


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
    signals: Annotated[
        str, typer.Option(metavar="NAME,...", help="Also record these: q_link, tau_link, temperature.")
    ] = "",
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Record the model itself. With a hidden effect if wanted, to try a diagnosis on."""
    from runtime import terminal

    boundary.check_writable(json, out)
    source = _source(model, effects)
    source.arm()
    with terminal.working("deriving and compiling the model"):
        loaded = source.model()
    from runtime import recording
    from runtime import simulate as simulation

    extra = simulation.parse_extra(signals)
    hidden = [simulation.parse_hidden(text, loaded) for text in hide or ()]
    path = None if motion is None else simulation.read_motion(motion, loaded.n)
    with terminal.working("simulating"):
        made, values = simulation.simulate(loaded, hidden, seed, path, seconds, repeats, noise, extra)
    recording.write(out, made)
    secret = {h.term for h in hidden}
    present = [
        {"effect": term.effect, "joint": term.joint, "hidden": term in secret, "values": dict(v)}
        for term, v in values.items()
    ]
    document = {"out": str(out), "samples": len(made.t), "seconds": len(made.t) * made.dt, "seed": seed}
    emit(json, {**document, "effects": present}, terminal.simulation)


@app.command(epilog="Example: tendon experiment drive.toml --between linear_spring@1,gravity --out motion.csv")
def experiment(
    model: ModelFile,
    between: Annotated[
        str,
        typer.Option(
            metavar="EFFECT@JOINT[:KEY=VALUE,...],...",
            help="Rivals to tell apart; one alone is told from the model as it is.",
        ),
    ],
    out: Annotated[Path | None, typer.Option(metavar="MOTION.csv", help="For your arm, or simulate --motion.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is other noise in what is simulated.")] = 0,
    noise: Annotated[float, typer.Option(min=0.0, max=10.0, help="Torque noise, part of the torque's rms.")] = 0.03,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Which motion tells these effects apart? Within the joints' limits, confirmed in simulation; exit 1 if none."""
    from runtime import terminal

    boundary.check_writable(json, out)
    source = _source(model, effects)
    source.arm()
    with terminal.working("deriving and compiling the model"):
        loaded = source.model()
    from runtime import experiment as experiments
    from runtime import terminal_experiment

    rivals = experiments.parse_rivals(between, loaded)
    with terminal.working("looking for a motion") as tell:
        proposal = experiments.propose(loaded, rivals, seed, noise, tell)
    document = proposal.to_json()
    if out and proposal.separated:
        experiments.write_motion(out, loaded, proposal.motion)
    emit(json, {**document, "out": str(out) if out and proposal.separated else None}, terminal_experiment.show)
    if not proposal.separated:
        raise typer.Exit(boundary.NO)


@app.command(epilog="Example: tendon demo")
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Recordings, improved model and report.")] = Path(
        "demo-report"
    ),
    json: Json = None,
) -> None:
    """The main job on a simulated drive. Compare, diagnose, add the hidden effect, refit, report."""
    from runtime import files, terminal, terminal_results
    from runtime.cli import Source
    from runtime.demo import record_files

    boundary.check_writable(json)
    boundary.check_directory(out)
    out.mkdir(parents=True, exist_ok=True)
    shipped = Source.shipped("drive")
    with terminal.working("recording a drive with a hidden effect"):
        paths = record_files(out)
    source = Source(out / "drive.toml", shipped.text, shipped.library, own_effects=False)
    data = source.recordings(paths)
    origin = _origin(source, boundary.nearby(shipped.path), paths[:1], None, None, False, tuple(paths[1:]), source.path)
    result, story = _improved(source, data[:1], data[1:], origin)
    page = _report(out, story)
    files.replace(source.path, result.model_text.encode())
    emit(json, story.document, terminal_results.improvement)
    _name_page(page, json)
