"""The verb sweep: many variations of a scenario, optimized."""

from __future__ import annotations

import os
import sys
import time
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from runtime.cli.inputs import print_notes
from runtime.cli.options import EffectsFile, Json, ScenarioFile, with_settings
from runtime.cli.output import NO, emit
from runtime.cli.places import WRITTEN
from runtime.planning.settings import Starts
from runtime.workspace.names import UsageError, scenario_path
from runtime.workspace.source import effects_described, scenario_source
from runtime.workspace.writing import keep

if TYPE_CHECKING:
    from runtime.sweep.job import Code, Pool

app = typer.Typer()

_HELP = """Exit status 1 if a combination has no plan.

\b
cycle_time=1.0:3.0:0.2    cycle time, s; or a list: cycle_time=1.0,1.2
case=A,B,C,D              A: neither springs nor friction, B: springs, C: friction, D: both
stiffness=5100,5900       stiffness of all springs, N/m
stiffness@4=5100,5900     stiffness of the spring at joint 4, or at a joint by its name
offset=-0.5,0             offset of all springs, rad or m; offset@4 likewise
plate.stiffness=600,1300  a parameter of the contact
seed=0:99                 seed of the first guesses

Finished jobs are kept in FILE.journal; the same command continues an interrupted sweep.

Dask workers (--scheduler) need Tendon and the same kind of processor; the compiled code is sent to them."""


@app.command(
    help=_HELP,
    epilog="Example: tendon sweep scenario1 --over cycle_time=1.0:3.0:0.2 --over case=A,B,C,D --table sweep.csv",
)
@with_settings
def sweep(
    scenario: ScenarioFile,
    over: Annotated[
        list[str], typer.Option("--over", metavar="NAME=VALUES", help="What varies, as above; repeatable.")
    ],
    table: Annotated[
        Path,
        typer.Option(metavar="FILE", help="Write a table with a row for each job (.csv, or .parquet with pyarrow)."),
        WRITTEN,
    ],
    starts: Starts = None,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=1024, help="Processes on this machine; default: one for each processor."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Run on the workers of this Dask scheduler instead.")
    ] = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    from runtime.documents.plans import SweepDocument
    from runtime.planning import scenario_file
    from runtime.progress import steps
    from runtime.report import motions, terminal
    from runtime.sweep import grid, journal
    from runtime.sweep.job import Code

    if workers is not None and scheduler is not None:
        raise UsageError("--workers are processes of this machine, --scheduler is a cluster; give one of them")
    journal.check(table)
    journal_path = journal.beside(table)
    if table.exists() and not journal_path.exists():
        raise UsageError(
            f"{table}: exists without its journal {journal_path.name}; move it away, or choose another --table"
        )
    path = scenario_path(scenario)
    asked = scenario_file.read(path)
    source = scenario_source(asked.model, path, effects)
    keep([path, source.path], [table, journal_path, *([Path(json)] if json else [])])
    print_notes(source)
    axes = grid.parse(over, effects_described(effects, space=True), [joint.name for joint in source.arm().joints])
    with terminal.working("deriving and compiling the model"):
        model = source.compiled.model()
    case = scenario_file.fitted(asked, model, str(path))
    code = Code(model.directory, model.library.directory)
    jobs = grid.jobs(case, axes, model, code, starts=starts)
    names = [axis.name for axis in axes]
    began = time.monotonic()
    with (
        _pool(code, workers, scheduler) as pool,
        journal.opened(journal_path, journal.heading(case, code, starts, names)) as kept,
    ):
        before = kept.finished(jobs)
        try:
            with terminal.working("planning"), steps("job", len(jobs) - before) as step:
                results = journal.run(jobs, pool, kept, step)
        except BaseException:
            done = f"{kept.finished(jobs)} of {len(jobs)} jobs are in {journal_path}"
            print(f"{done}; the same command continues from there", file=sys.stderr)
            raise
    journal.write(table, journal.columns(case, model.n, names), jobs, results)
    document = SweepDocument(
        scenario=case.name,
        arm=model.name,
        goal=case.objective.goal,
        over={axis.name: list(axis.values) for axis in axes},
        jobs=len(jobs),
        found_finished=before,
        seconds=time.monotonic() - began,
        table=str(table),
        journal=str(journal_path),
        variations=journal.summary(jobs, results, model),
    )
    emit(json, document, terminal.printer(motions.sweep))
    if not all(variation.feasible for variation in document.variations):
        raise typer.Exit(NO)


def _pool(code: Code, workers: int | None, scheduler: str | None) -> AbstractContextManager[Pool]:
    """Processes of this machine, or the workers of a cluster."""
    if scheduler is None:
        from runtime.sweep.job import processes

        return processes(code, workers or len(os.sched_getaffinity(0)))
    try:
        from runtime.sweep.cluster import cluster
    except ModuleNotFoundError as error:
        raise UsageError(
            f"--scheduler needs Dask, the extra `cluster`; run: {sys.executable} -m pip install 'dask[distributed]'"
        ) from error
    return cluster(scheduler, code)
