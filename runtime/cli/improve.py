"""Verbs that add what is missing: improve, and demo on a simulated drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from runtime import files
from runtime.cli.inputs import TypedInputs, check_own
from runtime.cli.options import (
    AllowGaps,
    Budget,
    EffectsFile,
    HeldOut,
    Json,
    Map,
    ModelFile,
    Recordings,
    Report,
    TimeLimit,
)
from runtime.cli.output import emit, end, write_page
from runtime.cli.places import FILLED, WRITTEN
from runtime.diagnosis.settings import BUDGET
from runtime.documents.replays import ReplayStep
from runtime.progress import within
from runtime.workspace.names import UsageError
from runtime.workspace.source import Source

if TYPE_CHECKING:
    from runtime.loop.improve import Improvement
    from runtime.recordings.recording import Recording
    from runtime.report.summary import Invocation, ResultSummary

app = typer.Typer()


@app.command(epilog="Example: tendon improve drive.toml run1.csv --held-out run2.csv --out better.toml --report report")
def improve(
    model: ModelFile,
    recordings: Recordings,
    held_out: HeldOut = None,
    write: Annotated[bool, typer.Option("--write", help="Write the improved model into the model file.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the improved model into this file."), WRITTEN
    ] = None,
    report: Report = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    budget: Budget = BUDGET,
    time_limit: TimeLimit = None,
    replayed: Annotated[
        bool, typer.Option("--replay", help="Let the recorded torques drive each model, and compare the motions.")
    ] = False,
    json: Json = None,
) -> None:
    """Fits, diagnoses, adds and fits again; nothing is written
    without --write or --out. Exit status 1 if the data are refused or
    the search was cut."""
    from runtime.report import loop, terminal

    if write and out:
        raise UsageError("--write and --out exclude each other: the model is written to one place")
    if write:
        check_own(model)
    for path in held_out or ():
        if path.resolve() in {p.resolve() for p in recordings}:
            raise UsageError(f"{path}: is fitted and held out; give it once")
    typed = TypedInputs(model, recordings, held_out or (), effects=effects, maps=maps, allow_gaps=allow_gaps)
    source, data, _ = typed.read()
    if write or out:
        typed.check_side(source, data)
    provenance = typed.provenance("improve", source)
    invocation = typed.invocation(source, provenance, model if write else out)
    fitted, kept = data[: len(recordings)], data[len(recordings) :]
    with within(time_limit):
        result, summary = improved_summary(source, fitted, kept, invocation, budget)
    if replayed:
        with terminal.working("replaying"):
            summary = replace(summary, replays=replays_of(result, fitted, kept))
    emit(json, summary.document, terminal.printer(loop.sections))
    if result.found.searched.suspicions:
        if (write or out) and json != "-":
            terminal.say("Nothing written.")
    elif write:
        replace(source.edits, text=result.model_text).write()
    elif out:
        files.replace(out, result.model_text.encode())
    write_page(report, summary, json)
    no = result.found.verdict == "refused" or result.left.search.ended != "complete"
    end(result.found.searched.suspicions, result.left.last.joints, no=no)


@app.command(epilog="Example: tendon demo")
def demo(
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Directory for recordings, improved model and report."), FILLED
    ] = Path("demo-report"),
    json: Json = None,
) -> None:
    """Two minutes, no hardware."""
    from runtime.report import loop, terminal
    from runtime.simulation.demo import record_files

    out.mkdir(parents=True, exist_ok=True)
    with terminal.working("recording a drive with a hidden effect"):
        paths = record_files(out)
    source = Source(out / "drive.toml", Source.shipped("drive").text)
    data = source.recordings(paths)
    typed = TypedInputs(Path("drive"), paths[:1], paths[1:])
    invocation = typed.invocation(source, typed.provenance("demo", source), source.path)
    result, summary = improved_summary(source, data[:1], data[1:], invocation)
    files.replace(source.path, result.model_text.encode())
    emit(json, summary.document, terminal.printer(loop.sections))
    write_page(out, summary, json)


def improved_summary(
    source: Source,
    fitted: list[Recording],
    held_out: list[Recording],
    invocation: Invocation,
    budget: int = BUDGET,
) -> tuple[Improvement, ResultSummary]:
    """The result of improve, and its summary."""
    from runtime.loop.improve import floors
    from runtime.loop.improve import improve as improved
    from runtime.report import terminal
    from runtime.report.summary import ResultSummary

    with terminal.working("fitting and looking for missing effects") as say:
        result = improved(source, fitted, held_out, say, budget)
        return result, ResultSummary(result, invocation, floors(result.steps[-1].fit, held_out))


def replays_of(
    result: Improvement, fitted: Sequence[Recording], held_out: Sequence[Recording]
) -> tuple[ReplayStep, ...]:
    """How far the motion of each step's model is off, on the held-out recordings or, without any, on those fitted."""
    from runtime.replay.replay import Replay

    return tuple(
        ReplayStep(
            added=None if step.added is None else str(step.added),
            joints=Replay.of_fit(step.fit, held_out or fitted).joints,
        )
        for step in result.steps
    )
