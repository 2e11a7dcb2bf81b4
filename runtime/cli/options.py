"""Options that several verbs share, and options made from settings (runtime/setting.py)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import typer

from runtime.cli import completion
from runtime.cli.places import FILLED, READ, WRITTEN, Role
from runtime.report import page
from runtime.setting import Checked, Setting, declared, split

ModelFile = Annotated[
    Path,
    typer.Argument(
        metavar="MODEL",
        help="Model file (TOML), or one of drive, vishard4, emps, ur10, panda.",
        autocompletion=completion.models,
    ),
    READ,
]
ScenarioFile = Annotated[
    Path,
    typer.Argument(
        metavar="SCENARIO",
        help="Scenario file (TOML: points, phases, springs, objective), or scenario1, scenario2.",
        autocompletion=completion.scenarios,
    ),
    READ,
]
Recordings = Annotated[
    list[Path],
    typer.Argument(
        metavar="RECORDING...",
        help="CSV (plain or gzip), MCAP, ROS 2 bag, MATLAB, HDF5, Parquet, LeRobot, NumPy or BAM. Columns: t, q1, "
        "tau1 (or q1_desired, duty1, voltage1, current1 by the law of the drive), ... and, where measured, "
        "temperature1, q1_link, tau1_link, tau1_rigid, fx, fy.",
    ),
    READ,
]
MaybeRecordings = Annotated[
    list[Path] | None,
    typer.Argument(metavar="[RECORDING...]", help="As of compare; none with --statistics."),
    READ,
]
HeldOut = Annotated[
    list[Path] | None,
    typer.Option(
        "--held-out", metavar="RECORDING", help="Recording that is not fitted and on which the model is judged."
    ),
    READ,
]
Budget = Annotated[int, typer.Option("--budget", metavar="N", help="Refits that the search may try.", min=0)]
TimeLimit = Annotated[
    float | None,
    typer.Option("--time-limit", metavar="S", help="Longest time for the search, s; default: none.", min=0.0),
]
Json = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE", help="Write all results as JSON; - for standard output."),
    WRITTEN,
]
EffectsFile = Annotated[
    Path | None,
    typer.Option("--effects", metavar="FILE.py", help="Python file with effects of your own. It is run: trust it."),
    READ,
]
Map = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        "--columns",
        metavar='q1="Position1 [deg]"',
        help="Read a signal from a column of another name; q=NAME for all joints; torque=link, command or "
        "gravity_compensated says what the torques are. "
        "--columns t,q1,tau1 names the columns of a file without a header.",
    ),
]
AllowGaps = Annotated[
    bool, typer.Option("--allow-gaps", help="Split a recording at gaps and drop rows with NaN or failed reads.")
]
GeneratedDir = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Output directory; default: ./generated/NAME."), FILLED
]
Check = Annotated[bool, typer.Option("--check", help="Write nothing; exit status 1 if files are out of date.")]
Report = Annotated[
    Path | None,
    typer.Option("--report", metavar="DIR", help="Write an HTML page with plots into this directory."),
    Role(writes=True, names=(page.NAME,)),
]


def with_settings(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb with options in place of its parameters that are settings.

    A parameter whose type is a dataclass of settings becomes an option for each of its fields, and the verb gets the
    dataclass; a parameter of type Annotated[type, Setting(...)] becomes one option.
    """
    hints = get_type_hints(verb, include_extras=True)
    groups = {name: hint for name, hint in hints.items() if isinstance(hint, type) and issubclass(hint, Checked)}

    @wraps(verb)
    def called(**given: Any) -> None:
        for name, group in groups.items():
            given[name] = group(**{item.name: given.pop(item.name) for item in declared(group)})
        verb(**given)

    parameters = [option for p in signature(verb).parameters.values() for option in _options(p, hints[p.name])]
    # typer reads both.
    called.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {p.name: p.annotation for p in parameters}
    return called


def _options(parameter: Parameter, hint: Any) -> Iterator[Parameter]:
    if isinstance(hint, type) and issubclass(hint, Checked):
        for item in declared(hint):
            yield _option(item.name, item.type, item.default, item.setting)
        return
    kind, setting = split(hint)
    if setting is not None:
        yield _option(parameter.name, kind, parameter.default, setting)
    else:
        yield parameter.replace(kind=Parameter.KEYWORD_ONLY, annotation=hint)


def _option(name: str, kind: Any, default: Any, setting: Setting) -> Parameter:
    # A flag that is off by default needs no option that turns it off; a word of Python has a line behind it.
    flag = [f"--{name.rstrip('_').replace('_', '-')}"] if default is False or name.endswith("_") else []
    kinds = get_args(kind) or (kind,)
    option = typer.Option(
        *flag,
        min=setting.low,
        max=setting.high,
        help=setting.help,
        metavar=setting.metavar or ("N" if int in kinds else "X" if float in kinds else None),
        show_default=not (default is None or default is False or default == ""),
    )
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, option])
