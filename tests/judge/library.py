"""Effects of the library, each in the library's own form or one that these recordings cannot tell from it."""

from __future__ import annotations

from functools import partial

import numpy as np

from runtime.arrays import Array

from . import space
from .bodies import in_space
from .hidden import POSITION, Hidden, Rows, Setup, at, entry, more, same

UPRIGHT = (0.0, -9.81)  # m/s^2

# friction ------------------------------------------------------------------------------------------------------------


@entry("coulomb")
def _(s: Setup) -> Hidden:
    put = at(s.joint, DRY_POSITIVE=same, DRY_NEGATIVE=same)
    believed = ("viscous", "viscous_cubic")
    return Hidden("coulomb", 0.2, (0.005, 3.0), put, accept=("coulomb_asymmetric",), believed=believed)


@entry("viscous")
def _(s: Setup) -> Hidden:
    put = at(s.joint, VISCOUS_POSITIVE=same, VISCOUS_NEGATIVE=same)
    # A slope through zero is both sides of a bent line, and a power of one.
    also = ("viscous_asymmetric", "viscous_power")
    return Hidden("viscous", 0.2, (0.005, 3.0), put, accept=also, believed=("coulomb_asymmetric",))


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


def power(s: Setup, low: float, high: float) -> Hidden:
    put = at(s.joint, POWER=same, POWER_EXPONENT=s.rng.uniform(low, high))
    return Hidden("viscous_power", 0.5, (0.005, 12.0), put)


@entry("viscous_power")
def _(s: Setup) -> Hidden:
    return power(s, 0.35, 0.6)


@entry("quadratic_drag")
def _(s: Setup) -> Hidden:
    return power(s, 1.999, 2.001)


def stribeck(s: Setup, form: float) -> Hidden:
    put = at(s.joint, CREEP=same, CREEP_SPEED=s.rng.uniform(0.08, 0.3), CREEP_FORM=form)
    return Hidden("stribeck", 0.3, (0.005, 4.0), put)


entry("stribeck")(partial(stribeck, form=0.0))


@entry("load_friction")
def _(s: Setup) -> Hidden:
    return Hidden("load_friction", 0.06, (0.001, 0.4), at(s.joint, LOAD=same))


def patch(s: Setup, edge: float) -> Hidden:
    start, wide = s.within(0.1, 0.7), (s.reach[1] - s.reach[0]) * s.rng.uniform(0.1, 0.3)
    put = at(s.joint, PATCH=same, PATCH_START=start, PATCH_END=start + wide, PATCH_EDGE=edge * wide)
    return Hidden("friction_patch", 0.3, (0.005, 5.0), put)


@entry("load_friction_upright", gravity=UPRIGHT)
def _(s: Setup) -> Hidden:
    """Gravity is in the model file, and most of the load."""
    return Hidden("load_friction", 0.06, (0.001, 0.4), at(s.joint, LOAD=same))


entry("friction_patch")(partial(patch, edge=0.0))


def bristle(s: Setup, form: float) -> Hidden:
    inertia = s.bodies[s.joint].rotor + s.link_inertia
    put = at(s.joint, BRISTLE=same, BRISTLE_DAMPING=lambda k: 0.3 * np.sqrt(k * inertia), BRISTLE_FORM=form)
    # Stiffer bristles than those of real gears differ from dry friction for a millisecond at each reversal only.
    stiffest = float(np.exp(s.rng.uniform(np.log(400.0), np.log(5000.0))))
    return Hidden("lugre", 300.0, (8.0, stiffest), put, power=-1.0, rivals=("spring_hysteresis",))


entry("lugre")(partial(bristle, form=0.0))


def thermal(s: Setup, exponential: bool) -> Hidden:
    dry = 0.0 if exponential else s.rng.uniform(0.6, 1.0)
    put = at(s.joint, WARM_DRY=lambda a: -a * dry, WARM_VISCOUS=lambda a: -a, WARM_EXPONENTIAL=float(exponential))
    return Hidden("thermal_friction", 0.15, (0.003, 0.9), put, warms=True)


entry("thermal_friction")(partial(thermal, exponential=False))


def coupled(s: Setup, creep: float) -> Hidden:
    put = at(s.joint, COUPLED=same, COUPLED_CREEP=creep, COUPLED_SPEED=0.3)
    return Hidden("coupled_friction", 0.2, (0.005, 2.0), put)


@entry("coupled_friction", least_joints=2, not_last=True)
def _(s: Setup) -> Hidden:
    return coupled(s, 0.0)


