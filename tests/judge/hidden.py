"""What a case can hide in the plant: each entry draws its shape at random and says how its amount enters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .bodies import BELIEVED, Body

Array = NDArray[np.float64]
Rows = list[dict[str, float]]
Put = Callable[[Rows, dict[str, float], float], None]
Push = Callable[[Array, float], Array]
"""(t (N,), amount) -> torque (N,) from outside at the hidden joint."""

POSITION = ("linear_spring", "gravity", "cable", "parallel_spring")
"""Torques over the position: a rival of these counts as right for another of them."""


@dataclass(frozen=True)
class Setup:
    """What an entry may know when it draws: the arm, the joint (0-based), the motion (3, n, N)."""

    bodies: Sequence[Body]
    joint: int
    motion: Array
    rng: np.random.Generator

    @property
    def seconds(self) -> float:
        return self.motion.shape[-1] * 1e-3

    @property
    def reach(self) -> Array:
        """Lowest and highest angle of the joint."""
        q = self.motion[0, self.joint]
        return np.array([q.min(), q.max()])

    def within(self, low: float, high: float) -> float:
        """An angle at a random place between two fractions of the range."""
        a, b = self.reach
        return float(a + (b - a) * self.rng.uniform(low, high))

    @property
    def link_inertia(self) -> float:
        """What hangs on the joint's transmission when the arm is stretched, kg m^2."""
        place, total = 0.0, 0.0
        for body in self.bodies[self.joint :]:
            total += body.inertia + body.mass * (place + body.com[0]) ** 2
            place += body.length
        return total


@dataclass(frozen=True)
class Hidden:
    """One hidden effect.

    truth     the library's name; "" for what no library has
    amount    where the search for a size begins; power: size goes about with amount**power
    limits    amounts that are still physics
    put       writes an amount into the plant's rows; push: or a torque from outside
    accept    further names that are as right, by algebra
    rivals    names that are right as rivals
    believed  effects of the user's model file, if the truth needs others than the usual
    """

    truth: str
    amount: float
    limits: tuple[float, float]
    put: Put | None = None
    push: Push | None = None
    power: float = 1.0
    accept: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()
    believed: tuple[str, ...] = BELIEVED
    of_arm: bool = False
    warms: bool = False


@dataclass(frozen=True)
class Entry:
    """An effect to hide: who can have it, in which class it is judged, and how it is drawn."""

    draw: Callable[[Setup], Hidden]
    kind: str = "single"
    least_joints: int = 1
    not_last: bool = False


ENTRIES: dict[str, Entry] = {}


def entry(name: str, kind: str = "single", least_joints: int = 1, not_last: bool = False) -> Callable[..., object]:
    def register(draw: Callable[[Setup], Hidden]) -> Callable[[Setup], Hidden]:
        ENTRIES[name] = Entry(draw, kind, least_joints, not_last)
        return draw

    return register


def at(joint: int, **values: Callable[[float], float] | float) -> Put:
    """Sets parameters of one joint: numbers, or functions of the amount."""

    def put(rows: Rows, _arm: dict[str, float], amount: float) -> None:
        rows[joint].update({k: float(v(amount)) if callable(v) else float(v) for k, v in values.items()})

    return put


def more(joint: int, **values: float) -> Put:
    """Adds amount times the number to parameters of one joint."""

    def put(rows: Rows, _arm: dict[str, float], amount: float) -> None:
        for key, value in values.items():
            rows[joint][key] = rows[joint].get(key, 0.0) + amount * value

    return put


def same(amount: float) -> float:
    return amount


# friction ------------------------------------------------------------------------------------------------------------


@entry("coulomb_asymmetric")
def _(s: Setup) -> Hidden:
    put = more(s.joint, DRY_POSITIVE=1.0, DRY_NEGATIVE=-1.0)
    believed = ("coulomb", "viscous", "viscous_cubic")
    return Hidden("coulomb_asymmetric", 0.1, (0.001, 0.6), put, accept=("offset",), believed=believed)


