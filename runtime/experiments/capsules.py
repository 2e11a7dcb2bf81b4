"""An arm as capsules: where its links run between the joints, and how thick they are.

Model files state joints and bodies, not shapes. Between two joints a link runs along the axis of the first, across, and
along the axis of the second, as in Denavit and Hartenberg's description, in the order that passes nearest to its centre
of mass. Its radius is that of a solid cylinder with its mass and its smallest principal moment: m r²/2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.experiments.scene import Scene
from runtime.experiments.settings import PARALLEL_AXES, REACH_TO_RADIUS, TRUSTED_MEDIAN, TRUSTED_RADIUS
from runtime.model.kinematics import pose, unit_axis
from symbolic.model_file.arm import Arm, Joint, Link
from symbolic.model_file.frames import principal_moments


class _Capsule(NamedTuple):
    """One of them; start and end (3,) m in the frame of the joint that moves it."""

    body: int
    start: Array
    end: Array
    radius: float
    tool: bool = False


@dataclass(frozen=True)
class Capsules:
    """S capsules on the links of an arm.

    body     (S,) of the link that carries it: 0 the base, k that of joint k     radius   (S,) m
    ends     (S, 2, 3) m, of its axis, in the frame of that joint                tool     (S,) whether it is the tool's
    """

    body: NDArray[np.int64]
    ends: Array
    radius: Array
    tool: NDArray[np.bool_]

    @classmethod
    def of(cls, arm: Arm, scene: Scene) -> Capsules:
        """Raises ModelError if the scene states the radius of a link that the arm does not have."""
        n = len(arm.joints)
        for joint in scene.radii:
            if joint > n:
                scene.place.inside("link").fail(f"there is no joint {joint}; {arm.name} has {n}")
        radii = link_radii(arm, scene)
        base = _Capsule(0, np.zeros(3), np.array(arm.joints[0].origin.xyz), radii[0])
        made = [base]
        for k, (one, after) in enumerate(zip(arm.joints, (*arm.joints[1:], None), strict=True), 1):
            made += [_Capsule(k, start, end, radii[k]) for start, end in pairwise(_way(arm, one, after))]
        if scene.tool is not None:
            R, p = pose(arm.tip)
            start, end = (p + R @ np.array(place) for place in (scene.tool.start, scene.tool.end))
            made.append(_Capsule(n, start, end, scene.tool.radius, True))
        body, starts, ends, radius, tool = (np.array(column) for column in zip(*made, strict=True))
        return cls(body, np.stack([starts, ends], axis=1), radius, tool)


def link_radii(arm: Arm, scene: Scene) -> list[float]:
    """(n + 1,) m, of the base and the links: those that the scene states, else from inertias; the base has link 1's.

    Identified inertias may be impossible, so that links are held near the median, and that near the usual of arms. A
    planar arm's file states the moment about the axis only.
    """
    lengths = [np.linalg.norm(frame.xyz) for frame in (*(joint.origin for joint in arm.joints[1:]), arm.tip)]
    usual = REACH_TO_RADIUS * float(sum(lengths))
    stated = [_radius(joint.link) if arm.space else None for joint in arm.joints]
    known = [radius for radius in stated if radius]
    least, most = (factor * usual for factor in TRUSTED_MEDIAN)
    typical = min(max(median(known), least), most) if known else usual
    least, most = (factor * typical for factor in TRUSTED_RADIUS)
    found = [min(max(radius or typical, least), most) for radius in stated]
    return [scene.radii.get(k, radius) for k, radius in enumerate((found[0], *found))]


def _radius(link: Link) -> float | None:
    """m, of the solid cylinder with its mass and its smallest moment; None where they are not stated."""
    if not link.mass or link.inertia is None:
        return None
    return math.sqrt(2 * max(principal_moments(link.inertia)[0], 0.0) / link.mass)


def _way(arm: Arm, joint: Joint, after: Joint | None) -> list[Array]:
    """Corners (3,) m of a link, from its own joint's origin to the next joint's or the tip's."""
    R, end = pose(arm.tip if after is None else after.origin)
    own = unit_axis(joint)
    others = R[:, 2] if after is None else R @ unit_axis(after)
    parts = [part for part in _parts(end, own, others) if np.linalg.norm(part) > PARALLEL_AXES * np.linalg.norm(end)]
    ways = [[np.zeros(3), *np.cumsum(order, axis=0)] for order in permutations(parts)] if parts else []
    ways.append([np.zeros(3), end])
    com = joint.link.com
    return ways[0] if com is None else min(ways, key=lambda way: _distance(way, np.array(com)))


def _parts(end: Array, own: Array, following: Array) -> list[Array]:
    """A vector (3,) as a sum of vectors along its own joint's axis, across, and along the next joint's axis."""
    along = (end @ own) * own
    beside = following - (following @ own) * own
    size = np.linalg.norm(beside)
    if size < PARALLEL_AXES:
        return [along, end - along]
    beside /= size
    last = (end @ beside) * beside
    return [along, end - along - last, last]


def _distance(way: Sequence[Array], point: Array) -> float:
    """m, rounded to a tenth of a millimetre, so that of ways of equal length the first is taken."""
    found = []
    for start, end in pairwise(way):
        d = end - start
        t = np.clip((point - start) @ d / max(float(d @ d), 1e-12), 0.0, 1.0)
        found.append(float(np.linalg.norm(start + t * d - point)))
    return round(min(found), 4)
