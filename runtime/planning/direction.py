"""Which way the end-effector of a spatial arm points: what a scenario asks for, in constraints and in numbers.

An axis a of the tip's frame (its z) along a direction d leaves the rotation about d free: with u and v across d, u·Ra
and v·Ra are zero, and d·Ra is not negative. A whole orientation Rᵗ is three numbers, the skew part of Rᵗᵀ R; they are
also zero half a turn off, which a trace that is not negative keeps away.
"""

from __future__ import annotations

from math import cos, sin

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.planning.blocks import Row
from runtime.planning.scenario import Point

Array = NDArray[np.float64]

AXIS = 2
"""Of the tip's frame: the one that points."""


def rotation(rpy: ArrayLike) -> Array:
    """(3, 3) of roll, pitch and yaw about fixed axes, rad, as URDF has them."""
    (cr, cp, cy), (sr, sp, sy) = ([f(float(a)) for a in np.asarray(rpy)] for f in (cos, sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def target_frame(point: Point) -> Array | None:
    """(3, 3) axes of the frame that is asked for, in columns; None where none is.

    Where only a direction is asked for, the other two are any across it.
    """
    if point.orientation is not None:
        return rotation(point.orientation)
    if point.pointing is None:
        return None
    d = np.array(point.pointing) / np.linalg.norm(point.pointing)
    across = np.cross(d, np.eye(3)[np.argmin(np.abs(d))])
    u = across / np.linalg.norm(across)
    return np.column_stack([u, np.cross(d, u), d])


def direction_rows(point: Point, R: ca.SX, target: ca.SX) -> list[Row]:
    """Constraints on the tip's rotation R (3, 3); target (9,): the frame that is asked for, column after column."""
    own = ca.reshape(target, 3, 3).T @ R
    what = "end-effector's direction"
    if point.orientation is None:
        pointing = own[:, AXIS]
        rows = [(pointing[0], 0.0, 0.0, what, "rad"), (pointing[1], 0.0, 0.0, what, "rad")]
        return [*rows, (pointing[2], 0.0, float("inf"), what, "rad")]
    skew = [(own[2, 1] - own[1, 2]) / 2, (own[0, 2] - own[2, 0]) / 2, (own[1, 0] - own[0, 1]) / 2]
    turned = [
        (part, 0.0, 0.0, f"end-effector's rotation about its {axis}", "rad")
        for part, axis in zip(skew, "xyz", strict=True)
    ]
    return [*turned, (ca.trace(own), 0.0, float("inf"), "end-effector's rotation", "rad")]


def turn_needed(point: Point, R: Array) -> tuple[Array, Array]:
    """What a tip's rotation R (3, 3) lacks of the direction: axes (k, 3), and by how much about each, rad (k,)."""
    frame = target_frame(point)
    if frame is None:
        return np.zeros((0, 3)), np.zeros(0)
    if point.orientation is None:
        about = np.cross(R[:, AXIS], frame[:, AXIS])
        angle = np.arctan2(np.linalg.norm(about), R[:, AXIS] @ frame[:, AXIS])
        axes = frame[:, :AXIS].T
        if angle > np.pi / 2 and np.linalg.norm(about) < 1e-9:
            return axes, np.array([angle, 0.0])
        return axes, axes @ about * (angle / max(np.linalg.norm(about), 1e-12))
    left = frame @ R.T
    about = np.array([left[2, 1] - left[1, 2], left[0, 2] - left[2, 0], left[1, 0] - left[0, 1]]) / 2
    angle = np.arctan2(np.linalg.norm(about), (np.trace(left) - 1) / 2)
    return np.eye(3), about * (angle / max(np.linalg.norm(about), 1e-12))
