"""Friction: all that takes energy out of a joint, by its direction, rate, load, place and warmth."""

from __future__ import annotations

from functools import partial
from math import inf

import sympy as sp

from symbolic import units as u
from symbolic.effects.declaration import SIGNAL, Effect, Grid, Parameter, State, parameter, state
from symbolic.elements import (
    AbsoluteDamper,
    Bristles,
    ConstantTorque,
    CreepFriction,
    CubicDamper,
    Damper,
    DryFriction,
    LoadFriction,
    PowerDamper,
)
from symbolic.primitives import WIDTH_FORCE, WIDTH_POSITION, WIDTH_RATE, absolute, ramp, sgn, step

Q, QD, T = SIGNAL["q"].symbol, SIGNAL["qd"].symbol, SIGNAL["t"].symbol
LOAD, LEVEL = SIGNAL["load"].symbol, SIGNAL["level"].symbol
WARMTH, UNMEASURED = SIGNAL["warmth"].symbol, SIGNAL["unmeasured"].symbol
SIGN, SPEED = sgn(QD, WIDTH_RATE), absolute(QD, WIDTH_RATE)
NOT_NEGATIVE = (0.0, inf)

SURVEY = (
    "Armstrong-Hélouvry, Dupont & Canudas de Wit 1994, A survey of models, analysis tools and compensation methods "
    "for the control of machines with friction, Automatica 30(7)"
)
BOOK = "Armstrong-Hélouvry 1991, Control of Machines with Friction, Kluwer"

_friction = partial(Effect, scope="joint", family="friction")

COULOMB = _friction(
    name="coulomb",
    torque=parameter("torque") * SIGN,
    parameters=(
        Parameter(
            "torque", u.FORCE, "friction torque, the same in both directions", bounds=NOT_NEGATIVE, abroad="friction"
        ),
    ),
    elements=(DryFriction(parameter("torque")),),
    summary="Dry friction: constant, against the motion, whatever the speed.",
    equation="F sgn(qd)",
    trace="At every reversal, a step of the same height in both directions; constant in between.",
    experiment="Constant speeds in both directions; several speeds separate it from viscous friction.",
    source=SURVEY,
    dissipates=True,
    dry=True,
)

COULOMB_ASYMMETRIC = _friction(
    name="coulomb_asymmetric",
    torque=parameter("positive") * step(QD, WIDTH_RATE) - parameter("negative") * step(-QD, WIDTH_RATE),
    parameters=(
        Parameter("positive", u.FORCE, "friction torque while qd > 0", bounds=NOT_NEGATIVE, abroad="friction"),
        Parameter(
            "negative", u.FORCE, "friction torque, as a magnitude, while qd < 0", bounds=NOT_NEGATIVE, abroad="friction"
        ),
    ),
    # At rest any torque between the two levels: the symmetric friction about a constant one.
    elements=(
        DryFriction((parameter("positive") + parameter("negative")) / 2),
        ConstantTorque((parameter("positive") - parameter("negative")) / 2),
    ),
    summary="Dry friction of a different height in each direction.",
    equation="F+ for qd > 0, -F- for qd < 0",
    trace="At every reversal, a step between two levels of different magnitude.",
    experiment="Constant speeds in both directions, over the same part of the range.",
    source="Equation (4) of the paper; " + SURVEY,
    dissipates=True,
    generalises=("coulomb",),
    assumed=True,
    dry=True,
)

VISCOUS = _friction(
    name="viscous",
    torque=parameter("coefficient") * QD,
    parameters=(Parameter("coefficient", u.VISCOUS, "torque per rate", bounds=NOT_NEGATIVE, abroad="damping"),),
    elements=(Damper(parameter("coefficient")),),
    summary="Friction in proportion to the speed: lubricant, and the motor's back-EMF where it is not compensated.",
    equation="c qd",
    trace="Over the rate, a straight line through zero.",
    experiment="Several constant speeds, from a tenth of the largest to the largest.",
    source=SURVEY,
    dissipates=True,
    assumed=True,
)

