"""What a file of your own effects imports; the guide of symbolic/ shows an example.

Called, `tendon.effects("stribeck")`, the module is the verb of this name, which it would otherwise hide.
"""

import sys
from types import ModuleType
from typing import Any

from runtime.notebook.generated import effects
from symbolic import elements, units
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
    "elements",
    "load_user_effects",
    "parameter",
    "ramp",
    "sgn",
    "state",
    "step",
    "units",
]


class _Verb(ModuleType):
    def __call__(self, *asked: Any, **named: Any) -> Any:
        return effects(*asked, **named)


sys.modules[__name__].__class__ = _Verb
