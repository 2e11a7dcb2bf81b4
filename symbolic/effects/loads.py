"""Loads of the whole arm, and what acts between two of its links."""

from __future__ import annotations

from math import inf

import sympy as sp

from symbolic import units as u
from symbolic.described import KnownSize
from symbolic.effects.declaration import SIGNAL, Effect, Grid, LinearForm, Parameter, parameter
from symbolic.effects.signals import OFF_TIP
from symbolic.elements import CoupledDrive, TiltedGravity, TipMass
from symbolic.primitives import WIDTH_RATE, WIDTH_TIME, sgn, step

QD, QDD, ELAPSED = (SIGNAL[name].symbol for name in ("qd", "qdd", "elapsed"))
NEXT, PREVIOUS, HAS_NEXT = SIGNAL["qd_next"].symbol, SIGNAL["qd_previous"].symbol, SIGNAL["has_next"].symbol
TIP_LOAD = SIGNAL["tip_load"].symbol
NEXT_ACCELERATION, PREVIOUS_ACCELERATION = (SIGNAL[name].symbol for name in ("qdd_next", "qdd_previous"))
MOMENT_X, MOMENT_Y, MOMENT_Z = (SIGNAL[f"moment_{axis}"].symbol for axis in "xyz")

TWICE_G = (-2 * 9.81, 2 * 9.81)
_ACCELERATION = u.METRE / u.SECOND**2

_BEYOND = "of gravity along base {}, beyond the model file's"

GRAVITY = Effect(
    name="gravity",
    scope="arm",
    family="load",
    torque=-(parameter("gx") * MOMENT_X + parameter("gy") * MOMENT_Y + parameter("gz") * MOMENT_Z),
    parameters=(
        # A model file that has the whole of it in the wrong direction lacks twice as much.
        Parameter("gx", _ACCELERATION, _BEYOND.format("x"), bounds=TWICE_G, abroad="gravity x"),
        Parameter("gy", _ACCELERATION, _BEYOND.format("y"), bounds=TWICE_G, abroad="gravity y"),
        Parameter("gz", _ACCELERATION, _BEYOND.format("z"), bounds=TWICE_G, abroad="gravity z", space=True),
    ),
    carried=True,
    known_size=KnownSize("gravity", 9.81),
    elements=(TiltedGravity(*(parameter(f"g{axis}") for axis in "xyz")),),
    summary="Gravity that the model leaves out, or a base that is not level.",
    equation="-(g_x dm_x/dq + g_y dm_y/dq), in space g_z dm_z/dq too, m the arm's first mass moment",
    trace="Torques that depend on posture as a constant acceleration in one direction does, at all joints.",
    experiment="Slow motion of every joint over two radians of range.",
    source="Spong & Vidyasagar 1989, Robot Dynamics and Control",
)

_MASS, _TIME = parameter("mass"), parameter("time")
_CENTRE = {axis: parameter(axis) for axis in "xyz"}
_THERE = step(ELAPSED - _TIME, WIDTH_TIME)
_TIP_LOADS = {part: SIGNAL[f"tip_load_{part}"].symbol for part in OFF_TIP}
_OFF_TIP = {part: sp.Mul(*(_CENTRE[axis] for axis in part)) for part in OFF_TIP}
_MOMENTS = {part: parameter(f"moment_{part}") for part in OFF_TIP}
# kg, far below any identifiable mass: keeps the centre finite where the mass is zero.
_WEIGHTLESS = sp.Rational(1, 10**9)


def _moment(part: str) -> Parameter:
    bounds = (0.0, inf) if part in ("xx", "yy", "zz") else (-inf, inf)
    meaning = f"of the payload's mass by {' '.join(part)} in the tip's frame"
    return Parameter(f"moment_{part}", u.KILOGRAM * u.METRE ** len(part), meaning, bounds=bounds, space=True)


_KILOGRAMS = Parameter("mass", u.KILOGRAM, "a point at the end-effector", bounds=(0.0, inf))

PAYLOAD = Effect(
    name="payload",
    scope="arm",
    family="load",
    torque=_MASS * _THERE * (TIP_LOAD + sum(_OFF_TIP[part] * _TIP_LOADS[part] for part in OFF_TIP)),
    parameters=(
        _KILOGRAMS,
        Parameter(
            "time",
            u.SECOND,
            "since the recording began, its runs one after another, when it is picked up",
            "shape",
            grid=Grid(-0.05, 0.95, 26, of="elapsed", spacing="linear"),
            kind="onset",
        ),
        *(Parameter(axis, u.METRE, f"of its centre along the tip frame's {axis}", space=True) for axis in "xyz"),
    ),
    form=LinearForm(
        coefficients=(_KILOGRAMS, *map(_moment, OFF_TIP)),
        torque=_THERE * (_MASS * TIP_LOAD + sum(_MOMENTS[part] * _TIP_LOADS[part] for part in OFF_TIP)),
        from_parameters=(_MASS, *(_MASS * _OFF_TIP[part] for part in OFF_TIP)),
        recover=(_MASS, *(_MASS * _MOMENTS[axis] / (_MASS**2 + _WEIGHTLESS**2) for axis in "xyz")),
    ),
    carried=True,
    elements=(TipMass(_MASS, _TIME, *_CENTRE.values()),),
    summary="A mass at the end-effector that the model does not know, from a moment on.",
    equation="m tau_tip(q, qd, qdd) for t > t_0, tau_tip the torque of a unit mass at the end-effector, in space at "
    "(x, y, z) from it",
    trace="From one time on, residuals at all joints as a mass at the end-effector causes them.",
    experiment="Accelerations of several joints before and after the mass is picked up.",
    source="Khalil, Gautier & Lemoine 2007, Identification of the payload inertial parameters of industrial "
    "manipulators, ICRA",
)

