"""The model file: TOML in, a checked Arm out.

Every error is one line that says where it is, what was found and what was expected.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from symbolic.described import AnyEffect, declared, numbered
from symbolic.model_file import checks, fields
from symbolic.model_file.arm import (
    Arm,
    ArmMonitor,
    Contact,
    Control,
    Drive,
    Frame,
    Gains,
    Joint,
    JointMonitor,
    Limits,
    Link,
    Values,
    planar,
    planar_link,
)
from symbolic.model_file.checks import (
    SMALLEST,
    ModelError,
    Place,
    is_taken,
    nearest,
    number,
    parse_toml,
    printable,
    quote,
    table_at,
    unknown,
)
from symbolic.model_file.drive_laws import GAIN_KEYS, LAWS, DriveLaw
from symbolic.model_file.frames import (
    IDENTITY,
    ROUNDED,
    SLACK,
    Rotation,
    Snapping,
    Vector,
    about,
    added,
    applied,
    cross,
    dot,
    impossible_moment,
    principal_moments,
    product,
    rotation,
    scaled,
    symmetric,
    transposed,
)
from symbolic.model_file.keys import SPATIAL, fields_of

__all__ = ["ModelError", "check_effect", "is_spatial", "load", "parse", "read_text"]


def load(path: Path | str, effects: Mapping[str, AnyEffect] | None = None) -> Arm:
    """The arm in the TOML file at `path`. effects: the library by name (None: the built-in one).

    Raises ModelError.
    """
    return parse(read_text(path), str(path), effects)


def read_text(path: Path | str) -> str:
    """The file as UTF-8 text with its line ends unchanged. Raises ModelError."""
    return checks.read_text(path, checks.MAX_BYTES, "a model file in TOML")


def is_spatial(text: str) -> bool:
    """Whether a model file describes a spatial arm, whose gravity has three components."""
    try:
        return fields_of(Place(""), tomllib.loads(text.removeprefix("\ufeff"))) is SPATIAL
    except (ValueError, RecursionError):
        return False


def parse(text: str, where: str, effects: Mapping[str, AnyEffect] | None = None) -> Arm:
    """The arm described by `text`.

    where     the file's name, for messages
    effects   the library by name (None: the built-in one)
    Raises ModelError for the first error found.
    """
    top = Place(printable(where))
    table = parse_toml(text, top)
    kind = fields_of(top, table)
    if effects is None:
        from symbolic.effects import shipped

        effects = shipped(kind is SPATIAL)
    said = fields.read(top, table, kind)
    name, n = said["name"], len(said["joint"])
    joints = [
        _joint(top.inside(f"joint {k}"), one, effects, last=k == n) for k, one in enumerate(said["joint"], start=1)
    ]
    if is_taken(name):
        top.fail(f"name {quote(name)} is reserved for the toolkit's own generated files; choose another name")
    arm = Arm(
        name,
        (*said["gravity"], 0.0)[:3],
        tuple(joints),
        effects=_effects(top, said["effects"], "arm", effects),
        inertial=said["inertial"],
        torque=said["torque"],
        controller=said["controller"] and Control(**said["controller"]),
    )
    if arm.controller is not None:
        cutoff = arm.controller.velocity_cutoff
        number(top.inside("controller"), "velocity_cutoff", cutoff, "Hz", high=arm.controller.rate / 2)
    arm = replace(arm, monitor=_monitor(top, said, arm.controller))
    if kind is SPATIAL:
        arm = _in_space(top, replace(arm, tip=Frame(**said["tip"]["origin"])))
    else:
        if (contact := said["contact"]) is not None:
            active = _effects(top.inside("contact"), contact["effects"], "contact", effects)
            arm = replace(arm, contact=Contact(contact["x"], active))
        arm = planar(arm, [one["link"]["length"] for one in said["joint"]])
    check_distinct(top, arm.joints)
    check_inertia_seen(top, arm)
    return arm


def _in_space(top: Place, arm: Arm) -> Arm:
    """Angles and axes close to quarter turns are made exact; the arm's notes list these and doubtful inertias. Raises
    ModelError for an axis without direction, or a negative principal moment."""
    made, snapping, notes = [], Snapping(), []
    for k, joint in enumerate(arm.joints, 1):
        place = top.inside(f"joint {k}")
        if joint.link.inertia is not None:
            small, middle, large = principal_moments(joint.link.inertia)
            moments = f"principal moments {small:.3g}, {middle:.3g}, {large:.3g} kg m^2"
            if impossible_moment(joint.link.inertia) is not None:
                place.inside("link").fail(
                    f"inertia has the {moments}; expected none below 0: check the order ixx, ixy, ixz, iyy, iyz, izz "
                    "and the signs, or leave inertia out: unknown"
                )
            if small + middle < large - max(SLACK * large, ROUNDED):
                notes.append(
                    f"{place.file}: {place.path}: no rigid body has this inertia: its {moments} violate the triangle "
                    "inequality; it is used as it is"
                )
        origin = snapping.frame(f"joint {k}", joint.origin)
        made.append(replace(joint, origin=origin, axis=snapping.axis(place, f"joint {k}", joint.axis)))
    tip = snapping.frame("the tip", arm.tip)
    notes += [f"{top.file}: {note}" for note in snapping.notes()]
    return replace(arm, joints=tuple(made), tip=tip, notes=tuple(notes))


# --- structure ---


def _joint(place: Place, said: Mapping[str, Any], effects: Mapping[str, AnyEffect], last: bool) -> Joint:
    """The joint as stated; a planar one has no pose yet."""
    spatial, link = "axis" in said, said["link"]
    encoder = said["encoder"] or {"counts": None, "zero": 0}
    return Joint(
        said["type"],
        said["rotor_inertia"],
        said["gear_ratio"],
        effects=_effects(place, said["effects"], "joint", library=effects, kind=said["type"], last=last),
        torque_constant=said["torque_constant"],
        limits=Limits(**said["limits"]),
        gains=said["controller"] and Gains(**said["controller"]),
        encoder_counts=encoder["counts"],
        encoder_zero=encoder["zero"],
        drive=said["drive"] and _drive(place.inside("drive"), said["drive"], said["torque_constant"]),
        name=said["name"],
        axis=said["axis"] if spatial else (0.0, 0.0, 1.0),
        origin=Frame(**said["origin"]) if spatial else Frame(),
        link=Link(**link) if spatial else planar_link(link["mass"], link["com"], link["inertia"]),
    )


def _monitor(top: Place, said: Mapping[str, Any], controller: Control | None) -> ArmMonitor | None:
    """The monitor: of all joints or of none, at the control rate. Raises ModelError."""
    joints = [one["monitor"] for one in said["joint"]]
    given = [k for k, one in enumerate(joints, 1) if one is not None]
    if said["monitor"] is None:
        if given:
            top.inside(f"joint {given[0]}").fail("[joint.monitor] needs [monitor] with its cutoff; expected both")
        return None
    without = [k for k in range(1, len(joints) + 1) if k not in given]
    if without:
        top.inside(f"joint {without[0]}").fail("[monitor] needs [joint.monitor] with a floor at every joint")
    if controller is None:
        top.fail("[monitor] needs the rate of [controller]; expected both")
    number(top.inside("monitor"), "cutoff", said["monitor"]["cutoff"], "Hz", high=controller.rate / 4)
    return ArmMonitor(**said["monitor"], joints=tuple(JointMonitor(**one) for one in joints))


def _drive(place: Place, said: Mapping[str, Any], torque_constant: float | None) -> Drive:
    """The drive as stated; a torque constant of the joint is its law's, too."""
    gains = {gain.key: said[gain.key] for gain in GAIN_KEYS if said[gain.key] is not None}
    of_bus = {key: said[key] for key in ("node", "direction", "rated_torque")}
    if said["law"] is None:
        if gains:
            homes = " or ".join(f'"{name}"' for name, law in LAWS.items() if _has(law, next(iter(gains))))
            place.fail(f"{next(iter(gains))} is a gain of a law, and none is named; add law = {homes}")
        if said["node"] is None:
            place.fail('missing key "node" or "law"; expected the CANopen id, or how the drive makes torque')
        return Drive(**of_bus)
    law = LAWS[said["law"]]
    for key in gains:
        if not _has(law, key):
            unknown(place, f"key of {law.name}", key, tuple(gain.key for gain in law.gains))
    if torque_constant is not None and _has(law, "torque_constant"):
        stated = gains.setdefault("torque_constant", torque_constant)
        if stated != torque_constant:
            place.fail(f"torque_constant is {stated:g} and that of the joint {torque_constant:g}; state one of the two")
    if "torque_per_volt" in gains and "resistance" in gains:
        place.fail("torque_per_volt is torque_constant over resistance; state it, or resistance")
    return Drive(**of_bus, law=law.name, gains=gains)


