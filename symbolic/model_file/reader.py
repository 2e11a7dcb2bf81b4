"""The model file: TOML in, a checked Arm out.

Every error is one line that says where it is, what was found and what was expected. Names end up in C
and in file names: they are checked against the languages' rules here, and never evaluated.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from symbolic.described import AnyEffect, declared, numbered
from symbolic.model_file import fields, user_file
from symbolic.model_file.arm import (
    Arm,
    Contact,
    Control,
    Drive,
    Frame,
    Gains,
    Joint,
    Limits,
    Link,
    Values,
    planar,
    planar_link,
)
from symbolic.model_file.checks import ModelError, Place, is_taken, nearest, number, printable, quote, table_at, unknown
from symbolic.model_file.keys import SPATIAL, fields_of
from symbolic.model_file.physics import body_notes, check_distinct, check_inertia_seen
from symbolic.model_file.snapping import Snapping

__all__ = ["ModelError", "check_effect", "is_spatial", "load", "parse", "read_text"]


def load(path: Path | str, effects: Mapping[str, AnyEffect] | None = None) -> Arm:
    """The arm in the TOML file at `path`; `effects`: the library by name (None: the built-in one).

    Raises ModelError.
    """
    return parse(read_text(path), str(path), effects)


def read_text(path: Path | str) -> str:
    """The file's text with its own line ends, decoded from UTF-8. Raises ModelError."""
    return user_file.read_text(path, user_file.MAX_BYTES, "a model file in TOML")


def is_spatial(text: str) -> bool:
    """Whether a model file is one of an arm in space: its gravity has three components."""
    try:
        return fields_of(Place(""), tomllib.loads(text.removeprefix("\ufeff"))) is SPATIAL
    except (ValueError, RecursionError):
        return False


def parse(text: str, where: str, effects: Mapping[str, AnyEffect] | None = None) -> Arm:
    """The arm described by `text`; `where` names the file in messages.

    effects   the library by name (None: the built-in one)
    Raises ModelError for the first thing that is wrong.
    """
    if effects is None:
        from symbolic.effects import shipped

        effects = shipped(is_spatial(text))
    top = Place(printable(where))
    table = _toml(text, top)
    kind = fields_of(top, table)
    arm = (_arm_in_space if kind is SPATIAL else _arm_in_plane)(top, fields.read(top, table, kind), effects)
    check_distinct(top, arm.joints)
    check_inertia_seen(top, arm)
    return arm


def _arm_in_plane(top: Place, said: Mapping[str, Any], effects: Mapping[str, AnyEffect]) -> Arm:
    made, lengths = [], []
    for one, common in _joints(top, said["joint"], effects):
        body = dict(one["link"])
        lengths.append(body.pop("length"))
        made.append(Joint(**common, link=planar_link(**body)))
    contact = _contact(top, said["contact"], effects)
    return planar(
        Arm(**_common(top, said, effects), gravity=(*said["gravity"], 0.0), joints=tuple(made), contact=contact),
        lengths,
    )


def _arm_in_space(top: Place, said: Mapping[str, Any], effects: Mapping[str, AnyEffect]) -> Arm:
    """With angles and axes snapped to quarter turns and bodies checked; the arm's notes say what was found."""
    made, snapping, notes = [], Snapping(), []
    for k, (one, common) in enumerate(_joints(top, said["joint"], effects), 1):
        place = top.inside(f"joint {k}")
        link = Link(**one["link"])
        notes += body_notes(place, link)
        origin = snapping.frame(f"joint {k}", Frame(**one["origin"]))
        axis = snapping.axis(place, f"joint {k}", one["axis"])
        made.append(Joint(**common, axis=axis, origin=origin, link=link))
    tip = snapping.frame("the tip", Frame(**said["tip"]["origin"]))
    notes += [f"{top.file}: {note}" for note in snapping.notes()]
    return Arm(**_common(top, said, effects), gravity=said["gravity"], joints=tuple(made), tip=tip, notes=tuple(notes))


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


def _name(top: Place, name: str) -> str:
    if is_taken(name):
        top.fail(f"name {quote(name)} is taken by the generated files of the toolkit; choose another name")
    return name


# --- what all arms have ---


