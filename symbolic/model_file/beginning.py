"""A model file for a new arm, out of what a person knows of it: what is not known is left out, with a word on it.

Motors are asked for as their data sheets have them, on their own side of the gear; the file has everything at the
joint's output.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from symbolic.model_file.arm import SpatialArm
from symbolic.model_file.checks import MAX_LABEL
from symbolic.model_file.exchange.model_text import COLUMN, DIGITS, row, tidy
from symbolic.model_file.fields import JointType

Values = tuple[float, ...]


@dataclass(frozen=True)
class Motor:
    """On the motor's side. gear_ratio: its turns a turn of the joint, or rad a metre; torque_constant: N m/A;
    inertia: kg m², with what turns with it; None: not known."""

    gear_ratio: float = 1.0
    torque_constant: float | None = None
    inertia: float | None = None


@dataclass(frozen=True)
class NewJoint:
    """One joint, SI; () and None: not known.

    length        of a planar arm's link, m            origin, rpy, axis   of the joint of one in space
    com           (2,) or (3,)                         inertia             (1,) or (6,)
    position      range, the smaller end first         speed, torque       largest, either way
    """

    type: JointType
    name: str = ""
    motor: Motor = Motor()
    length: float = 0.0
    origin: Values = (0.0, 0.0, 0.0)
    rpy: Values = (0.0, 0.0, 0.0)
    axis: Values = (0.0, 0.0, 1.0)
    mass: float | None = None
    com: Values = ()
    inertia: Values = ()
    position: Values = ()
    speed: float | None = None
    torque: float | None = None


@dataclass(frozen=True)
class NewArm:
    """gravity: (2,) in the plane of motion or (3,) in the base frame, m/s²; effects: that every joint is assumed to
    have, their values unknown; schema: where an editor finds that of model files, from this one."""

    name: str
    gravity: Values
    joints: tuple[NewJoint, ...]
    effects: tuple[str, ...] = ()
    tip: Values = (0.0, 0.0, 0.0)
    schema: str | None = None
    head: tuple[str, ...] = field(
        default=(
            "What is not known is left out: it is found where recordings allow it, by",
            "  tendon identify MODEL RECORDING --write",
        )
    )

    @property
    def spatial(self) -> bool:
        """Whether it is an arm in space: its gravity has three components."""
        return len(self.gravity) == 3


def schema_line(path: str) -> str:
    """What tells editors by which schema a TOML file is to be checked (Taplo, Even Better TOML)."""
    return f"#:schema {path}"


def text(arm: NewArm) -> str:
    """The model file, with units and what is missing beside the keys."""
    lines = [schema_line(arm.schema)] if arm.schema else []
    lines += [f"# {line}".rstrip() for line in arm.head]
    lines.append(_line("name", f'"{arm.name}"'))
    lines.append(
        _line("gravity", row(arm.gravity), "m/s^2, " + ("in the base frame" if arm.spatial else "in the plane"))
    )
    for joint in arm.joints:
        lines += ["", "[[joint]]", *_joint(arm, joint)]
    if arm.spatial:
        lines += [
            "",
            "[tip]",
            _line("origin", f"{{ xyz = {row(arm.tip)} }}", "m; flange or tool in the last joint's frame"),
        ]
    return "\n".join(lines) + "\n"


def with_motors(text: str, arm: SpatialArm, motors: Sequence[Motor], schema: str | None) -> str:
    """The text of a model file of `arm` that import made, with what it does not say of its motors."""
    made, joints = [schema_line(schema)] if schema else [], iter(zip(arm.joints, motors, strict=True))
    for line in text.splitlines():
        if not line.startswith("gear_ratio = "):
            made.append(line)
            continue
        joint, motor = next(joints)
        told = joint.rotor_inertia is not None
        if told and motor.inertia is not None:
            made.pop()  # its line stands before that of the ratio
        made += [one for one in motor_lines(motor, joint.type) if not (told and one.startswith("# rotor_inertia"))]
    return "\n".join(made) + "\n"


def motor_lines(motor: Motor, kind: JointType) -> Iterator[str]:
    """What the file says of a motor: at the joint's output, with the motor's own number beside it."""
    ratio = motor.gear_ratio
    turns = "turns of the motor a turn of the joint" if kind == "revolute" else "rad of the motor a metre"
    yield _line("gear_ratio", f"{ratio:.{DIGITS}g}", turns)
    if motor.inertia is not None:
        at_output = repr(tidy(motor.inertia * ratio**2))
        yield _line("rotor_inertia", at_output, f"kg m^2 of the motor {motor.inertia:g}, times gear_ratio^2")
    else:
        yield "# rotor_inertia: unknown; that of the motor times gear_ratio^2"
    if motor.torque_constant is not None:
        at_output = repr(tidy(motor.torque_constant * ratio))
        yield _line("torque_constant", at_output, f"N m/A of the motor {motor.torque_constant:g}, times gear_ratio")
    else:
        yield "# torque_constant: unknown; needed for recordings in A, the motor's times gear_ratio"


def _joint(arm: NewArm, joint: NewJoint) -> Iterator[str]:
    revolute = joint.type == "revolute"
    if joint.name:
        yield _line("name", f'"{joint.name[:MAX_LABEL]}"')
    yield _line("type", f'"{joint.type}"')
    yield from motor_lines(joint.motor, joint.type)
    if arm.spatial:
        yield _line("origin", f"{{ xyz = {row(joint.origin)}, rpy = {row(joint.rpy)} }}", "m, rad, in the frame before")
        yield _line("axis", row(joint.axis))
    yield from _link(arm, joint)
    yield from _limits(joint, ("rad", "rad/s", "N m") if revolute else ("m", "m/s", "N"))
    for k, name in enumerate(arm.effects):
        yield f"[joint.effects.{name}]" + (
            "   # an empty table: it is there, its values are not known" if k == 0 else ""
        )


def _link(arm: NewArm, joint: NewJoint) -> Iterator[str]:
    yield "[joint.link]"
    if not arm.spatial:
        yield _line("length", repr(tidy(joint.length)), "m, to the next joint or to the tip")
    order = "ixx, ixy, ixz, iyy, iyz, izz" if arm.spatial else ""
    where = "in the joint's frame" if arm.spatial else "along the link and across it"
    inertia = row(joint.inertia) if arm.spatial else "".join(repr(tidy(x)) for x in joint.inertia)
    stated = (
        ("mass", "" if joint.mass is None else repr(tidy(joint.mass)), "kg"),
        ("com", row(joint.com) if joint.com else "", f"m, {where}"),
        ("inertia", inertia if joint.inertia else "", f"kg m^2 about the centre of mass{': ' if order else ''}{order}"),
    )
    for key, value, unit in stated:
        yield _line(key, value, unit) if value else f"# {key}: unknown; {unit}"


def _limits(joint: NewJoint, units: Sequence[str]) -> Iterator[str]:
    stated = (
        ("position", row(joint.position) if joint.position else ""),
        ("speed", "" if joint.speed is None else repr(tidy(joint.speed))),
        ("torque", "" if joint.torque is None else repr(tidy(joint.torque))),
    )
    if any(value for _, value in stated):
        yield "[joint.limits]"
    for (key, value), unit in zip(stated, units, strict=True):
        if value:
            yield _line(key, value, unit)


def _line(key: str, value: str, comment: str = "") -> str:
    said = f"{key} = {value}"
    return (
        f"{said:<{COLUMN - 1}} # {comment}" if comment and len(said) < COLUMN else f"{said}   # {comment}".rstrip(" #")
    )
