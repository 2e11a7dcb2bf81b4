"""The model file: TOML in, a checked Arm out.

Every error is one line that says where it is, what was found and what was expected. Names end up in C
and in file names: they are checked against the languages' rules here, and never evaluated.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from symbolic.model_file.arm import Arm, Contact, Control, Drive, Gains, Joint, Limits, Link, Values
from symbolic.model_file.checks import (
    ModelError,
    Place,
    did_you_mean,
    found,
    identifier,
    keys,
    nearest,
    number,
    pair,
    printable,
    quote,
    table_at,
)

if TYPE_CHECKING:
    from symbolic.effects.declaration import Effect

__all__ = ["ModelError", "check_effect", "load", "parse", "read_text"]

MAX_JOINTS = 7
MAX_BYTES = 1_000_000
MAX_NODE = 126
"""Node ids on a CAN bus end at 127, which is left to the computer."""


def load(path: Path | str, effects: Mapping[str, Effect] | None = None) -> Arm:
    """The arm in the TOML file at `path`; `effects`: the library by name (None: the built-in one).

    Raises ModelError.
    """
    return parse(read_text(path), str(path), effects)


def read_text(path: Path | str) -> str:
    """The file's text with its own line ends, decoded from UTF-8. Raises ModelError."""
    where = Place(printable(str(path)))
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        where.fail("no such file; expected a model file in TOML")
    except IsADirectoryError:
        where.fail("is a directory; expected a model file in TOML")
    except (OSError, ValueError) as error:
        where.fail(f"cannot be read: {printable(getattr(error, 'strerror', None) or str(error))}")
    if len(data) > MAX_BYTES:
        where.fail(f"is larger than {MAX_BYTES // 1_000_000} MB; expected a model file in TOML")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ModelError(
            f"{where.file} line {line}: byte 0x{data[error.start]:02x} is not UTF-8; save the file as UTF-8"
        ) from None


def parse(text: str, where: str, effects: Mapping[str, Effect] | None = None) -> Arm:
    """The arm described by `text`; `where` names the file in messages.

    effects   the library by name (None: the built-in one)
    Raises ModelError for the first thing that is wrong.
    """
    if effects is None:
        from symbolic.effects import LIBRARY

        effects = LIBRARY
    top = Place(printable(where))
    table = _toml(text, top)
    keys(top, table, ("name", "gravity", "joint"), ("effects", "contact", "inertial", "controller"))
    name = _name(top, table["name"])
    gravity = pair(top, "gravity", table["gravity"], "m/s^2")
    joints = _joints(top, table["joint"], effects)
    arm = Arm(
        name=name,
        gravity=gravity,
        joints=joints,
        effects=_effects(top, table.get("effects", {}), "arm", effects),
        contact=_contact(top, table["contact"], effects) if "contact" in table else None,
        inertial=_inertial(top, table.get("inertial", {})),
        controller=_control(top.inside("controller"), table["controller"]) if "controller" in table else None,
    )
    _check_inertia_seen(top, arm)
    return arm


# --- structure ---


def _toml(text: str, top: Place) -> dict[str, Any]:
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError as error:
        match = re.match(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)$", str(error), re.DOTALL)
        what, line, column = match.groups() if match else (str(error), None, None)
        if "Cannot overwrite" in what or "declare" in what or "mutate" in what:
            what += " (the same key or table twice?)"
        where = f"line {line}" if line else f"line {text.count(chr(10)) + 1}"
        at = f" at column {column}" if column else ""
        raise ModelError(f"{top.file} {where}: not valid TOML{at}: {printable(what)}") from None
    except RecursionError:
        top.fail("not valid TOML: nested too deeply")
    except ValueError as error:  # a date that does not exist, a number of thousands of digits
        top.fail(f"not valid TOML: {printable(str(error)).split(';')[0][:120]}")


def _name(top: Place, value: Any) -> str:
    name = identifier(top, "name", value)
    if name.lower() in ("effects", "tendon") or name.lower().startswith("tendon_"):
        top.fail(f"name {quote(name)} is taken by the generated files of the toolkit; choose another name")
    return name


# --- the arm ---


def _joints(top: Place, value: Any, effects: Mapping[str, Effect]) -> tuple[Joint, ...]:
    if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
        top.fail(f"joint is {found(value)}; expected one [[joint]] table a joint, from the base outwards")
    if not 1 <= len(value) <= MAX_JOINTS:
        top.fail(f"found {len(value)} joints; expected 1 to {MAX_JOINTS} [[joint]] tables")
    joints = tuple(
        _joint(top.inside(f"joint {i}"), table, effects, last=i == len(value)) for i, table in enumerate(value, 1)
    )
    _check_nodes(top, joints)
    return joints


