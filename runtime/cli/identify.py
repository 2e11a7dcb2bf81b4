"""Verbs that fit a model to recordings: identify and compare."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from msgspec import UNSET, UnsetType
from msgspec.structs import replace

from runtime.cli.inputs import TypedInputs, check_own, made_from, opened
from runtime.cli.options import (
    AllowGaps,
    EffectsFile,
    Json,
    Map,
    MaybeRecordings,
    ModelFile,
    Recordings,
    Report,
    with_settings,
)
from runtime.cli.output import emit, end, write_page
from runtime.cli.places import READ
from runtime.documents.fits import FitParameters, IdentifyDocument, JudgedFitDocument
from runtime.documents.replays import OutputErrorEntry
from runtime.identification.settings import SKEW_RANGE
from runtime.setting import SearchSettings
from runtime.workspace.names import UsageError
from symbolic.model_file.arm import ROTOR

app = typer.Typer()


@app.command(epilog="Example: tendon identify drive.toml run1.csv run2.csv.gz --write")
@with_settings
def identify(
    model: ModelFile,
    recordings: MaybeRecordings = None,
    write: Annotated[bool, typer.Option("--write", help="Write the fitted values into the model file.")] = False,
    skew: Annotated[
        float | None,
        typer.Option(
            metavar="X",
            min=SKEW_RANGE[0],
            max=SKEW_RANGE[1],
            help="Offset between the clocks of torque and motion, in samples; estimated by default.",
        ),
    ] = None,
    motion: Annotated[
        bool,
        typer.Option(
            "--output-error",
            help="Refine the fit: make the error of the simulated motion small, not that of the torque.",
        ),
    ] = False,
    allowed: SearchSettings = SearchSettings(),
    statistics: Annotated[
        list[Path] | None,
        typer.Option(
            "--statistics",
            metavar="FILE",
            help="In place of recordings: what a board has added up (tendon execute --statistics).",
        ),
        READ,
    ] = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """With 95 % confidence intervals. Exit status 1 if the fit is not
    to be believed, or the search of --output-error was cut (--budget, --time-limit)."""
    from runtime.report import diagnosed, replays, terminal

    if write:
        check_own(model)
    if not motion and allowed != SearchSettings():
        raise UsageError("--budget and --time-limit are of the search of --output-error; add it, or leave them out")
    if bool(recordings) == bool(statistics):
        raise UsageError("expected recordings, or --statistics with what a board has added up, and not both")
    if statistics:
        if motion or skew is not None:
            raise UsageError("--statistics has no samples, which --output-error and --skew need; leave them out")
        _identify_sums(model, statistics, write=write, effects=effects, json=json)
        return
    assert recordings is not None
    typed = TypedInputs(model, recordings, effects=effects, maps=maps, allow_gaps=allow_gaps)
    source, data, loaded = typed.read()
    if write:
        typed.check_side(source, data)
    provenance = typed.provenance("identify", source)
    from runtime.diagnosis.credibility import judged
    from runtime.identification.identify import identify as fit
    from runtime.recordings.recording import drives_of

    with terminal.working("fitting the model"):
        found = judged(fit(loaded, data, skew=skew), data)
        document = to_write = diagnosed.judged(found)
    refined: OutputErrorEntry | UnsetType = UNSET
    if motion and found.verdict == "fitted":
        from runtime.replay import output_error

        with terminal.working("simulating the motion"):
            inference, data, refined = output_error.refined(found.fit, data, allowed)
        own = inference.document(loaded)
        to_write = replace(document, inertial=own.inertial, effects=own.effects)
    written: list[str] = []
    if write and found.verdict == "fitted":
        gains = {i: joint.to_write for i, joint in enumerate(drives_of(data), 1) if joint is not None}
        source.edits.set(to_write).set_drive_gains(gains).write()
        written = [*_written(to_write), *(f"{name}@{i}" for i, own in gains.items() for name in own)]
    origin = replace(document.skew, given=skew is not None)
    whole = document.as_part_of(
        IdentifyDocument, skew=origin, written=written, output_error=refined, provenance=provenance
    )
    emit(json, whole, terminal.printer(replays.identification))
    if written and json != "-":
        terminal.say(f"Written to {source.path}: {', '.join(written)}.")
    if found.verdict == "refused" and write and json != "-":
        terminal.say(f"Nothing written to {source.path}.")
    cut = isinstance(refined, OutputErrorEntry) and refined.search.ended != "complete"
    end(found.suspicions, found.joints, no=found.verdict == "refused" or cut)


def _identify_sums(model: Path, statistics: list[Path], *, write: bool, effects: Path | None, json: str | None) -> None:
    """Fit a model file to what boards have added up."""
    from runtime.identification.from_sums import fit_sums, sums_document
    from runtime.recordings.board_sums import BoardSums, added
    from runtime.report import fits, terminal

    source = opened(model, effects)
    sums = added([BoardSums.read(path) for path in statistics])
    provenance = made_from("identify", model, source, further=statistics, effects=effects)
    with terminal.working("deriving and compiling the model"):
        loaded = source.compiled.model()
    document = sums_document(loaded, fit_sums(loaded, sums))
    if write:
        source.edits.set(document).write()
        document = replace(document, written=_written(document))
    emit(json, replace(document, provenance=provenance), terminal.printer(fits.identification_of_sums))
    if write and json != "-":
        terminal.say(f"Written to {source.path}: {', '.join(document.written)}.")


def _written(document: FitParameters | JudgedFitDocument) -> list[str]:
    """Names of the values that the data determine and that the model file gets."""
    inertial = [p.name if p.name != ROTOR else f"{ROTOR}@{p.joint}" for p in document.inertial if p.fit is not None]
    effects = [
        entry.name if entry.joint is None else f"{entry.name}@{entry.joint}"
        for entry in document.effects
        if any(p.value is not None for p in entry.parameters.values())
    ]
    return [*inertial, *effects]


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
    """The residual torque of each joint after a fit, its noise floor, and the signals that
    it follows."""
    from runtime.report import loop, terminal

    typed = TypedInputs(model, recordings, effects=effects, maps=maps, allow_gaps=allow_gaps)
    source, data, loaded = typed.read()
    invocation = typed.invocation(source, typed.provenance("compare", source))
    from runtime.identification.compare import compare as compared

    with terminal.working("comparing"):
        result = compared(loaded, data)
    from runtime.report.summary import ResultSummary

    summary = ResultSummary(result, invocation)
    emit(json, summary.document, terminal.printer(loop.sections))
    write_page(report, summary, json)
    end(summary.suspicions, (), no=False)
