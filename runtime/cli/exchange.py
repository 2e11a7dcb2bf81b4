"""Verbs of other programs' model files: import and export."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from runtime import files
from runtime.cli.inputs import TypedInputs, opened
from runtime.cli.options import AllowGaps, EffectsFile, Json, Map, ModelFile, with_settings
from runtime.cli.output import emit
from runtime.cli.places import READ, WRITTEN
from runtime.experiments.options import MotionOptions
from runtime.setting import Checked, Setting
from runtime.workspace.names import UsageError
from runtime.workspace.source import effects_described

if TYPE_CHECKING:
    from symbolic.model_file.exchange.ways import Language

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
    """File formats of simulators, and of motions."""

    URDF = "urdf"
    MJCF = "mjcf"
    BAM = "bam"
    CSV = "csv"
    JOINT_TRAJECTORY = "joint_trajectory"
    URSCRIPT = "urscript"
    LEROBOT = "lerobot"


_OF_ARMS: dict[Format, Language] = {Format.URDF: "urdf", Format.MJCF: "mjcf", Format.BAM: "bam"}


@app.command("export", epilog="Example: tendon export ur10.toml motion.csv --to urscript --out motion.script")
@with_settings
def export_arm(
    model: ModelFile,
    to: Annotated[Format, typer.Option(help="File format.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write."), WRITTEN],
    motion: Annotated[
        Path | None,
        typer.Argument(metavar="[MOTION]", help="A CSV of t,q1,...: write it for another program, not the arm."),
        READ,
    ] = None,
    onto: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="URDF of the arm: write a copy of it with the numbers of the model."),
        READ,
    ] = None,
    on: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RECORDING",
            help="Along its motion, which part of the torque are effects that the file lacks? Without it, along a "
            "simulated motion.",
        ),
        READ,
    ] = None,
    servo: Annotated[
        str | None, typer.Option(metavar="NAME", help="BAM's name of the servo, as mx106; default: the model's name.")
    ] = None,
    options: MotionOptions = MotionOptions(),
    maps: Map = None,
    allow_gaps: AllowGaps = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """An arm with physically possible bodies and the effects that the format
    can state; a motion checked as execute checks it."""
    from runtime.report import models, motions, terminal
    from runtime.workspace.exporting import export, export_motion

    if onto is not None and to is not Format.URDF:
        raise UsageError(f"--onto {onto}: only a URDF can be written into; use --to urdf, or leave --onto out")
    if servo is not None and to is not Format.BAM:
        raise UsageError(f"--servo {servo}: only BAM's parameters name one; use --to bam, or leave --servo out")
    if (motion is None) != (to in _OF_ARMS):
        wanted = "a MOTION after MODEL" if motion is None else "no MOTION"
        raise UsageError(f"--to {to.value}: expected {wanted}; {', '.join(_OF_ARMS)} are formats of arms")
    source = opened(model, effects)
    if motion is not None:
        with terminal.working("deriving and compiling the model"):
            loaded = source.compiled.model()
        written = export_motion(loaded, motion, to.value, out, options)
        emit(json, written, terminal.printer(motions.exported_motion))
        return
    if options != MotionOptions():
        raise UsageError("--rate, --speed, --unit, --lookahead and --gain are for motions: pass one after MODEL")
    data = TypedInputs(model, on, (), effects, maps, allow_gaps).read()[1] if on else []
    with terminal.working("looking for physically possible bodies"):
        document = export(source.compiled, _OF_ARMS[to], out, onto, data, servo)
    emit(json, document, terminal.printer(models.exported))