@entry("offset")
def _(s: Setup) -> Hidden:
    sign = s.rng.choice([-1.0, 1.0])
    put = at(s.joint, OFFSET=lambda a: a * sign)
    believed = ("coulomb", "viscous", "viscous_cubic")
    return Hidden("offset", 0.1, (0.001, 5.0), put, accept=("coulomb_asymmetric",), believed=believed)


@entry("viscous_asymmetric")
def _(s: Setup) -> Hidden:
    sign = s.rng.choice([-1.0, 1.0])
    put = more(s.joint, VISCOUS_POSITIVE=0.5 * sign, VISCOUS_NEGATIVE=-0.5 * sign)
    return Hidden("viscous_asymmetric", 0.2, (0.001, 1.1), put)


@entry("viscous_cubic")
def _(s: Setup) -> Hidden:
    put = at(s.joint, CUBIC=lambda a: -a)
    # A curve over the speed in a family of three members: a power and a creeping level bend as well.
    return Hidden(
        "viscous_cubic", 0.01, (1e-4, 0.03), put, rivals=("viscous_power",), believed=("coulomb_asymmetric", "viscous")
    )


def _power(s: Setup, low: float, high: float) -> Hidden:
    put = at(s.joint, POWER=same, POWER_EXPONENT=s.rng.uniform(low, high))
    return Hidden("viscous_power", 0.5, (0.005, 12.0), put)


@entry("viscous_power")
def _(s: Setup) -> Hidden:
    return _power(s, 0.35, 0.6)


@entry("quadratic_drag", "forms")
def _(s: Setup) -> Hidden:
    return _power(s, 1.999, 2.001)


def _stribeck(s: Setup, form: float) -> Hidden:
    put = at(s.joint, CREEP=same, CREEP_SPEED=s.rng.uniform(0.08, 0.3), CREEP_FORM=form)
    return Hidden("stribeck", 0.3, (0.005, 4.0), put)


@entry("stribeck")
def _(s: Setup) -> Hidden:
    return _stribeck(s, 0.0)


@entry("stribeck_lorentz", "forms")
def _(s: Setup) -> Hidden:
    return _stribeck(s, 1.0)


@entry("stribeck_exponential", "forms")
def _(s: Setup) -> Hidden:
    return _stribeck(s, 2.0)


@entry("load_friction")
def _(s: Setup) -> Hidden:
    return Hidden("load_friction", 0.06, (0.001, 0.4), at(s.joint, LOAD=same))


@entry("load_friction_square", "forms")
def _(s: Setup) -> Hidden:
    return Hidden("load_friction", 0.006, (1e-5, 0.08), at(s.joint, LOAD_SQUARE=same))


def _patch(s: Setup, edge: float) -> Hidden:
    start, wide = s.within(0.1, 0.7), (s.reach[1] - s.reach[0]) * s.rng.uniform(0.1, 0.3)
    put = at(s.joint, PATCH=same, PATCH_START=start, PATCH_END=start + wide, PATCH_EDGE=edge * wide)
    return Hidden("friction_patch", 0.3, (0.005, 5.0), put)


@entry("friction_patch")
def _(s: Setup) -> Hidden:
    return _patch(s, 0.0)


@entry("friction_patch_soft", "forms")
def _(s: Setup) -> Hidden:
    return _patch(s, 0.2)


def _bristle(s: Setup, form: float) -> Hidden:
    inertia = s.bodies[s.joint].rotor + s.link_inertia
    put = at(s.joint, BRISTLE=same, BRISTLE_DAMPING=lambda k: 0.3 * np.sqrt(k * inertia), BRISTLE_FORM=form)
    # Stiffer bristles than those of real gears differ from dry friction for a millisecond at each reversal only.
    stiffest = float(np.exp(s.rng.uniform(np.log(400.0), np.log(5000.0))))
    return Hidden("lugre", 300.0, (8.0, stiffest), put, power=-1.0, rivals=("spring_hysteresis",))


@entry("lugre")
def _(s: Setup) -> Hidden:
    return _bristle(s, 0.0)


@entry("lugre_maxwell", "forms")
def _(s: Setup) -> Hidden:
    return _bristle(s, 1.0)


