"""What a case can hide in an arm of MuJoCo's: effects of library.py by its mechanisms, and mechanisms of its own.

single   the library's law: a tendon with a slack side, a gap between two tendons' springs, a quadratic drag
forms    the library's effect by another law: joint limits (which hold an acceleration, not a torque), plastic springs,
         a drive's filter and its limit
unknown  the library has nothing like it: drag of a body in oil, a load that swings, a wall, a link that bends across
inside   the model's own parameters take it
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import forms, inside, outside  # noqa: F401 (forms and outside add their entries)
from .hidden import ENTRIES, POSITION, Entry, Hidden, Rows, Setup, at, same
from .space import tip

Draw = Callable[[Setup], Hidden]

SHARED = (
    *("coulomb", "viscous", "viscous_cubic", "stribeck", "load_friction", "load_friction_upright", "friction_patch"),
    *("coupled_friction", "coupled_gear", "linear_spring", "cable", "torque_ripple", "torque_scale"),
    *("delay_of_samples", "elasticity", "gravity", "gravity_left_out", "payload"),
    *("torque_saturation_hard", "torque_lag", "inside_scale", "inside_payload"),
    *("outside_sine", "outside_knocks", "outside_wander"),
)
"""Entries of the judge's own plant whose parameters MuJoCo has a mechanism for."""

MECHANISMS: dict[str, Entry] = {name: ENTRIES[name] for name in SHARED}

PAIRS = (
    ("elasticity", "torque_ripple"),
    ("stribeck", "linear_spring"),
    ("stribeck", "torque_ripple"),
    ("load_friction", "elasticity"),
    ("friction_patch", "stribeck"),
    ("linear_spring", "stop_tendon"),
    ("torque_lag", "load_friction"),
    ("payload", "stribeck"),
    ("gravity", "bristle"),
)


def mechanism(name: str, kind: str, least_joints: int = 1, most_joints: int = 7) -> Callable[[Draw], Draw]:
    def register(draw: Draw) -> Draw:
        MECHANISMS[name] = Entry(draw, kind, least_joints, most_joints=most_joints)
        return draw

    return register


@mechanism("bristle", "single")
def _(s: Setup) -> Hidden:
    """LuGre friction of a passive motor. Stiffer bristles than those of real gears, which give way by 0.3 to 3.5 mrad,
    differ from dry friction for a millisecond at each reversal only."""
    inertia = s.bodies[s.joint].rotor + s.link_inertia
    stiffest = float(np.mean(s.bodies[s.joint].dry) / np.exp(s.rng.uniform(np.log(3e-4), np.log(3.5e-3))))
    put = at(s.joint, BRISTLE=same, BRISTLE_DAMPING=lambda k: 0.3 * np.sqrt(k * inertia))
    return Hidden("lugre", 0.5 * stiffest, (0.01 * stiffest, stiffest), put, power=-1.0, rivals=("spring_hysteresis",))


@mechanism("soft_friction", "forms")
def _(s: Setup) -> Hidden:
    """MuJoCo's friction where nobody makes it stiff: it rises in proportion to the rate, up to its level."""
    inertia = s.bodies[s.joint].rotor + s.link_inertia
    level = float(np.mean(s.bodies[s.joint].dry))
    put = at(s.joint, SOFT=lambda a: 2.0 * a * inertia / level)
    return Hidden("velocity_strengthening", 0.1, (0.05, 0.6), put)


@mechanism("torque_lag", "forms")
def _(s: Setup) -> Hidden:
    """An actuator's own filter; a shorter one than a step of the recording is taken for the hold of the torque."""
    put = at(s.joint, LAG=same)
    return Hidden("torque_lag", s.step, (s.step, 0.02), put, accept=("torque_delay",), rivals=("elasticity",))


