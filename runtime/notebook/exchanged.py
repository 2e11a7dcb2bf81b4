"""Files of other programs: an arm from a URDF or MJCF, and an arm's equations and bodies written for others."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from runtime.documents.models import ExportDocument
from runtime.notebook.arm import LoadedArm, PathOrText
from runtime.notebook.results import MadeResult
from runtime.report import models
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
    arm: LoadedArm, path: PathOrText, to: Literal["urdf", "mjcf"] = "urdf", onto: PathOrText | None = None
) -> ExportResult:
    """Write the arm as URDF or MJCF, with physically possible bodies. Raises ValueError, OSError.

    onto   a URDF of the arm: the new file is a copy of it, with the model's numbers in it
    """
    return ExportResult(exporting.export(arm.source.compiled, to, Path(path), None if onto is None else Path(onto)))
