"""The text of a model file for a new arm: what is known as keys, what is unknown as commented keys to fill in.

Motors are given on their own side of the gear, as in data sheets; the file has every value at the joint's output.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from symbolic.model_file.arm import Arm
from symbolic.model_file.exchange.model_text import COLUMN, DIGITS, row, tidy
from symbolic.model_file.fields import JointType

HEAD = """\
# Commented keys are unknown: fill in what you know and remove the #. What stays unknown is found, where the recordings
# allow it, by:  tendon identify MODEL RECORDING --write
# Firmware also needs [controller], [joint.encoder] and [joint.controller]; symbolic/README.md lists every key."""
FRAME = "{ xyz = [0.0, 0.0, 0.0], rpy = [0.0, 0.0, 0.0] }"


@dataclass(frozen=True)
class Motor:
    """gear_ratio: motor turns per turn of the joint, or motor rad per metre, None: as it is, or 1; torque_constant:
    N m/A of the motor; inertia: kg m² of the rotor. None: unknown."""

    gear_ratio: float | None = None
    torque_constant: float | None = None
    inertia: float | None = None


@dataclass(frozen=True)
class NewJoint:
    """length: m, to the next joint or the tip, of a planar arm; mass: kg of the link. None: unknown."""

    type: JointType
    motor: Motor
    length: float | None
    mass: float | None


def text(name: str, gravity: Sequence[float], joints: Sequence[NewJoint], effects: Sequence[str]) -> str:
    """The model file of a new arm.

    gravity   (2,) m/s² in the plane of motion, or (3,) in the base frame of a spatial arm
    effects   active at every joint, their values unknown
    """
    spatial = len(gravity) == 3
    frame = "in the base frame" if spatial else "in the plane of motion; zero where that is horizontal"
    lines = [HEAD, _line("name", json.dumps(name), ""), _line("gravity", row(gravity), f"m/s^2, {frame}")]
    for joint in joints:
        lines += ["", "[[joint]]", *_joint(joint, spatial)]
        lines += [f"[joint.effects.{effect}]   # active; its values are unknown" for effect in effects]
    if spatial:
        lines += ["", "[tip]", _line("origin", FRAME, "m, rad: flange or tool in the last joint's frame")]
    return "\n".join(lines) + "\n"


def with_motors(text: str, arm: Arm, motors: Sequence[Motor]) -> str:
    """The imported model file `text` of `arm`, its motors' values filled in."""
    made, joints = list[str](), iter(zip(arm.joints, motors, strict=True))
    for line in text.splitlines():
        if not line.startswith("gear_ratio = "):
            made.append(line)
            continue
        joint, motor = next(joints)
        if joint.rotor_inertia is not None and motor.inertia is not None:
            made.pop()  # rotor_inertia stands on the line before gear_ratio
        ratio, rotor, constant = _motor(motor, joint.type, joint.gear_ratio)
        made += [ratio, rotor] if joint.rotor_inertia is None or motor.inertia is not None else [ratio]
        made.append(constant)
    return "\n".join(made) + "\n"


def _motor(motor: Motor, kind: JointType, stated: float = 1.0) -> tuple[str, str, str]:
    """The lines of gear_ratio, rotor_inertia and torque_constant; stated: the ratio that holds unless the motor's."""
    ratio = stated if motor.gear_ratio is None else motor.gear_ratio
    inertia = None if motor.inertia is None else motor.inertia * ratio**2
    constant = None if motor.torque_constant is None else motor.torque_constant * ratio
    turns, kg, nm = ("motor turns per turn", "kg m^2", "N m") if kind == "revolute" else ("motor rad per m", "kg", "N")
    rotor = "" if motor.inertia is None else f" of {motor.inertia:g} kg m^2"
    of_motor = "; needed for recordings in A" if constant is None else f" of {motor.torque_constant:g} N m/A"
    return (
        _line("gear_ratio", f"{ratio:.{DIGITS}g}", turns),
        _line("rotor_inertia", inertia, f"{kg} at the output: gear_ratio^2 times the motor's{rotor}"),
        _line("torque_constant", constant, f"{nm}/A at the output: gear_ratio times the motor's{of_motor}"),
    )


def _joint(joint: NewJoint, spatial: bool) -> Iterator[str]:
    position, speed, torque = ("rad", "rad/s", "N m") if joint.type == "revolute" else ("m", "m/s", "N")
    yield _line("type", json.dumps(joint.type), "")
    yield from _motor(joint.motor, joint.type)
    if spatial:
        yield _line("origin", FRAME, "m, rad: the joint's frame in the one before")
        yield _line("axis", "[0.0, 0.0, 1.0]", "in the joint's frame")
    yield "[joint.link]"
    if not spatial:
        yield _line("length", joint.length or 0.0, "m, to the next joint or to the tip")
    yield _line("mass", joint.mass, "kg")
    yield _line("com", None, "m, [x, y, z] in the joint's frame" if spatial else "m, [along, across] the link")
    order = ": [ixx, ixy, ixz, iyy, iyz, izz]" if spatial else ""
    yield _line("inertia", None, f"kg m^2 about the centre of mass{order}")
    yield "# [joint.limits]"
    yield _line("position", None, f"{position}: [smallest, largest]")
    yield _line("speed", None, f"{speed}, largest in either direction")
    yield _line("torque", None, f"{torque} at the output, largest in either direction")


def _line(key: str, value: str | float | None, comment: str) -> str:
    """A key with its unit; commented, without a value, where that is unknown."""
    shown = repr(tidy(value)) if isinstance(value, float) else value
    entry = f"# {key} =" if shown is None else f"{key} = {shown}"
    if not comment:
        return entry
    return f"{entry:<{COLUMN - 1}} # {comment}" if len(entry) < COLUMN else f"{entry}   # {comment}"
