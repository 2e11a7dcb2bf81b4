"""Units of recorded signals: their dimension, and what one is in SI."""

from __future__ import annotations

import difflib
import re
from math import pi

_DEGREE = pi / 180
_FACTORS = {
    "time": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "angle": {
        "rad": 1.0,
        "radians": 1.0,
        "mrad": 1e-3,
        "urad": 1e-6,
        "rev": 2 * pi,
        "turn": 2 * pi,
        "deg": _DEGREE,
        "degrees": _DEGREE,
        "Grad": _DEGREE,
        "°": _DEGREE,
        "mdeg": _DEGREE / 1e3,
        "arcmin": _DEGREE / 60,
        "arcsec": _DEGREE / 3600,
    },
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "angular rate": {
        "rad/s": 1.0,
        "mrad/s": 1e-3,
        "deg/s": _DEGREE,
        "Grad/s": _DEGREE,
        "°/s": _DEGREE,
        "rpm": pi / 30,
        "U/min": pi / 30,
        "rev/min": pi / 30,
        "1/min": pi / 30,
        "rev/s": 2 * pi,
        "turn/s": 2 * pi,
        "rps": 2 * pi,
    },
    "speed": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6, "m/min": 1 / 60, "mm/min": 1e-3 / 60},
    "torque": {
        "N m": 1.0,
        "mN m": 1e-3,
        "N cm": 1e-2,
        "N mm": 1e-3,
        "kN m": 1e3,
        "Nm": 1.0,
        "mNm": 1e-3,
        "Ncm": 1e-2,
        "Nmm": 1e-3,
        "kNm": 1e3,
        "uNm": 1e-6,
    },
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "current": {"A": 1.0, "mA": 1e-3, "uA": 1e-6},
    "temperature": {"degC": 1.0, "°C": 1.0, "C": 1.0, "K": 1.0, "degF": 5 / 9, "°F": 5 / 9},
}
_ZERO = {"K": -273.15, "degF": -160 / 9, "°F": -160 / 9}
UNITS = {u: (kind, f, _ZERO.get(u, 0.0)) for kind, factors in _FACTORS.items() for u, f in factors.items()}
"""unit: (dimension, factor to SI, its zero in SI); temperatures are kept in °C."""

EXAMPLES = {
    "time": "s or ms",
    "angle": "rad or deg",
    "length": "m or mm",
    "angular rate": "rad/s, deg/s or rpm",
    "speed": "m/s or mm/s",
    "torque": "N m or mNm",
    "force": "N",
    "current": "A or mA",
    "temperature": "degC or K",
}


def normal(unit: str) -> str:
    """A unit as the table has it."""
    unit = unit.replace("µ", "u").replace("μ", "u")
    return " ".join(re.sub(r"[·⋅*.]", " ", unit).split())


def hint(unit: str) -> str:
    """What to do about a unit that is not known."""
    if unit.lower() in ("counts", "count", "cts", "inc", "increments", "ticks", "lsb", "qc"):
        return "convert it with the encoder's resolution first"
    by_lower = {known.lower(): known for known in UNITS}
    close = difflib.get_close_matches(normal(unit).lower()[:40], by_lower, n=1, cutoff=0.5)
    return f'did you mean "{by_lower[close[0]]}"?' if close else "write it in SI, without a unit"
