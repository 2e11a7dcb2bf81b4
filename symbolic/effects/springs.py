"""Torques of the position and of its history alone: springs, cables, stops, hysteresis."""

from __future__ import annotations

from functools import partial
from math import inf

import sympy as sp

from symbolic import units as u
from symbolic.effects.declaration import SIGNAL, Effect, Grid, LinearForm, Parameter, State, parameter, state
from symbolic.elements import (
    ConstantTorque,
    CurvedSpring,
    JointSpring,
    OneSidedDamper,
    OneSidedSpring,
    OneSidedTorque,
    YieldingSpring,
)
from symbolic.primitives import WIDTH_POSITION, ramp, step

Q, QD = SIGNAL["q"].symbol, SIGNAL["qd"].symbol
NOT_NEGATIVE = (0.0, inf)

_spring = partial(Effect, scope="joint", family="spring")

OFFSET = _spring(
    name="offset",
    torque=parameter("torque"),
    parameters=(Parameter("torque", u.FORCE, "constant part of the recorded torque"),),
    elements=(ConstantTorque(parameter("torque")),),
    summary="A constant torque: an amplifier's offset, a constant pull.",
    equation="tau_0",
    trace="The residual has a constant mean.",
    experiment="Motion in both directions over the same range.",
    source="Khalil & Dombre 2002, Modeling, Identification and Control of Robots",
    sits_at="link",
)

LINEAR_SPRING = _spring(
    name="linear_spring",
    torque=parameter("stiffness") * (Q - parameter("rest")),
    parameters=(
        Parameter("stiffness", u.STIFFNESS, "torque per displacement", bounds=NOT_NEGATIVE, abroad="stiffness"),
        Parameter("rest", u.POSITION, "position at which the spring is slack", abroad="rest"),
    ),
    form=LinearForm(
        coefficients=(
            Parameter("stiffness", u.STIFFNESS, "torque per displacement", bounds=NOT_NEGATIVE),
            Parameter("bias", u.FORCE, "the spring's torque at q = 0"),
        ),
        torque=parameter("stiffness") * Q + parameter("bias"),
        from_parameters=(parameter("stiffness"), -parameter("stiffness") * parameter("rest")),
        recover=(parameter("stiffness"), -parameter("bias") / parameter("stiffness")),
    ),
    elements=(JointSpring(parameter("stiffness"), parameter("rest")),),
    summary="A spring that pulls the joint to a rest position from both sides.",
    equation="k (q - q_0)",
    trace="Over the position, a straight line, the same in both directions and at every speed.",
    experiment="Slow motion in both directions over two radians of range or more.",
    source="Khalil & Dombre 2002, Modeling, Identification and Control of Robots",
    # A constant torque and a shift of the rest position are the same law.
    generalises=("offset",),
    carried=True,
    sits_at="link",
)

_LACKING = parameter("offset") - Q
_TAUT = step(_LACKING, WIDTH_POSITION)
_STRETCH = ramp(_LACKING, WIDTH_POSITION)

PARALLEL_SPRING = _spring(
    name="parallel_spring",
    torque=-(
        parameter("radius") ** 2 * parameter("stiffness") * _STRETCH
        + parameter("radius") * parameter("pretension") * _TAUT
    ),
    parameters=(
        Parameter(
            "stiffness",
            u.NEWTON / u.METRE,
            "of the extension spring, k_s",
            bounds=NOT_NEGATIVE,
            planned="size",
            scale=1000.0,
            says="",
        ),
        Parameter(
            "radius",
            u.METRE / u.POSITION,
            "of the pulley, r_p: cable per joint angle; where it is not known, 1, and stiffness and pretension then "
            "stand for the products with it",
            role="given",
            bounds=(0.0, inf),
            default=1.0,
        ),
        Parameter(
            "offset",
            u.POSITION,
            "position q_s0 below which the spring is taut",
            "shape",
            grid=Grid(0.25, 1, 13, of="position", spacing="linear"),
            planned="place",
            says="taut below",
        ),
        Parameter("pretension", u.NEWTON, "initial tension of the spring, F_s0", bounds=NOT_NEGATIVE),
    ),
    form=LinearForm(
        coefficients=(
            Parameter("joint_stiffness", u.STIFFNESS, "torque per displacement, r_p^2 k_s", bounds=NOT_NEGATIVE),
            Parameter("joint_pretension", u.FORCE, "torque at the offset, r_p F_s0", bounds=NOT_NEGATIVE),
        ),
        torque=-(parameter("joint_stiffness") * _STRETCH + parameter("joint_pretension") * _TAUT),
        from_parameters=(
            parameter("radius") ** 2 * parameter("stiffness"),
            parameter("radius") * parameter("pretension"),
        ),
        recover=(
            parameter("joint_stiffness") / parameter("radius") ** 2,
            parameter("joint_pretension") / parameter("radius"),
        ),
    ),
    elements=(
        OneSidedSpring(-sp.S.One, parameter("offset"), parameter("radius") ** 2 * parameter("stiffness")),
        OneSidedTorque(-sp.S.One, parameter("offset"), parameter("radius") * parameter("pretension")),
    ),
    summary="An extension spring on a pulley, parallel to the drive, that pulls on one side of an offset only.",
    equation="-(r_p^2 k_s (q_s0 - q) + r_p F_s0) for q < q_s0, else 0",
    trace="Over the position, a straight line below the offset, with a step there if pretensioned; zero above.",
    experiment="Slow motion in both directions, from a radian below the offset to a radian above it.",
    source="Equation (2) of the paper, with the motor's sign",
    carried=True,
    sits_at="link",
    brought=True,
)

