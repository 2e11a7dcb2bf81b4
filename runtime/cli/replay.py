"""The verb that lets recorded torques drive the model: replay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

import typer

from runtime.cli.inputs import TypedInputs, made_from, opened
from runtime.cli.options import AllowGaps, EffectsFile, Json, Map, ModelFile, Recordings, Report
from runtime.cli.output import draw, emit
from runtime.cli.places import READ
from runtime.documents.provenance import Provenance
from runtime.documents.replays import ReplayDocument, ReplayStep
from runtime.workspace.names import UsageError
from runtime.workspace.source import Source
from symbolic.model_file.checks import ModelError

if TYPE_CHECKING:
    from runtime.model.loader import Model
    from runtime.recordings.recording import Recording
    from runtime.replay.elsewhere import MujocoReplay
    from runtime.replay.replay import Replay
    from runtime.report.page.html import ReportPage

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
    sources: dict[str | None, Source] = {None: source}
    if before is not None:
        sources = {str(before): opened(before, effects), str(model): source}
        if (n := len(sources[str(before)].arm().joints)) != loaded.n:
            raise UsageError(f"--before {before}: has {n} of the {loaded.n} joints of {model}; expected the same arm")
    found = ReplayedModels.of(sources, data[: len(fitted)], data[len(fitted) :], player)
    document = found.document(provenance)
    emit(json, document, terminal.printer(replays.sections))
    if report is not None:
        draw(lambda: found.page(document).write(report), json)


@dataclass(frozen=True)
class ReplayedModels:
    """One model or two, by what they are called, replayed.

    fitted      whether their parameters were fitted to other recordings
    elsewhere   the same in MuJoCo; empty where nobody asked
    """

    names: list[str | None]
    fitted: bool
    found: list[Replay]
    elsewhere: list[MujocoReplay]

    @classmethod
    def of(
        cls,
        sources: Mapping[str | None, Source],
        fitted: Sequence[Recording],
        recordings: Sequence[Recording],
        player: Player,
    ) -> Self:
        """Raises ModelError, RecordingError, PlayError."""
        from runtime.report.terminal import working

        with working("replaying"):
            found = [replayed(each.compiled.model(), fitted, recordings) for each in sources.values()]
        elsewhere: list[MujocoReplay] = []
        if player is Player.MUJOCO:
            with working("replaying in MuJoCo"):
                elsewhere = [in_mujoco(one, own) for one, own in zip(sources.values(), found, strict=True)]
        return cls(list(sources), bool(fitted), found, elsewhere)

    def document(self, provenance: Provenance) -> ReplayDocument:
        """As --json writes it."""
        steps = [ReplayStep(added=k, joints=one.joints) for k, one in zip(self.names, self.found, strict=True)]
        if self.elsewhere:
            others = zip(self.names, self.elsewhere, strict=True)
            steps += [ReplayStep(added=name, player="mujoco", joints=one.joints) for name, one in others]
        return ReplayDocument(provenance=provenance, arm=self.found[-1].model.name, fitted=self.fitted, steps=steps)

    def page(self, document: ReplayDocument) -> ReportPage:
        """With the arm in motion."""
        from runtime.report.page.replay_page import replay_page

        return replay_page(self.found, document, self.elsewhere)


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


def in_mujoco(source: Source, own: Replay) -> MujocoReplay:
    """The same windows in MuJoCo. Raises PlayError, ModelError, RecordingError."""
    from tempfile import TemporaryDirectory

    from runtime.exchange.mujoco_play import Played
    from runtime.replay.elsewhere import MujocoReplay
    from runtime.workspace.exporting import export

    with TemporaryDirectory() as folder:
        path = Path(folder) / "arm.xml"
        export(source.compiled, "mjcf", path)
        return MujocoReplay.beside(own, Played(path))