VISCOUS_ASYMMETRIC = _friction(
    name="viscous_asymmetric",
    torque=parameter("positive") * ramp(QD, WIDTH_RATE) - parameter("negative") * ramp(-QD, WIDTH_RATE),
    parameters=(
        Parameter("positive", u.VISCOUS, "torque per rate while qd > 0", bounds=NOT_NEGATIVE, abroad="damping"),
        Parameter("negative", u.VISCOUS, "torque per rate while qd < 0", bounds=NOT_NEGATIVE, abroad="damping"),
    ),
    elements=(
        Damper((parameter("positive") + parameter("negative")) / 2),
        AbsoluteDamper((parameter("positive") - parameter("negative")) / 2),
    ),
    summary="Viscous friction with a different slope in each direction.",
    equation="c+ qd for qd > 0, c- qd for qd < 0",
    trace="Over the rate, two straight lines of different slope that meet at zero.",
    experiment="Several constant speeds, each in both directions over the same part of the range.",
    source=BOOK,
    dissipates=True,
    generalises=("viscous",),
)

VISCOUS_CUBIC = _friction(
    name="viscous_cubic",
    torque=parameter("coefficient") * QD**3,
    parameters=(
        Parameter(
            "coefficient",
            u.FORCE / u.RATE**3,
            "torque per cubed rate; negative where friction grows less than in proportion, and then valid only "
            "within the speeds at which it was identified",
        ),
    ),
    elements=(CubicDamper(parameter("coefficient")),),
    summary="The curvature of viscous friction over the speed, odd in the rate.",
    equation="c qd^3",
    trace="Over the rate, a cubic curve: close to zero at low speed, large near the highest speed.",
    experiment="Speeds up to the highest one in use; the slow ones determine the viscous part.",
    source="Equation (4) of the paper; Tuttle & Seering 1996, A nonlinear model of a harmonic drive gear transmission, "
    "IEEE Trans. Robotics and Automation 12(3)",
    friction=True,
)

# Far below any rate, level or resolution: what keeps a power and a quotient finite at 0, where another factor is 0.
_TINY = sp.Rational(1, 10**9)

VISCOUS_POWER = _friction(
    name="viscous_power",
    torque=parameter("torque") * (SPEED + _TINY) ** parameter("exponent") * SIGN,
    parameters=(
        Parameter("torque", u.FORCE, "torque at 1 rad/s (1 m/s)", bounds=NOT_NEGATIVE),
        Parameter(
            "exponent",
            u.ONE,
            "power of the speed: below 1 for a lubricant that thins with shear",
            role="shape",
            bounds=(0.0, 5.0),
            # In steps of 0.2 from 0.05, so that the exponent 1, which is viscous friction, is not on the grid.
            grid=Grid(0.05, 2.85, 15, spacing="linear"),
        ),
    ),
    elements=(PowerDamper(parameter("torque"), parameter("exponent")),),
    summary="Friction that grows with a power of the speed other than the first.",
    equation="F |qd/(1 rad/s)|^p sgn(qd)",
    trace="Over the rate, steep at low speed and flat at high speed (p < 1), or the other way round (p > 1).",
    experiment="Speeds over two decades, spaced evenly on a logarithmic scale, in both directions.",
    source="Waiboer, Aarts & Jonker 2005, Velocity dependence of joint friction in robotic manipulators with gear "
    "transmissions, ECCOMAS Multibody Dynamics",
    dissipates=True,
)

# What is left of the friction at rest, of two opposite effects: a film lowers it, shear of the contacts raises it.
_CREEPING = sp.exp(-((QD / parameter("speed")) ** 2))

