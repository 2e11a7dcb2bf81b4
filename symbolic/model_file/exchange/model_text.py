"""The text of a model file, as a person would write it: units beside the numbers, one line a fact."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from symbolic.model_file.arm import Arm, Frame, Joint, Limits, Link, Values
from symbolic.model_file.checks import SMALLEST
from symbolic.model_file.frames import QUARTER

DIGITS = 12
"""Of a number that was computed: what rounding adds is behind them."""
COLUMN = 32
"""Where a comment begins, if there is room."""


def text(arm: Arm, head: Sequence[str], gravity: str, gears: Sequence[str]) -> str:
    """A model file that says what the arm does.

    head     lines of the comment at its top
    gravity, gears   what is said beside gravity and each joint's gear ratio; may be empty
    """
    lines = [*(f"# {line}".rstrip() for line in head), f'name = "{arm.name}"']
    lines += [_line("gravity", row(arm.gravity), gravity)]
    for joint, gear in zip(arm.joints, gears, strict=True):
        lines += ["", "[[joint]]", *_joint(joint, gear)]
    lines += ["", "[tip]", _line("origin", _frame(arm.tip), "m, rad; flange or tool in the last joint's frame")]
    return "\n".join(lines) + "\n"


def tidy(value: float) -> float:
    """Without what rounding leaves: quarter turns as they are, next to nothing as 0, else DIGITS digits."""
    if value == round(value / QUARTER) * QUARTER:
        return value + 0.0
    return 0.0 if abs(value) < SMALLEST else float(f"{value:.{DIGITS}g}")


def row(values: Sequence[float]) -> str:
    """A list of numbers; what is rounding beside the largest of them is 0."""
    largest = max(map(abs, values), default=0.0)
    kept = (0.0 if abs(value) < 10.0**-DIGITS * largest else tidy(value) for value in values)
    return f"[{', '.join(map(repr, kept))}]"


def _line(key: str, value: str, comment: str = "") -> str:
    said = f"{key} = {value}"
    return f"{said:<{COLUMN - 1}} # {comment}" if comment and len(said) < COLUMN else _beside(said, comment)


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
        yield _line("rotor_inertia", repr(tidy(joint.rotor_inertia)), f"{'kg m^2' if revolute else 'kg'} at the output")
    yield _line("gear_ratio", f"{joint.gear_ratio:.{DIGITS}g}", gear)
    yield _line("origin", _frame(joint.origin), "m, rad")
    yield _line("axis", row(joint.axis))
    yield from _link(joint.link)
    yield from _limits(joint.limits, revolute)
    for name, values in joint.effects.items():
        yield from _effect(name, values)


def _link(link: Link) -> Iterator[str]:
    stated = (
        ("mass", None if link.mass is None else repr(tidy(link.mass)), "kg"),
        ("com", None if link.com is None else row(link.com), "m"),
        ("inertia", None if link.inertia is None else row(link.inertia), "kg m^2: ixx, ixy, ixz, iyy, iyz, izz"),
    )
    lines = [_line(key, value, unit) for key, value, unit in stated if value is not None]
    unknown = [key for key, value, _ in stated if value is None]
    if lines:
        yield "[joint.link]"
        yield from lines
    if unknown:
        yield f"# {', '.join(unknown)} of the link: unknown"


def _limits(limits: Limits, revolute: bool) -> Iterator[str]:
    units = ("rad", "rad/s", "N m") if revolute else ("m", "m/s", "N")
    stated = (
        ("position", None if limits.position is None else row(limits.position)),
        ("speed", None if limits.speed is None else repr(tidy(limits.speed))),
        ("torque", None if limits.torque is None else repr(tidy(limits.torque))),
    )
    lines = [_line(key, value, unit) for (key, value), unit in zip(stated, units, strict=True) if value is not None]
    if lines:
        yield "[joint.limits]"
        yield from lines


def _effect(name: str, values: Values) -> Iterator[str]:
    yield _beside(f"[joint.effects.{name}]", "" if values else "values unknown")
    for key, value in values.items():
        yield _line(key, repr(tidy(value)))
