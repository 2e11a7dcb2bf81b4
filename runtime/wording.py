"""Numbers, units and estimates as people write them."""

from __future__ import annotations

import math
import re

from runtime.covariance import Estimate
from runtime.terms import Term


def at(term: Term) -> str:
    """Where a term acts, after its name."""
    return "" if term.joint is None else f" at joint {term.joint}"


def sentence(text: str) -> str:
    """With a capital and a full stop."""
    text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."


def number(value: float | None, digits: int = 4) -> str:
    """A few significant digits, with a true minus sign and powers of ten where a person would write them."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if -4 <= exponent < 6:
        text = f"{value:.{max(0, digits - 1 - exponent)}f}"
        text = text.rstrip("0").rstrip(".") if "." in text else text
    else:
        text = f"{value / 10**exponent:.{digits - 1}f}".rstrip("0").rstrip(".") + f"·10{_raised(exponent)}"
    return text.replace("-", "−")


def whole(value: float) -> str:
    """To the nearest whole number."""
    return f"{round(value):d}".replace("-", "−") if math.isfinite(value) else "–"


def _raised(exponent: int | str) -> str:
    return str(exponent).translate(str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻"))


def percent(value: float, digits: int = 2) -> str:
    """A ratio as a percentage."""
    return f"{100 * value:.{digits}f} %".replace("-", "−")


def unit(text: str, before: str = "") -> str:
    """A unit as people write it: `kg m^2` with a raised 2, nothing for 1."""
    return "" if text == "1" else before + re.sub(r"\^(-?\d+)", lambda power: _raised(power[1]), text)


def quantity(value: float, of: str, digits: int = 4) -> str:
    """A number with its unit."""
    return number(value, digits) + unit(of, " ")


def estimate(e: Estimate | None) -> str:
    """Value ± half of its 95 % interval, to the digits that the interval supports."""
    if e is None:
        return ""
    if e.interval is None:
        together = f" (only together with {', '.join(e.with_others)})" if e.with_others else ""
        return number(e.value) + together
    half = (e.interval[1] - e.interval[0]) / 2
    if half <= 0 or not math.isfinite(half):
        return number(e.value)
    places = 1 - math.floor(math.log10(half))
    if not -6 <= places <= 9:
        return f"{number(e.value)} ± {number(half, 2)}"
    shown = max(0, places)
    return f"{round(e.value, places):.{shown}f} ± {round(half, places):.{shown}f}".replace("-", "−")