def _common(top: Place, said: Mapping[str, Any], effects: Mapping[str, AnyEffect]) -> dict[str, Any]:
    return {
        "name": _name(top, said["name"]),
        "effects": _effects(top, said["effects"], "arm", effects),
        "inertial": said["inertial"],
        "controller": _control(top, said["controller"]),
    }


def _joints(
    top: Place, said: Sequence[Mapping[str, Any]], effects: Mapping[str, AnyEffect]
) -> Iterator[tuple[Mapping[str, Any], dict[str, Any]]]:
    """Of each joint, what its table says, and of that what every joint has."""
    for k, one in enumerate(said, 1):
        yield one, _joint(top.inside(f"joint {k}"), one, effects, k == len(said))


def _joint(place: Place, said: Mapping[str, Any], effects: Mapping[str, AnyEffect], last: bool) -> dict[str, Any]:
    encoder = said["encoder"] or {"counts": None, "zero": 0}
    return {
        "type": said["type"],
        "rotor_inertia": said["rotor_inertia"],
        "gear_ratio": said["gear_ratio"],
        "effects": _effects(place, said["effects"], "joint", effects, said["type"], last),
        "torque_constant": said["torque_constant"],
        "limits": Limits(**said["limits"]),
        "gains": said["controller"] and Gains(**said["controller"]),
        "encoder_counts": encoder["counts"],
        "encoder_zero": encoder["zero"],
        "drive": said["drive"] and Drive(**said["drive"]),
        "name": said["name"],
    }


def _control(top: Place, said: Mapping[str, float] | None) -> Control | None:
    if said is None:
        return None
    made = Control(**said)
    number(top.inside("controller"), "velocity_cutoff", made.velocity_cutoff, "Hz", high=made.rate / 2)
    return made


def _contact(top: Place, said: Mapping[str, Any] | None, effects: Mapping[str, AnyEffect]) -> Contact | None:
    if said is None:
        return None
    return Contact(said["x"], _effects(top.inside("contact"), said["effects"], "contact", effects))


# --- effects ---

_HOME = {
    "joint": "acts on one joint; put it under [joint.effects.{}] of that joint",
    "joints": "acts on a joint and the next one; put it under [joint.effects.{}] of the first of the two",
    "arm": "acts on the whole arm; put it under [effects.{}]",
    "contact": "acts at the end-effector; put it under [contact.effects.{}]",
}


def _effects(
    place: Place,
    table: Mapping[str, Any],
    scope: str,
    library: Mapping[str, AnyEffect],
    kind: str = "revolute",
    last: bool = False,
) -> dict[str, Values]:
    """The active effects under `place`, in the file's order; `last`: the joint has none after it."""
    return {name: _effect(place, name, values, scope, library, kind, last) for name, values in table.items()}


def _effect(
    place: Place, name: str, value: Any, scope: str, library: Mapping[str, AnyEffect], kind: str, last: bool
) -> Values:
    check_effect(place, name, scope, library, last)
    effect = declared(name, library)
    place = place.inside(name)
    known = {p.name: p for p in effect.parameters}
    table = table_at(place, value, f"with {', '.join(known) or 'nothing in it'}, or an empty one: values unknown")
    for key in table:
        if key not in known:
            unknown(place, "parameter", key, tuple(known))
    return {
        key: number(place, key, entry, known[key].unit.text(kind), *known[key].bounds) for key, entry in table.items()
    }


def check_effect(place: Place, name: str, scope: str, library: Mapping[str, AnyEffect], last: bool = False) -> None:
    """Raise ModelError unless `name` is an effect that may stand in a table of this scope.

    scope   "joint", "arm" or "contact"; last: the joint is the outermost one
    """
    effect = numbered(name, library)[0]
    if effect not in library:
        close = nearest(name, library)
        hint = f'; did you mean "{close}"?' if close else ""
        place.fail(f"unknown effect {quote(name)}{hint} (tendon effects lists them all)")
    home = library[effect].scope
    if home not in ((scope, "joints") if scope == "joint" else (scope,)):
        place.fail(f'effect "{name}" {_HOME[home].format(name)}')
    if home == "joints" and last:
        place.fail(f'effect "{name}" names the first of two joints, and there is none after this one')
