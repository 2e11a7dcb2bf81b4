"""The verb that runs planned motions on an arm: execute."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from msgspec import UnsetType

from runtime.cli import completion
from runtime.cli.inputs import check_hidden, opened
from runtime.cli.options import EffectsFile, Json, ModelFile, Report, with_settings
from runtime.cli.output import NO, draw, emit
from runtime.cli.places import READ, WRITTEN
from runtime.documents.generated import BuildEntry
from runtime.execution.options import ExecutionSettings
from runtime.workspace.names import UsageError

if TYPE_CHECKING:
    from runtime.documents.diagnosis import CommandEntry
    from runtime.documents.plans import BoardEntry, ExecuteDocument
    from runtime.execution.execute import Execution
    from runtime.execution.real import ArmLine, Setup
    from runtime.hardware.link import BoardLink
    from runtime.hardware.lockstep import Board
    from runtime.model.loader import Model
    from runtime.planning.trajectory import Trajectory

app = typer.Typer()


@app.command(epilog="Example: tendon execute vishard4 case1D.json --on simulation --out run.csv.gz")
@with_settings
def execute(
    model: ModelFile,
    trajectory: Annotated[
        Path, typer.Argument(metavar="TRAJECTORY", help="File that tendon optimize --out wrote."), READ
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
    report: Report = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Shows cost, tracking and contact beside those planned; exit
    status 1 after a safe stop."""
    from runtime import files
    from runtime.documents.plans import ImageEntry
    from runtime.execution import execute as execution
    from runtime.execution import real
    from runtime.planning.trajectory import read
    from runtime.recordings import recording
    from runtime.report import motions, terminal

    line = _line_to_real_arm(on, arm=arm, approach=settings.approach, hide=hide, change=change)
    source = opened(model, effects)
    check_hidden(source, "--hide", hide or ())
    check_hidden(source, "--set", change or ())
    simulated = execution.SIMULATED["simulation" if line else on]
    with terminal.working("deriving and compiling the model and its controller"):
        loaded, controller = source.compiled.model(), source.compiled.controller(simulated.build)
    if line is not None:
        real.check_limits(loaded)
        line.check(on, loaded)
    plan = read(trajectory, loaded)
    asked = _Asked(loaded, controller, plan, settings, hide=hide or (), change=change or ())
    if line is None:
        result = asked.simulate(settings, simulated.board)
        build = msgspec.json.decode((controller / "image.json").read_bytes(), type=BuildEntry)
        image = None  # a board of this computer has none
        if not isinstance(build.text, UnsetType):
            image = ImageEntry(target=build.target, compiler=build.toolchain.version, text=build.text)
        document = msgspec.structs.replace(result.document(), image=image)
    else:
        result, document = _real(line, on, asked, moves=arm, talks=json != "-")
    text = source.edits.mount(plan).text
    if result.recording is None or document.status == "refused":
        out = model_out = None
    elif out is not None:
        recording.write(out, result.recording)
    if model_out is not None:
        files.replace(model_out, text.encode())
    same = model_out or (model if text == source.text else None)
    said = msgspec.structs.replace(
        document,
        on=on,
        recording=None if out is None else str(out),
        model_out=None if model_out is None else str(model_out),
        next=_next(same, out, effects),
    )
    emit(json, said, terminal.printer(motions.execution))
    if report is not None and result.recording is not None:
        from runtime.report.page.motion_pages import execution_page

        draw(lambda: execution_page(result, said).write(report), json)
    if document.status != "done":
        raise typer.Exit(NO)


def _line_to_real_arm(
    on: str, *, arm: bool, approach: bool, hide: Sequence[str] | None, change: Sequence[str] | None
) -> ArmLine | None:
    """The link to a real arm; None for a simulated one. Raises UsageError if there is no such target, or an option does
    not apply."""
    from runtime.execution import execute, real

    if on in execute.SIMULATED:
        if arm or approach:
            raise UsageError(f"--{'arm' if arm else 'approach'} is for a real arm, and --on {on} is none")
        return None
    line = real.LINES.get(real.scheme(on))
    if line is None:
        meant = f"; did you mean serial://{on}?" if on.startswith("/dev/") else ""
        raise UsageError(f"--on {on}: no such target; there is: {', '.join(real.KNOWN)}{meant}")
    line.parse(on)
    if hide or change:
        raise UsageError(f"--{'hide' if hide else 'set'} is for the simulated arm, and --on {on} is a real one")
    return line