STRIBECK = _friction(
    name="stribeck",
    torque=parameter("torque") * _CREEPING * SIGN,
    parameters=(
        Parameter("torque", u.FORCE, "how much friction at the slowest motion exceeds Coulomb's", bounds=NOT_NEGATIVE),
        Parameter(
            "speed",
            u.RATE,
            "speed within which the excess falls to 1/e",
            role="shape",
            bounds=(0.0, inf),
            grid=Grid(0.003, 0.6, 18, "rate"),
        ),
    ),
    elements=(CreepFriction(parameter("torque"), parameter("speed")),),
    summary="Extra friction at creep that a lubricating film takes away as the speed rises.",
    equation="dF exp(-(qd/v_s)^2) sgn(qd)",
    trace="A narrow peak on both sides of zero rate with opposite signs; nothing at higher speed.",
    experiment="Constant speeds from a tenth of v_s to three times v_s in both directions, and some fast ones.",
    source=SURVEY,
    dissipates=True,
    dry=True,
)

VELOCITY_STRENGTHENING = _friction(
    name="velocity_strengthening",
    torque=parameter("torque") * (1 - _CREEPING) * SIGN,
    parameters=(
        Parameter("torque", u.FORCE, "rise of the friction from rest to its plateau", bounds=NOT_NEGATIVE),
        Parameter(
            "speed",
            u.RATE,
            "speed at which all but 1/e of the rise is there",
            role="shape",
            bounds=(0.0, inf),
            # Over most speeds it is a plateau: a longer rise is a curvature, of viscous_cubic and viscous_power.
            grid=Grid(0.003, 0.15, 14, "rate"),
        ),
    ),
    elements=(DryFriction(parameter("torque")), CreepFriction(-parameter("torque"), parameter("speed"))),
    summary="Friction that rises from rest to a plateau at a low speed, the opposite of Stribeck's.",
    equation="F (1 - exp(-(qd/v_s)^2)) sgn(qd)",
    trace="Over the rate, a notch on both sides of zero with opposite signs; a constant at higher speed.",
    experiment="Constant speeds from a tenth of v_s to three times v_s in both directions, and some fast ones.",
    source="Bar-Sinai, Spatschek, Brener & Bouchbinder 2014, On the velocity-strengthening behavior of dry friction, "
    "J. Geophysical Research: Solid Earth 119(3); for the exponential in the speed, Bo & Pavelescu 1982, The "
    "friction-speed relation and its influence on the critical velocity of stick-slip motion, Wear 82(3)",
    dissipates=True,
    dry=True,
    one_form=True,
)

LOAD_FRICTION = _friction(
    name="load_friction",
    torque=parameter("coefficient") * absolute(LOAD, WIDTH_FORCE) * SIGN,
    parameters=(Parameter("coefficient", u.ONE, "friction torque per transmitted torque", bounds=NOT_NEGATIVE),),
    elements=(LoadFriction(parameter("coefficient")),),
    summary="Gear friction in proportion to the torque that the gear transmits.",
    equation="mu |load| sgn(qd)",
    trace="At every reversal, a step whose height grows with the predicted load.",
    experiment="The same speeds under changing load: other postures, accelerations, or a mass at the end-effector.",
    source="Hamon, Gautier & Garrec 2010, Dynamic identification of robots with a dry friction model depending on load "
    "and velocity, IROS",
    dissipates=True,
)

FRICTION_PATCH = _friction(
    name="friction_patch",
    torque=parameter("torque")
    * step(Q - parameter("start"), WIDTH_POSITION)
    * step(parameter("end") - Q, WIDTH_POSITION)
    * SIGN,
    parameters=(
        Parameter("torque", u.FORCE, "additional friction torque within the patch", bounds=NOT_NEGATIVE),
        Parameter(
            "start",
            u.POSITION,
            "where the patch begins",
            "shape",
            grid=Grid(0, 1, 11, of="position", spacing="linear"),
            kind="begin",
        ),
        Parameter(
            "end",
            u.POSITION,
            "where the patch ends",
            "shape",
            grid=Grid(0, 1, 11, of="position", spacing="linear"),
            kind="end",
        ),
    ),
    one_form=True,
    summary="A stretch of the range with more friction: a worn or dirty place, a bent shaft, a tight seal.",
    equation="dF sgn(qd) for start < q < end, else 0",
    trace="Over the position, a rectangle whose sign is that of the motion.",
    experiment="The whole range at one constant speed, in both directions.",
    source=BOOK,
    dissipates=True,
)