def _thermal(s: Setup, exponential: bool) -> Hidden:
    dry = 0.0 if exponential else s.rng.uniform(0.6, 1.0)
    put = at(s.joint, WARM_DRY=lambda a: -a * dry, WARM_VISCOUS=lambda a: -a, WARM_EXPONENTIAL=float(exponential))
    return Hidden("thermal_friction", 0.15, (0.003, 0.9), put, warms=True)


@entry("thermal_friction")
def _(s: Setup) -> Hidden:
    return _thermal(s, False)


@entry("thermal_exponential", "forms")
def _(s: Setup) -> Hidden:
    return _thermal(s, True)


@entry("coupled_friction", least_joints=2, not_last=True)
def _(s: Setup) -> Hidden:
    return Hidden("coupled_friction", 0.2, (0.005, 2.0), at(s.joint, COUPLED=same))


# torques over the position -------------------------------------------------------------------------------------------


@entry("linear_spring")
def _(s: Setup) -> Hidden:
    put = at(s.joint, SPRING=same, SPRING_REST=s.rng.uniform(-0.3, 0.3))
    return Hidden("linear_spring", 0.3, (0.005, 20.0), put, rivals=POSITION)


@entry("parallel_spring")
def _(s: Setup) -> Hidden:
    first = s.rng.uniform(0.0, 0.2)
    put = at(s.joint, PULL=same, PULL_FROM=s.within(0.35, 0.75), PULL_FIRST=lambda a: first * a)
    return Hidden("parallel_spring", 0.8, (0.01, 30.0), put, rivals=POSITION)


@entry("cable")
def _(s: Setup) -> Hidden:
    square, phase = s.rng.uniform(-1.0, 1.0), s.rng.uniform(-1.0, 1.0)
    put = at(s.joint, CABLE_SQUARE=lambda a: a * square, CABLE_CUBE=same, SPRING=same, SPRING_REST=phase)
    return Hidden("cable", 0.3, (0.005, 20.0), put, rivals=POSITION)


@entry("cable_sine", "forms")
def _(s: Setup) -> Hidden:
    square = s.rng.choice([-1, 1]) * s.rng.uniform(0.5, 1.0)
    put = at(s.joint, CABLE_SINE=same, CABLE_PHASE=s.rng.uniform(-1, 1), CABLE_SQUARE=lambda a: a * square)
    return Hidden("cable", 0.3, (0.005, 20.0), put, rivals=POSITION)


def _stop(s: Setup, exponent: float) -> Hidden:
    side = float(s.rng.choice([-1, 1]))
    place = s.within(0.78, 0.9) if side > 0 else s.within(0.1, 0.22)
    put = at(s.joint, STOP=same, STOP_AT=place, STOP_SIDE=side, STOP_EXPONENT=exponent, STOP_DAMPING=lambda a: 0.01 * a)
    return Hidden("end_stop", 8.0, (0.1, 3e3), put)


@entry("end_stop")
def _(s: Setup) -> Hidden:
    return _stop(s, 1.0)


@entry("end_stop_hertz", "forms")
def _(s: Setup) -> Hidden:
    return _stop(s, 1.5)


def _hysteresis(s: Setup, form: float) -> Hidden:
    put = at(s.joint, HYSTERESIS=same, HYSTERESIS_WIDTH=s.rng.uniform(0.06, 0.3), HYSTERESIS_FORM=form)
    return Hidden("spring_hysteresis", 0.3, (0.005, 4.0), put, rivals=("lugre",))


@entry("spring_hysteresis")
def _(s: Setup) -> Hidden:
    return _hysteresis(s, 0.0)


@entry("spring_hysteresis_wen", "forms")
def _(s: Setup) -> Hidden:
    return _hysteresis(s, 1.0)


# drive and transmission ----------------------------------------------------------------------------------------------


def _ripple(s: Setup, second: float) -> Hidden:
    order = 100.0 * s.rng.choice([1.0, 2.0])
    put = at(s.joint, RIPPLE=same, RIPPLE_ORDER=order, RIPPLE_PHASE=s.rng.uniform(0, 6), RIPPLE_SECOND=second)
    return Hidden("torque_ripple", 0.2, (0.005, 3.0), put)