@mechanism("drives_late", "single", least_joints=4)
def _(s: Setup) -> Hidden:
    """All actuators' own delay, of some steps of the recording; the first half step is what any hold makes."""
    late = min(float(s.rng.uniform(2.0, 3.5)) * s.step, 0.008)  # more is not borne by all controllers at once
    return Hidden("command_delay", late, (late, late), _of_all("DELAY"), of_arm=True, rivals=("command_lag",))


@mechanism("drives_filtered", "single", least_joints=4)
def _(s: Setup) -> Hidden:
    """All actuators' own first-order filter; at low frequencies it is a delay."""
    lag = float(s.rng.uniform(0.004, 0.008))
    return Hidden("command_lag", lag, (lag, lag), _of_all("LAG"), of_arm=True, accept=("command_delay",))


@mechanism("pull_tendon", "single")
def _(s: Setup) -> Hidden:
    """A tendon that is slack on one side. Undamped, it is an end stop that is met early, too."""
    put = at(s.joint, PULL=same, PULL_FROM=s.within(0.35, 0.75))
    return Hidden("parallel_spring", 0.8, (0.01, 100.0), put, accept=("end_stop",), rivals=POSITION)


def _place_of_stop(s: Setup) -> tuple[float, float]:
    side = float(s.rng.choice([-1, 1]))
    return (s.within(0.78, 0.9) if side > 0 else s.within(0.1, 0.22)), side


@mechanism("stop_tendon", "single")
def _(s: Setup) -> Hidden:
    place, side = _place_of_stop(s)
    put = at(s.joint, STOP=same, STOP_AT=place, STOP_SIDE=side)
    return Hidden("end_stop", 8.0, (0.1, 3e3), put, accept=("parallel_spring",) if side < 0 else ())


@mechanism("stop_range", "forms")
def _(s: Setup) -> Hidden:
    """A joint's limit, by the acceleration per angle, 1/s^2, with which it returns whatever inertia is there."""
    place, side = _place_of_stop(s)
    return Hidden("end_stop", 1e3, (1.0, 1e5), at(s.joint, RANGE=same, RANGE_AT=place, RANGE_SIDE=side))


@mechanism("gap_tendon", "single")
def _(s: Setup) -> Hidden:
    stiffness = 2.5e5 * s.link_inertia
    flank = {"STIFFNESS": stiffness, "STIFFNESS_DAMPING": 0.2 * np.sqrt(stiffness * s.link_inertia)}
    return Hidden("backlash", 2e-3, (1e-5, 0.1), at(s.joint, GAP=same, **flank))


@mechanism("gap_range", "forms")
def _(s: Setup) -> Hidden:
    """A second hinge between two limits, which are met without rebound."""
    return Hidden("backlash", 2e-3, (1e-5, 0.1), at(s.joint, LOOSE=same))


@mechanism("plastic_spring", "forms")
def _(s: Setup) -> Hidden:
    """One spring that yields, where the library's hysteresis yields little by little."""
    put = at(s.joint, YIELD=same, YIELD_WIDTH=s.rng.uniform(0.06, 0.3))
    return Hidden("spring_hysteresis", 0.3, (0.005, 20.0), put, rivals=("lugre",))


@mechanism("oil", "single", most_joints=1)
def _(_s: Setup) -> Hidden:
    """One body in a dense medium: a torque with the square of the rate."""
    return Hidden("viscous_power", 1e3, (1.0, 1e6), _of_arm("DENSITY"))


@mechanism("oil_arm", "unknown", least_joints=4)
def _(_s: Setup) -> Hidden:
    """Each body's drag goes with its own motion through the medium, and passes through all joints before it."""
    return Hidden("", 1e3, (1.0, 1e6), _of_arm("DENSITY"), of_arm=True)