@dataclass(frozen=True)
class _Asked:
    """An arm, its trajectory and how it is executed; hide, change: of the simulated arm, as typed."""

    model: Model
    controller: Path
    plan: Trajectory
    settings: ExecutionSettings
    hide: Sequence[str]
    change: Sequence[str]

    def simulate(self, settings: ExecutionSettings, board: Callable[[Path, str, int], Board]) -> Execution:
        """The execution on the simulated arm, by a board of this computer or an emulated one."""
        from runtime.execution.execute import execute as executed
        from runtime.interruption import listening
        from runtime.report import terminal
        from runtime.simulation.simulate import parse_hidden

        with terminal.working(f"executing {self.plan.scenario} on the simulated arm"):
            return executed(
                self.model,
                self.controller,
                self.plan,
                settings,
                hidden=[parse_hidden(item, self.model) for item in self.hide],
                changed=[parse_hidden(item, self.model, "--set") for item in self.change],
                board=board,
                listening=listening,
            )


def _real(line: ArmLine, on: str, asked: _Asked, *, moves: bool, talks: bool) -> tuple[Execution, ExecuteDocument]:
    """On a real arm: simulated first, and moved only if that was completed and --arm is given."""
    from runtime.execution import execute, real
    from runtime.interruption import listening
    from runtime.report import motions, terminal

    simulated = asked.simulate(replace(asked.settings, trials=1), execute.SIMULATED["simulation"].board)
    nothing = replace(simulated, trials=())
    if not simulated.completed:
        reason = f"the simulated arm did not complete it: {simulated.reason}"
        return nothing, msgspec.structs.replace(nothing.document(), status="refused", reason=reason)
    predicted = real.prediction(simulated)

    def connect() -> tuple[BoardLink, Setup]:
        link = line.open(on, asked.model, asked.controller)
        every = real.decimation(asked.controller, asked.model, link.baud)
        return link, real.Setup(
            directory=asked.controller,
            model=asked.model,
            trajectory=asked.plan,
            settings=asked.settings,
            every=every,
            late=link.late,
        )

    if not moves:
        reason = "a real arm moves only with --arm, and nobody in its reach"
        refused = msgspec.structs.replace(nothing.document(), status="refused", reason=reason)
        return nothing, msgspec.structs.replace(refused, prediction=predicted, board=_look(connect))
    link, setup = connect()

    def ready() -> None:
        if talks:
            terminal.show(motions.prediction(predicted))

    with terminal.working(f"executing {asked.plan.scenario} on {on}"), listening() as stop:
        done, frames = real.execute_on(link, setup, ready, stop)
    found = msgspec.structs.replace(done.document(), prediction=predicted, every=setup.every, link=frames)
    if drives := link.figures():
        found = msgspec.structs.replace(found, drives=drives)
    if done.completed and link.fault:
        # Something failed after the motion, such as drives that stay powered.
        found = msgspec.structs.replace(found, status="stopped", reason=link.fault)
    return done, found


def _look(connect: Callable[[], tuple[BoardLink, Setup]]) -> BoardEntry:
    """Where each joint stands by the board, or why that is unknown; nothing moves."""
    from runtime.documents.plans import BoardEntry
    from runtime.execution import real
    from runtime.hardware.link import LinkError, LinkLost
    from runtime.hardware.lockstep import Fault

    try:
        return BoardEntry(standing=real.standing(*connect()), text=None)
    except (LinkError, LinkLost, Fault) as error:
        return BoardEntry(standing=None, text=str(error))


def _next(model: Path | None, recording: Path | None, effects: Path | None) -> list[CommandEntry]:
    """Commands for a recording, if model and recording are of the same arm."""
    from runtime.documents.diagnosis import CommandEntry

    if recording is None or model is None:
        return []
    own = [] if effects is None else ["--effects", str(effects)]
    verbs = {"compare": "where the model fails on this recording", "diagnose": "which effect is missing in it"}
    return [
        CommandEntry(what=what, command=shlex.join(["tendon", verb, str(model), str(recording), *own]))
        for verb, what in verbs.items()
    ]
