"""Loads of the whole arm, and what acts between two of its links."""

from __future__ import annotations

from math import inf

from symbolic import units as u
from symbolic.effects.declaration import SIGNAL, Effect, Grid, Parameter, parameter
from symbolic.primitives import WIDTH_RATE, WIDTH_TIME, sgn, step

QD, ELAPSED = SIGNAL["qd"].symbol, SIGNAL["elapsed"].symbol
NEXT, PREVIOUS, HAS_NEXT = SIGNAL["qd_next"].symbol, SIGNAL["qd_previous"].symbol, SIGNAL["has_next"].symbol
MOMENT_X, MOMENT_Y, TIP_LOAD = SIGNAL["moment_x"].symbol, SIGNAL["moment_y"].symbol, SIGNAL["tip_load"].symbol

GRAVITY = Effect(
    name="gravity",
    scope="arm",
    family="load",
    torque=-(parameter("gx") * MOMENT_X + parameter("gy") * MOMENT_Y),
    parameters=(
        Parameter("gx", u.METRE / u.SECOND**2, "acceleration of gravity along base x, beyond the model file's"),
        Parameter("gy", u.METRE / u.SECOND**2, "acceleration of gravity along base y, beyond the model file's"),
    ),
    summary="Gravity that the model leaves out, or a base that is not level.",
    equation="-(g_x dm_x/dq + g_y dm_y/dq), m the arm's first mass moment",
    trace="Over the postures, one direction in space explains the constant torques of all joints together.",
    experiment="Slow motion of every joint over two radians of range.",
    source="Spong & Vidyasagar 1989, Robot Dynamics and Control",
)

PAYLOAD = Effect(
    name="payload",
    scope="arm",
    family="load",
    torque=parameter("mass") * step(ELAPSED - parameter("time"), WIDTH_TIME) * TIP_LOAD,
    parameters=(
        Parameter("mass", u.KILOGRAM, "a point at the end-effector", bounds=(0.0, inf)),
        Parameter(
            "time",
            u.SECOND,
            "since the recording began, its runs one after another, when it is picked up",
            "shape",
            grid=Grid(-0.05, 0.95, 26, "elapsed", "linear"),
            kind="onset",
        ),
    ),
    summary="A mass at the end-effector that the model does not know, from a moment on.",
    equation="m tau_tip(q, qd, qdd) for t > t_0, tau_tip the torque of a unit mass at the end-effector",
    trace="From one moment on, residuals of all joints in the proportions of a mass at the end-effector.",
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
    summary="Dry friction between two links that are not neighbours: a belt, cable or shaft that passes a joint.",
    equation="F sgn(qd_i + qd_(i+1)), on both joints",
    trace="Two joints jump together where the sum of their rates changes its sign.",
    experiment="Two joints moving at once, in the same and in opposite directions, with different reversals.",
    source="Janot, Vandanjon & Gautier 2014, A generic instrumental variable approach for industrial robot "
    "identification, IEEE Trans. Control Systems Technology 22(1), for the coupled wrist of the TX40",
    dissipates=True,
)

EFFECTS = (GRAVITY, PAYLOAD, COUPLED_FRICTION)
