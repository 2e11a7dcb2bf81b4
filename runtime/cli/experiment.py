"""The verb that designs motions: the first, and those that separate rival effects: experiment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from msgspec.structs import replace

from runtime.cli import completion
from runtime.cli.inputs import TypedInputs, check_hidden, opened
from runtime.cli.options import EffectsFile, Json, Map, ModelFile, with_settings
from runtime.cli.output import NO, emit
from runtime.cli.places import READ, WRITTEN
from runtime.documents.experiments import FirstMotionDocument
from runtime.documents.recordings import ExperimentDocument
from runtime.experiments.options import ExperimentSettings, FirstMotionSettings
from runtime.workspace.names import UsageError
from runtime.workspace.source import Source

if TYPE_CHECKING:
    from runtime.workspace.moving import MotionBounds

Tell = Callable[[str], None]
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
    given: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RECORDING",
            help="The next motion: it tells most beyond this recording, and separates what that leaves open; "
            "repeatable.",
        ),
        READ,
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
    shapes: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.urdf", help="Check the finished motion with this file's collision shapes, too (coal)."
        ),
        READ,
    ] = None,
    chosen: FirstMotionSettings = FirstMotionSettings(),
    settings: ExperimentSettings = ExperimentSettings(),
    maps: Map = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Within the limits of the joints. With --between confirmed in simulation.
    Exit status 1 if there is none, or the search was cut."""
    from runtime.report import terminal

    if between and (given or held_out):
        raise UsageError("--given and --held-out are for motions without --between")
    with terminal.working("looking for a motion") as say:
        from runtime.workspace.moving import MotionBounds

        bounds = MotionBounds(start, joints, ranges, floor, boxes, scene, shapes)
        said: ExperimentDocument | FirstMotionDocument
        if between:
            said = _separating(opened(model, effects), between, out, bounds, chosen, settings, say)
        else:
            typed = TypedInputs(model, given or [], effects=effects, maps=maps)
            said = _telling(typed, (out, held_out), bounds, chosen, settings, say)
    from runtime.report import recordings

    if isinstance(said, FirstMotionDocument):
        emit(json, said, terminal.printer(recordings.first_motion))
    else:
        emit(json, said, terminal.printer(recordings.experiment))
    if said.search.ended != "complete" or not getattr(said, "separated", True):
        raise typer.Exit(NO)


def _separating(
    source: Source,
    between: Sequence[str],
    out: Path | None,
    bounds: MotionBounds,
    chosen: FirstMotionSettings,
    settings: ExperimentSettings,
    say: Tell,
) -> ExperimentDocument:
    """The motion that separates rivals."""
    from runtime.experiments import asking, design
    from runtime.report import recordings
    from runtime.workspace.moving import separating

    text = ",".join(between)
    check_hidden(source, "--between", asking.rival_texts(text))
    rivals = asking.parse_rivals(text, source.compiled.model())
    to_move = bounds.arm(source, rivals)
    proposal = separating(to_move, rivals, settings, chosen, say)
    written = out if proposal.separated else None
    if written:
        design.write_motion(written, to_move.model, proposal.motion, notes=recordings.not_checked(to_move.unchecked))
    return proposal.document().as_part_of(ExperimentDocument, out=str(written) if written else None)


def _telling(
    typed: TypedInputs,
    files: tuple[Path | None, Path | None],
    bounds: MotionBounds,
    chosen: FirstMotionSettings,
    settings: ExperimentSettings,
    say: Tell,
) -> FirstMotionDocument:
    """The motion that tells most of what is unknown, beyond recordings at hand."""
    from runtime.experiments.design import write_motion
    from runtime.experiments.first_proposal import propose_first
    from runtime.report import recordings
    from runtime.workspace.moving import told_by

    source, at_hand = opened(typed.model, typed.effects), None
    if typed.recordings:
        source, data, _ = typed.read()
        say("fitting and diagnosing the recordings at hand")
        source, at_hand = told_by(source, data)
    to_move = bounds.arm(source, at_hand=at_hand)
    found = propose_first(to_move, settings, chosen, check=files[1] is not None, tell=say)
    for path, motion in zip(files, (found.first, found.check), strict=True):
        if path is not None and motion is not None:
            write_motion(path, to_move.model, motion.path, notes=recordings.motion_notes(found.document))
    out, held_out = (None if path is None else str(path) for path in files)
    return replace(found.document, out=out, held_out=held_out)
