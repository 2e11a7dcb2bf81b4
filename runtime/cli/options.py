"""What several verbs are told in the same way: options, and the checks of what they name before any work is done."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.places import READ, WRITTEN, Role, check_writable
from runtime.report import page
from runtime.workspace.names import UsageError, is_name

ModelFile = Annotated[
    Path, typer.Argument(metavar="MODEL", help="Model file (TOML), or drive, vishard4, emps, ur10, panda."), READ
]
ScenarioFile = Annotated[
    Path,
    typer.Argument(metavar="SCENARIO", help="Points, phases, springs, objective (TOML); or scenario1, scenario2."),
    READ,
]
Recordings = Annotated[
    list[Path],
    typer.Argument(
        metavar="RECORDING...",
        help="CSV, plain or gzip: t, q1, tau1, ... and, if measured, temperature1, q1_link, tau1_link, tau1_rigid, fx, "
        "fy; the same in MCAP, ROS 2 bags, MATLAB, HDF5, Parquet, NumPy.",
    ),
    READ,
]
Json = Annotated[
    str | None, typer.Option("--json", metavar="FILE", help="Write every figure as JSON; - for stdout."), WRITTEN
]
EffectsFile = Annotated[
    Path | None,
    typer.Option("--effects", metavar="FILE.py", help="Your own effects: Python that is run, so trust it."),
    READ,
]
Map = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        "--columns",
        metavar='q1="Position1 [deg]"',
        help="Read a signal from a column of another name, q=NAME those of all joints; --columns t,q1,tau1 names the "
        "columns of a file without a header.",
    ),
]
AllowGaps = Annotated[bool, typer.Option("--allow-gaps", help="Split at gaps and drop NaN rows instead of refusing.")]
Report = Annotated[
    Path | None,
    typer.Option("--report", metavar="DIR", help="Write an HTML page with plots there."),
    Role(writes=True, names=(page.NAME,)),
]


def check_own(model: Path) -> None:
    """Refuse before any work is done to write into a model file that is not the user's or could not be written."""
    if is_name(model):
        raise UsageError(
            f"{model}: comes with Tendon and is left as it is; first make a copy of it that is yours, with "
            f"tendon init --like {model} --out {model}.toml"
        )
    check_writable(model)


def nearby(path: Path) -> Path:
    """The path as one would type it from here, where it lies below."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path
