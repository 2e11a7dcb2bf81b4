"""The verb that reproduces the paper's tables and figures: paper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from msgspec import UNSET

from runtime.cli.options import Json, with_settings
from runtime.cli.output import NO, costs_itself, emit
from runtime.cli.places import FILLED
from runtime.setting import Setting
from runtime.study.published import TRIALS
from runtime.workspace.names import UsageError
from runtime.workspace.source import Source

app = typer.Typer()
ARM = "vishard4"


@app.command(epilog="Example: tendon paper table2 --trials 0")
@with_settings
def paper(
    what: Annotated[
        str | None, typer.Argument(metavar="[WHAT]", help="table1 to table3 or figure4 to figure8; default: all.")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Directory for the figures."), FILLED] = Path("paper-study"),
    trials: Annotated[int, Setting("Trials of each case on the simulated arm; 0: none.", 0, 20)] = TRIALS,
    keep: Annotated[
        bool, typer.Option("--keep", help="Also write trajectories, recordings and models into it.")
    ] = False,
    json: Json = None,
) -> None:
    """Shows its numbers beside ours; exit status 1 if an expected
    claim does not hold."""
    from runtime.documents.paper import PaperDocument
    from runtime.report import terminal
    from runtime.report.plots.style import save
    from runtime.study import figures, study

    everything = (*study.TABLES, *study.FIGURES)
    if what is not None and what not in everything:
        raise UsageError(f"{what}: there is no such part; expected one of {', '.join(everything)}")
    if not trials and (what in study.EXECUTED or keep):
        raise UsageError(f"{what or '--keep'} is nothing without the experiment; leave out --trials 0")
    wanted = [name for name in everything if trials or name not in study.EXECUTED] if what is None else [what]
    source = Source.shipped(ARM)
    with terminal.working("reproducing the study") as progress:
        made = study.Study(source.compiled.model(), source.compiled.controller(), trials, progress)
        table1 = made.table1.entry() if "table1" in wanted else UNSET
        table2, table3 = (made.cases(name) if name in wanted else UNSET for name in ("table2", "table3"))
        drawn = figures.drawn(made, wanted)
        kept = study.keep(made, out, lambda plan: source.edits.mount(plan).text) if keep else []
    claims = [claim for table in (table1, table2, table3) if table is not UNSET for claim in table.claims]
    document = PaperDocument(
        table1=table1,
        table2=table2,
        table3=table3,
        spread={str(T): value for T, value in made.spread.items()} if "figure5" in wanted else UNSET,
        figures=[str(out / f"{name}.png") for name in drawn],
        kept=kept,
        holds=all(claim.holds or claim.unclaimed != "" for claim in claims),
    )
    emit(json, document, terminal.printer(study.sections))
    if drawn:
        with costs_itself("the figures"):
            out.mkdir(parents=True, exist_ok=True)
            for name, figure in drawn.items():
                save(figure, out / f"{name}.png")
    if not document.holds:
        raise typer.Exit(NO)
