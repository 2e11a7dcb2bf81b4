"""The text of model files: of an imported arm, and of a new arm whose unknown keys are commented."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from symbolic.model_file.arm import Arm, Frame, Joint
from symbolic.model_file.checks import SMALLEST
from symbolic.model_file.drivers import known_driver
from symbolic.model_file.fields import JointType
from symbolic.model_file.frames import QUARTER

DIGITS = 12
"""Significant digits of computed numbers, so that rounding errors do not appear."""
COLUMN = 32
"""Column at which comments begin, if there is room."""


def text(arm: Arm, head: Sequence[str], gravity: str, gears: Sequence[str]) -> str:
    """The model file of a spatial arm.

    head             lines of the comment at the top
    gravity, gears   comments beside gravity and each joint's gear ratio; may be empty
    """
    lines = [*(f"# {line}".rstrip() for line in head), f'name = "{arm.name}"']
    lines += [_line("gravity", row(arm.gravity), gravity), *torque_lines(arm)]
    for joint, gear in zip(arm.joints, gears, strict=True):
        lines += ["", "[[joint]]", *_joint(joint, gear)]
    lines += ["", "[tip]", _line("origin", _frame(arm.tip), "m, rad; flange or tool in the last joint's frame")]
    return "\n".join(lines) + "\n"


def torque_lines(arm: Arm) -> list[str]:
    """What the torques of the arm's recordings are, as far as its driver is known."""
    driver = known_driver(joint.name for joint in arm.joints)
    torque = arm.torque or (driver and driver.torque)
    stated = None if torque is None else json.dumps(torque)
    return [] if driver is None and stated is None else [_line("torque", stated, driver.says if driver else "")]


def tidy(value: float) -> float:
    """A number without rounding errors: quarter turns unchanged, tiny values 0, otherwise DIGITS digits."""
    if value == round(value / QUARTER) * QUARTER:
        return value + 0.0
    return 0.0 if abs(value) < SMALLEST else float(f"{value:.{DIGITS}g}")


def row(values: Sequence[float]) -> str:
    """A list of numbers; entries that are rounding errors beside the largest one are 0."""
    largest = max(map(abs, values), default=0.0)
    kept = (0.0 if abs(value) < 10.0**-DIGITS * largest else tidy(value) for value in values)
    return f"[{', '.join(map(repr, kept))}]"


def _beside(said: str, comment: str) -> str:
    return f"{said}   # {comment}" if comment else said


def _frame(frame: Frame) -> str:
    return f"{{ xyz = {row(frame.xyz)}, rpy = [{', '.join(repr(tidy(angle)) for angle in frame.rpy)}] }}"


def _joint(joint: Joint, gear: str) -> Iterator[str]:
    revolute = joint.type == "revolute"
    if joint.name is not None:
        yield _line("name", f'"{joint.name}"')
    yield _line("type", f'"{joint.type}"')
    if joint.rotor_inertia is not None:
        yield _line("rotor_inertia", joint.rotor_inertia, f"{'kg m^2' if revolute else 'kg'} at the output")
    yield _line("gear_ratio", f"{joint.gear_ratio:.{DIGITS}g}", gear)
    yield _line("origin", _frame(joint.origin), "m, rad")
    yield _line("axis", row(joint.axis))
    link, limits = joint.link, joint.limits
    body: _Stated = [
        ("mass", link.mass, "kg"),
        ("com", None if link.com is None else row(link.com), "m"),
        ("inertia", None if link.inertia is None else row(link.inertia), "kg m^2: ixx, ixy, ixz, iyy, iyz, izz"),
    ]
    yield from _section("[joint.link]", body)
    if unknown := [key for key, value, _ in body if value is None]:
        yield f"# {', '.join(unknown)} of the link: unknown"
    position, speed, torque = ("rad", "rad/s", "N m") if revolute else ("m", "m/s", "N")
    stated: _Stated = [
        ("position", None if limits.position is None else row(limits.position), position),
        ("speed", limits.speed, speed),
        ("torque", limits.torque, torque),
    ]
    yield from _section("[joint.limits]", stated)
    for name, values in joint.effects.items():
        yield _beside(f"[joint.effects.{name}]", "" if values else "values unknown")
        yield from (_line(key, value) for key, value in values.items())


_Stated = list[tuple[str, str | float | None, str]]
"""Keys of a table, their values (None: unknown) and units."""


def _section(header: str, stated: _Stated) -> Iterator[str]:
    """A table of the known keys; nothing if there are none."""
    lines = [_line(key, value, unit) for key, value, unit in stated if value is not None]
    if lines:
        yield header
        yield from lines