# The rate of link i+1 relative to link i-1 is the sum of the rates of the two joints between them.
_RELATIVE = QD + HAS_NEXT * NEXT + (1 - HAS_NEXT) * PREVIOUS

COUPLED_FRICTION = Effect(
    name="coupled_friction",
    scope="joints",
    family="load",
    torque=parameter("torque") * sgn(_RELATIVE, WIDTH_RATE),
    parameters=(Parameter("torque", u.FORCE, "friction torque on the relative rate", bounds=(0.0, inf)),),
    elements=(CoupledDrive(sp.S.One, parameter("torque"), sp.S.Zero, inertia=sp.S.Zero),),
    summary="Dry friction between two links that are not neighbours: a belt, cable or shaft that passes a joint.",
    equation="F sgn(qd_i + qd_(i+1)), on both joints",
    trace="Simultaneous steps at two joints when the sum of their rates changes sign.",
    experiment="Two joints that move together, in the same and in opposite directions, with separate reversals.",
    source="Janot, Vandanjon & Gautier 2014, A generic instrumental variable approach for industrial robot "
    "identification, IEEE Trans. Control Systems Technology 22(1), for the coupled wrist of the TX40",
    dissipates=True,
)

_RATIO = parameter("ratio")
# Of the motor, in motion of the first joint: both joints' places see the same motor.
_MOTOR_RATE = HAS_NEXT * (QD + _RATIO * NEXT) + (1 - HAS_NEXT) * (PREVIOUS + _RATIO * QD)
_MOTOR_ACCELERATION = HAS_NEXT * (QDD + _RATIO * NEXT_ACCELERATION) + (1 - HAS_NEXT) * (
    PREVIOUS_ACCELERATION + _RATIO * QDD
)
# What works on the motor's rate works on each joint by the part that the joint has in that rate.
_PART = HAS_NEXT + (1 - HAS_NEXT) * _RATIO

COUPLED_GEAR = Effect(
    name="coupled_gear",
    scope="joints",
    family="load",
    torque=_PART
    * (
        parameter("coulomb") * sgn(_MOTOR_RATE, WIDTH_RATE)
        + parameter("viscous") * _MOTOR_RATE
        + parameter("inertia") * _MOTOR_ACCELERATION
    ),
    parameters=(
        Parameter("coulomb", u.FORCE, "dry friction on the motor's rate, at the first joint", bounds=(0.0, inf)),
        Parameter("viscous", u.VISCOUS, "viscous friction on the motor's rate, at the first joint", bounds=(0.0, inf)),
        Parameter("inertia", u.INERTIA, "of what turns at the motor's rate, at the first joint", bounds=(0.0, inf)),
        Parameter(
            "ratio",
            u.ONE,
            "turns of the motor for a turn of the second joint over those for a turn of the first; 1 or -1 are tried",
            "shape",
            grid=Grid(-1.0, 1.0, 2, of="one", spacing="linear"),
        ),
    ),
    elements=(CoupledDrive(_RATIO, parameter("coulomb"), parameter("viscous"), parameter("inertia")),),
    summary="A motor that turns with two joints at once, as in wrists: its friction and inertia are felt at both.",
    equation="F sgn(w) + c w + I w_d,  w = qd_i + r qd_(i+1), on joint i; r times that on joint i+1",
    trace="Friction and inertia at two joints that follow the sum or difference of their rates.",
    experiment="Two joints that move together, in the same and in opposite directions, with separate reversals, slow "
    "and fast.",
    source="Janot, Vandanjon & Gautier 2014, A generic instrumental variable approach for industrial robot "
    "identification, IEEE Trans. Control Systems Technology 22(1): the wrist of the TX40; Gautier, Janot & Vandanjon "
    "2012, A new closed-loop output error method for parameter identification of robot dynamics, likewise 21(2)",
    # Of which the dry friction alone, on the sum of the rates, is the other effect.
    generalises=("coupled_friction",),
    sits_at="motor",
)

EFFECTS = (GRAVITY, PAYLOAD, COUPLED_FRICTION, COUPLED_GEAR)
