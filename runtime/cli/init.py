"""The verb that begins a model file: init."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from runtime.cli import schemas
from runtime.cli.import_arm import Base, Lock, Tip, locked
from runtime.cli.interview import Answered, motors, new_arm
from runtime.cli.opening import opened
from runtime.cli.options import EffectsFile, Json
from runtime.cli.output import emit
from runtime.cli.places import READ, WRITTEN, check_writable
from runtime.cli.questions import Questions
from runtime.workspace import UsageError, effects_described

if TYPE_CHECKING:
    from symbolic.model_file.exchange.importing import ImportedArm

app = typer.Typer()

_HELP = """Begin a model file for an arm of your own: asked for, out of a URDF, or like one that ships.

What the options do not say is asked for on the terminal, or read line by line from standard input; an empty line takes
what stands in brackets, and what is not known (?) is left out of the file. Motors are asked for on their own side of
the gear."""
_EACH = "one for all joints or one each, ? if unknown"


@app.command(help=_HELP, epilog="Example: tendon init --joints r,r,p --gear-ratio 100 --out my_arm.toml")
def init(
    out: Annotated[Path | None, typer.Option(metavar="MODEL", help="Default: NAME.toml."), WRITTEN] = None,
    like: Annotated[
        Path | None,
        typer.Option(metavar="MODEL", help="A copy of this: drive, vishard4, emps, ur10, panda, or a file."),
        READ,
    ] = None,
    urdf: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Geometry and bodies from a URDF or MJCF; asks for motors."),
        READ,
    ] = None,
    base: Base = None,
    tip: Tip = None,
    lock: Lock = None,
    name: Annotated[str | None, typer.Option(help="A C identifier.")] = None,
    joints: Annotated[str | None, typer.Option(metavar="r,p,...", help="Revolute, prismatic, from the base.")] = None,
    space: Annotated[bool | None, typer.Option("--space/--plane", help="Where it moves.", show_default=False)] = None,
    gravity: Annotated[str | None, typer.Option(metavar="X,Y[,Z]", help="m/s^2.")] = None,
    gear_ratio: Annotated[str | None, typer.Option(metavar="N,...", help=_EACH)] = None,
    torque_constant: Annotated[
        str | None, typer.Option(metavar="KT,...", help=f"N m/A of the motors; {_EACH}.")
    ] = None,
    rotor_inertia: Annotated[str | None, typer.Option(metavar="J,...", help=f"kg m^2 of the motors; {_EACH}.")] = None,
    length: Annotated[str | None, typer.Option(metavar="L,...", help="m, of the links of a planar arm.")] = None,
    mass: Annotated[str | None, typer.Option(metavar="M,...", help=f"kg, of the links; {_EACH}.")] = None,
    friction: Annotated[
        bool, typer.Option("--friction/--no-friction", help="Dry and viscous friction at every joint, values unknown.")
    ] = True,
    schema: Annotated[
        bool, typer.Option("--schema", help="Put the JSON schemas beside it, by which editors check such files.")
    ] = False,
    questions: Annotated[
        bool, typer.Option("--questions/--no-questions", help="Ask for what the options leave open, or leave it out.")
    ] = True,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    asked = Questions(sys.stdin if questions else None)
    said = Answered(name, joints, space, gravity, gear_ratio, torque_constant, rotor_inertia, length, mass, asked)
    if like is not None and (urdf is not None or said.stated):
        raise UsageError("--like is a copy as it stands; leave the other options out, or --like")
    if urdf is None and any((base, tip, lock)):
        raise UsageError("--base, --tip and --lock are of a --urdf")
    if urdf is not None and any((said.name, said.joints, said.space, said.gravity, said.length, said.mass)):
        raise UsageError("--urdf says what joints and links there are; only motors can be given beside it")
    if out is not None:
        _check_new(out)
    if like is not None:
        text = opened(like, effects).text
    elif urdf is not None:
        from symbolic.model_file.exchange.importing import imported

        library = effects_described(effects, space=True)
        made = imported(urdf, library, base, tip, locked(lock or []), friction)
        text = _with_motors(made, said, schema)
    else:
        text = _asked(said, "arm" if out is None else out.stem, effects, friction, schema)
    _write(text, out, effects, schema, like, json)


def _check_new(path: Path) -> None:
    if path.exists():
        raise UsageError(f"{path}: is there already; choose another name")


def _with_motors(made: ImportedArm, said: Answered, schema: bool) -> str:
    from symbolic.model_file.beginning import with_motors

    return with_motors(made.text, made.arm, motors(said, made.arm), f"./{schemas.MODEL}" if schema else None)


def _asked(said: Answered, called: str, effects: Path | None, friction: bool, schema: bool) -> str:
    from symbolic.model_file.beginning import text
    from symbolic.model_file.exchange.importing import arm_name

    library = effects_described(effects, space=True)
    assumed = tuple(effect.name for effect in library.values() if effect.assumed and friction)
    called = arm_name(called, Path("arm"))
    return text(new_arm(said, called, assumed, f"./{schemas.MODEL}" if schema else None))


def _write(
    text: str, out: Path | None, effects: Path | None, schema: bool, like: Path | None, json: str | None
) -> None:
    """The file, if it is one that can be read, and the schemas beside it if they are wanted."""
    from runtime import files
    from symbolic.model_file import reader

    library = effects_described(effects, reader.is_spatial(text))
    arm = reader.parse(text, str(out or "the new model file"), library)
    path = out or Path(f"{arm.name}.toml")
    if out is None:
        check_writable(path)
        _check_new(path)
    beside = {path.parent / name: data for name, data in schemas.shipped().items()} if schema else {}
    for place, data in beside.items():
        if place.exists() and place.read_bytes() != data:
            raise UsageError(f"{place}: is there already and is another; move it away, or leave --schema out")
    for place, data in {path: text.encode(), **beside}.items():
        files.replace(place, data)
    unknown = [list(joint.unknown) for joint in arm.joints]
    document = {
        "out": str(path),
        "like": None if like is None else str(like),
        "name": arm.name,
        "joints": len(arm.joints),
    }

    def show(_: Any) -> None:
        from runtime.report.terminal.pages import say

        count = "1 joint" if len(arm.joints) == 1 else f"{len(arm.joints)} joints"
        if like is not None:
            say(f"{path}: {arm.name}, {count}, as in {like}; change in it what is different at your arm")
            return
        say(f"{path}: {arm.name}, {count}")
        say(*(f"joint {k}: {', '.join(keys)} unknown" for k, keys in enumerate(unknown, 1) if keys))
        say(*(f"{place}: for editors" for place in beside))

    emit(json, {**document, "unknown": unknown, "schemas": [str(place) for place in beside]}, show)
