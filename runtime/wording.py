"""Numbers and units as text for people."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

AS_GIVEN = "file, refitted"
"""The first step of a loop: the effects of the model file, whose values are fitted to the recordings, too."""


def times_floor(rms: float, floor: float) -> float:
    """A torque as a multiple of the noise floor; infinite for a floor of 0."""
    if floor > 0:
        return rms / floor
    return math.inf if rms > 0 else 0.0


def sentence(text: str) -> str:
    """Text with a capital and a full stop."""
    text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."


def number(value: float | None, digits: int = 4) -> str:
    """A few significant digits, with a true minus sign and powers of ten for very large and small numbers."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if -4 <= exponent < 6:
        text = f"{value:.{max(0, digits - 1 - exponent)}f}"
        text = text.rstrip("0").rstrip(".") if "." in text else text
    else:
        mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
        mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        text = f"{mantissa}·10{_raised(int(power))}"
    return text.replace("-", "−")


def told_apart(value: float, other: float, digits: int = 2) -> str:
    """A value with as few digits as show on which side of the other it lies."""
    if not math.isfinite(value) or value == other:
        return number(value, digits)
    enough = (k for k in range(digits, 17) if (float(f"{value:.{k - 1}e}") - other) * (value - other) > 0)
    return number(value, next(enough, 17))


def numbered(joint: int, name: str | None) -> str:
    """Number (from 1) and name of a joint."""
    return str(joint) if name is None else f"{joint} {name}"


def joints_said(joints: Sequence[int], count: int | None = None) -> str:
    """Joints by their numbers (from 1), "1, 4 to 6"; "all joints" if there are `count` of them."""
    if count is not None and 1 < len(joints) == count:
        return "all joints"
    runs: list[list[int]] = []
    for k in joints:
        if runs and runs[-1][-1] == k - 1:
            runs[-1].append(k)
        else:
            runs.append([k])
    said = ", ".join(f"{r[0]} to {r[-1]}" if len(r) > 2 else ", ".join(map(str, r)) for r in runs)
    return f"joint{'' if len(joints) == 1 else 's'} {said}"


def fixed(value: float, digits: int = 3) -> str:
    """A number of decimals, for columns; zero has no sign."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def whole(value: float) -> str:
    """The nearest whole number."""
    return f"{round(value):d}".replace("-", "−") if math.isfinite(value) else "–"


def _raised(exponent: int | str) -> str:
    return str(exponent).translate(str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻"))


def percent(value: float, digits: int = 2) -> str:
    """A ratio as a percentage."""
    return f"{100 * value:.{digits}f} %".replace("-", "−")


def unit(text: str, before: str = "") -> str:
    """A unit as people write it: `kg m^2` with a raised 2, nothing for 1."""
    return "" if text == "1" else before + re.sub(r"\^(-?\d+)", lambda power: _raised(power[1]), text)


def milliseconds(seconds: float | None) -> str:
    """A time in s as a number of ms."""
    return "–" if seconds is None else f"{1e3 * seconds:.3g}"


def quantity(value: float, of: str, digits: int = 4) -> str:
    """A number with its unit."""
    return number(value, digits) + unit(of, " ")


def per_turn(order: float, ratio: float) -> str:
    """How often a line repeats, for people: of a geared joint in both counts."""
    if ratio == 1.0:
        return f"{order:.4g} per turn"
    return f"{order:.4g} per turn of the motor, {order * ratio:.4g} of the joint"
