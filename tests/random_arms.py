"""Arms of any mixture of joints, for tests that must not depend on one arm."""

from __future__ import annotations

import random
from dataclasses import replace

from symbolic.effects import LIBRARY
from symbolic.model_file.arm import Arm, Joint, planar, planar_link


def arm(types: str, gravity: tuple[float, float], seed: int = 1) -> Arm:
    """`types`: "r" or "p" a joint; centres of mass off the link's line; decimal numbers as a file has them."""
    rng = random.Random(seed)

    def decimal(low: float, high: float) -> float:
        return round(rng.uniform(low, high), 3)

    def joint(kind: str) -> tuple[Joint, float]:
        com = (decimal(-0.1, 0.4), decimal(-0.05, 0.05))
        length, link = decimal(0.1, 0.5), planar_link(decimal(0.2, 4.0), com, decimal(0.01, 0.1))
        rotor, ratio = decimal(0.01, 0.3), float(rng.randint(1, 160))
        return Joint("revolute" if kind == "r" else "prismatic", rotor, ratio, link=link), length

    joints, lengths = zip(*(joint(kind) for kind in types), strict=True)
    return planar(Arm(f"arm_{types}", (*gravity, 0.0), joints), lengths)


MIXED = {
    name: arm(name, gravity)
    for name, gravity in (
        ("r", (0.0, -9.81)),
        ("rp", (1.0, -9.0)),
        ("prr", (0.0, 0.0)),
        ("rrrr", (0.0, -9.81)),
        ("rprrp", (1.0, 2.0)),
        ("rrprrrr", (3.0, -9.0)),
    )
}

EVERY_JOINT_EFFECT = {
    name: {p.name: 0.5 for p in effect.parameters}
    for name, effect in LIBRARY.items()
    if effect.scope == "joint" and name != "parallel_spring"
}


def loaded(arm: Arm) -> Arm:
    """The arm with every effect of the library somewhere."""
    everything = {"gravity": {"gx": 0.1, "gy": 0.2}, "payload": {"mass": 1.0, "time": 0.0}}
    first, *others = arm.joints
    coupled = {
        "coupled_friction": {"torque": 0.2},
        "coupled_gear": {"coulomb": 0.1, "viscous": 0.2, "inertia": 0.05, "ratio": -1.0},
    }
    effects = EVERY_JOINT_EFFECT | (coupled if others else {})
    return replace(arm, joints=(replace(first, effects=effects), *others), effects=everything)
