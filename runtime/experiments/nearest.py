"""Nearest points of segments and boxes, for many at once; components are the first axis of every array.

Source: Ericson 2005, Real-Time Collision Detection (two segments). The signed distance to a box is convex along a
segment, so that its least value is found by bisection of its slope.
"""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.experiments.settings import BISECTIONS


def nearest_points(start: Array, end: Array, other_start: Array, other_end: Array) -> tuple[Array, Array]:
    """The nearest points of two segments, (3, ...) m each; of parallel ones, some nearest points."""
    along, other, between = end - start, other_end - other_start, start - other_start
    a, e, b = _dot(along, along), _dot(other, other), _dot(along, other)
    c, f = _dot(along, between), _dot(other, between)
    crossing = a * e - b * b
    skew = crossing > 1e-12 * a * e
    s = np.where(skew, np.clip((b * f - c * e) / np.where(skew, crossing, 1.0), 0.0, 1.0), 0.0)
    t = np.clip((b * s + f) / np.maximum(e, 1e-12), 0.0, 1.0)
    s = np.clip((b * t - c) / np.maximum(a, 1e-12), 0.0, 1.0)
    return start + s * along, other_start + t * other


def box_distance(point: Array, half: Array) -> tuple[Array, Array]:
    """Signed distance (...) m of points (3, ...) to a box about the origin, negative inside, and its gradient (3, ...).

    half   (3,) m, half its edges
    """
    over = np.abs(point) - half.reshape(3, *[1] * (point.ndim - 1))
    outside = np.maximum(over, 0.0)
    length = np.sqrt(_dot(outside, outside))
    deepest = over.max(axis=0)
    is_outside = length > 0
    toward = np.where(is_outside, outside / np.where(is_outside, length, 1.0), over == deepest)
    return np.where(is_outside, length, deepest), np.copysign(toward, point)


def nearest_to_box(start: Array, end: Array, half: Array) -> tuple[Array, Array, Array]:
    """Of segments (3, K) m and a box about the origin: the nearest point, or the deepest in it, (3, K) m; its signed
    distance (K,) m; and the derivative (3, K) of that distance by a shift of the segment.

    In a box the deepest point is as far from two faces, of whose normals it takes the part that is across the segment.
    """
    along = end - start
    low, high = np.zeros(start.shape[1]), np.ones(start.shape[1])
    for _ in range(BISECTIONS):
        t = (low + high) / 2
        _, gradient = box_distance(start + t * along, half)
        rising = _dot(gradient, along) > 0
        low, high = np.where(rising, low, t), np.where(rising, t, high)
    point = start + (low + high) / 2 * along
    distance, gradient = box_distance(point, half)
    (_, before), (_, after) = (box_distance(start + t * along, half) for t in (low, high))
    falls, rises = _dot(before, along), _dot(after, along)
    turns = (falls < 0) & (rises > 0)
    part = rises / np.where(turns, rises - falls, 1.0)
    return point, distance, np.where(turns, part * before + (1 - part) * after, gradient)


def _dot(a: Array, b: Array) -> Array:
    found: Array = (a * b).sum(axis=0)
    return found
