"""The verb that reproduces the paper's tables and figures: paper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.options import Json, with_settings
from runtime.cli.output import NO, costs_itself, emit
from runtime.cli.places import FILLED
from runtime.study.options import TRIALS, Trials
from runtime.workspace.names import UsageError
from runtime.workspace.source import Source

app = typer.Typer()
ARM = "vishard4"


@app.command(epilog="Example: tendon paper table2 --trials 0")
@with_settings
def paper(
    what: Annotated[
        str | None, typer.Argument(metavar="WHAT", help="table1 to table3 or figure4 to figure8; default: all.")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Directory for the figures."), FILLED] = Path("paper-study"),
    trials: Trials = TRIALS,
    keep: Annotated[
        bool, typer.Option("--keep", help="Also write trajectories, recordings and models into it.")
    ] = False,
    json: Json = None,
) -> None:
    """Reproduce the tables and figures of the paper. Shows its numbers beside ours; exit status 1 if an expected
    claim does not hold."""
    from runtime.report import terminal
    from runtime.study import sections, study, write

    everything = (*study.TABLES, *study.FIGURES)
    if what is not None and what not in everything:
        raise UsageError(f"{what}: there is no such part; expected one of {', '.join(everything)}")
    if not trials and (what in study.EXECUTED or keep):
        raise UsageError(f"{what or '--keep'} is nothing without the experiment; leave out --trials 0")
    wanted = [name for name in everything if trials or name not in study.EXECUTED] if what is None else [what]
    source = Source.shipped(ARM)
    with terminal.working("reproducing the study") as progress:
        made = study.Study(source.compiled.model(), source.compiled.controller(), trials, progress)
        document = {name: made.table(name) for name in wanted if name in study.TABLES}
        drawn = write.figures(made, wanted)
        kept = write.recordings(made, out, lambda plan: source.edits.mount(plan).text) if keep else []
    held = [claim["holds"] or claim["unclaimed"] != "" for page in document.values() for claim in page["claims"]]
    spread = {"spread": made.spread} if "figure5" in wanted else {}
    paths = [str(out / f"{name}.png") for name in drawn]
    whole = {**document, **spread, "figures": paths, "kept": kept, "holds": all(held)}
    emit(json, whole, terminal.printer(sections.study))
    if drawn:
        with costs_itself("the figures"):
            write.save(drawn, out)
    if not all(held):
        raise typer.Exit(NO)
