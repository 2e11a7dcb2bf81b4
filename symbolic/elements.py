"""Mechanical elements of which simulators' models are made; each effect declares of which its law is the sum.

An element's fields are expressions in an effect's parameters where it is declared, and numbers where it is written.
Torques have the motor's sign, as effects' have. Units are those of the joint, SI.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar


@dataclass(frozen=True)
class Element:
    """One element of the list below."""


@dataclass(frozen=True)
class DryFriction(Element):
    """F sgn(qd)."""

    torque: Any


@dataclass(frozen=True)
class CreepFriction(Element):
    """dF exp(-(qd/v)^2) sgn(qd), a part of the dry friction."""

    torque: Any
    speed: Any


@dataclass(frozen=True)
class Bristles(Element):
    """The joint's dry friction is carried by bristles: the LuGre model."""

    stiffness: Any
    damping: Any


@dataclass(frozen=True)
class LoadFriction(Element):
    """mu |load| sgn(qd)."""

    coefficient: Any


@dataclass(frozen=True)
class Damper(Element):
    """c qd."""

    coefficient: Any


@dataclass(frozen=True)
class AbsoluteDamper(Element):
    """c |qd|: half the difference of two directions' dampers."""

    coefficient: Any


@dataclass(frozen=True)
class CubicDamper(Element):
    """c qd^3."""

    coefficient: Any


@dataclass(frozen=True)
class PowerDamper(Element):
    """F |qd|^p sgn(qd)."""

    torque: Any
    exponent: Any


@dataclass(frozen=True)
class ConstantTorque(Element):
    """A torque that never changes."""

    torque: Any


@dataclass(frozen=True)
class JointSpring(Element):
    """k (q - rest)."""

    stiffness: Any
    rest: Any


@dataclass(frozen=True)
class CurvedSpring(Element):
    """c1 q + c2 q^2 + c3 q^3 + c4 q^4."""

    first: Any
    second: Any
    third: Any
    fourth: Any


@dataclass(frozen=True)
class OneSidedSpring(Element):
    """k (q - place) where side (q - place) > 0; side is +1 or -1."""

    side: Any
    place: Any
    stiffness: Any


@dataclass(frozen=True)
class OneSidedTorque(Element):
    """side F where side (q - place) > 0."""

    side: Any
    place: Any
    torque: Any


@dataclass(frozen=True)
class OneSidedDamper(Element):
    """d qd where side (q - place) > 0."""

    side: Any
    place: Any
    coefficient: Any


@dataclass(frozen=True)
class YieldingSpring(Element):
    """A spring whose rest follows q where it is further from it than the limit."""

    stiffness: Any
    limit: Any


@dataclass(frozen=True)
class Wave(Element):
    """A cos(order N q + phase), N the gear ratio."""

    amplitude: Any
    order: Any
    phase: Any


@dataclass(frozen=True)
class Gain(Element):
    """The recorded torque is the acting one times a factor."""

    factor: Any


@dataclass(frozen=True)
class Delay(Element):
    """The recorded torque acts later, s."""

    time: Any


@dataclass(frozen=True)
class Lag(Element):
    """The acting torque follows the recorded one by a first-order lag, s."""

    time: Any


@dataclass(frozen=True)
class Compliance(Element):
    """The link behind a spring with a damper."""

    stiffness: Any
    damping: Any


@dataclass(frozen=True)
class Gap(Element):
    """The link behind a gap, from flank to flank, whose flanks are springs with dampers."""

    width: Any
    stiffness: Any
    damping: Any


@dataclass(frozen=True)
class CoupledDrive(Element):
    """F sgn(w) + c w + I dw/dt on w = qd + ratio qd_next, at this joint; ratio times that at the next one."""

    ratio: Any
    friction: Any
    damping: Any
    inertia: Any


@dataclass(frozen=True)
class TiltedGravity(Element):
    """Gravity in base axes, beyond the model file's."""

    x: Any
    y: Any
    z: Any


@dataclass(frozen=True)
class TipMass(Element):
    """A point mass at a place in the tip's frame, from a time on."""

    mass: Any
    time: Any
    x: Any
    y: Any
    z: Any


E = TypeVar("E", bound=Element)


def converted(element: E, convert: Callable[[Any], Any]) -> E:
    """The element with each field converted."""
    return replace(element, **{f.name: convert(getattr(element, f.name)) for f in fields(element)})
