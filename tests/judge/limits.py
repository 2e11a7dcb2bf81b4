"""Are detection limits true? What a clean recording "would have seen" is hidden in it, a little beyond the limit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from .hidden import Hidden, Put, Rows, at, more, same

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


def put(limit: Mapping[str, Any]) -> Put | None:
    """How the plant is given an effect of the shape that its limit assumes, by its parameter; None: not told."""
    joint, shape = (limit["joint"] or 1) - 1, limit["with"]
    put = {
        "stribeck": lambda: at(joint, CREEP=same, CREEP_SPEED=shape["speed"]),
        "load_friction": lambda: at(joint, LOAD=same),
        "viscous_asymmetric": lambda: more(joint, VISCOUS_POSITIVE=1.0),
        "linear_spring": lambda: at(joint, SPRING=same, SPRING_REST=shape["rest"]),
        "torque_ripple": lambda: at(joint, RIPPLE=same, RIPPLE_ORDER=100 * shape["order"], RIPPLE_PHASE=shape["phase"]),
        "spring_hysteresis": lambda: at(joint, HYSTERESIS=same, HYSTERESIS_WIDTH=shape["width"]),
        "elasticity": lambda: at(joint, STIFFNESS=same, STIFFNESS_DAMPING=shape["damping"]),
        "payload": lambda: _payload(shape["time"]),
    }.get(limit["effect"])
    return None if put is None else put()


def _payload(time: float) -> Put:
    def put(_rows: Rows, arm: dict[str, float], amount: float) -> None:
        arm.update(PAYLOAD=amount, PAYLOAD_TIME=time)

    return put


def hidden(limit: Mapping[str, Any], times: float) -> tuple[Hidden, int, float] | None:
    """What to hide for an effect `times` as strong as its limit, for Bench.run; None for effects that `put` lacks."""
    how = put(limit)
    if how is None:
        return None
    amount = limit["above"] * times if "above" in limit else limit["below"] / times
    return Hidden(limit["effect"], amount, (0.0, np.inf), how), (limit["joint"] or 1) - 1, amount