@entry("coupled_gear", least_joints=2, not_last=True)
def _(s: Setup) -> Hidden:
    """The motor of a wrist, on the sum or the difference of two rates; a planar arm's inertias take its own."""
    ratio = float(s.rng.choice([-1.0, 1.0]) * s.rng.choice([1.0, s.rng.uniform(0.4, 0.8)]))
    wet, inertia = s.rng.uniform(0.3, 0.9), 0.3 * s.bodies[s.joint + 1].rotor
    put = at(s.joint, GEAR_DRY=same, GEAR_VISCOUS=lambda a: wet * a, GEAR_INERTIA=inertia, GEAR_RATIO=ratio)
    return Hidden("coupled_gear", 0.2, (0.005, 2.0), put, rivals=("coupled_friction",) if ratio == 1.0 else ())


# torques over the position -------------------------------------------------------------------------------------------


@entry("linear_spring")
def _(s: Setup) -> Hidden:
    put = at(s.joint, SPRING=same, SPRING_REST=s.rng.uniform(-0.3, 0.3))
    return Hidden("linear_spring", 0.3, (0.005, 20.0), put, rivals=POSITION)


def one_sided(s: Setup, soft: float) -> Hidden:
    first = s.rng.uniform(0.0, 0.2)
    put = at(s.joint, PULL=same, PULL_FROM=s.within(0.35, 0.75), PULL_FIRST=lambda a: first * a, PULL_SOFT=soft)
    return Hidden("parallel_spring", 0.8, (0.01, 30.0), put, rivals=POSITION)


entry("parallel_spring")(partial(one_sided, soft=0.0))


@entry("cable")
def _(s: Setup) -> Hidden:
    square, phase = s.rng.uniform(-1.0, 1.0), s.rng.uniform(-1.0, 1.0)
    put = at(s.joint, CABLE_SQUARE=lambda a: a * square, CABLE_CUBE=same, SPRING=same, SPRING_REST=phase)
    return Hidden("cable", 0.3, (0.005, 20.0), put, rivals=POSITION)


def stop(s: Setup, exponent: float) -> Hidden:
    side = float(s.rng.choice([-1, 1]))
    place = s.within(0.78, 0.9) if side > 0 else s.within(0.1, 0.22)
    put = at(s.joint, STOP=same, STOP_AT=place, STOP_SIDE=side, STOP_EXPONENT=exponent, STOP_DAMPING=lambda a: 0.01 * a)
    return Hidden("end_stop", 8.0, (0.1, 3e3), put)


entry("end_stop")(partial(stop, exponent=1.0))


def hysteresis(s: Setup, form: float) -> Hidden:
    put = at(s.joint, HYSTERESIS=same, HYSTERESIS_WIDTH=s.rng.uniform(0.06, 0.3), HYSTERESIS_FORM=form)
    return Hidden("spring_hysteresis", 0.3, (0.005, 4.0), put, rivals=("lugre",))


entry("spring_hysteresis")(partial(hysteresis, form=0.0))


# drive and transmission ----------------------------------------------------------------------------------------------


def ripple(s: Setup, second: float, *turns: float) -> Hidden:
    """turns: orders per turn of the joint, one of which is drawn; without them once or twice a turn of the motor."""
    order = float(s.rng.choice(turns or (s.ratio, 2.0 * s.ratio)))
    put = at(s.joint, RIPPLE=same, RIPPLE_ORDER=order, RIPPLE_PHASE=s.rng.uniform(0, 6), RIPPLE_SECOND=second)
    orders = (order / s.ratio, 2.0 * order / s.ratio) if second else (order / s.ratio,)
    return Hidden("torque_ripple", 0.2, (0.005, 3.0), put, orders=orders)


entry("torque_ripple")(partial(ripple, second=0.0))


@entry("ripple_direct", gear_ratio=1.0)
def _(s: Setup) -> Hidden:
    """Cogging of a motor without a gear: slots and poles."""
    return ripple(s, 0.0, 18.0, 72.0, 144.0)


@entry("ripple_geared", gear_ratio=30.0)
def _(s: Setup) -> Hidden:
    """Of the gear's teeth and not of the motor: no whole number of its turns."""
    return ripple(s, 0.0, 200.0)


