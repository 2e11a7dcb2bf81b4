"""Are detection limits true? What a clean recording "would have seen" is hidden in it, a little beyond the limit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

BEYOND = 1.5
"""How far beyond its limit an effect is hidden."""


def _same(value: float) -> float:
    return value


AMOUNTS: dict[str, dict[str, Callable[[float], float]]] = {
    "stribeck": {"torque": _same},
    "viscous_power": {"torque": _same},
    "load_friction": {"coefficient": _same},
    "friction_patch": {"torque": _same},
    "lugre": {"stiffness": _same},
    "coupled_friction": {"torque": _same},
    "linear_spring": {"stiffness": _same},
    "parallel_spring": {"stiffness": _same},
    "end_stop": {"stiffness": _same},
    "spring_hysteresis": {"torque": _same},
    "torque_ripple": {"amplitude": _same},
    # L tanh(tau / L) lacks tau^3 / (3 L^2).
    "torque_saturation": {"coefficient": lambda c: float(np.sqrt(1 / (3 * c)))},
    "torque_delay": {"time": _same},
    "elasticity": {"stiffness": _same},
    "backlash": {"gap": _same},
    "payload": {"mass": _same},
}
"""Of effects of hidden.ENTRIES by the library's parameter: the plant's amount that is this value."""


def beyond(seen: Sequence[Mapping[str, Any]], effect: str, joint: int | None) -> float | None:
    """The plant's amount a little beyond the limit that `would_have_seen` gives for an effect; None without one."""
    for limit in seen:
        if limit["effect"] == effect and limit["joint"] == joint and limit["parameter"] in AMOUNTS[effect]:
            value = limit["above"] * BEYOND if "above" in limit else limit["below"] / BEYOND
            return AMOUNTS[effect][limit["parameter"]](value)
    return None
