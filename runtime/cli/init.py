"""The verb that makes a new model file: init."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isfinite, nan
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli import completion
from runtime.cli import schema as schemas
from runtime.cli.controller import init_controller
from runtime.cli.exchange import ROOT_TO_END, ChainOptions
from runtime.cli.inputs import opened
from runtime.cli.options import EffectsFile, Json, with_settings
from runtime.cli.output import emit
from runtime.cli.places import READ, WRITTEN
from runtime.cli.task import NO_TASK, TaskOptions, init_scenario
from runtime.documents.models import InitDocument
from runtime.setting import Checked, Setting
from runtime.workspace.names import UsageError
from runtime.workspace.source import effects_described
from runtime.workspace.writing import check_writable
from symbolic.model_file.arm import COMMAND, LINK_TORQUE, MOTOR_TORQUE, TORQUES, WEIGHTLESS, Arm
from symbolic.model_file.fields import JointType
from symbolic.model_file.keys import MAX_JOINTS
from symbolic.model_file.model_text import Motor, NewJoint, new_text, with_motors, with_torque

app = typer.Typer()

_HELP = """From options, from a URDF, or as a copy.

What no option states is a comment in the file with its unit, to be filled in. ? means unknown."""
UNKNOWN = "?"
OF_MOTORS: tuple[str, ...] = ("gear_ratio", "torque_constant", "rotor_inertia")
_EACH = "One number for all joints, or one for each with commas between."


@dataclass(frozen=True)
class ArmOptions(Checked):
    """What the command line states of a new arm, as text. Motors are stated on their own side of the gear."""

    name: Annotated[str | None, Setting("Name of the arm, a C identifier.", metavar="NAME")] = None
    joints: Annotated[
        str | None,
        Setting(
            "Types of the joints from the base, revolute or prismatic; or the number of revolute ones.",
            metavar="N|r,p,...",
        ),
    ] = None
    gravity: Annotated[str | None, Setting("Gravity in base axes, m/s^2.", metavar="X,Y[,Z]")] = None
    length: Annotated[
        str | None, Setting(f"Lengths of the links, m. From a joint's axis to the next one, or to the tip. {_EACH}")
    ] = None
    mass: Annotated[str | None, Setting("Masses of the links, kg.", metavar="X,...")] = None
    gear_ratio: Annotated[
        str | None,
        Setting(
            f"Gear ratios, motor turns per turn of the joint or rad per metre. {UNKNOWN} counts as 1: recordings then "
            f"hold what is behind the gear. {_EACH}",
            metavar="X,...",
        ),
    ] = None
    torque_constant: Annotated[
        str | None,
        Setting(
            "Torque constants of the motors, N m/A. Of the motor alone, before the gear, as in its data sheet: Tendon "
            f"multiplies by the gear ratio. Needed where recordings hold currents. {_EACH}",
            metavar="X,...",
        ),
    ] = None
    rotor_inertia: Annotated[
        str | None,
        Setting(
            "Inertias of the motors' rotors, kg m^2. Of the rotor alone, before the gear, as in its data sheet (1 g "
            "cm^2 = 1e-7 kg m^2): Tendon multiplies by the gear ratio squared. Motion tells it where it is unknown. "
            f"{_EACH}",
            metavar="X,...",
        ),
    ] = None
    torque: Annotated[
        str | None,
        Setting(
            f"What the recorded torques are: {', '.join(TORQUES)}. {MOTOR_TORQUE}: from the motor's current or torque, "
            f"times the gear ratio; {LINK_TORQUE}: of a sensor behind the gear; {COMMAND}: what the controller asked "
            f"for; {WEIGHTLESS}: the driver took gravity out. {UNKNOWN} counts as {MOTOR_TORQUE}."
        ),
    ] = None


@app.command(help=_HELP, epilog="Example: tendon init --joints r,r,p --gear-ratio 100 --out my_arm.toml")
@with_settings
def init(
    out: Annotated[
        Path | None, typer.Option(metavar="MODEL", help="File to write; default: NAME.toml."), WRITTEN
    ] = None,
    like: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL",
            help="Copy a model: a file, or one of drive, vishard4, emps, ur10, panda.",
            autocompletion=completion.models,
        ),
        READ,
    ] = None,
    urdf: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Take joints and links from a URDF or MJCF."),
        READ,
    ] = None,
    chain: ChainOptions = ROOT_TO_END,
    options: ArmOptions = ArmOptions(),
    space: Annotated[
        bool | None,
        typer.Option("--space/--plane", help="Whether the arm moves in space or in a plane.", show_default=False),
    ] = None,
    friction: Annotated[
        bool,
        typer.Option("--friction/--no-friction", help="Add dry and viscous friction, values unknown, to every joint."),
    ] = True,
    schema: Annotated[
        bool, typer.Option("--schema", help="Write the JSON schemas for editors beside the file.")
    ] = False,
    controller: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL",
            help="Propose what the controller of this arm lacks: gains, encoders, rate, torque limits, unknown values.",
            autocompletion=completion.models,
        ),
        READ,
    ] = None,
    write: Annotated[
        bool, typer.Option("--write", help="With --controller: write what is proposed into the model file.")
    ] = False,
    new_gains: Annotated[
        bool, typer.Option("--new-gains", help="With --controller: propose gains that the file states, too.")
    ] = False,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL",
            help="Write a scenario for this arm, from point to point with parallel springs, for tendon optimize; "
            "default: task.toml.",
            autocompletion=completion.models,
        ),
        READ,
    ] = None,
    task: TaskOptions = NO_TASK,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    if controller is None and (write or new_gains):
        raise UsageError(f"--{'write' if write else 'new-gains'} needs --controller MODEL")
    stated = {key: value for key, value in asdict(options).items() if value is not None}
    of_new_arm = stated or space is not None or chain != ROOT_TO_END or schema or like is not None or urdf is not None
    if scenario is None and task != NO_TASK:
        raise UsageError("the options of a task need --scenario MODEL")
    if (controller or scenario) and of_new_arm:
        raise UsageError(
            f"--{'controller' if controller else 'scenario'} is for a model file as it is; leave out the options of a "
            "new arm"
        )
    if controller and scenario:
        raise UsageError("--controller and --scenario are two steps; run one after the other")
    if scenario is not None:
        init_scenario(scenario, out, task, effects=effects, json=json)
        return
    if controller is not None:
        init_controller(controller, out, write, new_gains=new_gains, effects=effects, json=json)
        return
    if like is not None and (urdf is not None or stated or space is not None):
        raise UsageError("--like copies a model as it is; leave out the other options, or --like")
    if urdf is None and chain != ROOT_TO_END:
        raise UsageError("--base, --tip and --lock need --urdf")
    if urdf is not None and (space is not None or stated.keys() - {*OF_MOTORS, "torque"}):
        raise UsageError("--urdf states joints and links; only options of motors and --torque can stand beside it")
    beside = _schemas(out) if schema else {}
    if out is not None:
        _check_new(out)
    if like is not None:
        made = opened(like, effects).text
    else:
        from symbolic.model_file.exchange import importing

        library = effects_described(effects, space=True)
        if urdf is not None:
            arm = importing.imported(urdf, library, chain.base, chain.tip, locked=chain.locked(), friction=friction)
            made = _of_urdf(arm.text, arm.arm, stated)
        else:
            assumed = [effect.name for effect in library.values() if effect.assumed and friction]
            called = importing.arm_name("arm" if out is None else out.stem, Path("arm"))
            made = _new_arm(called, assumed, stated, planar=space is False)
    _write(f"#:schema ./{schemas.MODEL}\n{made}" if schema else made, out, effects, beside, like=like, json=json)


def _schemas(out: Path | None) -> dict[Path, bytes]:
    """The schemas for editors by where they go. Raises UsageError if another file is there."""
    beside = {(out or Path()).parent / name: data for name, data in schemas.shipped().items()}
    for place, data in beside.items():
        if place.exists() and place.read_bytes() != data:
            raise UsageError(f"{place}: already exists with other content; move it away, or leave out --schema")
    return beside


def _check_new(path: Path) -> None:
    if path.exists():
        raise UsageError(f"{path}: already exists; choose another name")


def _of_urdf(text: str, arm: Arm, stated: Mapping[str, str]) -> str:
    """The text of an imported arm with what is stated of its motors. Raises UsageError."""
    return with_torque(with_motors(text, arm, _motors(stated, len(arm.joints))), _torque(stated))


def _new_arm(called: str, assumed: Sequence[str], stated: Mapping[str, str], *, planar: bool) -> str:
    """The text for a new arm; called: default name. Raises UsageError."""
    if "joints" not in stated:
        raise UsageError(
            "--joints is needed: their number, or their types from the base, such as r,r,p; or --urdf, or --like"
        )
    letters = re.sub(r"[,\s]", "", stated["joints"].lower())
    if letters in map(str, range(1, MAX_JOINTS + 1)):
        letters = "r" * int(letters)
    if not 1 <= len(letters) <= MAX_JOINTS or letters.strip("rp"):
        raise UsageError(f"--joints {stated['joints']}: expected 1 to {MAX_JOINTS} letters r or p, or their number")
    count = len(letters)
    gravity = _numbers("gravity", stated.get("gravity", "0,0" if planar else "0,0,-9.81"), 2 if planar else 3)
    lengths = _each("length", stated, count)
    if planar and None in lengths[:-1]:
        at = f"Joint {lengths.index(None) + 1}"
        raise UsageError(f"{at}: the length of a planar link cannot be left out; expected --length, m")
    kinds: list[JointType] = ["revolute" if letter == "r" else "prismatic" for letter in letters]
    joints = list(map(NewJoint, kinds, _motors(stated, count), lengths, _each("mass", stated, count)))
    text = new_text(stated.get("name", called), [g or 0.0 for g in gravity], joints, assumed)
    return with_torque(text, _torque(stated))


def _torque(stated: Mapping[str, str]) -> str | None:
    """What the recorded torques are; None if unknown. Raises UsageError."""
    said = stated.get("torque", UNKNOWN)
    if said not in (*TORQUES, UNKNOWN):
        raise UsageError(f"--torque {said}: expected one of {', '.join(TORQUES)}, or {UNKNOWN} where it is unknown")
    return None if said == UNKNOWN else said


def _motors(stated: Mapping[str, str], count: int) -> list[Motor]:
    return list(map(Motor, *(_each(key, stated, count) for key in OF_MOTORS)))


def _each(key: str, stated: Mapping[str, str], count: int) -> list[float | None]:
    """A value for each joint, None where unknown. Raises UsageError."""
    return _numbers(key, stated.get(key, "?"), 1, count) * (1 if stated.get(key, "?").count(",") else count)


def _numbers(key: str, stated: str, *counts: int) -> list[float | None]:
    """Numbers separated by commas; None for ?. Raises UsageError."""
    option, values = f"--{key.replace('_', '-')}", list[float | None]()
    for part in stated.strip("[]() ").split(","):
        try:
            value = None if part.strip() == "?" else float(part)
        except ValueError:
            value = nan
        if value is not None and not isfinite(value):
            raise UsageError(f"{option} {stated}: expected a number, or ? where it is unknown")
        values.append(value)
    if len(values) not in counts:
        one_each = f"one for all joints, or {counts[-1]}, one each"
        expected = one_each if len(counts) > 1 else f"{counts[0]} numbers with commas between"
        raise UsageError(f"{option} {stated}: {len(values)} numbers; expected {expected}")
    return values


def _write(
    text: str, out: Path | None, effects: Path | None, beside: Mapping[Path, bytes], like: Path | None, json: str | None
) -> None:
    """Check the text and write the file, and the schemas beside it if there are any."""
    from runtime import files
    from symbolic.model_file import reader

    arm = reader.parse(text, str(out or "the new model file"), effects_described(effects, reader.is_spatial(text)))
    path = out or Path(f"{arm.name}.toml")
    if out is None:
        check_writable(path)
        _check_new(path)
    for place, data in {path: text.encode(), **beside}.items():
        files.replace(place, data)
    unknown = [list(joint.unknown) for joint in arm.joints]
    document = InitDocument(
        out=str(path),
        like=None if like is None else str(like),
        name=arm.name,
        joints=len(arm.joints),
        unknown=unknown,
        schemas=[str(place) for place in beside],
    )

    def show(_: InitDocument) -> None:
        from runtime.report.terminal import say

        copy = f", as in {like}; change what differs on your arm" if like else ""
        say(f"{path}: {arm.name}, {len(unknown)} joint{'s' * (len(unknown) > 1)}{copy}")
        say(*(f"joint {k}: {', '.join(keys)} unknown" for k, keys in enumerate(unknown, 1) if keys and not like))
        say(*(f"{place}: for editors" for place in beside))

    emit(json, document, show)