# The bristle's torque z follows dz/dt = stiffness (qd - |qd| z/level): the LuGre model with the joint's own Coulomb
# level as g(qd).
_Z = state("bristle")
_LEVEL = LEVEL + _TINY
# Bent by the way since the last sample, over which they follow an exponential whatever the time it takes: the last
# sample's rate alone would bend them half a step late, which a fit takes for damping.
_WAY = Q - state("position")
_SLIDING = LEVEL * sgn(_WAY, WIDTH_POSITION)
_BENT = _SLIDING + (_Z - _SLIDING) * sp.exp(-parameter("stiffness") * absolute(_WAY, WIDTH_POSITION) / _LEVEL)

LUGRE = _friction(
    name="lugre",
    torque=_BENT - LEVEL * SIGN + parameter("damping") * (QD - SPEED * _BENT / _LEVEL),
    parameters=(
        Parameter(
            "stiffness",
            u.STIFFNESS,
            "of the bristles: torque per deflection before sliding",
            role="shape",
            bounds=NOT_NEGATIVE,
            grid=Grid(3.0, 1e4, 15, "level_per_range"),
            kind="stiffness",
        ),
        Parameter("damping", u.VISCOUS, "of the bristles while they deflect", bounds=NOT_NEGATIVE),
    ),
    states=(
        State(
            "bristle",
            u.FORCE,
            "torque of the bent bristles, between the two Coulomb levels",
            _BENT,
        ),
        State("position", u.POSITION, "q of the last sample", Q, initial=Q),
    ),
    one_form=True,
    elements=(Bristles(parameter("stiffness"), parameter("damping")),),
    summary="Presliding: after a reversal, dry friction builds up like a spring until it slides.",
    equation="z - F sgn(qd) + d (qd - |qd| z/F),  dz/dt = k (qd - |qd| z/F),  F the joint's Coulomb friction",
    trace="After each reversal, a decay over a fixed distance, at any speed.",
    experiment="Reversals with amplitudes from 1 to 300 mrad, slow enough to resolve the first microns of travel.",
    source="Canudas de Wit, Olsson, Åström & Lischinsky 1995, A new model for control of systems with friction, "
    "IEEE Trans. Automatic Control 40(3)",
    friction=True,
)

_WARMING = WARMTH + UNMEASURED * (1 - sp.exp(-T / parameter("time_constant")))

THERMAL_FRICTION = _friction(
    name="thermal_friction",
    torque=(parameter("coulomb") * SIGN + parameter("viscous") * QD) * _WARMING,
    parameters=(
        Parameter(
            "coulomb",
            u.FORCE / u.KELVIN,
            "change of dry friction per kelvin of warming; where no temperature is recorded, its whole change "
            "(the warming is then counted as 1 K in all)",
        ),
        Parameter("viscous", u.VISCOUS / u.KELVIN, "change of viscous friction, likewise"),
        Parameter(
            "time_constant",
            u.SECOND,
            "of the warming; without meaning where the temperature is recorded",
            role="shape",
            bounds=(0.0, inf),
            grid=Grid(0.03, 3.0, 8, "duration"),
        ),
    ),
    summary="Friction that changes as the drive warms up, mostly because grease thins.",
    equation="(a sgn(qd) + b qd) w,  w the recorded rise of temperature, else 1 - exp(-t/T)",
    trace="Friction at the same speed differs between the beginning and the end of the recording.",
    experiment="A long recording with the same slow and fast motion at its beginning and end, with temperature.",
    source="Bittencourt & Gunnarsson 2012, Static friction in a robot joint: modeling and identification of load and "
    "temperature effects, ASME J. Dynamic Systems, Measurement, and Control 134(5)",
    friction=True,
)

EFFECTS = (
    COULOMB,
    COULOMB_ASYMMETRIC,
    VISCOUS,
    VISCOUS_ASYMMETRIC,
    VISCOUS_CUBIC,
    VISCOUS_POWER,
    STRIBECK,
    VELOCITY_STRENGTHENING,
    LOAD_FRICTION,
    FRICTION_PATCH,
    LUGRE,
    THERMAL_FRICTION,
)
