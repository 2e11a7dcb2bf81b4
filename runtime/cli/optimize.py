"""The verb that plans motions: optimize."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer
from msgspec import structs

from runtime.cli.inputs import made_from, print_notes
from runtime.cli.options import EffectsFile, Json, Report, ScenarioFile, with_settings
from runtime.cli.output import NO, costs_itself, draw, emit
from runtime.cli.places import DRAWN, WRITTEN
from runtime.planning.settings import LONGEST_CYCLE, SHORTEST_CYCLE, PlanningSettings
from runtime.workspace.names import is_name, scenario_path
from runtime.workspace.source import scenario_source
from runtime.workspace.writing import keep

app = typer.Typer()


@app.command(epilog="Example: tendon optimize scenario1 --out plan.json --plot plan.png")
@with_settings
def optimize(
    scenario: ScenarioFile,
    cycle_time: Annotated[
        float | None,
        typer.Option(
            min=SHORTEST_CYCLE, max=LONGEST_CYCLE, metavar="S", help="Cycle time in s, in place of the file's."
        ),
    ] = None,
    friction: Annotated[
        bool | None,
        typer.Option(
            "--friction/--no-friction", help="Whether joints have friction, in place of the file's.", show_default=False
        ),
    ] = None,
    springs: Annotated[
        bool, typer.Option("--springs/--no-springs", help="With the springs of the file, or without.")
    ] = True,
    settings: PlanningSettings = PlanningSettings(),
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the trajectory, for tendon execute."), WRITTEN
    ] = None,
    model_out: Annotated[
        Path | None,
        typer.Option("--model-out", metavar="FILE", help="Write the model with the planned springs and contact."),
        WRITTEN,
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw positions and torques (.png, .svg or .pdf)."), DRAWN
    ] = None,
    report: Report = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Exit status 1 if no motion meets all constraints, or the search was cut; shows
    which constraint fails, and by how much."""
    from dataclasses import replace

    from runtime import files
    from runtime.planning import scenario_file
    from runtime.report import motions, terminal

    scenario = scenario_path(scenario)
    asked = scenario_file.read(scenario)
    source = scenario_source(asked.model, scenario, effects)
    keep([source.path], [Path(path) for path in (json, out, model_out, plot) if path])
    print_notes(source)
    provenance = made_from("optimize", source.path, source, further=[scenario], effects=effects)
    with terminal.working("deriving and compiling the model"):
        model = source.compiled.model()
    case = scenario_file.fitted(asked, model, str(scenario))
    case = replace(
        case if springs else case.without_springs(),
        cycle_time=case.cycle_time if cycle_time is None else cycle_time,
        friction=case.friction if friction is None else friction,
    )
    from runtime.planning import optimize as optimizer
    from runtime.planning import results

    try:
        with terminal.working(f"optimizing {case.name}"):
            plan = optimizer.optimize(model, case, settings)
        with terminal.working(f"optimizing {case.name} without springs, to compare"):
            bare = optimizer.without_springs(model, plan, settings)
    except optimizer.Infeasible as error:
        refusal = structs.replace(results.refusal(model, case, error), provenance=provenance)
        emit(json, refusal, terminal.printer(motions.plan))
        raise typer.Exit(NO) from error
    document = structs.replace(results.document(model, plan, bare), provenance=provenance)
    if out is not None:
        plan.trajectory.write(out)
    if model_out is not None:
        files.replace(model_out, source.edits.mount(plan.trajectory).text.encode())
    emit(json, document, terminal.printer(motions.plan))
    if plot is not None:
        from runtime.report.plots import motion_plots, style

        with costs_itself("the plot"):
            style.save(motion_plots.plan(document), plot)
    if report is not None:
        from runtime.documents.diagnosis import CommandEntry
        from runtime.report.page.motion_pages import plan_page

        below = source.path.is_relative_to(here := Path.cwd())
        arm = asked.model if is_name(Path(asked.model)) else source.path.relative_to(here) if below else source.path
        line = shlex.join(["tendon", "execute", str(arm), str(out), "--on", "simulation"])
        following = [CommandEntry(command=line, what="executes it on the simulated arm")] if out else []
        draw(lambda: plan_page(model, plan.trajectory, document, following).write(report), json)
    if document.search.ended != "complete":
        raise typer.Exit(NO)