@mechanism("hanging_load", "unknown")
def _(s: Setup) -> Hidden:
    """A mass that swings at the tip by a hinge that nobody measures."""
    length = s.rng.uniform(0.1, 0.2)
    inertia = length**2
    stiffness = inertia * (2 * np.pi * s.rng.uniform(1.0, 2.0)) ** 2
    damping = 0.1 * np.sqrt(stiffness * inertia)

    def put(_rows: Rows, arm: dict[str, float], amount: float) -> None:
        springs = {"HANGING_STIFFNESS": amount * stiffness, "HANGING_DAMPING": amount * damping}
        arm.update(HANGING=amount, HANGING_LENGTH=length, **springs, **inside.at_tip(s))

    return Hidden("", 0.2, (1e-3, 10.0), put, of_arm=True)


@mechanism("wall", "unknown", least_joints=6)
def _(s: Setup) -> Hidden:
    """The tip runs into a soft wall, seen from the arm's foot, beyond where it is in five sixths of the time."""
    path = _path_of_tip(s)
    out = path - path.mean(axis=1, keepdims=True)
    normal = np.linalg.svd(out, full_matrices=False)[0][:, 0]
    beyond = np.quantile(normal @ path, 5 / 6)
    point = normal * beyond
    where = dict(zip(("WALL_X", "WALL_Y", "WALL_Z"), (-normal).tolist(), strict=True))
    where |= dict(zip(("WALL_AT_X", "WALL_AT_Y", "WALL_AT_Z"), point.tolist(), strict=True))

    def put(_rows: Rows, arm: dict[str, float], amount: float) -> None:
        arm.update(WALL=amount, **where, **inside.at_tip(s))

    return Hidden("", 1e3, (1.0, 1e5), put, of_arm=True)


@mechanism("link_bends", "unknown", least_joints=6)
def _(s: Setup) -> Hidden:
    """A link gives way across its joint's axis."""
    inertia = s.link_inertia
    damping = lambda k: 0.1 * np.sqrt(k * inertia)  # noqa: E731
    put = at(s.joint, BENDS=same, BENDS_DAMPING=damping)
    return Hidden("", 5e3, (20.0, 1e6), put, power=-1.0)


@mechanism("inside_friction", "inside")
def _(s: Setup) -> Hidden:
    more, wetter = s.rng.uniform(0.1, 0.6), s.rng.uniform(0.1, 0.6)

    def put(rows: Rows, _arm: dict[str, float], _amount: float) -> None:
        row = rows[s.joint]
        for side in ("POSITIVE", "NEGATIVE"):
            row[f"DRY_{side}"] *= 1 + more
            row[f"VISCOUS_{side}"] *= 1 + wetter

    return Hidden("", 1.0, (0.0, 1.0), put)


@mechanism("inside_armature", "inside")
def _(s: Setup) -> Hidden:
    right = s.bodies[s.joint].rotor
    return Hidden("", float(s.rng.uniform(0.4, 2.0)) * right, (0.0, 10.0), at(s.joint, ROTOR=same))


@mechanism("inside_mass", "inside")
def _(s: Setup) -> Hidden:
    return Hidden("", float(s.rng.choice([0.6, 1.5])), (0.0, 2.0), at(s.joint, HEAVIER=same))


def _of_all(name: str) -> Callable[[Rows, dict[str, float], float], None]:
    def put(rows: Rows, _arm: dict[str, float], amount: float) -> None:
        for row in rows:
            row[name] = amount

    return put


def _of_arm(name: str) -> Callable[[Rows, dict[str, float], float], None]:
    def put(_rows: Rows, arm: dict[str, float], amount: float) -> None:
        arm[name] = amount

    return put


def _path_of_tip(s: Setup) -> np.ndarray:
    """(3, M) m along the motion, in base axes."""
    angles = s.motion[0, :, ::50]
    place = np.tile(tip(s.bodies)[:, None], (1, angles.shape[1]))
    for body, angle in zip(reversed(s.bodies), reversed(angles), strict=True):
        axis, arm = body.axes[:, 2], place - body.point[:, None]
        along = axis[:, None] * (axis @ arm)
        across = np.cross(axis, arm, axisb=0, axisc=0)
        place = body.point[:, None] + along + np.cos(angle) * (arm - along) + np.sin(angle) * across
    return place
