"""The verb that finds missing effects: diagnose."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from msgspec.structs import replace

from runtime.cli.inputs import TypedInputs
from runtime.cli.options import (
    AllowGaps,
    Budget,
    EffectsFile,
    Json,
    Map,
    ModelFile,
    Recordings,
    Report,
    TimeLimit,
)
from runtime.cli.output import emit, end, write_page
from runtime.cli.places import WRITTEN
from runtime.diagnosis.settings import BUDGET
from runtime.documents.diagnosis import DraftEntry
from runtime.progress import within
from runtime.workspace.names import UsageError

if TYPE_CHECKING:
    from runtime.diagnosis.verdict import Diagnosis
    from runtime.report.summary import Invocation
    from runtime.workspace.source import Source

app = typer.Typer()


@app.command(epilog="Example: tendon diagnose drive.toml run1.csv --report report")
def diagnose(
    model: ModelFile,
    recordings: Recordings,
    report: Report = None,
    draft: Annotated[
        Path | None,
        typer.Option(metavar="FILE.py", help="If unexplained, draft an effect into this file, for --effects."),
        WRITTEN,
    ] = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    budget: Budget = BUDGET,
    time_limit: TimeLimit = None,
    json: Json = None,
) -> None:
    """Exit status 1 if the verdict is "unexplained" or "refused", or if
    the search was cut."""
    from runtime.report import loop, terminal

    if draft is not None:
        from symbolic.effects.source import BANNER

        if draft.exists() and not draft.read_bytes().startswith(BANNER.encode()):
            raise UsageError(f"{draft}: already exists and is not a draft; choose another name")
    typed = TypedInputs(model, recordings, effects=effects, maps=maps, allow_gaps=allow_gaps)
    source, data, loaded = typed.read()
    invocation = typed.invocation(source, typed.provenance("diagnose", source))
    from runtime.diagnosis.stages import diagnose as diagnosed

    with terminal.working("looking for missing effects"), within(time_limit):
        result = diagnosed(loaded, data, budget=budget)
    from runtime.report.summary import ResultSummary

    summary = ResultSummary(result, invocation, drafted=draft is not None)
    document = summary.document
    if draft is not None:
        from runtime.report.summary import reading

        options = reading(maps or (), allow_gaps)
        document = replace(document, **_drafted(source, result, draft, invocation, reading=options))
    emit(json, document, terminal.printer(loop.sections))
    write_page(report, summary, json)
    no = result.verdict in ("unexplained", "refused") or result.search.ended != "complete"
    end(result.searched.suspicions, result.last.joints, no=no)


def _drafted(
    source: Source, result: Diagnosis, target: Path, invocation: Invocation, reading: list[str]
) -> dict[str, DraftEntry | str]:
    """Keys of the document for the draft that was asked for; writes its file if there is one.

    reading   options with which the recordings were read
    """
    from runtime import files
    from runtime.loop import improve
    from runtime.report import diagnosed, drafts, terminal
    from symbolic.effects.source import python_source

    if not result.unexplained:
        return {"draft_reason": drafts.needless(result)}
    with terminal.working("trying guesses at what is missing"):
        wider = source.compiled.with_guesses()
        found = improve.propose(result, *source.compiled.model_with_guesses())
    if found is None:
        return {"draft_reason": drafts.none_found(result)}
    own = invocation.effects
    beside = None if own is None else os.path.relpath(own.resolve(), target.resolve().parent)
    notes = drafts.notes(found, source.path.name, [path.name for path in invocation.recordings])
    files.replace(target, python_source(wider.library[found.term.effect], notes, beside).encode())
    following = drafts.next_steps(found, invocation.model, invocation.recordings, reading, target=target)
    following = [invocation.copy(), *following] if invocation.like else following
    return {"draft": diagnosed.drafted(found).as_part_of(DraftEntry, file=str(target), next=following)}
