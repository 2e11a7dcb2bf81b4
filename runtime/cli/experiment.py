"""The verb that designs motions: the first, and those that separate rival effects: experiment."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from msgspec.structs import replace

from runtime.cli import completion
from runtime.cli.inputs import check_hidden, opened
from runtime.cli.options import EffectsFile, Json, ModelFile, with_settings
from runtime.cli.output import NO, emit
from runtime.cli.places import READ, WRITTEN
from runtime.documents.recordings import ExperimentDocument
from runtime.experiments.options import ExperimentSettings, FirstMotionSettings
from runtime.workspace.names import UsageError
from runtime.workspace.source import Source

if TYPE_CHECKING:
    from runtime.experiments.scene import Scene

app = typer.Typer()


@app.command(epilog="Example: tendon experiment drive.toml --out motion.csv --held-out check.csv")
@with_settings
def experiment(
    model: ModelFile,
    between: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT@JOINT[:KEY=VALUE,...],...",
            help="Separate these rival effects, repeatable; a single one from the model as it is. "
            "Default: the motion from which everything unknown is told best.",
            autocompletion=completion.effects_at_joints,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="MOTION.csv", help="Write the motion, for your arm or for tendon simulate --motion."),
        WRITTEN,
    ] = None,
    held_out: Annotated[
        Path | None,
        typer.Option(metavar="MOTION.csv", help="Write another motion for validation, half as long."),
        WRITTEN,
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(metavar="Q1,...", help="Pose before and after, rad or m. Default: the middle of the ranges."),
    ] = None,
    joints: Annotated[
        str | None,
        typer.Option(metavar="N,...", help="Joints that move, by number or name; the others rest. Default: all."),
    ] = None,
    ranges: Annotated[
        list[str],
        typer.Option("--range", metavar="JOINT=LOW:HIGH", help="Narrower range of a joint, rad or m; repeatable."),
    ] = [],  # noqa: B006 (Typer reads it)
    floor: Annotated[
        float | None,
        typer.Option(metavar="Z", help="Height of a floor above the base frame's origin, against gravity, m."),
    ] = None,
    boxes: Annotated[
        list[str],
        typer.Option("--box", metavar="x=A:B,y=A:B,z=A:B", help="What stands in the way, m; repeatable."),
    ] = [],  # noqa: B006 (Typer reads it)
    scene: Annotated[
        Path | None,
        typer.Option(metavar="FILE.toml", help="Floor, boxes, tool, margins and the links' radii."),
        READ,
    ] = None,
    chosen: FirstMotionSettings = FirstMotionSettings(),
    settings: ExperimentSettings = ExperimentSettings(),
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Within the limits of the joints. With --between confirmed in simulation;
    exit status 1 if there is none."""
    source = opened(model, effects)
    if not between:
        _first(source, _Asked(out, held_out, start, joints, ranges, floor, boxes, scene), chosen, settings, json)
        return
    if held_out or start or boxes or scene or floor is not None or chosen != FirstMotionSettings():
        raise UsageError(
            "--held-out, --start, --floor, --box, --scene, --seconds, --speed and --tip-speed are for motions without "
            "--between"
        )
    from runtime.experiments import design as experiments
    from runtime.report import recordings, terminal

    check_hidden(source, "--between", experiments.rival_texts(",".join(between)))
    with terminal.working("deriving and compiling the model"):
        loaded = source.compiled.model()
    rivals = experiments.parse_rivals(",".join(between), loaded)
    moving = None if joints is None else experiments.parse_joints(joints, loaded, rivals)
    narrower = experiments.parse_ranges(ranges, loaded)
    with terminal.working("looking for a motion") as say:
        proposal = experiments.propose(loaded, rivals, settings, say, moving, narrower)
    written = out if proposal.separated else None
    if written:
        experiments.write_motion(written, loaded, proposal.motion)
    document = proposal.document().as_part_of(ExperimentDocument, out=str(written) if written else None)
    emit(json, document, terminal.printer(recordings.experiment))
    if not proposal.separated:
        raise typer.Exit(NO)


@dataclass(frozen=True)
class _Asked:
    """Options of a first motion as they were typed."""

    out: Path | None
    held_out: Path | None
    start: str | None
    joints: str | None
    ranges: list[str]
    floor: float | None
    boxes: list[str]
    scene_file: Path | None

    def scene(self) -> Scene:
        """What stands around the arm."""
        from runtime.experiments.scene import Scene

        return Scene.of(self.floor, self.boxes, self.scene_file)


def _first(
    source: Source, asked: _Asked, chosen: FirstMotionSettings, settings: ExperimentSettings, json: Json
) -> None:
    from runtime.report import recordings, terminal

    with terminal.working("deriving and compiling the model"):
        own, (likely, assumed) = source.compiled, source.compiled.with_likely_numbers()
        models = own.model(), likely.model()
    from runtime.experiments import design
    from runtime.experiments.clearance import Clearance
    from runtime.experiments.first_proposal import ArmToMove, propose_first

    room = Clearance.of(likely.arm, asked.scene())
    to_move = ArmToMove(
        *models,
        likely.arm,
        assumed,
        room,
        room.unchecked,
        start=None if asked.start is None else design.parse_pose(asked.start),
        moving=None if asked.joints is None else design.parse_joints(asked.joints, models[0], []),
        ranges=design.parse_ranges(asked.ranges, models[0]),
    )
    with terminal.working("looking for a motion") as say:
        found = propose_first(to_move, settings, chosen, check=asked.held_out is not None, tell=say)
    for path, motion in ((asked.out, found.first), (asked.held_out, found.check)):
        if path is not None and motion is not None:
            design.write_motion(path, models[0], motion.path, notes=recordings.motion_notes(found.document))
    document = replace(
        found.document,
        out=str(asked.out) if asked.out else None,
        held_out=str(asked.held_out) if asked.held_out else None,
    )
    emit(json, document, terminal.printer(recordings.first_motion))
