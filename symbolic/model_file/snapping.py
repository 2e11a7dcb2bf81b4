"""Angles next to a quarter turn, and axes next to one of the frame's: taken as exact, and said so.

A drawing has quarter turns; a file has 1.5708 or 1.57079632679. Only exact ones fold away in the equations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass, field

from symbolic.model_file.arm import Frame
from symbolic.model_file.checks import Place
from symbolic.model_file.frames import QUARTER, Vector

CLOSE = 1e-5
"""rad; off a quarter turn by less, an angle was rounded when it was written: URDFs in the wild are off by 4.9e-12 to
3.7e-6, while the smallest angle that was meant is 0.049."""
ROUNDING = 4e-15
"""Off by less, it is the quarter turn in the digits of a double: nothing to report."""


@dataclass
class Snapping:
    """What was snapped in a file, place by place."""

    turned: list[tuple[str, float]] = field(default_factory=list)
    directed: list[tuple[str, float]] = field(default_factory=list)

    def frame(self, where: str, frame: Frame) -> Frame:
        """The frame with exact quarter turns."""
        snapped = [snapped_angle(angle) for angle in frame.rpy]
        off = max(abs(a - b) for a, b in zip(frame.rpy, snapped, strict=True))
        if off > ROUNDING:
            self.turned.append((where, off))
        roll, pitch, yaw = snapped
        return Frame(frame.xyz, (roll, pitch, yaw))

    def axis(self, place: Place, where: str, axis: Sequence[float]) -> Vector:
        """The axis without components that rounding has left, of length 1 along an axis of the frame.

        Raises ModelError for one without a direction.
        """
        length = math.hypot(*axis)
        if not SHORTEST <= length <= 1 / SHORTEST:
            place.fail(f"axis has the length {length:g}; expected a direction, such as [0.0, 0.0, 1.0]")
        snapped = snapped_axis(axis)
        off = max(abs(a / length - b / math.hypot(*snapped)) for a, b in zip(axis, snapped, strict=True))
        if off > ROUNDING:
            self.directed.append((where, off))
        return snapped

    def only(self, places: Set[str]) -> None:
        """Forget the other places."""
        self.turned = [entry for entry in self.turned if entry[0] in places]
        self.directed = [entry for entry in self.directed if entry[0] in places]

    def notes(self) -> list[str]:
        """A line for a person, or none."""
        kinds = (("the angles", " rad", self.turned), ("the axis", "", self.directed))
        parts = [_said(what, unit, places) for what, unit, places in kinds if places]
        return [f"taken as exact quarter turns: {'; '.join(parts)}"] if parts else []


LISTED = 8
"""Joints in a line; of more, the number is said."""
SHORTEST = 1e-6
"""Length of an axis below which its direction is rounding; and its inverse, above which it is no direction."""


def snapped_angle(angle: float) -> float:
    """In rad; the quarter turn if it is next to one."""
    nearest = round(angle / QUARTER) * QUARTER
    return nearest if abs(angle - nearest) < CLOSE else angle


def snapped_axis(axis: Sequence[float]) -> Vector:
    """Components within CLOSE of 0, of an axis of length 1, are 0; a single one that is left is ±1."""
    length = math.hypot(*axis)
    x, y, z = (0.0 if abs(a / length) < CLOSE else a for a in axis)
    if sum(component != 0.0 for component in (x, y, z)) > 1:
        return x, y, z
    x, y, z = (math.copysign(1.0, a) if a else 0.0 for a in (x, y, z))
    return x, y, z


def _said(what: str, unit: str, places: Sequence[tuple[str, float]]) -> str:
    return (
        f"{what} of {listed([where for where, _ in places])} (off by up to {max(off for _, off in places):.1g}{unit})"
    )


def listed(places: Sequence[str]) -> str:
    """joints 1, 2 and the tip."""
    joints = [place.removeprefix("joint ") for place in places if place.startswith("joint ")]
    others = [place for place in places if not place.startswith("joint ")]
    shown = [*joints[:LISTED], *([f"{len(joints) - LISTED} more"] if len(joints) > LISTED else [])]
    named = [f"joint{'s' if len(joints) > 1 else ''} {', '.join(shown)}"] if joints else []
    return " and ".join([*named, *others])