HEAD = """\
# Commented keys are unknown: fill in what you know and remove the #. What stays unknown is found, where the recordings
# allow it, by:  tendon identify MODEL RECORDING --write
# What its controller needs, too:  tendon init --controller MODEL --write.  symbolic/README.md lists every key."""
FRAME = "{ xyz = [0.0, 0.0, 0.0], rpy = [0.0, 0.0, 0.0] }"


@dataclass(frozen=True)
class Motor:
    """A motor's data on its own side of the gear; None where unknown.

    gear_ratio        motor turns per joint turn, or motor rad per metre
    torque_constant   N m/A     inertia   of the rotor, kg m²
    """

    gear_ratio: float | None = None
    torque_constant: float | None = None
    inertia: float | None = None


@dataclass(frozen=True)
class NewJoint:
    """length: m, to the next joint or the tip, planar arms only; mass: of the link, kg. None where unknown."""

    type: JointType
    motor: Motor
    length: float | None
    mass: float | None


def new_text(name: str, gravity: Sequence[float], joints: Sequence[NewJoint], effects: Sequence[str]) -> str:
    """The model file of a new arm.

    gravity   (2,) m/s² in the plane of motion, or (3,) in the base frame of a spatial arm
    effects   active at every joint, their values unknown
    """
    spatial = len(gravity) == 3
    order = ": [ixx, ixy, ixz, iyy, iyz, izz]" if spatial else ""
    frame = "in the base frame" if spatial else "in the plane of motion; zero where that is horizontal"
    lines = [HEAD, _line("name", json.dumps(name), ""), _line("gravity", row(gravity), f"m/s^2, {frame}")]
    for joint in joints:
        position, speed, torque = ("rad", "rad/s", "N m") if joint.type == "revolute" else ("m", "m/s", "N")
        lines += ["", "[[joint]]", _line("type", json.dumps(joint.type)), *_motor(joint.motor, joint.type)]
        if spatial:
            lines += [
                _line("origin", FRAME, "m, rad: the joint's frame in the one before"),
                _line("axis", "[0.0, 0.0, 1.0]", "in the joint's frame"),
            ]
        length = [] if spatial else [_line("length", joint.length or 0.0, "m, to the next joint or to the tip")]
        lines += [
            "[joint.link]",
            *length,
            _line("mass", joint.mass, "kg"),
            _line("com", None, "m, [x, y, z] in the joint's frame" if spatial else "m, [along, across] the link"),
            _line("inertia", None, f"kg m^2 about the centre of mass{order}"),
            "# [joint.limits]",
            _line("position", None, f"{position}: [smallest, largest]"),
            _line("speed", None, f"{speed}, largest in either direction"),
            _line("torque", None, f"{torque} at the output, largest in either direction"),
        ]
        lines += [f"[joint.effects.{effect}]   # active; its values are unknown" for effect in effects]
    if spatial:
        lines += ["", "[tip]", _line("origin", FRAME, "m, rad: flange or tool in the last joint's frame")]
    return "\n".join(lines) + "\n"


def with_motors(text: str, arm: Arm, motors: Sequence[Motor]) -> str:
    """The text of an imported arm's model file with the motors' data filled in."""
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


def with_torque(text: str, torque: str | None) -> str:
    """The text with what the recordings' torques are, where that is stated: in the place of the line that says so
    already, or below the gravity."""
    if torque is None:
        return text
    lines = text.splitlines()
    there = [k for k, line in enumerate(lines) if line.startswith(("torque = ", "# torque ="))]
    place = there[0] if there and "[[joint]]" not in lines[: there[0]] else None
    stated = _line("torque", json.dumps(torque), "what its recordings hold")
    if place is None:
        lines.insert(next(k for k, line in enumerate(lines) if line.startswith("gravity = ")) + 1, stated)
    else:
        lines[place] = stated
    return "\n".join(lines) + "\n"


def _motor(motor: Motor, kind: JointType, stated: float = 1.0) -> tuple[str, str, str]:
    """The lines of gear_ratio, rotor_inertia and torque_constant; stated: the ratio if the motor has none."""
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


def _line(key: str, value: str | float | None, comment: str = "") -> str:
    """A line with a key, its value and a comment; the key is commented out where the value is unknown (None)."""
    shown = repr(tidy(value)) if isinstance(value, float) else value
    entry = f"# {key} =" if shown is None else f"{key} = {shown}"
    return f"{entry:<{COLUMN - 1}} # {comment}" if comment and len(entry) < COLUMN else _beside(entry, comment)
