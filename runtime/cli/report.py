"""The verb that makes a report again from the JSON of a result: report."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from json import loads
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from runtime.cli.inputs import TypedInputs
from runtime.cli.options import EffectsFile, Json
from runtime.cli.output import emit
from runtime.cli.places import READ, Role
from runtime.documents.diagnosis import DiagnosisDocument, ImprovementDocument, SearchEntry
from runtime.documents.fits import CompareDocument, IdentifyDocument
from runtime.documents.parts import given
from runtime.documents.provenance import InputFile, ReportDocument, digest
from runtime.documents.replays import ReplayDocument
from runtime.report import page
from runtime.workspace.names import UsageError, column_mapping
from runtime.workspace.source import Source, effects_library

if TYPE_CHECKING:
    from runtime.cli.replay import ReplayedModels
    from runtime.documents.provenance import Provenance
    from runtime.report.page.html import ReportPage
    from runtime.report.summary import LoopDocument, ResultSummary

_KINDS: dict[str, type[LoopDocument | IdentifyDocument | ReplayDocument]] = {
    "history": ImprovementDocument,
    "findings": DiagnosisDocument,
    "written": IdentifyDocument,
    "joints": CompareDocument,
    "steps": ReplayDocument,
}
"""The kind of a document by a key that the kinds below it lack."""
_SAME = 1e-3
"""Part by which a residual may differ where the same is computed again: sums in another order, on another machine."""

_OF_OTHERS = {"optimize": " --report DIR", "execute": " --report DIR", "simulate": "", "inspect": ""}
"""Verbs whose results are not made again here, and the option by which they make a page."""

_TAKEN = "compare, diagnose, improve, identify, replay or demo"

app = typer.Typer()


@app.command("report", epilog="Example: tendon report result.json --out report")
def report_again(
    result: Annotated[
        Path,
        typer.Argument(metavar="RESULT.json", help=f"What {_TAKEN} wrote as JSON."),
        READ,
    ],
    out: Annotated[
        Path,
        typer.Option(metavar="DIR", help="Write the HTML page into this directory."),
        Role(writes=True, names=(page.NAME,)),
    ],
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """The result is computed again and the page has its plots, if the recordings are where they were and have not
    changed; otherwise the page has the words and tables of the JSON, and the reason is said. Plans, executions,
    simulations and inspections are not made again from JSON: it says the command that makes them."""
    from runtime.report.page import words_alone
    from runtime.report.terminal import say

    document = read_result(result)
    why_not = list(_changed(document, effects))
    made: ReportPage | None = None
    if not why_not and not isinstance(document, IdentifyDocument):
        try:
            made = _page_again(document, effects)
            if made is None:
                why_not = ["computed again, the result is another one; the page is that of the JSON"]
        except ValueError as error:
            why_not = [f"it cannot be computed again: {error}"]
    for reason in why_not:
        print(f"{result}: no plots: {reason}", file=sys.stderr)
    path = (made or words_alone.of_document(document)).write(out)
    again = ReportDocument(page=str(path), plots=made is not None, why_not=why_not)
    how = "computed again from the same files" if again.plots else "words and tables of the JSON, no plots"
    emit(json, again, lambda _: say(f"Report: {path} ({how})"))


def read_result(path: Path) -> LoopDocument | IdentifyDocument | ReplayDocument:
    """The result in a JSON file. Raises UsageError, OSError."""
    try:
        found = loads(path.read_bytes())
        if (instead := _instead(found)) is not None:
            raise UsageError(f"{path}: {instead}")
        kind = next((kind for key, kind in _KINDS.items() if key in found), None) if isinstance(found, dict) else None
        if kind is not None:
            return msgspec.convert(found, kind)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise UsageError(f"{path}: not what --json of {_TAKEN} writes: {error}") from error
    raise UsageError(f"{path}: not the result of {_TAKEN}; expected the file that its --json wrote")


def _instead(found: object) -> str | None:
    """What to do about a result whose page this verb does not make again; None if it does, or the JSON does not say."""
    provenance = found.get("provenance") if isinstance(found, dict) else None
    verb = provenance.get("verb") if isinstance(provenance, dict) else None
    if not isinstance(provenance, dict) or verb not in _OF_OTHERS:
        return None
    command = provenance.get("command")
    again = f": {command}{_OF_OTHERS[verb]}" if isinstance(command, str) else ""
    page = "" if _OF_OTHERS[verb] else ", and it has no page"
    return f"a result of {verb} is not made again from its JSON{page}; run the verb again{again}"


def _changed(document: LoopDocument | IdentifyDocument | ReplayDocument, effects: Path | None) -> Iterator[str]:
    """Why a result cannot be computed again, a sentence each."""
    provenance = given(document.provenance)
    if provenance is None:
        yield "the JSON does not say what it was made from"
        return
    if provenance.model is None or provenance.model_text is None:
        yield "the JSON does not hold the model file"
    for file in (*provenance.recordings, *provenance.held_out, *provenance.further):
        yield from _differs(file, Path(file.path))
    if provenance.effects is not None and effects is None:
        yield f"name the file of effects again, which is run: --effects {provenance.effects.typed}"
    elif provenance.effects is not None and effects is not None:
        yield from _differs(provenance.effects, effects)


def _differs(file: InputFile, path: Path) -> Iterator[str]:
    if not path.exists():
        yield f"{path} is not there"
    elif file.sha256 is None or digest(path) != file.sha256:
        yield f"{path} is not the file that was read: its SHA-256 differs"


def _page_again(document: LoopDocument | ReplayDocument, effects: Path | None) -> ReportPage | None:
    """The page of the same result, from the text of the model and the recordings; None if it is another result.

    Raises ModelError, RecordingError.
    """
    from runtime.report.page import reports

    provenance = given(document.provenance)
    assert provenance is not None
    if isinstance(document, ReplayDocument):
        replays = _replayed_again(document, provenance, effects)
        again = replays.document(provenance)
        return replays.page(again) if _same_motion(document, again) else None
    summary = _computed_again(document, provenance, effects)
    return reports.report(summary) if _agree(document, summary.document) else None


def _source_of(provenance: Provenance, effects: Path | None) -> Source:
    """The model file as it was."""
    from symbolic.model_file import reader

    assert provenance.model is not None
    assert provenance.model_text is not None
    text = provenance.model_text
    own = None if effects is None else effects_library(effects, reader.is_spatial(text))
    return Source(Path(provenance.model.path), text, own)


def _replayed_again(document: ReplayDocument, provenance: Provenance, effects: Path | None) -> ReplayedModels:
    """The same from the text of the model and the files that were read."""
    from runtime.cli.replay import Player, ReplayedModels

    source, columns = _source_of(provenance, effects), column_mapping(provenance.maps)
    names = list(dict.fromkeys(step.added for step in document.steps))
    further = [Path(file.path) for file in provenance.further]
    sources = [source] if len(names) < 2 else [Source.read(further.pop(), effects), source]
    fitted, recordings = (
        source.recordings(paths, columns, provenance.allow_gaps)
        for paths in (further, [Path(file.path) for file in provenance.recordings])
    )
    player = Player(document.steps[-1].player)
    return ReplayedModels.of(dict(zip(names, sources, strict=True)), fitted, recordings, player)


def _same_motion(one: ReplayDocument, other: ReplayDocument) -> bool:
    """Whether two replays are of the same models and leave the same errors in the longest windows."""

    def errors(document: ReplayDocument) -> list[float]:
        joints = (joint for step in document.steps for joint in step.joints)
        return [joint.open_loop[-1].rms or 0.0 if joint.open_loop else 0.0 for joint in joints]

    pairs = zip(errors(one), errors(other), strict=False)
    alike = len(errors(one)) == len(errors(other))
    return alike and all(math.isclose(a, b, rel_tol=_SAME) for a, b in pairs)


def _computed_again(document: LoopDocument, provenance: Provenance, effects: Path | None) -> ResultSummary:
    """The same from the text of the model and the recordings. Raises ModelError, RecordingError."""
    from runtime.cli.improve import improved_summary
    from runtime.diagnosis.stages import diagnose
    from runtime.identification.compare import compare
    from runtime.report.summary import ResultSummary
    from runtime.report.terminal import working

    source = _source_of(provenance, effects)
    assert provenance.model is not None
    typed = TypedInputs(
        Path(provenance.model.typed),
        [Path(file.typed) for file in provenance.recordings],
        [Path(file.typed) for file in provenance.held_out],
        effects=effects,
        maps=provenance.maps,
        allow_gaps=provenance.allow_gaps,
    )
    improved = None if isinstance(document, CompareDocument) else document.improved_model
    invocation = typed.invocation(source, provenance, None if improved is None else Path(improved))
    columns = column_mapping(provenance.maps)
    fitted, held_out = (
        source.recordings([Path(file.path) for file in files], columns, provenance.allow_gaps)
        for files in (provenance.recordings, provenance.held_out)
    )
    if isinstance(document, ImprovementDocument):
        return improved_summary(source, fitted, held_out, invocation, _budget(document.search))[1]
    with working("computing the result again"):
        model = source.compiled.model()
        if isinstance(document, CompareDocument):
            return ResultSummary(compare(model, fitted), invocation)
        found = diagnose(model, fitted, budget=_budget(document.search))
        return ResultSummary(found, invocation)


def _budget(search: SearchEntry) -> int:
    return search.refits if search.ended == "time" else search.budget


def _agree(one: LoopDocument, other: LoopDocument) -> bool:
    """Whether two results name the same effects and leave the same residuals."""

    def named(document: LoopDocument) -> list[str | None]:
        if isinstance(document, ImprovementDocument):
            return [step.added for step in document.history]
        return [] if isinstance(document, CompareDocument) else [f"{f.effect}@{f.joint}" for f in document.findings]

    pairs = zip(one.joints, other.joints, strict=False)
    alike = all(math.isclose(a.rms, b.rms, rel_tol=_SAME) for a, b in pairs)
    return named(one) == named(other) and len(one.joints) == len(other.joints) and alike
