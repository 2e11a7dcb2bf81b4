"""What `init` asks for: an arm from the base outwards, as far as it is known, or what a URDF says nothing of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from runtime.cli.questions import Questions, choice, for_each, number, numbers, of_option
from runtime.workspace import UsageError
from symbolic.model_file.beginning import Motor, NewArm, NewJoint
from symbolic.model_file.keys import MAX_JOINTS

if TYPE_CHECKING:
    from symbolic.model_file.arm import SpatialArm
    from symbolic.model_file.fields import JointType

_TYPES: dict[str, JointType] = {"r": "revolute", "p": "prismatic"}
_PLAIN, _DOWN = (0.0, 0.0), (0.0, 0.0, -9.81)
_UNKNOWN = "unknown"


@dataclass(frozen=True)
class Answered:
    """What the command line says already, as text; None: to be asked for."""

    name: str | None
    joints: str | None
    space: bool | None
    gravity: str | None
    gear_ratio: str | None
    torque_constant: str | None
    rotor_inertia: str | None
    length: str | None
    mass: str | None
    questions: Questions

    @property
    def stated(self) -> bool:
        """Whether the command line says anything of the arm."""
        return any(value is not None for key, value in vars(self).items() if key != "questions")


def new_arm(said: Answered, called: str, effects: tuple[str, ...], schema: str | None) -> NewArm:
    """An arm, asked for; called: what it is named if nothing is said. Raises UsageError."""
    name = said.name or said.questions.ask("Name of the arm, a C identifier", str, called, called) or called
    asked = "Joints from the base outwards, r for one that turns and p for one that slides, such as r,r,p"
    types = (
        of_option("--joints", said.joints, _types)
        if said.joints
        else said.questions.ask(asked, _types, "", needed="--joints")
    )
    assert types is not None
    space = said.space
    if space is None:
        space = bool(
            said.questions.ask(
                "Do all joints move in one plane, or in space", choice(plane=False, space=True), "space", True
            )
        )
    gravity = _gravity(said, space)
    sides = {
        field: for_each(f"--{field.replace('_', '-')}", getattr(said, field), len(types))
        for field in ("gear_ratio", "torque_constant", "rotor_inertia", "length", "mass")
    }
    joints = tuple(_joint(said.questions, k, kind, space, k == len(types), sides) for k, kind in enumerate(types, 1))
    tip: tuple[float, ...] = (0.0, 0.0, 0.0)
    if space:
        tip = (
            said.questions.ask("Flange or tool in the last joint's frame, x, y, z in m", numbers(3), "0, 0, 0", tip)
            or tip
        )
    return NewArm(name, gravity, joints, effects, tip, schema)


def motors(said: Answered, arm: SpatialArm) -> list[Motor]:
    """Of an arm from a URDF, which hardly ever says anything of them."""
    sides = {
        field: for_each(f"--{field.replace('_', '-')}", getattr(said, field), len(arm.joints))
        for field in ("gear_ratio", "torque_constant", "rotor_inertia")
    }
    return [
        _motor(said.questions, f"Joint {k} ({j.name})", k, j.type, sides, j.gear_ratio)
        for k, j in enumerate(arm.joints, 1)
    ]


Sides = dict[str, Sequence[float | None] | None]


def _types(text: str) -> tuple[JointType, ...]:
    letters = [part.strip().lower()[:1] for part in text.split(",")] if "," in text else list(text.strip().lower())
    if not 1 <= len(letters) <= MAX_JOINTS or any(letter not in _TYPES for letter in letters):
        raise ValueError(f"expected 1 to {MAX_JOINTS} letters r or p")
    return tuple(_TYPES[letter] for letter in letters)


def _gravity(said: Answered, space: bool) -> tuple[float, ...]:
    count, default = (3, _DOWN) if space else (2, _PLAIN)
    if said.gravity is not None:
        return of_option("--gravity", said.gravity, numbers(count))
    where = "along x, y, z of the base" if space else "in the plane of motion, zero where that is horizontal"
    shown = ", ".join(f"{g:g}" for g in default)
    return said.questions.ask(f"Gravity {where}, m/s^2", numbers(count), shown, default) or default


def _joint(questions: Questions, k: int, kind: JointType, space: bool, last: bool, sides: Sides) -> NewJoint:
    at = f"Joint {k}"
    position, rate, force = ("rad", "rad/s", "N m") if kind == "revolute" else ("m", "m/s", "N")

    def of(question: str, read: Callable[[str], Any], shown: str = _UNKNOWN, default: Any = None, **more: Any) -> Any:
        return questions.ask(f"{at}: {question}", read, shown, default, **more)

    place: dict[str, Any] = {}
    if space:
        zero, z = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
        place["origin"] = of("its frame in the one before, x, y, z in m", numbers(3), "0, 0, 0", zero) or zero
        place["rpy"] = of("and turned by roll, pitch, yaw in rad", numbers(3), "0, 0, 0", zero) or zero
        place["axis"] = of("its axis in its own frame", numbers(3), "0, 0, 1", z) or z
    else:
        place["length"] = _length(sides, k, last, of)
    return NewJoint(
        type=kind,
        motor=_motor(questions, at, k, kind, sides, 1.0),
        mass=_given(sides, "mass", k, lambda: of("mass of its link, kg", number)),
        com=of(
            f"its centre of mass, {'x, y, z' if space else 'along and across the link'}, m",
            numbers(3 if space else 2),
            default=(),
        ),
        inertia=of(
            "its inertia about that, kg m^2" + (": ixx, ixy, ixz, iyy, iyz, izz" if space else ""),
            numbers(6 if space else 1),
            default=(),
        ),
        position=of(f"range of position, {position}, the smaller end first", numbers(2), default=()),
        speed=of(f"largest speed, {rate}", number),
        torque=of(f"largest torque at its output, {force}", number),
        **place,
    )


def _length(sides: Sides, k: int, last: bool, of: Callable[..., Any]) -> float:
    """m, of a planar link: without those between joints there are no equations; the last places the tip alone."""
    if last:
        length = _given(sides, "length", k, lambda: of("length of its link, to the tip, m", number, "0", 0.0))
        return length or 0.0
    length = _given(sides, "length", k, lambda: of("length of its link, m", number, "", needed="--length"))
    if length is None:
        raise UsageError(f"Joint {k}: the length of a planar link cannot be left out; expected m to the next joint")
    return length


def _motor(questions: Questions, at: str, k: int, kind: JointType, sides: Sides, stated: float) -> Motor:
    turns = "turns of the motor a turn of the joint" if kind == "revolute" else "rad of the motor a metre"

    def of(question: str, shown: str = _UNKNOWN, default: float | None = None) -> Callable[[], float | None]:
        return lambda: questions.ask(f"{at}: {question}", number, shown, default)

    ratio = _given(sides, "gear_ratio", k, of(f"gear ratio, {turns}", f"{stated:g}", stated))
    return Motor(
        stated if ratio is None else ratio,
        _given(sides, "torque_constant", k, of("torque constant of the motor, N m/A")),
        _given(sides, "rotor_inertia", k, of("inertia of the motor's rotor, kg m^2")),
    )


def _given(sides: Sides, field: str, k: int, asked: Callable[[], float | None]) -> float | None:
    """What an option says of joint k, else what is answered."""
    values = sides.get(field)
    return asked() if values is None else values[k - 1]
