"""Inertias that come out as the model file's times a factor that a mistake explains, which no fit of torques can tell.

An inertia, and a friction, that are all too small by one factor fit as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, log, prod

import numpy as np
from numpy.typing import NDArray

from runtime.identification.identify import Identification
from runtime.identification.readings import DEGREE, Reading, turns
from runtime.identification.settings import FACTOR_OF_INERTIA, LEAST_TELLING_RATIO
from runtime.recordings.columns import UNITS, normal_unit

Array = NDArray[np.float64]


RATIO = "ratio"
"""The gear's, by which the motor's torque was not multiplied."""
DEGREES, MOTOR = "degrees", "motor"
"""What a position may be that covers many turns: in degrees, or the motor's before the gear."""


@dataclass(frozen=True)
class ByFactor:
    """Mistakes, together, that explain a joint's inertia, and it as fitted and as stated, kg m² (kg).

    kinds   any of "degrees"; "motor", the position before the gear; "milli", a torque or a current in thousandths;
            "current", which was read as a torque; and "ratio", of the gear, which is missing from the torque
    others  what explains it, too, in place of the first of the kinds
    """

    kinds: tuple[str, ...]
    fitted: float
    stated: float
    others: tuple[str, ...] = ()


_INSTEAD = (DEGREES, MOTOR, RATIO)
"""What alike makes an inertia too small, the likeliest first."""
_TOGETHER = (
    *((DEGREES,), (MOTOR,), ("milli",), (RATIO,), ("current",), ("current", "milli")),
    *((DEGREES, RATIO), (MOTOR, RATIO), (DEGREES, "milli"), (DEGREES, "current"), (MOTOR, "current")),
    *((DEGREES, "current", "milli"), (MOTOR, "current", "milli"), ("milli", RATIO), (DEGREES, MOTOR, RATIO)),
)
"""What is made wrong alone or together, the likeliest first."""


def found(
    identification: Identification, able: Sequence[int], lumps: Array, reading: Reading, least: float
) -> dict[int, ByFactor]:
    """Of joints (0-based) whose inertia is wrong by such a factor, what explains it.

    lumps   base inertial parameters as fitted      reading   what was put right before that
    least   ratio of an inertia to the file's from which it is told
    """
    model = identification.model
    if not model.lumps_known:
        return {}
    rest, result = np.zeros((model.n, 1)), {}
    fitted, stated = (np.diagonal(model.inertia(rest, x)[:, :, 0]) for x in (lumps, model.lump_values))
    for i in able:
        if not (isfinite(stated[i]) and fitted[i] > 0 and stated[i] > 0):
            continue
        sizes = _sizes(identification, i, reading)
        ratio = float(stated[i] / fitted[i])
        kinds, others = _explained(ratio, sizes, least)
        if kinds:
            result[i] = ByFactor(kinds, float(fitted[i]), float(stated[i]), others)
    return result


def _explained(ratio: float, sizes: Mapping[str, float], least: float) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Kinds of mistakes of these sizes that explain a ratio, and what may stand in the first one's place."""

    factors = {k: prod(sizes[kind] for kind in k) for k in _TOGETHER if sizes.keys() >= set(k)}
    off = {k: abs(log(ratio / factor)) for k, factor in factors.items() if abs(log(factor)) > log(least)}
    able = [k for k, distance in off.items() if distance < log(FACTOR_OF_INERTIA)]
    if not able or able[0][0] not in _INSTEAD:
        return (able[0] if able else ()), ()
    rest = able[0][1:]
    alike = [kinds for kinds in able if kinds[0] in _INSTEAD and kinds[1:] == rest]
    best = min(alike, key=lambda kinds: off[kinds])
    return best, tuple(kinds[0] for kinds in alike if kinds != best)


def _sizes(identification: Identification, joint: int, reading: Reading) -> dict[str, float]:
    """By what each mistake that may have been made at a joint (0-based) divides its inertia."""
    info, motion = identification.model.joints[joint], identification.motion
    sizes = {"milli": UNITS["mA"][1]}
    if info.gear_ratio > LEAST_TELLING_RATIO:
        sizes[RATIO] = info.gear_ratio
    if info.torque_constant is not None and f"tau{reading.torques[joint] + 1}" not in motion.units:
        sizes["current"] = info.torque_constant
    if turns(motion, reading.positions[joint]) > 1 and info.type == "revolute":
        stated = normal_unit(motion.units.get(f"q{reading.positions[joint] + 1}", ""))
        if joint not in reading.degrees and stated != "deg":
            sizes[DEGREES] = 1 / DEGREE
        if joint not in reading.motors and RATIO in sizes:
            sizes[MOTOR] = info.gear_ratio
    return sizes
