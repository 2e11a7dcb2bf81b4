"""Inertias that come out as the model file's times a factor that a mistake explains, which no fit of torques can tell.

An inertia, and a friction, that are all too small by one factor fit as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, log, prod

import numpy as np
from numpy.typing import NDArray

from runtime.estimation.identify import Identification
from runtime.estimation.readings import DEGREE, Reading, turns
from runtime.estimation.settings import FACTOR_OF_INERTIA, LEAST_TELLING_RATIO
from runtime.recordings.units import UNITS

Array = NDArray[np.float64]


RATIO = "ratio"
"""The gear's, which is missing."""


@dataclass(frozen=True)
class ByFactor:
    """Mistakes, together, that explain a joint's inertia, and it as fitted and as stated, kg m² (kg).

    kinds   any of "degrees"; "milli", a torque or a current in thousandths; "current", which was read as a torque; and
            "ratio", of the gear, which is missing
    """

    kinds: tuple[str, ...]
    fitted: float
    stated: float


_TOGETHER = (
    *(("degrees",), ("milli",), (RATIO,), ("current",), ("current", "milli")),
    *(("degrees", RATIO), ("degrees", "milli"), ("degrees", "current"), ("degrees", "current", "milli")),
    ("milli", RATIO),
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
        for kinds in (kinds for kinds in _TOGETHER if sizes.keys() >= set(kinds)):
            factor = prod(sizes[kind] for kind in kinds)
            if abs(log(factor)) > log(least) and _about(float(stated[i] / fitted[i]), factor):
                result[i] = ByFactor(kinds, float(fitted[i]), float(stated[i]))
                break
    return result


def _sizes(identification: Identification, joint: int, reading: Reading) -> dict[str, float]:
    """By what each mistake that may have been made at a joint (0-based) divides its inertia."""
    info, motion = identification.model.joints[joint], identification.motion
    sizes = {"milli": UNITS["mA"][1]}
    if info.gear_ratio > LEAST_TELLING_RATIO:
        sizes[RATIO] = info.gear_ratio
    if info.torque_constant is not None and f"tau{reading.torques[joint] + 1}" not in motion.units:
        sizes["current"] = info.torque_constant
    wide = turns(motion, reading.positions[joint]) > 1
    if wide and info.type == "revolute" and joint not in reading.degrees:
        sizes["degrees"] = 1 / DEGREE
    return sizes


def _about(ratio: float, factor: float) -> bool:
    return abs(log(ratio / factor)) < log(FACTOR_OF_INERTIA)
