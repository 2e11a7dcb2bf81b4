"""Likely bodies and rotors where a model file leaves them out, and what was assumed for which reason."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from statistics import median

from symbolic.model_file.arm import ROTOR, Arm, Joint, Link
from symbolic.model_file.frames import Inertia, StatedBody, Vector, about_point, scaled

SLENDER, LEAST_RADIUS, USUAL_MASS = 8.0, 0.04, 1.0
"""An unknown body is a cylinder from its joint to the next: length over radius, minimum radius in m, and mass in kg
where no other body has one."""

TORQUE_OVER_ROTOR = {"revolute": 100.0, "prismatic": 20.0}
"""rad/s^2, m/s^2; a joint's largest torque over its rotor's inertia at the output, where that is unknown: 60 to 200 at
geared joints with known rotors."""


@dataclass(frozen=True)
class LikelyNumber:
    """A number that a model file leaves out. value: what is assumed, in `unit`; None: several numbers."""

    joint: int
    name: str | None
    parameter: str
    value: float | None
    unit: str
    reason: str


def likely_arm(arm: Arm) -> tuple[Arm, tuple[LikelyNumber, ...]]:
    """The arm with likely numbers in place of those that its file leaves out, and what they are."""
    joints = [
        replace(joint, link=Link(body.mass, body.com, body.inertia), rotor_inertia=_likely_rotor(joint, body))
        for joint, body in zip(arm.joints, likely_bodies(arm), strict=True)
    ]
    pairs = enumerate(zip(arm.joints, joints, strict=True), 1)
    numbers = tuple(number for k, (joint, full) in pairs for number in _assumed(k, joint, full))
    return replace(arm, joints=tuple(joints)), numbers


def _assumed(k: int, joint: Joint, full: Joint) -> Iterator[LikelyNumber]:
    turns, limit = joint.type == "revolute", joint.limits.torque
    fastest = f"{TORQUE_OVER_ROTOR[joint.type]:g} {'rad' if turns else 'm'}/s^2"
    why = "as much as its link" if limit is None else f"its largest torque accelerates it with {fastest}"
    told = {
        "mass": (full.link.mass, "kg", "the median of the links' masses"),
        "com": (None, "m", "halfway to the next joint"),
        "inertia": (None, "kg m^2", "a cylinder of this mass to the next joint"),
        ROTOR: (full.rotor_inertia, "kg m^2" if turns else "kg", why),
    }
    for key in joint.unknown:
        value, unit, reason = told[key]
        yield LikelyNumber(k, joint.name, key, value, unit, reason)


def _likely_rotor(joint: Joint, body: StatedBody) -> float:
    """From the largest torque, else as much as the link's inertia."""
    if joint.rotor_inertia is not None:
        return joint.rotor_inertia
    if joint.limits.torque is not None:
        return joint.limits.torque / TORQUE_OVER_ROTOR[joint.type]
    return turning(body, joint)


def likely_bodies(arm: Arm) -> list[StatedBody]:
    """The stated bodies, with likely ones where they are unknown."""
    masses = [joint.link.mass for joint in arm.joints if joint.link.mass]
    usual = median(masses) if masses else USUAL_MASS
    ends = [*(joint.origin.xyz for joint in arm.joints[1:]), arm.tip.xyz]
    bodies = []
    for joint, end in zip(arm.joints, ends, strict=True):
        link = joint.link
        mass = usual if link.mass is None else link.mass
        com = scaled(0.5, end) if link.com is None else link.com
        bodies.append(StatedBody(mass, com, _cylinder(mass, end) if link.inertia is None else link.inertia))
    return bodies


def _cylinder(mass: float, end: Vector) -> Inertia:
    """Inertia of a solid cylinder from the joint to `end`, about its centre, kg m²."""
    length = math.hypot(*end)
    radius = max(LEAST_RADIUS, length / SLENDER)
    along, across = mass * radius**2 / 2, mass * (3 * radius**2 + length**2) / 12
    x, y, z = scaled(1 / length, end) if length else (0.0, 0.0, 1.0)
    d = along - across
    return across + d * x * x, d * x * y, d * x * z, across + d * y * y, d * y * z, across + d * z * z


def turning(body: StatedBody, joint: Joint) -> float:
    """A rotor inertia equal to that of the moved body, for which gears are usually chosen (Pasch & Seering 1984)."""
    if joint.type == "prismatic":
        return body.mass or USUAL_MASS
    moments = about_point(body, (0.0, 0.0, 0.0))
    return (moments[0] + moments[3] + moments[5]) / 3 or USUAL_MASS * LEAST_RADIUS**2
