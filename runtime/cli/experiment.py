"""The verb that designs the motion that separates rival effects: experiment."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.cli import completion
from runtime.cli.inputs import check_hidden, opened
from runtime.cli.options import EffectsFile, Json, ModelFile, with_settings
from runtime.cli.output import NO, emit
from runtime.cli.places import WRITTEN
from runtime.documents.recordings import ExperimentDocument
from runtime.experiments.options import ExperimentSettings

app = typer.Typer()


@app.command(epilog="Example: tendon experiment drive.toml --between linear_spring@1,gravity --out motion.csv")
@with_settings
def experiment(
    model: ModelFile,
    between: Annotated[
        list[str],
        typer.Option(
            metavar="EFFECT@JOINT[:KEY=VALUE,...],...",
            help="Rival effects, repeatable. A single one is separated from the model as it is.",
            autocompletion=completion.effects_at_joints,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="MOTION.csv", help="Write the motion, for your arm or for tendon simulate --motion."),
        WRITTEN,
    ] = None,
    joints: Annotated[
        str | None,
        typer.Option(metavar="N,...", help="Joints that move, by number or name; the others rest. Default: all."),
    ] = None,
    ranges: Annotated[
        list[str],
        typer.Option("--range", metavar="JOINT=LOW:HIGH", help="Narrower range of a joint, rad or m; repeatable."),
    ] = [],  # noqa: B006 (Typer reads it)
    settings: ExperimentSettings = ExperimentSettings(),
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Within the limits of the joints and confirmed in simulation; exit
    status 1 if there is none."""
    from runtime.report import recordings, terminal

    source = opened(model, effects)
    from runtime.experiments import design as experiments

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