@entry("ripple_lines", gear_ratio=1.0)
def _(s: Setup) -> Hidden:
    """Three lines at once, one half and one a third as large as the first."""
    a, b, c = (float(x) for x in s.rng.permutation([18.0, 72.0, 144.0]))
    phase = s.rng.uniform(0, 6, 3)
    put = at(
        s.joint,
        RIPPLE=same,
        RIPPLE_ORDER=a,
        RIPPLE_PHASE=phase[0],
        LINE_B=lambda x: x / 2,
        LINE_B_ORDER=b,
        LINE_B_PHASE=phase[1],
        LINE_C=lambda x: x / 3,
        LINE_C_ORDER=c,
        LINE_C_PHASE=phase[2],
    )
    return Hidden("torque_ripple", 0.2, (0.005, 3.0), put, orders=(a / s.ratio, b / s.ratio, c / s.ratio))


def limit(s: Setup, form: float) -> Hidden:
    return Hidden("torque_saturation", 25.0, (2.0, 500.0), at(s.joint, LIMIT=same, LIMIT_FORM=form), power=-2.0)


entry("torque_saturation")(partial(limit, form=4.0))


@entry("torque_scale", least_joints=2)
def _(s: Setup) -> Hidden:
    return Hidden("torque_scale", 0.1, (0.001, 0.6), at(s.joint, GAIN=lambda a: 1.0 / (1.0 + a)))


@entry("torque_delay")
def _(s: Setup) -> Hidden:
    return Hidden("torque_delay", 1e-3, (5e-5, 2e-2), at(s.joint, DELAY=same), rivals=("elasticity", "torque_lag"))


@entry("delay_of_samples")
def _(s: Setup) -> Hidden:
    """2 to 3.5 steps of the recording, as bus cycles make it; no more than the controller bears."""
    late = min(float(s.rng.uniform(2.0, 3.5)) * s.step, 0.012)
    return Hidden("torque_delay", late, (late, late), at(s.joint, DELAY=same), rivals=("elasticity", "torque_lag"))


def spring(s: Setup, hardening: float) -> Hidden:
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
    return spring(s, 0.0)


def gap(s: Setup, exponent: float) -> Hidden:
    stiffness = 2.5e5 * s.link_inertia
    damping = 0.2 * np.sqrt(stiffness * s.link_inertia)
    flank = {"STIFFNESS": stiffness, "STIFFNESS_DAMPING": damping, "GAP_EXPONENT": exponent, "GAP_DEPTH": 1e-4}
    return Hidden("backlash", 2e-3, (1e-5, 0.1), at(s.joint, GAP=same, **flank))


@entry("backlash")
def _(s: Setup) -> Hidden:
    return gap(s, 1.0)


# the arm -------------------------------------------------------------------------------------------------------------


@entry("gravity")
def _(s: Setup) -> Hidden:
    angle = s.rng.uniform(0, 2 * np.pi)

    def put(_rows: Rows, arm: dict[str, float], amount: float) -> None:
        arm["GRAVITY_X"] = arm.get("GRAVITY_X", 0.0) + amount * np.cos(angle)
        arm["GRAVITY_Y"] = arm.get("GRAVITY_Y", 0.0) + amount * np.sin(angle)

    return Hidden("gravity", 0.2, (1e-3, 9.81), put, rivals=POSITION, of_arm=True)


@entry("gravity_left_out", gravity=UPRIGHT)
def _(_s: Setup) -> Hidden:
    """An arm in the upright plane, and a model file of one that lies."""

    def put(_rows: Rows, _arm: dict[str, float], _amount: float) -> None:
        """It is in the plant already."""

    return Hidden("gravity", 9.81, (9.81, 9.81), put, rivals=POSITION, of_arm=True, left_out=True)


def _centre(s: Setup) -> list[float]:
    """Of a payload in space, some cm off the tip, in base axes where q = 0; nothing in the plane."""
    if not in_space(s.bodies):
        return []
    off: Array = s.bodies[-1].axes @ (s.rng.uniform(-0.08, 0.08, 3) + np.array([0.0, 0.0, 0.06]))
    return [float(x) for x in space.tip(s.bodies) + off]


def carried(s: Setup, ahead: float, radius: float) -> Hidden:
    time = s.rng.uniform(0.4, 0.65) * s.seconds
    place = dict(zip(("PAYLOAD_X", "PAYLOAD_Y", "PAYLOAD_Z"), _centre(s), strict=False))

    def put(_rows: Rows, arm: dict[str, float], amount: float) -> None:
        arm.update(PAYLOAD=amount, PAYLOAD_TIME=time, PAYLOAD_AHEAD=ahead, PAYLOAD_RADIUS=radius, **place)

    return Hidden("payload", 0.1, (1e-3, 3.0), put, of_arm=True)


@entry("payload")
def _(s: Setup) -> Hidden:
    return carried(s, 0.0, 0.0)
