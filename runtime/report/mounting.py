"""How an arm's base stands, from the gravity of its model file and the gravity that recordings add to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.arrays import Array
from runtime.wording import quantity
from symbolic.model_file.arm import WEIGHTLESS

_STRAIGHT = 10.0
"""degrees; a direction this close to an axis of the base, or to the opposite one, is called by it: how straight people
mount arms, and how well recordings tell it."""
_LEVEL = 1.0
"""degrees; a base that is tilted by less is called level."""
_NONE = 0.1
"""part of the gravity on earth; less is called none."""
_EARTH = 9.81
_UNIT = "m/s^2"
_CURE = f'state torque = "{WEIGHTLESS}" in the model file, or pass --map torque={WEIGHTLESS}'


def said(stated: Sequence[float], added: Sequence[float], spread: Array | None = None) -> str:
    """How the base is mounted, and what to type.

    stated   gravity in the model file, along base x, y and, in space, z, m/s²     added   what recordings add to it
    spread   (k, k) rows: half axes of the region that holds it with 95 %; None: unknown
    """
    before, extra = np.array(stated, dtype=float), np.array(added, dtype=float)
    whole = before + extra
    cure = f"state gravity = [{', '.join(f'{x:.3g}' for x in np.round(whole, 2) + 0.0)}] in the model file"
    if np.linalg.norm(whole) < _NONE * _EARTH:
        return _none(len(whole))
    if np.linalg.norm(before) < _NONE * _EARTH:
        return f"gravity is not in the file: it points along {_direction(whole)}; {cure}"
    angle = _angle(before, whole)
    if angle < _LEVEL and not np.isclose(np.linalg.norm(whole), np.linalg.norm(before)):
        size = quantity(float(np.linalg.norm(whole)), _UNIT, 3)
        return f"gravity has the file's direction and is {size}: masses or torques may be wrong by that factor"
    if angle > 180 - _STRAIGHT:
        return f"the base is mounted on the ceiling: gravity points along {_direction(whole)}; {cure}"
    if abs(angle - 90) < _STRAIGHT:
        return f"the base is mounted on a wall: gravity points along {_direction(whole)}; {cure}"
    ends = [] if spread is None else [_angle(before, whole + side * axis) for axis in spread for side in (1, -1)]
    within = f" (95 % in {_degrees(min(angle, *ends))} to {_degrees(max(angle, *ends))})" if ends else ""
    return f"the base is tilted by {_degrees(angle)}{within} about {_axis(before, whole)}; {cure}"


def _degrees(angle: float) -> str:
    return f"{angle:.0f}°" if angle >= 10 else f"{angle:.2g}°"


def _none(dimensions: int) -> str:
    if dimensions == 2:
        return (
            "no gravity acts: the arm moves in a horizontal plane (state gravity = [0.0, 0.0]), or it was taken out "
            f"of the recorded torque ({_CURE})"
        )
    return f"gravity was taken out of the recorded torque: {_CURE}"


def _angle(one: Array, other: Array) -> float:
    """Between two directions, degrees."""
    cosine = one @ other / (np.linalg.norm(one) * np.linalg.norm(other))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _direction(vector: Array) -> str:
    """The axis of the base along which a vector points, or its components over its length."""
    along = int(np.argmax(np.abs(vector)))
    axis = np.sign(vector[along]) * np.eye(len(vector))[along]
    if _angle(vector, axis) < _STRAIGHT:
        return f"{'−' if vector[along] < 0 else ''}{'xyz'[along]}"
    parts = vector / np.linalg.norm(vector)
    return f"({', '.join(f'{x:.2f}' for x in parts)})".replace("-", "−")


def _axis(before: Array, whole: Array) -> str:
    """The base's own axis about which it was turned from where the file has it: gravity turns the other way."""
    if len(before) == 2:
        turned = float(whole[0] * before[1] - whole[1] * before[0])
        return "z" if turned > 0 else "−z"
    return _direction(np.cross(whole, before))
