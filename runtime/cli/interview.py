"""The questions of `tendon init`: what is asked of a new arm, with units and sides of the gear, and how it is asked."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from runtime.workspace.names import UsageError
from symbolic.model_file.arm import COMMAND, LINK_TORQUE, MOTOR_TORQUE, TORQUES, WEIGHTLESS

Check = Callable[[Mapping[str, str]], None]
"""Raises ValueError if what is stated so far makes no model file, or one that exists already."""

UNKNOWN = "?"


class Question(NamedTuple):
    """What is asked, the answer that Enter gives, and what a person must know to answer."""

    text: str
    default: str
    explained: str


_EACH = "One number for all joints, or one for each with commas between."
_POINT = "A position for each joint, rad or m: 0.3,-0.5; or a place of the tip, m: tip=0.4,0.1."
QUESTIONS: Mapping[str, Question] = {
    "joints": Question("Joints from the base outwards, r for revolute and p for prismatic, such as r,r,p", "r", ""),
    "name": Question("Name of the arm, a C identifier", "arm", "The file and the generated code are called so."),
    "space": Question(
        "Do all joints move in one plane, or in space",
        "space",
        "In a plane all axes are parallel.",
    ),
    "length": Question("Lengths of the links, m", "1", f"From a joint's axis to the next one, or to the tip. {_EACH}"),
    "gear_ratio": Question(
        "Gear ratios, motor turns per turn of the joint or rad per metre",
        UNKNOWN,
        f"{UNKNOWN} counts as 1: recordings then hold what is behind the gear. {_EACH}",
    ),
    "torque_constant": Question(
        "Torque constants of the motors, N m/A",
        UNKNOWN,
        "Of the motor alone, before the gear, as in its data sheet: Tendon multiplies by the gear ratio. Needed where "
        f"recordings hold currents. {_EACH}",
    ),
    "rotor_inertia": Question(
        "Inertias of the motors' rotors, kg m^2",
        UNKNOWN,
        "Of the rotor alone, before the gear, as in its data sheet (1 g cm^2 = 1e-7 kg m^2): Tendon multiplies by the "
        f"gear ratio squared. Motion tells it where it is unknown. {_EACH}",
    ),
    "torque": Question(
        f"What the recorded torques are: {', '.join(TORQUES)}",
        UNKNOWN,
        f"{MOTOR_TORQUE}: from the motor's current or torque, times the gear ratio; {LINK_TORQUE}: of a sensor behind "
        f"the gear; {COMMAND}: what the controller asked for; {WEIGHTLESS}: the driver took gravity out. "
        f"{UNKNOWN} counts as {MOTOR_TORQUE}.",
    ),
    "from": Question("Where the motion begins", "", f"{_POINT} The arm rests there."),
    "to": Question("Where it turns", "", f"{_POINT} The arm rests there, too."),
    "duration": Question("Duration of the whole motion, there and back, s", "", ""),
    "springs": Question(
        "Joints that may have a parallel spring, such as 2,3",
        "none",
        "A spring beside the motor that takes over a part of its torque; stiffness and rest angle are then optimized.",
    ),
}
OF_TASK: tuple[str, ...] = ("from", "to", "duration", "springs")
OF_MOTORS: tuple[str, ...] = ("gear_ratio", "torque_constant", "rotor_inertia")
OF_URDF: tuple[str, ...] = (*OF_MOTORS, "torque")
OF_NEW_ARM = tuple(key for key in QUESTIONS if key not in ("rotor_inertia", *OF_TASK))  # motion tells a rotor's inertia


def interview(keys: Sequence[str], stated: Mapping[str, str], called: str, check: Check) -> dict[str, str]:
    """Everything that is stated, after asking for what no option states; the end of the input leaves the rest open.

    called   default name
    check    of each answer when it is given. On a terminal the question is then repeated; elsewhere UsageError names
             the answers before it, as options
    """
    given = dict(stated)
    interactive = sys.stdin.isatty()
    for key in keys:
        if key == "length" and not is_planar(given):
            continue
        question = QUESTIONS[key]
        default = called if key == "name" else question.default
        if interactive and key not in given and question.explained:
            print(question.explained, file=sys.stderr)
        while key not in given:
            if interactive:
                print(f"{question.text} [{default}]: ", end="", file=sys.stderr, flush=True)
            try:
                line = sys.stdin.readline()
            except KeyboardInterrupt:
                print(f"\n{_kept(given)}", file=sys.stderr)
                raise
            if not line:
                return given
            answer = line.strip() or default
            try:
                check({**given, key: answer})
                given[key] = answer
            except ValueError as error:
                if not interactive:
                    raise UsageError(f"{question.text}: {error}. {_kept(given)}") from error
                print(error, file=sys.stderr)
    return given


def is_planar(stated: Mapping[str, str]) -> bool:
    """Whether all joints move in one plane. Raises UsageError."""
    where = stated.get("space", QUESTIONS["space"].default).lower()
    if not where or not any(word.startswith(where) for word in ("plane", "space")):
        raise UsageError(f"{where}: expected plane or space")
    return where.startswith("p")


def _kept(given: Mapping[str, str]) -> str:
    """The answers so far as options with which to go on."""
    return f"Answered before it: {shlex.join(_options(given))}" if given else "Nothing was answered before it"


def _options(given: Mapping[str, str]) -> Iterator[str]:
    for key, answer in given.items():
        if key == "space":
            yield "--plane" if is_planar(given) else "--space"
        else:
            yield from (f"--{key.replace('_', '-')}", answer)
