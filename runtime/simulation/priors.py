"""Likely numbers where a model file leaves them out: so that an unknown arm can be simulated, and moved with care.

Every number that is assumed is listed with its reason. Friction without values is sized by `simulate.complete`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from runtime.documents.recordings import AssumedNumber
from runtime.simulation.settings import LINK_RADIUS, MASS_PER_LENGTH, SHORTEST_LINK, TORQUE_OVER_ROTOR
from symbolic.model_file.arm import ROTOR, Arm, Joint, Link


@dataclass(frozen=True)
class AssumedArm:
    """An arm with all its inertias, and which of them were assumed."""

    arm: Arm
    numbers: tuple[AssumedNumber, ...]

    @classmethod
    def of(cls, arm: Arm) -> AssumedArm:
        """The arm with likely numbers in place of those that its file leaves out."""
        joints, numbers = [], list[AssumedNumber]()
        for i, joint in enumerate(arm.joints):
            link = _likely_link(arm, i)
            full = replace(joint, link=link, rotor_inertia=_likely_rotor(joint, link))
            numbers += _assumed(i + 1, joint, full)
            joints.append(full)
        return cls(replace(arm, joints=tuple(joints)), tuple(numbers))


def _likely_link(arm: Arm, i: int) -> Link:
    """A tube to the next joint, whose mass grows with its length."""
    link = arm.joints[i].link
    ahead = (*(joint.origin for joint in arm.joints[1:]), arm.tip)[i].xyz
    length = max(sum(x * x for x in ahead) ** 0.5, SHORTEST_LINK)
    mass = MASS_PER_LENGTH * length if link.mass is None else link.mass
    com = tuple(x / 2 for x in ahead) if link.com is None else link.com
    across = mass * (length**2 + 3 * LINK_RADIUS**2) / 12
    inertia = (across, 0.0, 0.0, across, 0.0, across) if link.inertia is None else link.inertia
    return Link(mass, (com[0], com[1], com[2]), inertia)


def _likely_rotor(joint: Joint, link: Link) -> float:
    """From the largest torque, else as much as the link's own inertia about its joint: the gear ratio of fastest
    acceleration makes both equal (Pasch & Seering 1984, On the drive systems for high-performance machines)."""
    if joint.rotor_inertia is not None:
        return joint.rotor_inertia
    if joint.limits.torque is not None:
        return joint.limits.torque / TORQUE_OVER_ROTOR[joint.type]
    mass, com, inertia = link.mass or 0.0, link.com or (0.0, 0.0, 0.0), link.inertia or (0.0,) * 6
    return (
        mass if joint.type == "prismatic" else mass * sum(x * x for x in com) + max(inertia[0], inertia[3], inertia[5])
    )


def _assumed(number: int, joint: Joint, full: Joint) -> Iterator[AssumedNumber]:
    length = "kg" if joint.type == "prismatic" else "kg m^2"
    told = {
        "mass": (full.link.mass, "kg", f"{MASS_PER_LENGTH:g} kg for each metre to the next joint"),
        "com": (None, "m", "halfway to the next joint"),
        "inertia": (None, "kg m^2", "that of a tube of this mass"),
        ROTOR: (
            full.rotor_inertia,
            length,
            "that of its link"
            if joint.limits.torque is None
            else f"its largest torque accelerates it with {TORQUE_OVER_ROTOR[joint.type]:g} {_acceleration(joint)}",
        ),
    }
    for key in joint.unknown:
        value, unit, why = told[key]
        yield AssumedNumber(joint=number, name=joint.name, parameter=key, value=value, unit=unit, reason=why)


def _acceleration(joint: Joint) -> str:
    return "m/s^2" if joint.type == "prismatic" else "rad/s^2"