def _joint(place: Place, table: dict[str, Any], effects: Mapping[str, Effect], last: bool) -> Joint:
    optional = ("effects", "torque_constant", "limits", "controller", "encoder", "drive")
    keys(place, table, ("type", "rotor_inertia", "gear_ratio", "link"), optional)
    kind: Literal["revolute", "prismatic"]
    if table["type"] == "revolute":
        kind, force, inertia = "revolute", "N m", "kg m^2"
    elif table["type"] == "prismatic":
        kind, force, inertia = "prismatic", "N", "kg"
    else:
        place.fail(f'type is {found(table["type"])}; expected "revolute" or "prismatic"')
    constant = table.get("torque_constant")
    if constant is not None:
        constant = number(place, "torque_constant", constant, f"{force}/A at the joint's output", positive=True)
    return Joint(
        type=kind,
        rotor_inertia=number(place, "rotor_inertia", table["rotor_inertia"], inertia, low=0.0),
        gear_ratio=number(place, "gear_ratio", table["gear_ratio"], "", positive=True),
        link=_link(place.inside("link"), table["link"]),
        effects=_effects(place, table.get("effects", {}), "joint", effects, kind, last),
        torque_constant=constant,
        limits=_limits(place.inside("limits"), table.get("limits", {}), kind),
        gains=_gains(place.inside("controller"), table["controller"], kind) if "controller" in table else None,
        **(_encoder(place.inside("encoder"), table["encoder"]) if "encoder" in table else {}),
        drive=_drive(place.inside("drive"), table["drive"]) if "drive" in table else None,
    )


def _link(place: Place, value: Any) -> Link:
    table = table_at(place, value, "[joint.link] with length, mass, com and inertia")
    keys(place, table, ("length", "mass", "com", "inertia"))
    return Link(
        length=number(place, "length", table["length"], "m", low=0.0),
        mass=number(place, "mass", table["mass"], "kg", low=0.0),
        com=pair(place, "com", table["com"], "m"),
        inertia=number(place, "inertia", table["inertia"], "kg m^2", low=0.0),
    )


def _limits(place: Place, value: Any, kind: str) -> Limits:
    table = table_at(place, value, "[joint.limits] with position, speed or torque")
    keys(place, table, (), ("position", "speed", "torque"))
    unit, force = ("rad", "N m") if kind == "revolute" else ("m", "N")
    position = None
    if "position" in table:
        position = pair(place, "position", table["position"], unit)
        if position[0] >= position[1]:
            place.fail(f"position is [{position[0]:g}, {position[1]:g}]; expected the smaller end first")
    speed, torque = (
        number(place, key, table[key], key_unit, positive=True) if key in table else None
        for key, key_unit in (("speed", f"{unit}/s"), ("torque", force))
    )
    return Limits(position, speed, torque)


def _gains(place: Place, value: Any, kind: str) -> Gains:
    table = table_at(place, value, "[joint.controller] with kp and kd")
    keys(place, table, ("kp", "kd"))
    kp, kd = ("N m/rad", "N m s/rad") if kind == "revolute" else ("N/m", "N s/m")
    return Gains(number(place, "kp", table["kp"], kp, low=0.0), number(place, "kd", table["kd"], kd, low=0.0))


def _encoder(place: Place, value: Any) -> dict[str, int]:
    table = table_at(place, value, "[joint.encoder] with counts")
    keys(place, table, ("counts",), ("zero",))
    counts = number(place, "counts", table["counts"], "counts per turn of the motor", positive=True)
    if counts != int(counts):
        place.fail(f"counts is {counts:.6g}; expected a whole number, counts per turn of the motor")
    zero = table.get("zero", 0)
    if not isinstance(zero, int) or isinstance(zero, bool) or not -(2**31) <= zero < 2**31:
        place.fail(f"zero is {found(zero)}; expected a whole number of 32 bits, what the encoder counts at position 0")
    return {"encoder_counts": int(counts), "encoder_zero": zero}


def _drive(place: Place, value: Any) -> Drive:
    table = table_at(place, value, "[joint.drive] with node")
    keys(place, table, ("node",), ("direction", "rated_torque"))
    node, direction = table["node"], table.get("direction", 1)
    if not isinstance(node, int) or isinstance(node, bool) or not 1 <= node <= MAX_NODE:
        place.fail(f"node is {found(node)}; expected the drive's CANopen node id, a whole number from 1 to {MAX_NODE}")
    if isinstance(direction, bool) or direction not in (1, -1):
        place.fail(f"direction is {found(direction)}; expected 1, or -1 where the motor counts against the joint")
    rated = table.get("rated_torque")
    if rated is not None:
        rated = number(place, "rated_torque", rated, "N m at the motor", positive=True)
    return Drive(node, int(direction), rated)


def _check_nodes(top: Place, joints: tuple[Joint, ...]) -> None:
    """Every drive answers to an id of its own."""
    seen: dict[int, int] = {}
    for i, joint in enumerate(joints, 1):
        if joint.drive is not None and seen.setdefault(joint.drive.node, i) != i:
            first, node = seen[joint.drive.node], joint.drive.node
            top.inside(f"joint {i}").inside("drive").fail(
                f"node {node} is the drive of joint {first} already; expected an id of its own"
            )


