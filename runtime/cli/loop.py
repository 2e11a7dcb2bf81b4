"""What the verbs on recordings share: their inputs read and checked, the invocation of a result, its page."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.cli.opening import opened
from runtime.cli.output import costs_itself
from runtime.workspace.names import column_mapping, is_name
from runtime.workspace.source import Source

if TYPE_CHECKING:
    from runtime.loop.improve import Improvement
    from runtime.model.loader import Model
    from runtime.recordings.recording import Recording
    from runtime.report.follow_up import Invocation
    from runtime.report.summary import ResultSummary


def inputs(
    model: Path, recordings: list[Path], effects: Path | None, maps: list[str] | None, allow_gaps: bool
) -> tuple[Source, list[Recording], Model]:
    """Everything that a user can have wrong is checked before the first work that takes time."""
    from runtime.inspection.inspection import by_signals
    from runtime.report.terminal.pages import working

    columns = column_mapping(maps)
    source = opened(model, effects)
    data = source.recordings(recordings, columns, allow_gaps)
    for recording in data:
        for note in (*recording.notes, *map(str, by_signals(recording))):
            print(f"{recording.path}: {note}", file=sys.stderr)
    with working("deriving and compiling the model"):
        return source, data, source.compiled.model()


def improved_model(
    source: Source, fitted: list[Recording], held_out: list[Recording], invocation: Invocation
) -> tuple[Improvement, ResultSummary]:
    from runtime.loop.held_out import floors
    from runtime.loop.improve import improve as improved
    from runtime.report.summary import ResultSummary
    from runtime.report.terminal import pages

    with pages.working("fitting and looking for missing effects") as tell:
        result = improved(source, fitted, held_out, tell)
        return result, ResultSummary(result, invocation, floors(result.steps[-1].identification, held_out))


def invocation_of(
    source: Source,
    model: Path,
    recordings: list[Path],
    effects: Path | None,
    maps: list[str] | None,
    allow_gaps: bool,
    held_out: tuple[Path, ...] = (),
    improved: Path | None = None,
) -> Invocation:
    """What was typed, for the commands that follow from a result, and what the model file says of itself."""
    from runtime.report.follow_up import Invocation, about

    read = tuple(recordings), held_out, effects, tuple(maps or ()), allow_gaps
    if is_name(model):
        return Invocation(Path(f"{model}.toml"), *read, improved, about(source.text), like=str(model))
    return Invocation(model, *read, improved, about(source.text))


def draw_page(directory: Path | None, summary: ResultSummary, json: str | None) -> None:
    """The page of a result that has been said already, if one was asked for."""
    if directory is None:
        return
    from runtime.report.page.html_page import write_report
    from runtime.report.terminal.pages import say, working

    with costs_itself("the report"):
        with working("drawing the report"):
            page = write_report(directory, summary)
        if json != "-":
            say(f"Report: {page}")
