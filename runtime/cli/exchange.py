"""Verbs of other programs' model files: import and export."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from runtime import files
from runtime.cli.inputs import opened
from runtime.cli.options import EffectsFile, Json, ModelFile, with_settings
from runtime.cli.output import emit
from runtime.cli.places import READ, WRITTEN
from runtime.setting import Checked, Setting
from runtime.workspace.names import UsageError
from runtime.workspace.source import effects_described

app = typer.Typer()


@dataclass(frozen=True)
class ChainOptions(Checked):
    """The chain of a URDF or MJCF that is the arm."""

    base: Annotated[str | None, Setting("First link of the arm; default: the root.", metavar="LINK")] = None
    tip: Annotated[str | None, Setting("Last link of the arm; default: the only end.", metavar="LINK")] = None
    lock: Annotated[
        list[str] | None, Setting("Fix a joint at a position, rad or m; repeatable.", metavar="JOINT=VALUE")
    ] = None

    def locked(self) -> dict[str, float]:
        """Position by joint. Raises UsageError."""
        found: dict[str, float] = {}
        for entry in self.lock or ():
            name, equals, value = entry.rpartition("=")
            try:
                position = float(value)
            except ValueError:
                position = math.nan
            if not equals or not name or not math.isfinite(position):
                expected = "expected JOINT=VALUE with a number in rad or m, for example finger=0.02"
                raise UsageError(f"--lock {entry}: {expected}")
            if name in found:
                raise UsageError(f"--lock {name}: given twice")
            found[name] = position
        return found


ROOT_TO_END = ChainOptions()


@app.command("import", epilog="Example: tendon import ur10.urdf --out ur10.toml")
@with_settings
def import_arm(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="URDF, or MJCF (needs the package mujoco)."), READ],
    out: Annotated[Path, typer.Option(metavar="MODEL", help="The new model file."), WRITTEN],
    chain: ChainOptions = ROOT_TO_END,
    friction: Annotated[
        bool,
        typer.Option(
            "--friction/--no-friction",
            help="Add dry and viscous friction to every joint, unknown where the file states none.",
        ),
    ] = True,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """What the file does not state is unknown and can be identified."""
    from runtime.report import models, terminal
    from runtime.workspace.importing import import_document
    from symbolic.model_file.exchange.importing import imported

    if out.exists():
        raise UsageError(f"{out}: already exists; choose another name")
    made = imported(
        file, effects_described(effects, space=True), chain.base, chain.tip, locked=chain.locked(), friction=friction
    )
    files.replace(out, made.text.encode())
    document = import_document(made, str(out))
    emit(json, document, terminal.printer(models.imported))


class Format(StrEnum):
    """File formats of simulators."""

    URDF = "urdf"
    MJCF = "mjcf"


@app.command("export", epilog="Example: tendon export ur10.toml --to urdf --out ur10_identified.urdf")
def export_arm(
    model: ModelFile,
    to: Annotated[Format, typer.Option(help="File format.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write."), WRITTEN],
    onto: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="URDF of the arm: write a copy of it with the numbers of the model."),
        READ,
    ] = None,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """With physically possible bodies and the effects that the format can state."""
    from runtime.report import models, terminal
    from runtime.workspace.exporting import export

    if onto is not None and to is not Format.URDF:
        raise UsageError(f"--onto {onto}: only a URDF can be written into; use --to urdf, or leave --onto out")
    source = opened(model, effects)
    with terminal.working("looking for physically possible bodies"):
        document = export(source.compiled, to.value, out, onto)
    emit(json, document, terminal.printer(models.exported))
