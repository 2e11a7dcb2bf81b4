"""How each mechanical element stands in the files of other programs: exactly, approximated by what, or not at all.

An effect stands there as its elements do. The exporters write by this table, and guide and JSON show it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from symbolic import elements as e

if TYPE_CHECKING:
    from symbolic.effects.declaration import Effect

Language = Literal["urdf", "mjcf", "bam"]
LANGUAGES: tuple[Language, ...] = ("mjcf", "urdf", "bam")
Played = Literal["exact", "approximated", "not"]


@dataclass(frozen=True)
class Way:
    """What an element becomes.

    by         the words of the file
    but        in what it differs from the element; "" where it is the same law
    tolerance  by how much MuJoCo's motion and that of `tendon simulate`'s plant may differ within 0.3 s of the same
               torque, in part of the motion; 0 where no simulator plays the file. Of a delay, the plant has the first
               order only; dry friction has a width of 1e-3 rad/s there, which makes most of its difference.
    """

    by: str
    but: str = ""
    tolerance: float = 0.0


_BRISTLED = "lugre of a passive dcmotor"
_COGGED = "cogging of a passive dcmotor"

WAYS: Mapping[Language, Mapping[type[e.Element], Way]] = {
    "mjcf": {
        e.DryFriction: Way("frictionloss of the joint", tolerance=3e-3),
        e.CreepFriction: Way(_BRISTLED, "bristles that hardly bend stand for it", 1e-2),
        e.Bristles: Way(_BRISTLED, tolerance=3e-3),
        e.Damper: Way("damping of the joint", tolerance=1e-3),
        e.AbsoluteDamper: Way("a general actuator that only brakes", tolerance=1e-3),
        e.CubicDamper: Way("damping of the joint", tolerance=1e-3),
        e.PowerDamper: Way("damping of the joint", "the nearest cubic polynomial up to the speed limit", 5e-3),
        e.ConstantTorque: Way("bias of the motor", tolerance=1e-3),
        e.JointSpring: Way("stiffness of the joint", tolerance=1e-3),
        e.CurvedSpring: Way("stiffness of tendons", "a cubic spline stands for the fourth power", 5e-3),
        e.OneSidedSpring: Way("stiffness of a tendon with a dead band", tolerance=1e-3),
        e.OneSidedTorque: Way("a general actuator", "it rises within 1 mrad (1 mm)", 2e-3),
        e.OneSidedDamper: Way("a soft range of the tendon", "it never pulls", 2e-2),
        e.YieldingSpring: Way("springyield of a tendon", tolerance=1e-3),
        e.Wave: Way(_COGGED, tolerance=1e-3),
        e.Gain: Way("gain of the motor", tolerance=1e-3),
        e.Delay: Way("delay of the motor", tolerance=2e-2),
        e.Lag: Way("filter of the motor", tolerance=1e-3),
        e.Compliance: Way("a second joint with stiffness and damping", tolerance=1e-3),
        e.Gap: Way("a second joint with a soft range", tolerance=1e-2),
        e.CoupledDrive: Way("frictionloss, damping and armature of a tendon", tolerance=3e-3),
        e.TiltedGravity: Way("gravity", tolerance=1e-3),
        e.TipMass: Way("a body at the tip", "it is there from the beginning", 1e-3),
    },
    "urdf": {
        e.DryFriction: Way("friction of the joint"),
        e.Damper: Way("damping of the joint"),
    },
    "bam": {
        e.DryFriction: Way("friction_base"),
        e.CreepFriction: Way("friction_stribeck, dtheta_stribeck, alpha"),
        e.LoadFriction: Way("load_friction_base", "half of it, on the sum of the motor's and the outer torque"),
        e.Damper: Way("friction_viscous"),
    },
}
"""Of each format's elements; an element that is not there, it has nothing for."""


@dataclass(frozen=True)
class Standing:
    """How an effect stands in a file. by, but: as `Way`, of all its elements; tolerance: the largest of theirs; whole:
    every element has a place there."""

    played: Played
    by: str
    but: str
    tolerance: float
    whole: bool = False


def standing(kinds: Iterable[type[e.Element]], language: Language) -> Standing:
    """Of the elements of an effect, for a format."""
    kinds = tuple(dict.fromkeys(kinds))
    ways = [WAYS[language][kind] for kind in kinds if kind in WAYS[language]]
    if not ways:
        return Standing("not", "", "", 0.0)
    lacking = [f"its {said(kind)} is left out" for kind in kinds if kind not in WAYS[language]]
    buts = [*dict.fromkeys(way.but for way in ways if way.but), *lacking]
    return Standing(
        "approximated" if buts else "exact",
        "; ".join(dict.fromkeys(way.by for way in ways)),
        "; ".join(buts),
        max(way.tolerance for way in ways),
        not lacking,
    )


def of_effect(effect: Effect, language: Language) -> Standing:
    """How a declared effect stands in a format."""
    return standing(map(type, effect.elements), language)


def table(effects: Collection[Effect]) -> list[tuple[str, ...]]:
    """A row for each effect: its name, and in each of LANGUAGES how it stands there."""
    return [(effect.name, *(_cell(of_effect(effect, language)) for language in LANGUAGES)) for effect in effects]


def _cell(there: Standing) -> str:
    if there.played == "not":
        return "not"
    tolerance = f" ({there.tolerance:g})" if there.tolerance else ""
    return f"{there.played}: {there.by}{', but ' * bool(there.but)}{there.but}{tolerance}"


def said(kind: type[e.Element]) -> str:
    """An element's name in words."""
    return "".join(f" {c.lower()}" if c.isupper() else c for c in kind.__name__).strip()
