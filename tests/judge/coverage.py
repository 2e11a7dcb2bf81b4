"""Whether reported 95 % intervals hold the true values, by families of parameters.

Only where the structure that was fitted is the plant's: nothing is hidden, or just what is hidden was named, in the
library's own form. A parameter without an interval makes no claim and is not counted. Not counted either is what an
equivalent parametrisation would give another value: a spring's rest beside two dry frictions, the inertias of an arm
with a coupled gear, a thermal friction (the plant's changes in proportion to each direction's own level), a hysteresis
(of other widths than the library's).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .bench import Setting
from .bodies import torque
from .cases import Made
from .hidden import Hidden
from .plant import PERIOD
from .recorder import held
from .truth import Parameters

FAMILIES = ("friction", "springs", "drive", "transmissions", "inertia")

Row = Mapping[str, float]
Values = dict[str, float]


@dataclass(frozen=True)
class Covered:
    """One interval that was reported, and the true value."""

    family: str
    parameter: str
    true: float
    low: float
    high: float

    @property
    def holds(self) -> bool:
        return self.low <= self.true <= self.high


def to_text(found: Sequence[Covered]) -> str:
    """For a cell of the judge's table."""
    return json.dumps([[float(f"{x:.6g}") if isinstance(x, float) else x for x in asdict(c).values()] for c in found])


def from_text(cell: str) -> list[Covered]:
    return [Covered(*values) for values in json.loads(cell or "[]")]


FAMILY: dict[str, tuple[str, Callable[[Row, Row], Values]]] = {
    "coulomb": ("friction", lambda p, _: {"torque": p["DRY_POSITIVE"]}),
    "viscous_asymmetric": (
        "friction",
        lambda p, _: {"positive": p["VISCOUS_POSITIVE"], "negative": p["VISCOUS_NEGATIVE"]},
    ),
    "viscous_power": (
        "friction",
        # Of friction in proportion to the speed it is the general law, whose torque the plant has elsewhere.
        lambda p, _: {"torque": p["POWER"], "exponent": p["POWER_EXPONENT"]} if "POWER" in p else {},
    ),
    "stribeck": ("friction", lambda p, _: {"torque": p["CREEP"], "speed": p["CREEP_SPEED"]}),
    "load_friction": ("friction", lambda p, _: {"coefficient": p["LOAD"]}),
    "friction_patch": (
        "friction",
        lambda p, _: {"torque": p["PATCH"], "start": p["PATCH_START"], "end": p["PATCH_END"]},
    ),
    "lugre": ("friction", lambda p, _: {"stiffness": p["BRISTLE"], "damping": p["BRISTLE_DAMPING"]}),
    "coupled_friction": ("friction", lambda p, _: {"torque": p["COUPLED"]}),
    "coupled_gear": (
        "friction",
        lambda p, _: {"coulomb": p["GEAR_DRY"], "viscous": p["GEAR_VISCOUS"], "ratio": p["GEAR_RATIO"]},
    ),
    "linear_spring": ("springs", lambda p, _: {"stiffness": p["SPRING"]}),
    "cable": ("springs", lambda p, _: {"c1": p["SPRING"], "c2": p["CABLE_SQUARE"], "c3": p["CABLE_CUBE"], "c4": 0.0}),
    "parallel_spring": (
        "springs",
        lambda p, found: {
            "stiffness": p["PULL"] / found["radius"] ** 2,
            "offset": p["PULL_FROM"],
            "pretension": p["PULL_FIRST"] / found["radius"],
        },
    ),
    "end_stop": (
        "springs",
        lambda p, _: {"position": p["STOP_AT"], "stiffness": p["STOP"], "damping": p["STOP_DAMPING"]},
    ),
    "torque_saturation": ("drive", lambda p, _: {"coefficient": 1 / (3 * p["LIMIT"] ** 2)}),
    "torque_scale": ("drive", lambda p, _: {"factor": 1 / p["GAIN"]}),
    "elasticity": ("transmissions", lambda p, _: {"stiffness": p["STIFFNESS"], "damping": p["STIFFNESS_DAMPING"]}),
    "backlash": (
        "transmissions",
        lambda p, _: {"gap": p["GAP"], "stiffness": p["STIFFNESS"], "damping": p["STIFFNESS_DAMPING"]},
    ),
}
"""Family and true values of an effect's parameters, by the plant's row of its joint and what was found."""


