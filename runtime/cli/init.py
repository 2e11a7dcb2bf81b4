"""The verb that makes a new model file: init. Options and answers have the same form."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from math import isfinite, nan
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli import completion
from runtime.cli import schema as schemas
from runtime.cli.controller import init_controller
from runtime.cli.exchange import ROOT_TO_END, ChainOptions
from runtime.cli.inputs import opened
from runtime.cli.interview import OF_MOTORS, OF_NEW_ARM, OF_URDF, QUESTIONS, UNKNOWN, interview, is_planar
from runtime.cli.options import EffectsFile, Json, with_settings
from runtime.cli.output import emit
from runtime.cli.places import READ, WRITTEN
from runtime.cli.task import NO_TASK, TaskOptions, init_scenario
from runtime.documents.models import InitDocument
from runtime.setting import Checked, Setting
from runtime.workspace.names import UsageError
from runtime.workspace.source import effects_described
from runtime.workspace.writing import check_writable
from symbolic.model_file.arm import TORQUES, Arm
from symbolic.model_file.fields import JointType
from symbolic.model_file.keys import MAX_JOINTS
from symbolic.model_file.model_text import Motor, NewJoint, new_text, with_motors, with_torque

app = typer.Typer()

_HELP = f"""From options and at most {len(OF_NEW_ARM)} questions, from a URDF, or as a copy.

Asks on the terminal for what no option states, or reads the answers from standard input, a line each. Enter takes the
value in brackets; ? means unknown. Unknown keys are comments in the file, to be filled in."""


def _answered(key: str) -> Setting:
    """The option that answers a question."""
    asked = QUESTIONS[key]
    return Setting(f"{asked.text}. {asked.explained}".strip(), metavar="X,..." if key in OF_MOTORS else None)


@dataclass(frozen=True)
class ArmOptions(Checked):
    """What the command line states of a new arm, as text. Motors are stated on their own side of the gear."""

    name: Annotated[str | None, Setting("Name of the arm, a C identifier.", metavar="NAME")] = None
    joints: Annotated[
        str | None, Setting("Types of the joints from the base, revolute or prismatic.", metavar="r,p,...")
    ] = None
    gravity: Annotated[str | None, Setting("Gravity in base axes, m/s^2.", metavar="X,Y[,Z]")] = None
    length: Annotated[str | None, _answered("length")] = None
    mass: Annotated[str | None, Setting("Masses of the links, kg.", metavar="X,...")] = None
    gear_ratio: Annotated[str | None, _answered("gear_ratio")] = None
    torque_constant: Annotated[str | None, _answered("torque_constant")] = None
    rotor_inertia: Annotated[str | None, _answered("rotor_inertia")] = None
    torque: Annotated[str | None, _answered("torque")] = None


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
        typer.Option(metavar="FILE", help="Take joints and links from a URDF or MJCF, and ask for the motors."),
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
    questions: Annotated[
        bool, typer.Option("--questions/--no-questions", help="Ask for what no option states.")
    ] = True,
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
    stated |= {} if space is None else {"space": "space" if space else "plane"}
    of_new_arm = stated or chain != ROOT_TO_END or schema or like is not None or urdf is not None
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
        init_scenario(scenario, out, task, questions=questions, effects=effects, json=json)
        return
    if controller is not None:
        init_controller(controller, out, write, new_gains=new_gains, effects=effects, json=json)
        return
    if like is not None and (urdf is not None or stated):
        raise UsageError("--like copies a model as it is; leave out the other options, or --like")
    if urdf is None and chain != ROOT_TO_END:
        raise UsageError("--base, --tip and --lock need --urdf")
    if urdf is not None and stated.keys() - set(OF_URDF):
        raise UsageError("--urdf states joints and links; only options of motors and --torque can stand beside it")
    beside = _schemas(out) if schema else {}
    if out is not None:
        _check_new(out)
    if like is not None:
        made = opened(like, effects).text
    else:
        from symbolic.model_file import reader
        from symbolic.model_file.exchange import importing

        library = effects_described(effects, space=True)
        called = importing.arm_name("arm" if out is None else out.stem, Path("arm"))
        if urdf is not None:
            arm = importing.imported(urdf, library, chain.base, chain.tip, locked=chain.locked(), friction=friction)
            keys, text_of = OF_URDF, partial(_of_urdf, arm.text, arm.arm)
        else:
            assumed = [effect.name for effect in library.values() if effect.assumed and friction]
            keys, text_of = OF_NEW_ARM, partial(_new_arm, called, assumed)

        def check(stated: Mapping[str, str]) -> None:
            trial = reader.parse(text_of({"length": "1", **stated}), "the new model file", library)
            if out is None and (urdf is not None or "name" in stated):
                _check_new(Path(f"{trial.name}.toml"))

        if questions:
            check({"joints": "r" * _most(stated), **stated})
            stated = interview(keys, stated, called, check)
        made = text_of(stated)
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


def _most(stated: Mapping[str, str]) -> int:
    """The most numbers that an option states, one a joint."""
    return max((stated[key].count(",") + 1 for key in (*OF_MOTORS, "length", "mass") if key in stated), default=1)


def _of_urdf(text: str, arm: Arm, stated: Mapping[str, str]) -> str:
    """The text of an imported arm with what is stated of its motors. Raises UsageError."""
    return with_torque(with_motors(text, arm, _motors(stated, len(arm.joints))), _torque(stated))


def _new_arm(called: str, assumed: Sequence[str], stated: Mapping[str, str]) -> str:
    """The text for a new arm; called: default name. Raises UsageError."""
    if "joints" not in stated:
        raise UsageError(f"{QUESTIONS['joints'].text}: an answer is needed, or --joints")
    letters = re.sub(r"[,\s]", "", stated["joints"].lower())
    if not 1 <= len(letters) <= MAX_JOINTS or letters.strip("rp"):
        raise UsageError(f"--joints {stated['joints']}: expected 1 to {MAX_JOINTS} letters r or p")
    planar, count = is_planar(stated), len(letters)
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
