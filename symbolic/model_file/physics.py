"""What a model file says of bodies, held against what bodies can be."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from symbolic.model_file.arm import Arm, Joint, Link
from symbolic.model_file.checks import SMALLEST, Place
from symbolic.model_file.frames import (
    IDENTITY,
    Rotation,
    Vector,
    about,
    added,
    applied,
    cross,
    dot,
    principal_moments,
    product,
    rotation,
    scaled,
    symmetric,
    transposed,
)

SLACK = 1e-3
"""Part of the largest principal moment; published inertias have three or four digits, and miss what holds exactly by
so much."""
ROUNDED = 1e-12
"""kg m²; a gram at 30 micrometres from the axis. Files computed by programs have as much beside a 0, of either sign."""
SOMEWHERE = 0.7
"""rad, m; how far each joint, times its number, stands from 0 where inertia is looked for: no angle of a drawing."""


def check_distinct(top: Place, joints: Sequence[Joint]) -> None:
    """Every drive answers to an id of its own, and every name means one joint. Raises ModelError."""
    nodes: dict[int, int] = {}
    names: dict[str, int] = {}
    for i, joint in enumerate(joints, 1):
        place = top.inside(f"joint {i}")
        if joint.drive is not None and (first := nodes.setdefault(joint.drive.node, i)) != i:
            place.inside("drive").fail(
                f"node {joint.drive.node} is the drive of joint {first} already; expected an id of its own"
            )
        if joint.name is not None and (first := names.setdefault(joint.name, i)) != i:
            place.fail(f'name "{joint.name}" is that of joint {first} already; expected one of its own')


# --- bodies in space ---


def impossible_moment(inertia: Sequence[float]) -> float | None:
    """The principal moment below 0, which no mass has, by more than digits and rounding explain; None without any."""
    small, _, large = principal_moments(inertia)
    return small if small < -max(SLACK * large, ROUNDED) else None


def body_notes(place: Place, link: Link) -> list[str]:
    """What is doubtful about a body, a line each.

    Raises ModelError for an inertia that no mass has: one with a negative principal moment.
    """
    if link.inertia is None:
        return []
    small, middle, large = principal_moments(link.inertia)
    if impossible_moment(link.inertia) is not None:
        place.inside("link").fail(
            f"inertia has the principal moments {small:.3g}, {middle:.3g}, {large:.3g} kg m^2; expected none below 0: "
            "check the order ixx, ixy, ixz, iyy, iyz, izz and the signs, or leave inertia out: unknown"
        )
    if small + middle < large - max(SLACK * large, ROUNDED):
        return [
            f"{place.file}: {place.path}: the inertia is that of no body: its principal moments {small:.3g}, "
            f"{middle:.3g}, {large:.3g} kg m^2 break the rule that two of them come to the third at least"
        ]
    return []


# --- inertia at every joint ---


def check_inertia_seen(top: Place, arm: Arm) -> None:
    """Every joint must move some inertia, or D is singular and the arm cannot be simulated or identified; what is not
    known may be there. Raises ModelError."""
    for i in range(len(arm.joints)):
        if not any(value is None or value > 0 for value in _moments_seen(arm.joints[i:])):
            top.inside(f"joint {i + 1}").fail(
                "moves no inertia at all; expected a rotor_inertia, or a mass or inertia on this link or further out"
            )


def _moments_seen(joints: Sequence[Joint]) -> Iterator[float | None]:
    """Inertias about (along) the first joint of its rotor and of each link outwards, at some configuration; None: not
    known. A link of unknown mass on the axis has its own inertia alone."""
    first = joints[0]
    yield first.rotor_inertia
    turned, origin = IDENTITY, (0.0, 0.0, 0.0)
    for k, joint in enumerate(joints):
        if k > 0:
            turned, origin = _moved(joint, turned, origin, SOMEWHERE * (k + 1))
        mass, com, inertia = joint.link.mass, joint.link.com, joint.link.inertia
        if first.type == "prismatic":
            yield mass
        elif inertia is None or (com is None and mass != 0):
            yield None
        else:
            centre = added(origin, applied(turned, com or (0.0, 0.0, 0.0)))
            moment = _moment(first.axis, turned, centre, mass or 0.0, inertia)
            heavier = _moment(first.axis, turned, centre, 1.0, inertia)
            yield None if mass is None and heavier > moment else moment


def _moved(joint: Joint, turned: Rotation, origin: Vector, q: float) -> tuple[Rotation, Vector]:
    """The joint's own frame at q, from the one before it."""
    origin = added(origin, applied(turned, joint.origin.xyz))
    turned = product(turned, rotation(joint.origin.rpy))
    if joint.type == "revolute":
        return product(turned, about(joint.axis, q)), origin
    return turned, added(origin, applied(turned, scaled(q / math.hypot(*joint.axis), joint.axis)))


def _moment(axis: Vector, turned: Rotation, com: Vector, mass: float, inertia: Sequence[float]) -> float:
    """About an axis through the origin; what rounding leaves of points on the axis counts as nothing."""
    along = scaled(1 / math.hypot(*axis), axis)
    off = cross(along, com)
    own = applied(transposed(turned), along)
    moment = mass * dot(off, off) + dot(own, applied(symmetric(inertia), own))
    return moment if moment > SMALLEST else 0.0