def covered(made: Made, document: Mapping[str, Any], lumps: Sequence[float] | None) -> list[Covered]:
    """Every interval of an identification's JSON whose true value is known.

    lumps   true base inertial parameters, None where they have no one value
    """
    found: list[Covered] = []
    if lumps is not None:
        for x, true in zip(document["inertial"], lumps, strict=True):
            _add(found, "inertia", x["name"], true, x["interval"])
    for effect in document["effects"]:
        name, values = effect["effect"], {k: x["value"] for k, x in effect["parameters"].items()}
        row = _complete(made.plant[(effect["joint"] or 1) - 1])
        family, known = _true(made, name, effect["joint"], row, values, document["skew"])
        for parameter, x in effect["parameters"].items():
            if parameter in known and not x.get("inseparable_from"):
                _add(found, family, f"{name} {parameter}", known[parameter], x["interval"])
    return found


def true_lumps(made: Made, regressor: Callable[..., Any]) -> list[float] | None:
    """Base inertial parameters of the true bodies, by a regressor of them; None where a hidden inertia adds to them."""
    if any(row.get("GEAR_INERTIA") for row in made.plant):
        return None
    bodies = made.parameters.bodies if made.parameters else made.bodies
    states = np.random.default_rng(0).uniform(-2.0, 2.0, (3, len(bodies), 40))
    columns = np.moveaxis(regressor(*states), 1, 0).reshape(-1, len(bodies) * 40)
    solved = np.linalg.lstsq(columns.T, torque(bodies, states, made.gravity).ravel(), rcond=None)[0]
    return [float(x) for x in solved]


def _complete(row: Row) -> Values:
    return {"GAIN": 1.0, "SPRING": 0.0, "CABLE_SQUARE": 0.0, "CABLE_CUBE": 0.0, **row}


def _true(
    made: Made, name: str, joint: int | None, row: Row, found: Row, skew: Mapping[str, Any]
) -> tuple[str, Values]:
    """Family and true values of one effect's parameters."""
    known: Parameters | None = made.parameters
    if known is not None:
        return "friction", {p: v for (e, j, p), v in known.friction.items() if (e, j) == (name, joint)}
    if name in ("coulomb_asymmetric", "viscous", "viscous_cubic", "offset"):
        return ("springs" if name == "offset" else "friction"), _base(name, made.hidden, row)
    if name == "torque_ripple":
        return "drive", _ripple(made.case.setting, row, found)
    if name == "torque_delay":
        logger = made.case.setting.logger
        hold, step = 0.5 * PERIOD * held(logger), PERIOD * logger.every
        return "drive", {} if skew["estimated"] else {"time": row["DELAY"] + hold - skew["value"] * step}
    if name == "gravity":
        gx, gy = made.gravity[:2]
        return "springs", {"gx": made.arm["GRAVITY_X"] - gx, "gy": made.arm["GRAVITY_Y"] - gy}
    if name == "payload":
        return "inertia", {"mass": made.arm["PAYLOAD"], "time": made.arm["PAYLOAD_TIME"]}
    family, values = FAMILY.get(name, ("", lambda *_: {}))
    return family, values(row, found)


def _base(name: str, hidden: Sequence[Hidden], row: Row) -> Values:
    """Of the frictions of the model file. A constant torque lies in two dry frictions; one spring has any rest."""
    if name == "viscous":
        uneven = row["VISCOUS_POSITIVE"] != row["VISCOUS_NEGATIVE"]
        return {} if uneven else {"coefficient": row["VISCOUS_POSITIVE"]}
    if name == "viscous_cubic":
        return {"coefficient": row["CUBIC"]}
    if any(h.truth == "linear_spring" for h in hidden):
        return {}
    constant = row.get("OFFSET", 0.0) - row["SPRING"] * row.get("SPRING_REST", 0.0)
    if name == "offset":
        return {"torque": constant + 0.5 * (row["DRY_POSITIVE"] - row["DRY_NEGATIVE"])}
    return {"positive": row["DRY_POSITIVE"] + constant, "negative": row["DRY_NEGATIVE"] - constant}


def _ripple(setting: Setting, row: Row, found: Row) -> Values:
    """The phase is the one of its turns that is nearest."""
    if row.get("LINE_B") or row.get("RIPPLE_SECOND"):
        return {}
    phase = row["RIPPLE_PHASE"] + 2 * np.pi * np.round((found.get("phase", 0.0) - row["RIPPLE_PHASE"]) / (2 * np.pi))
    return {"order": row["RIPPLE_ORDER"] / setting.gear_ratio, "amplitude": row["RIPPLE"], "phase": float(phase)}


def _add(found: list[Covered], family: str, parameter: str, true: float, interval: Sequence[float] | None) -> None:
    if interval is not None:
        found.append(Covered(family, parameter, float(true), float(interval[0]), float(interval[1])))