CABLE = _spring(
    name="cable",
    torque=sum((parameter(f"c{k}") * Q**k for k in range(2, 5)), parameter("c1") * Q),
    parameters=tuple(
        Parameter(f"c{k}", u.FORCE / u.POSITION**k, f"torque per q^{k}" if k > 1 else "torque per q")
        for k in range(1, 5)
    ),
    # A polynomial: a dress pack bends and does not repeat with the turn, so harmonics of q have no meaning, and the
    # fourth degree is what the source found sufficient over a joint's range. Its constant is the effect `offset`.
    one_form=True,
    elements=(CurvedSpring(*(parameter(f"c{k}") for k in range(1, 5))),),
    summary="The pull of hoses and wires along the arm: a smooth curve over the position.",
    equation="c1 q + c2 q^2 + c3 q^3 + c4 q^4",
    trace="Over the position, a smooth curve, the same in both directions and at every speed.",
    experiment="Slow motion in both directions over the whole range.",
    source="Lin et al. 2019, A reliable gravity compensation control strategy for dVRK robotic arms with nonlinear "
    "disturbance forces, IEEE Robotics and Automation Letters 4(4)",
    carried=True,
    sits_at="link",
)

_SIDE = parameter("side")
_DEPTH = _SIDE * (Q - parameter("position"))

END_STOP = _spring(
    name="end_stop",
    torque=parameter("stiffness") * _SIDE * ramp(_DEPTH, WIDTH_POSITION)
    + parameter("damping") * QD * step(_DEPTH, WIDTH_POSITION),
    parameters=(
        # Nearer to the middle of the range, the law is that of a one-sided spring.
        Parameter(
            "position",
            u.POSITION,
            "where the stop is touched",
            "shape",
            grid=Grid(0, 0.4, 13, of="end", spacing="linear"),
        ),
        Parameter("stiffness", u.STIFFNESS, "of the stop", bounds=NOT_NEGATIVE, kind="contact"),
        Parameter("damping", u.VISCOUS, "of the stop while it is touched", bounds=NOT_NEGATIVE),
        Parameter(
            "side",
            u.ONE,
            "+1: stops motion to larger q, -1: to smaller q",
            role="shape",
            bounds=(-1.0, 1.0),
            grid=Grid(-1, 1, 2, spacing="linear"),
            kind="side",
        ),
    ),
    one_form=True,
    elements=(
        OneSidedSpring(_SIDE, parameter("position"), parameter("stiffness")),
        OneSidedDamper(_SIDE, parameter("position"), parameter("damping")),
    ),
    summary="A soft mechanical stop at one end of the range.",
    equation="k (q - q_e)+ + d qd in contact, mirrored for side = -1",
    trace="Over the position, zero up to a point near one end of the range, then a steep rise.",
    experiment="Slow motion up to the ends of the range.",
    source="Kelvin-Voigt contact: Gilardi & Sharf 2002, Literature survey of contact dynamics modelling, "
    "Mechanism and Machine Theory 37",
    carried=True,
    sits_at="link",
)

# Maxwell-slip elements in parallel: springs of one stiffness behind sliders that give way one after the other, the
# last at the width. With limits of 1, 3, 5, 7 sevenths of it their sum is a parabola to 1/64 of the torque.
_ELEMENTS = 4


def _limit(number: int) -> sp.Expr:
    return parameter("width") * sp.Rational(2 * number - 1, 2 * _ELEMENTS - 1)


def _held(number: int) -> sp.Expr:
    limit = _limit(number)
    free = state(f"element{number}") + Q - state("position")
    return free - ramp(free - limit, WIDTH_POSITION) + ramp(-free - limit, WIDTH_POSITION)


_HELD = tuple(_held(number) for number in range(1, _ELEMENTS + 1))
# The limits' sum is this part of N^2 widths.
_OF_ONE = parameter("torque") * sp.Rational(2 * _ELEMENTS - 1, _ELEMENTS**2) / parameter("width")

SPRING_HYSTERESIS = _spring(
    name="spring_hysteresis",
    torque=_OF_ONE * sum(_HELD, sp.S.Zero),
    parameters=(
        Parameter("torque", u.FORCE, "when all elements slide: half the height of the loop", bounds=NOT_NEGATIVE),
        Parameter(
            "width",
            u.POSITION,
            "displacement from rest after which all elements slide; after a reversal it takes twice that",
            role="shape",
            bounds=(0.0, inf),
            grid=Grid(1e-3, 0.5, 13, "range"),
        ),
    ),
    states=(
        *(
            State(f"element{number}", u.POSITION, f"deflection of element {number}", held)
            for number, held in enumerate(_HELD, 1)
        ),
        State("position", u.POSITION, "q of the last sample", Q, initial=Q),
    ),
    one_form=True,
    elements=tuple(YieldingSpring(_OF_ONE, _limit(number)) for number in range(1, _ELEMENTS + 1)),
    summary="A loop over the position, the same at any speed: inner friction of a flexspline, belt or cable.",
    equation="F sum_j z_j / sum_j w_j,  dz_j = dq while |z_j| < w_j, else held,  w_j = width (2 j - 1)/7,  j = 1..4",
    trace="After each reversal the residual follows the same parabola over twice the width, at any speed.",
    experiment="Slow reversals at several places and with several amplitudes, from a tenth of the width to several.",
    source="Tjahjowidodo, Al-Bender & Van Brussel 2013, Theoretical modelling and experimental identification of "
    "nonlinear torsional behaviour in harmonic drives, Mechatronics 23(5); Iwan 1966, A distributed-element model for "
    "hysteresis and its steady-state dynamic response, ASME J. Applied Mechanics 33(4)",
    sits_at="link",
)

EFFECTS = (OFFSET, LINEAR_SPRING, PARALLEL_SPRING, CABLE, END_STOP, SPRING_HYSTERESIS)