def _control(place: Place, value: Any) -> Control:
    table = table_at(place, value, "[controller] with rate, velocity_cutoff, friction_scale and friction_slope")
    keys(place, table, ("rate", "velocity_cutoff", "friction_scale", "friction_slope"))
    rate = number(place, "rate", table["rate"], "Hz", positive=True)
    return Control(
        rate=rate,
        velocity_cutoff=number(place, "velocity_cutoff", table["velocity_cutoff"], "Hz", high=rate / 2, positive=True),
        friction_scale=number(place, "friction_scale", table["friction_scale"], "", low=0.0, high=1.0),
        friction_slope=number(place, "friction_slope", table["friction_slope"], "s/rad (s/m)", positive=True),
    )


def _contact(top: Place, value: Any, effects: Mapping[str, Effect]) -> Contact:
    place = top.inside("contact")
    table = table_at(place, value, "[contact] with x and [contact.effects.…]")
    keys(place, table, ("x",), ("effects",))
    return Contact(
        number(place, "x", table["x"], "m"),
        _effects(place, table.get("effects", {}), "contact", effects),
    )


def _inertial(top: Place, value: Any) -> Values:
    place = top.inside("inertial")
    table = table_at(place, value, "[inertial] with base inertial parameters as identify --write puts them there")
    return {identifier(place, "key", key): number(place, key, entry, "SI units") for key, entry in table.items()}


# --- effects ---

_HOME = {
    "joint": "acts on one joint; put it under [joint.effects.{}] of that joint",
    "joints": "acts on a joint and the next one; put it under [joint.effects.{}] of the first of the two",
    "arm": "acts on the whole arm; put it under [effects.{}]",
    "contact": "acts at the end-effector; put it under [contact.effects.{}]",
}
_TABLE = {"joint": "[joint.effects.…]", "arm": "[effects.…]", "contact": "[contact.effects.…]"}


def _effects(
    place: Place,
    value: Any,
    scope: str,
    library: Mapping[str, Effect],
    kind: str = "revolute",
    last: bool = False,
) -> dict[str, Values]:
    """The active effects under `place`, in the file's order; `last`: the joint has none after it."""
    table = table_at(place.inside("effects"), value, f"{_TABLE[scope]}, one an effect")
    return {name: _effect(place, name, values, scope, library, kind, last) for name, values in table.items()}


def _effect(
    place: Place, name: str, value: Any, scope: str, library: Mapping[str, Effect], kind: str, last: bool
) -> Values:
    check_effect(place, name, scope, library, last)
    effect = library[name]
    place = place.inside(name)
    known = {p.name: p for p in effect.parameters}
    table = table_at(place, value, f"with {', '.join(known) or 'nothing in it'}, or an empty one: values unknown")
    for key in table:
        if key not in known:
            hint = did_you_mean(key, tuple(known)) if known else "it has none"
            place.fail(f"unknown parameter {quote(key)}; {hint}")
    return {
        key: number(place, key, entry, known[key].unit.text(kind), *known[key].bounds) for key, entry in table.items()
    }


def check_effect(place: Place, name: str, scope: str, library: Mapping[str, Effect], last: bool = False) -> None:
    """Raise ModelError unless `name` is an effect that may stand in a table of this scope.

    scope   "joint", "arm" or "contact"; last: the joint is the outermost one
    """
    if name not in library:
        close = nearest(name, library)
        hint = f'; did you mean "{close}"?' if close else ""
        place.fail(f"unknown effect {quote(name)}{hint} (tendon effects lists them all)")
    home = library[name].scope
    if home not in ((scope, "joints") if scope == "joint" else (scope,)):
        place.fail(f'effect "{name}" {_HOME[home].format(name)}')
    if home == "joints" and last:
        place.fail(f'effect "{name}" names the first of two joints, and there is none after this one')


# --- physics ---


def _check_inertia_seen(top: Place, arm: Arm) -> None:
    """Every joint must move some inertia, or D is singular and the arm cannot be simulated or identified."""
    for i, joint in enumerate(arm.joints):
        seen, offset = joint.rotor_inertia, False
        for k, outer in enumerate(arm.joints[i:]):
            if joint.type == "prismatic":
                seen += outer.link.mass
                continue
            slides = k > 0 and outer.type == "prismatic"
            if offset or slides or outer.link.com != (0.0, 0.0):
                seen += outer.link.mass
            seen += outer.link.inertia
            offset = offset or slides or outer.link.length > 0
        if seen <= 0:
            top.inside(f"joint {i + 1}").fail(
                "moves no inertia at all; expected a rotor_inertia, or a mass or inertia on this link or further out"
            )
