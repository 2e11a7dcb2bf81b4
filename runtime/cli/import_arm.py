"""The verb that makes a model file out of a URDF or MJCF: import."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.options import EffectsFile, Json
from runtime.cli.output import emit
from runtime.cli.places import READ, WRITTEN
from runtime.workspace import UsageError, effects_described

app = typer.Typer()

Base = Annotated[str | None, typer.Option(metavar="LINK", help="Where the arm begins; default: the root.")]
Tip = Annotated[str | None, typer.Option(metavar="LINK", help="Where it ends; default: the only end.")]
Lock = Annotated[
    list[str] | None, typer.Option(metavar="JOINT=VALUE", help="A joint that is held, at rad or m; repeatable.")
]


@app.command("import", epilog="Example: tendon import ur10.urdf --out ur10.toml")
def import_arm(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="URDF, or MJCF (with the package mujoco)."), READ],
    out: Annotated[Path, typer.Option(metavar="MODEL", help="The new model file."), WRITTEN],
    base: Base = None,
    tip: Tip = None,
    lock: Lock = None,
    friction: Annotated[
        bool,
        typer.Option(
            "--friction/--no-friction",
            help="Dry and viscous friction at every joint, unknown where the file states none.",
        ),
    ] = True,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Make a model file from a URDF or MJCF. What it does not state is unknown, to be identified."""
    from runtime import files
    from runtime.report.terminal import exchange_pages
    from symbolic.model_file.exchange.importing import imported

    if out.exists():
        raise UsageError(f"{out}: is there already; choose another name")
    made = imported(file, effects_described(effects, space=True), base, tip, locked(lock or []), friction)
    files.replace(out, made.text.encode())
    emit(json, {"out": str(out), **made.document()}, exchange_pages.imported)


def locked(entries: list[str]) -> dict[str, float]:
    """`--lock joint=value`, several times, as a dictionary."""
    found: dict[str, float] = {}
    for entry in entries:
        name, equals, value = entry.rpartition("=")
        try:
            place = float(value)
        except ValueError:
            place = math.nan
        if not equals or not name or not math.isfinite(place):
            raise UsageError(f"--lock {entry}: expected JOINT=VALUE with a number in rad or m, for example finger=0.02")
        if name in found:
            raise UsageError(f"--lock {name}: given twice")
        found[name] = place
    return found
