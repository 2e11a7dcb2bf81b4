"""The verb that lets recorded torques drive the model: replay."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from runtime.cli.inputs import TypedInputs, made_from, opened
from runtime.cli.options import AllowGaps, EffectsFile, Json, Map, ModelFile, Recordings, Report
from runtime.cli.output import draw, emit
from runtime.cli.places import READ
from runtime.documents.replays import ReplayDocument, ReplayedJoint, ReplayStep
from runtime.workspace.names import UsageError
from runtime.workspace.source import Source
from symbolic.model_file.checks import ModelError

if TYPE_CHECKING:
    from runtime.model.loader import Model
    from runtime.recordings.recording import Recording
    from runtime.replay.replay import Replay

app = typer.Typer()


class Player(StrEnum):
    """Whose equations of motion."""

    TENDON = "tendon"
    MUJOCO = "mujoco"


@app.command(epilog="Example: tendon replay better.toml run2.csv --before drive.toml --fit run1.csv")
def replay(
    model: ModelFile,
    recordings: Recordings,
    fit: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RECORDING",
            help="Fit all parameters to this recording first; without it, the values of MODEL count.",
        ),
        READ,
    ] = None,
    before: Annotated[
        Path | None,
        typer.Option(metavar="MODEL", help="A model to compare with, for instance that without the added effect."),
        READ,
    ] = None,
    player: Annotated[
        Player, typer.Option("--in", help="Beside Tendon's equations, play the file that export writes in MuJoCo.")
    ] = Player.TENDON,
    report: Report = None,
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """How far does the model's motion come from the recorded one? In open loop, windows of
    0.1, 0.3 and 1 s begin at the recorded state; in closed loop, the joints' gains or the
    law of their drives answer to the model's motion."""
    from runtime.report import replays, terminal

    fitted = fit or []
    if fitted and player is Player.MUJOCO:
        raise UsageError("--in mujoco plays the numbers of the file; identify --write writes those of --fit there")
    typed = TypedInputs(model, fitted or recordings, recordings if fitted else (), effects, maps, allow_gaps)
    source, data, loaded = typed.read()
    provenance = made_from(
        "replay",
        model,
        source,
        recordings,
        further=[*fitted, *([] if before is None else [before])],
        effects=effects,
        maps=maps or (),
        allow_gaps=allow_gaps,
    )
    sources = [source]
    if before is not None:
        sources.insert(0, opened(before, effects))
    names = [None] if before is None else [str(before), str(model)]
    with terminal.working("replaying"):
        models = [each.compiled.model() for each in sources]
        if (n := models[0].n) != loaded.n:
            raise UsageError(f"--before {before}: has {n} of the {loaded.n} joints of {model}; expected the same arm")
        found = [replayed(each, data[: len(fitted)], data[len(fitted) :]) for each in models]
        steps = [ReplayStep(added=name, joints=one.joints) for name, one in zip(names, found, strict=True)]
    if player is Player.MUJOCO:
        with terminal.working("replaying in MuJoCo"):
            for name, one, own in zip(names, sources, found, strict=True):
                steps.append(ReplayStep(added=name, player="mujoco", joints=in_mujoco(one, own)))
    document = ReplayDocument(provenance=provenance, arm=loaded.name, fitted=bool(fitted), steps=steps)
    emit(json, document, terminal.printer(replays.sections))
    if report is not None:
        from runtime.report.page.replay_page import replay_page

        draw(lambda: replay_page(found, document).write(report), json)


def replayed(model: Model, fitted: Sequence[Recording], recordings: Sequence[Recording]) -> Replay:
    """The replay of some recordings, with parameters fitted to others or, without any, those of the model file."""
    from runtime.identification.identify import identify
    from runtime.replay.replay import Replay

    if fitted:
        return Replay.of_fit(identify(model, fitted), recordings)
    try:
        return Replay.of_file(model, recordings)
    except ModelError as error:
        raise ModelError(f"{error}, or fit them to another recording first: --fit RECORDING") from error


def in_mujoco(source: Source, own: Replay) -> list[ReplayedJoint]:
    """The same windows in MuJoCo. Raises PlayError, ModelError, RecordingError."""
    from tempfile import TemporaryDirectory

    from runtime.exchange.mujoco_play import Played
    from runtime.replay.elsewhere import MujocoReplay
    from runtime.workspace.exporting import export

    with TemporaryDirectory() as folder:
        path = Path(folder) / "arm.xml"
        export(source.compiled, "mjcf", path)
        return MujocoReplay.beside(own, Played(path)).joints