@entry("torque_ripple")
def _(s: Setup) -> Hidden:
    return _ripple(s, 0.0)


@entry("torque_ripple_second", "forms")
def _(s: Setup) -> Hidden:
    return _ripple(s, 0.5)


def _limit(s: Setup, form: float) -> Hidden:
    return Hidden("torque_saturation", 25.0, (2.0, 500.0), at(s.joint, LIMIT=same, LIMIT_FORM=form), power=-2.0)


@entry("torque_saturation")
def _(s: Setup) -> Hidden:
    return _limit(s, 1.0)


@entry("torque_saturation_algebraic", "forms")
def _(s: Setup) -> Hidden:
    return _limit(s, 2.0)


@entry("torque_saturation_hard", "forms")
def _(s: Setup) -> Hidden:
    return _limit(s, 3.0)


@entry("torque_scale", least_joints=2)
def _(s: Setup) -> Hidden:
    return Hidden("torque_scale", 0.1, (0.001, 0.6), at(s.joint, GAIN=lambda a: 1.0 / (1.0 + a)))


@entry("torque_delay")
def _(s: Setup) -> Hidden:
    return Hidden("torque_delay", 1e-3, (5e-5, 2e-2), at(s.joint, DELAY=same), rivals=("elasticity",))


@entry("torque_lag", "forms")
def _(s: Setup) -> Hidden:
    return Hidden("torque_delay", 1e-3, (5e-5, 2e-2), at(s.joint, LAG=same), rivals=("elasticity",))


def _spring(s: Setup, hardening: float) -> Hidden:
    inertia = s.link_inertia
    put = at(
        s.joint,
        STIFFNESS=same,
        STIFFNESS_DAMPING=lambda k: 0.06 * np.sqrt(k * inertia),
        HARDENING=lambda k: hardening * (k / 6.0) ** 2,
    )
    return Hidden("elasticity", 5e3, (150.0, 4e5), put, power=-1.0, rivals=("torque_delay",))


@entry("elasticity")
def _(s: Setup) -> Hidden:
    return _spring(s, 0.0)


@entry("elasticity_hardening", "forms")
def _(s: Setup) -> Hidden:
    return _spring(s, 1.0)


@entry("backlash")
def _(s: Setup) -> Hidden:
    stiffness = 2.5e5 * s.link_inertia
    put = at(s.joint, GAP=same, STIFFNESS=stiffness, STIFFNESS_DAMPING=0.2 * np.sqrt(stiffness * s.link_inertia))
    return Hidden("backlash", 2e-3, (1e-5, 0.1), put)


# the arm -------------------------------------------------------------------------------------------------------------


@entry("gravity")
def _(s: Setup) -> Hidden:
    angle = s.rng.uniform(0, 2 * np.pi)

    def put(_rows: Rows, arm: dict[str, float], amount: float) -> None:
        arm.update(GRAVITY_X=amount * np.cos(angle), GRAVITY_Y=amount * np.sin(angle))

    return Hidden("gravity", 0.2, (1e-3, 9.81), put, rivals=POSITION, of_arm=True)


@entry("payload")
def _(s: Setup) -> Hidden:
    time = s.rng.uniform(0.4, 0.65) * s.seconds

    def put(_rows: Rows, arm: dict[str, float], amount: float) -> None:
        arm.update(PAYLOAD=amount, PAYLOAD_TIME=time)

    return Hidden("payload", 0.1, (1e-3, 3.0), put, of_arm=True)


PAIRS = (
    ("elasticity", "torque_ripple"),
    ("backlash", "load_friction"),
    ("linear_spring", "end_stop"),
    ("thermal_friction", "parallel_spring"),
    ("stribeck", "linear_spring"),
    ("stribeck", "torque_ripple"),
    ("lugre", "gravity"),
    ("load_friction", "elasticity"),
    ("friction_patch", "stribeck"),
    ("viscous_asymmetric", "cable"),
    ("torque_saturation", "stribeck"),
    ("payload", "stribeck"),
)
