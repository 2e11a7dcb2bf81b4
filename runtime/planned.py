"""The verbs that work on planned motions: optimize, execute."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from runtime import boundary
from runtime.boundary import EffectsFile, Json, ModelFile, UsageError, emit

if TYPE_CHECKING:
    from runtime.cli import Source
    from runtime.planning.scenario import Scenario

app = typer.Typer()

TARGETS = ("simulation",)


def _source(model: Path, effects: Path | None) -> Source:
    # The command line knows both ends; these verbs only the motions' end.
    from runtime.cli import Source

    return Source.read(model, effects)


def scenario_source(scenario: Scenario, path: Path, effects: Path | None) -> Source:
    """The arm of a scenario: a model file beside it, or one that comes with the toolkit."""
    from runtime.cli import Source

    beside = path.parent / scenario.model
    return Source.read(beside, effects) if beside.exists() else Source.shipped(scenario.model, effects)


@app.command(epilog="Example: tendon optimize runtime/study/scenario1.toml --out plan.json --plot plan.png")
def optimize(
    scenario: Annotated[Path, typer.Argument(metavar="SCENARIO", help="Points, phases, springs, objective (TOML).")],
    cycle_time: Annotated[float | None, typer.Option(min=0.01, help="s, in place of the file's.")] = None,
    friction: Annotated[
        bool | None, typer.Option("--friction/--no-friction", help="In place of the file's.", show_default=False)
    ] = None,
    springs: Annotated[bool, typer.Option("--springs/--no-springs", help="With the file's springs, or bare.")] = True,
    starts: Annotated[int | None, typer.Option(min=1, max=10_000, help="Random first guesses; few by default.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is other guesses.")] = 0,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="The trajectory, for tendon execute.")] = None,
    model_out: Annotated[
        Path | None, typer.Option("--model-out", metavar="FILE", help="The model with the plan's springs and contact.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE", help="Positions and torques (.png, .svg, .pdf).")] = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Plan motion and springs together. Exit 1 if no motion meets all constraints: which one, and by how much."""
    from dataclasses import replace

    from runtime import files, terminal, terminal_plan
    from runtime.planning import scenario_file

    targets = [path for path in (out, model_out, plot) if path is not None]
    boundary.check_writable(json, *targets)
    asked = scenario_file.read(scenario)
    source = scenario_source(asked, scenario, effects)
    for path in targets:
        if path.resolve() in {scenario.resolve(), source.path.resolve()}:
            raise UsageError(f"{path}: is read here; choose another name to write to")
    source.arm()
    with terminal.working("deriving and compiling the model"):
        model = source.model()
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
            plan = optimizer.optimize(model, case, starts, seed)
    except optimizer.Infeasible as error:
        emit(json, results.refusal(model, case, error), terminal_plan.plan)
        raise typer.Exit(boundary.NO) from error
    document = results.document(model, plan)
    if out is not None:
        plan.trajectory.write(out)
    if model_out is not None:
        files.replace(model_out, source.mounted(plan.trajectory.springs, plan.trajectory.contact).encode())
    if plot is not None:
        from runtime import plot_style, plots_plan

        plot_style.save(plots_plan.plan(document), plot)
    emit(json, document, terminal_plan.plan)


@app.command(epilog="Example: tendon execute vishard4.toml case1D.json --on simulation --out run.csv.gz")
def execute(
    model: ModelFile,
    trajectory: Annotated[Path, typer.Argument(metavar="TRAJECTORY", help="JSON of tendon optimize --out.")],
    on: Annotated[str, typer.Option("--on", metavar="TARGET", help="The arm: simulation.")],
    trials: Annotated[int, typer.Option(min=1, max=100, help="Each with other noise, from rest.")] = 3,
    cycles: Annotated[
        int, typer.Option(min=1, max=10_000, help="Of a periodic motion, after one that runs it in.")
    ] = 3,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is other noise.")] = 0,
    noise: Annotated[float, typer.Option(min=0.0, max=10.0, help="Of the torque sensor, part of the rms.")] = 0.03,
    hide: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT@JOINT[:KEY=VALUE,...]", help="The simulated arm has an effect that MODEL has not."
        ),
    ] = None,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="EFFECT@JOINT:KEY=VALUE,...", help="It has other values than MODEL."),
    ] = None,
    friction_compensation: Annotated[
        bool | None,
        typer.Option(
            "--friction-compensation/--no-friction-compensation",
            help="By the controller; if not given, where the motion was planned with friction.",
            show_default=False,
        ),
    ] = None,
    tracking_limit: Annotated[
        float | None,
        typer.Option(min=0.0, help="rad or m; a larger error is a safe stop. 0.5 rad, 0.1 m.", show_default=False),
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Recording; compressed if it ends in .gz.")] = None,
    model_out: Annotated[
        Path | None,
        typer.Option("--model-out", metavar="FILE", help="The model with the springs and contact of TRAJECTORY."),
    ] = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Run a planned motion on an arm. Cost, tracking and contact beside the plan's; exit 1 after a safe stop."""
    from runtime import files, recording, terminal, terminal_execution

    if on not in TARGETS:
        raise UsageError(f"--on {on}: no such target; there is: {', '.join(TARGETS)}")
    boundary.check_writable(json, out, model_out)
    for path in (out, model_out):
        if path is not None and path.resolve() in {model.resolve(), trajectory.resolve()}:
            raise UsageError(f"{path}: is read here; choose another name to write to")
    source = _source(model, effects)
    source.arm()
    with terminal.working("deriving and compiling the model and its controller"):
        loaded, controller = source.model(), source.controller()
    from runtime import simulate
    from runtime.execution.execute import execute as executed
    from runtime.planning.trajectory import read

    plan = read(trajectory, loaded)
    text = source.mounted(plan.springs, plan.contact)
    hidden = [simulate.parse_hidden(item, loaded) for item in hide or ()]
    changed = [simulate.parse_hidden(item, loaded, "--set") for item in change or ()]
    with terminal.working(f"executing {plan.scenario} on the simulated arm"):
        result = executed(
            loaded,
            controller,
            plan,
            trials,
            cycles,
            hidden,
            changed,
            friction_compensation,
            tracking_limit,
            seed,
            noise,
        )
        document = result.to_json()
    if result.recording is None:
        out = model_out = None
    elif out is not None:
        recording.write(out, result.recording)
    if model_out is not None:
        files.replace(model_out, text.encode())
    same = model_out or (model if text == source.text else None)
    paths = {"recording": out, "model_out": model_out, "next": _next(same, out, effects)}
    emit(json, {"on": on, **document, **paths}, terminal_execution.show)
    if not result.completed:
        raise typer.Exit(boundary.NO)


def _next(model: Path | None, recording: Path | None, effects: Path | None) -> list[dict[str, str]]:
    """What follows from a recording, where model and recording of the same arm are there."""
    if recording is None or model is None:
        return []
    own = [] if effects is None else ["--effects", str(effects)]
    verbs = {"compare": "where the model fails on this recording", "diagnose": "which effect is missing in it"}
    return [
        {"what": what, "command": shlex.join(["tendon", verb, str(model), str(recording), *own])}
        for verb, what in verbs.items()
    ]
