"""What a file of your own effects imports; the guide of symbolic/ shows an example."""

from symbolic import units
from symbolic.effects import load_user_effects
from symbolic.effects.declaration import DT, SIGNAL, Effect, Grid, LinearForm, Parameter, State, parameter, state
from symbolic.primitives import WIDTH_FORCE, WIDTH_POSITION, WIDTH_RATE, WIDTH_TIME, absolute, ramp, sgn, step

__all__ = [
    "DT",
    "SIGNAL",
    "WIDTH_FORCE",
    "WIDTH_POSITION",
    "WIDTH_RATE",
    "WIDTH_TIME",
    "Effect",
    "Grid",
    "LinearForm",
    "Parameter",
    "State",
    "absolute",
    "load_user_effects",
    "parameter",
    "ramp",
    "sgn",
    "state",
    "step",
    "units",
]
