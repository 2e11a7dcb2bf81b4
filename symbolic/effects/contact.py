"""The spring-loaded plate at the end-effector."""

from __future__ import annotations

from functools import partial
from math import inf

from symbolic import units as u
from symbolic.effects.declaration import SIGNAL, Effect, Grid, Parameter, parameter
from symbolic.primitives import WIDTH_POSITION, WIDTH_RATE, ramp, sgn, step

Y, YD, ROW, PLATE_Y = (SIGNAL[name].symbol for name in ("tip_y", "tip_yd", "tip_row", "plate_y"))
NOT_NEGATIVE = (0.0, inf)

_DEPTH = parameter("position") - Y

_contact = partial(Effect, scope="contact", family="contact")

PLATE = _contact(
    name="plate",
    # The plate's force stands on the other side of (1): minus J^T F.
    torque=-ROW
    * (
        parameter("stiffness") * ramp(_DEPTH, WIDTH_POSITION)
        + (parameter("pretension") - parameter("friction") * sgn(YD, WIDTH_RATE)) * step(_DEPTH, WIDTH_POSITION)
    ),
    parameters=(
        Parameter("stiffness", u.NEWTON / u.METRE, "of the plate's spring, k_p", bounds=NOT_NEGATIVE),
        Parameter("pretension", u.NEWTON, "force at first touch, F_p0", bounds=NOT_NEGATIVE),
        Parameter("friction", u.NEWTON, "dry friction of the plate's guide, F_pc", bounds=NOT_NEGATIVE),
        Parameter(
            "position",
            u.METRE,
            "base y of the plate when it is not touched, y_p",
            "shape",
            grid=Grid(0, 1, 48, of="tip", spacing="linear"),
            gives="plate_y",
        ),
    ),
    carried=True,
    summary="A plate on a spring that the end-effector presses down.",
    equation="-J_y^T F_p,  F_p = F_p0 + k_p (y_p - y) - F_pc sgn(yd) for y < y_p, else 0",
    trace="Zero at all joints until the end-effector passes one y, then proportional to dy/dq.",
    experiment="Press the plate slowly down and release it, starting well above it.",
    source="Equation (3) of the paper",
    brought=True,
)

PLATE_DAMPING = _contact(
    name="plate_damping",
    torque=ROW * parameter("coefficient") * YD * step(PLATE_Y - Y, WIDTH_POSITION),
    parameters=(
        Parameter("coefficient", u.NEWTON * u.SECOND / u.METRE, "force per speed of the plate", bounds=NOT_NEGATIVE),
    ),
    carried=True,
    summary="A damper beside the plate's spring; it needs the effect plate, whose position it shares.",
    equation="J_y^T c yd for y < y_p, else 0",
    trace="In contact, proportional to the end-effector's speed.",
    experiment="Press the plate down and up at several speeds.",
    source="Kelvin-Voigt contact: Gilardi & Sharf 2002, Literature survey of contact dynamics modelling, "
    "Mechanism and Machine Theory 37",
    dissipates=True,
    brought=True,
)

EFFECTS = (PLATE, PLATE_DAMPING)
