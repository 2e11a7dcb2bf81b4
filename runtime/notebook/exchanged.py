"""Files of other programs: an arm from a URDF or MJCF, and an arm's equations and bodies written for others."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from runtime.documents.experiments import ExportedMotionDocument
from runtime.documents.models import ExportDocument
from runtime.experiments.options import MotionOptions
from runtime.notebook.arm import LoadedArm, PathOrText
from runtime.notebook.results import MadeResult
from runtime.notebook.verbs import Recordings, read_both
from runtime.report import models, motions
from runtime.workspace import exporting
from runtime.workspace.source import Source, effects_described, effects_library
from symbolic.model_file.exchange.importing import imported


class ExportResult(MadeResult[ExportDocument]):
    """An arm that was written for simulators: its bodies, and what the format cannot say."""

    _sections = staticmethod(models.exported)

    @staticmethod
    def _in_short(document: ExportDocument) -> list[str]:
        return [f"{document.out}: {document.name}", *models.export_notes(document)]


def import_(
    path: PathOrText,
    base: str | None = None,
    tip: str | None = None,
    lock: Mapping[str, float] | None = None,
    friction: bool = True,
    effects: PathOrText | None = None,
) -> LoadedArm:
    """The arm of a URDF or MJCF file; `arm.notes` says what was left out of it, `arm.save(path)` writes the model file.

    base, tip   links between which it lies; None: the root, and the only end
    lock        joint -> where it is held, rad or m
    friction    dry and viscous friction at every joint, unknown where the file states none
    Raises ValueError.
    """
    own = None if effects is None else Path(effects)
    made = imported(Path(path), effects_described(own, space=True), base, tip=tip, locked=lock, friction=friction)
    library = effects_library(own, space=True) if own else None
    return LoadedArm(Source(Path(f"{made.arm.name}.toml"), made.text, library), made.notes)


def export(
    arm: LoadedArm,
    path: PathOrText,
    to: Literal["urdf", "mjcf", "bam"] = "urdf",
    onto: PathOrText | None = None,
    on: Recordings = (),
    servo: str | None = None,
) -> ExportResult:
    """Write the arm as URDF or MJCF, with physically possible bodies, or BAM's parameters. Raises ValueError, OSError.

    onto    a URDF of the arm: the new file is a copy of it, with the model's numbers in it
    on      recordings along whose motion the file's lacks have their share of the torque
    servo   BAM's name of it; None: the arm's
    """
    data = read_both(arm, on)[0] if on else []
    whole = None if onto is None else Path(onto)
    return ExportResult(exporting.export(arm.source.compiled, to, Path(path), whole, data, servo))


class ExportedMotionResult(MadeResult[ExportedMotionDocument]):
    """A motion that was written for another program: where it starts, and what nothing keeps the arm from."""

    _sections = staticmethod(motions.exported_motion)

    @staticmethod
    def _in_short(document: ExportedMotionDocument) -> list[str]:
        return motions.exported_motion_lines(document)


def export_motion(
    arm: LoadedArm,
    motion: PathOrText,
    path: PathOrText,
    to: Literal["csv", "joint_trajectory", "urscript", "lerobot"],
    rate: float | None = MotionOptions.rate,
    speed: float = MotionOptions.speed,
    unit: str = MotionOptions.unit,
    lookahead: float = MotionOptions.lookahead,
    gain: float = MotionOptions.gain,
) -> ExportedMotionResult:
    """Write a motion for another program, checked as `execute` checks it.

    motion    a CSV of t,q1,..., as `experiment` saves it
    path      joint_trajectory: .yaml or .mcap; csv: .csv; urscript: .script; lerobot: .parquet
    rate      points a second; None: of CSV the controller's, joint_trajectory 100, urscript 125, lerobot 30
    speed     its pace, 1 as in the file        unit   of LeRobot's positions: deg, rad, normalised
    lookahead, gain   of servoj, s and 1
    Raises ValueError, OSError.
    """
    options = MotionOptions(rate, speed, unit, lookahead=lookahead, gain=gain)
    return ExportedMotionResult(exporting.export_motion(arm.model, Path(motion), to, Path(path), options))