def _has(law: DriveLaw, key: str) -> bool:
    return any(gain.key == key for gain in law.gains)


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
    """The active effects of a table with their stated values, in the file's order. last: the joint is the outermost."""
    made: dict[str, Values] = {}
    for name, value in table.items():
        check_effect(place, name, scope, library=library, last=last)
        known = {p.name: p for p in declared(name, library).parameters}
        here = place.inside(name)
        expected = f"with {', '.join(known) or 'no keys'}, or an empty one if the values are unknown"
        made[name] = {}
        for key, entry in table_at(here, value, expected).items():
            if key not in known:
                unknown(here, "parameter", key, tuple(known))
            made[name][key] = number(here, key, entry, known[key].unit.text(kind), *known[key].bounds)
    return made


def check_effect(place: Place, name: str, scope: str, library: Mapping[str, AnyEffect], last: bool = False) -> None:
    """Raise ModelError unless `name` is an effect that is allowed in a table of this scope.

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


SOMEWHERE = 0.7
"""rad, m; joint k is at k times this where inertia is checked: a posture without special alignments."""


def check_distinct(top: Place, joints: Sequence[Joint]) -> None:
    """Drive ids and joint names must be unique. Raises ModelError."""
    nodes: dict[int, int] = {}
    names: dict[str, int] = {}
    for i, joint in enumerate(joints, 1):
        place = top.inside(f"joint {i}")
        node = None if joint.drive is None else joint.drive.node
        if node is not None and (first := nodes.setdefault(node, i)) != i:
            place.inside("drive").fail(f"node {node} is already the drive of joint {first}; expected another id")
        if joint.name is not None and (first := names.setdefault(joint.name, i)) != i:
            place.fail(f'name "{joint.name}" is already that of joint {first}; expected another name')


# --- inertia at every joint ---


def check_inertia_seen(top: Place, arm: Arm) -> None:
    """Every joint must move some inertia, otherwise D is singular; unknown inertias are accepted. Raises ModelError."""
    for i in range(len(arm.joints)):
        if not any(value is None or value > 0 for value in _moments_seen(arm.joints[i:])):
            top.inside(f"joint {i + 1}").fail(
                "moves no inertia; expected a rotor_inertia, or a mass or inertia of this link or one further out"
            )


def _moments_seen(joints: Sequence[Joint]) -> Iterator[float | None]:
    """Inertias about (along) the first joint's axis of its rotor and of each link outwards, at one configuration; None
    where unknown. A link of unknown mass on the axis has its own inertia only."""
    first = joints[0]
    yield first.rotor_inertia
    turned, origin = IDENTITY, (0.0, 0.0, 0.0)
    for k, joint in enumerate(joints):
        if k > 0:
            q = SOMEWHERE * (k + 1)
            origin = added(origin, applied(turned, joint.origin.xyz))
            turned = product(turned, rotation(joint.origin.rpy))
            if joint.type == "revolute":
                turned = product(turned, about(joint.axis, q))
            else:
                origin = added(origin, applied(turned, scaled(q / math.hypot(*joint.axis), joint.axis)))
        mass, com, inertia = joint.link.mass, joint.link.com, joint.link.inertia
        if first.type == "prismatic":
            yield mass
        elif inertia is None or (com is None and mass != 0):
            yield None
        else:
            centre = added(origin, applied(turned, com or (0.0, 0.0, 0.0)))
            moment = _moment(first.axis, turned, centre, mass=mass or 0.0, inertia=inertia)
            heavier = _moment(first.axis, turned, centre, mass=1.0, inertia=inertia)
            yield None if mass is None and heavier > moment else moment


def _moment(axis: Vector, turned: Rotation, com: Vector, mass: float, inertia: Sequence[float]) -> float:
    """Moment of inertia about an axis through the origin; rounding errors count as 0."""
    along = scaled(1 / math.hypot(*axis), axis)
    off = cross(along, com)
    own = applied(transposed(turned), along)
    moment = mass * dot(off, off) + dot(own, applied(symmetric(inertia), own))
    return moment if moment > SMALLEST else 0.0
