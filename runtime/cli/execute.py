"""The verb that runs planned motions and motions from files on an arm: execute."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from runtime.cli import completion
from runtime.cli.inputs import check_hidden, made_from, opened
from runtime.cli.options import EffectsFile, Json, ModelFile, Report, with_settings
from runtime.cli.output import NO, draw, emit
from runtime.cli.places import READ, WRITTEN
from runtime.execution.options import ExecutionSettings
from runtime.workspace.names import UsageError

if TYPE_CHECKING:
    from runtime.documents.diagnosis import CommandEntry

app = typer.Typer()


@app.command(epilog="Example: tendon execute vishard4 case1D.json --on simulation --out run.csv.gz")
@with_settings
def execute(
    model: ModelFile,
    trajectory: Annotated[
        Path,
        typer.Argument(
            metavar="TRAJECTORY|MOTION", help="File that tendon optimize or experiment wrote, or a CSV of t,q1,..."
        ),
        READ,
    ],
    on: Annotated[
        str,
        typer.Option(
            "--on",
            metavar="TARGET",
            help="Simulated arm: simulation, unicorn, qemu. Real arm: serial:///dev/ttyACM0, canopen://can0.",
        ),
    ],
    settings: ExecutionSettings = ExecutionSettings(),
    hide: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT@JOINT[:KEY=VALUE,...]",
            help="Give the simulated arm an effect that MODEL lacks.",
            autocompletion=completion.effects_at_joints,
        ),
    ] = None,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="EFFECT@JOINT:KEY=VALUE,...", help="Give it other values than MODEL."),
    ] = None,
    arm: Annotated[
        bool, typer.Option("--arm", help="Move a real arm. Without it the motion is only predicted.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the recording; compressed if the name ends in .gz."),
        WRITTEN,
    ] = None,
    model_out: Annotated[
        Path | None,
        typer.Option("--model-out", metavar="FILE", help="Write the model with the springs and contact of TRAJECTORY."),
        WRITTEN,
    ] = None,
    statistics: Annotated[
        Path | None,
        typer.Option(
            "--statistics", metavar="FILE", help="Write what the board has added up for identify --statistics."
        ),
        WRITTEN,
    ] = None,
    report: Report = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Shows cost, tracking and contact beside those planned; exit
    status 1 after a safe stop. A motion of positions is executed
    as a plan is."""
    from runtime import files
    from runtime.execution import targets
    from runtime.execution.motions import read_either
    from runtime.recordings import recording
    from runtime.report import motions, terminal
    from runtime.simulation.simulate import parse_hidden

    targets.check_options(on, moves=arm, approach=settings.approach, hidden=hide, changed=change)
    source = opened(model, effects)
    if statistics is not None and not ((monitor := source.arm().monitor) and monitor.statistics):
        raise UsageError(f"{source.path}: its board adds nothing up; state statistics = true under [monitor]")
    check_hidden(source, "--hide", hide or ())
    check_hidden(source, "--set", change or ())
    with terminal.working("deriving and compiling the model and its controller"):
        loaded = source.compiled.model()
        controller = source.compiled.controller(targets.build_of(on), roomy=targets.is_roomy(on))
    targets.check(on, loaded)
    plan, played = read_either(trajectory, loaded, settings.speed)
    if played is not None and model_out is not None:
        raise UsageError("--model-out is for trajectories of tendon optimize: a motion brings no springs")
    warned = motions.unchecked([] if played is None else played.unchecked)
    provenance = made_from("execute", model, source, further=[trajectory], effects=effects)
    order = targets.Order(
        loaded,
        controller,
        plan,
        settings,
        hidden=[parse_hidden(item, loaded) for item in hide or ()],
        changed=[parse_hidden(item, loaded, "--set") for item in change or ()],
        moves=arm,
        ready=lambda predicted: None if json == "-" else terminal.show([*warned, *motions.prediction(predicted)]),
        working=terminal.working,
        played=played,
    )
    result, document = order.run(on)
    text = source.text if played is not None else source.edits.mount(plan).text
    if result.recording is None or document.status == "refused":
        out = model_out = None
    elif out is not None:
        recording.write(out, result.recording)
    if model_out is not None:
        files.replace(model_out, text.encode())
    summed = statistics if result.sums is not None else None
    if summed is not None and result.sums is not None:
        replace(result.sums, path=summed).write()
    same = model_out or (model if text == source.text else None)
    said = msgspec.structs.replace(
        document,
        provenance=provenance,
        recording=None if out is None else str(out),
        model_out=None if model_out is None else str(model_out),
        statistics=msgspec.UNSET if statistics is None else None if summed is None else str(summed),
        next=[] if same is None else _next(same, out, summed, effects),
    )
    emit(json, said, terminal.printer(motions.execution))
    if report is not None and result.recording is not None:
        from runtime.report.page.motion_pages import execution_page

        draw(lambda: execution_page(result, said).write(report), json)
    if document.status != "done":
        raise typer.Exit(NO)


def _next(model: Path, recording: Path | None, summed: Path | None, effects: Path | None) -> list[CommandEntry]:
    """Commands for a recording and for what the board added up, both of the model's arm."""
    from runtime.documents.diagnosis import CommandEntry

    own = [] if effects is None else ["--effects", str(effects)]
    lines: list[tuple[str, str, list[str]]] = []
    if recording is not None:
        lines.append(("where the model fails on this recording", "compare", [str(recording)]))
        lines.append(("which effect is missing in it", "diagnose", [str(recording)]))
    if summed is not None:
        lines.append(("the parameters by what the board added up", "identify", ["--statistics", str(summed)]))
    return [
        CommandEntry(what=what, command=shlex.join(["tendon", verb, str(model), *of, *own])) for what, verb, of in lines
    ]
