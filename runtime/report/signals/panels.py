"""What a canvas draws, panel by panel, as static/signals.js reads it: which numbers, called what, in which colour.

Colours are those of report/plots/style.py by their names: ink is what was measured, before and after are models.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Colour = Literal["ink", "faint", "before", "after"]


@dataclass(frozen=True)
class DrawnLine:
    """A line of a set (its name there), and what it is called and drawn in; cloud or curve over time."""

    line: str
    name: str
    colour: Colour


@dataclass(frozen=True)
class DrawnCurve:
    """A few numbers of its own: x and y (K,), NaN where it breaks."""

    name: str
    colour: Colour
    x: Sequence[float | None]
    y: Sequence[float | None]
    dashed: bool = False


@dataclass(frozen=True)
class SignalPanel:
    """One of the views of a set, which zoom each on their own and are lit together.

    kind      "time": lines over the time; "over": clouds over another signal; "curves": curves alone
    x         for "over" the name of that signal in the set
    labels    of the axes, with units
    low, high vertical scale
    band      ± noise floor, or for "curves" from 0 to it; 0: none
    stretch   within this distance from 0 the horizontal axis is linear, beyond logarithmic; 0: plain
    log       the vertical axis is logarithmic
    marks     places on the horizontal axis to point at
    note      a sentence below it
    """

    kind: Literal["time", "over", "curves"]
    title: str
    x: str
    labels: tuple[str, str]
    low: float
    high: float
    lines: tuple[DrawnLine, ...] = ()
    curves: tuple[DrawnCurve, ...] = ()
    band: float = 0.0
    stretch: float = 0.0
    log: bool = False
    marks: tuple[float, ...] = ()
    note: str = ""

    def to_json(self) -> dict[str, Any]:
        """Numbers and texts; the browser shows texts as texts."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> SignalPanel:
        """As `to_json` wrote it."""
        return cls(
            **{
                **document,
                "labels": tuple(document["labels"]),
                "lines": tuple(DrawnLine(**line) for line in document["lines"]),
                "curves": tuple(DrawnCurve(**curve) for curve in document["curves"]),
                "marks": tuple(document["marks"]),
            }
        )


def curve(name: str, colour: Colour, x: Array, y: Array, dashed: bool = False) -> DrawnCurve:
    """A curve of arrays; what is not finite is where it breaks."""
    points = [
        (float(a), float(b)) if np.isfinite(a) and np.isfinite(b) else (None, None) for a, b in zip(x, y, strict=True)
    ]
    return DrawnCurve(name, colour, [a for a, _ in points], [b for _, b in points], dashed)


def around(values: Sequence[Array], least: float = 0.0) -> tuple[float, float]:
    """A vertical scale for lines (M,): all that is finite, with a margin, and `least` about zero if that is given."""
    finite = [v[np.isfinite(v)] for v in values]
    low = min([*(float(v.min()) for v in finite if len(v)), -least], default=-1.0)
    high = max([*(float(v.max()) for v in finite if len(v)), least], default=1.0)
    margin = 0.05 * (high - low) or abs(high) or 1.0
    return low - margin, high + margin
