"""How far an arm stays from floor, boxes and itself: distances of capsules, less margins, and their gradients.

Floor and boxes are at rest in the base frame; the base touches them rightly and is only checked against links.
A gradient is the torque that forces along the normals would ask of the joints.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.experiments.capsules import Capsules
from runtime.experiments.margins import (
    KeptDistances,
    Nearest,
    body_name,
    check_place,
    joints_unchecked,
    least_of,
    nearest_of,
    sampled_poses,
    surroundings_unchecked,
    upward,
)
from runtime.experiments.nearest import box_distance, nearest_points, nearest_to_box
from runtime.experiments.scene import Scene
from runtime.model.kinematics import body_frames, pose, unit_axis
from symbolic.model_file.arm import Arm

Which = NDArray[np.int64]


@dataclass(frozen=True)
class _Distances:
    """Distances of T pairs of axes at N samples, m.

    distance   (T, N), less what is kept     normal   (3, T, N), its derivative by the first point
    points     (3, T, N), of the first and of the second of each pair, in the base frame
    bodies     (T,), which bodies carry the points; 0 for what is at rest
    """

    distance: Array
    normal: Array
    points: tuple[Array, Array]
    bodies: tuple[Which, Which]


@dataclass(frozen=True)
class Clearance:
    """The distances of an arm in a scene, of capsules.

    pairs    (2, P) of capsules     grounded   (2, E) capsule and end, against the floor
    boxed    (2, B) capsule and number of the box
    judged   what all of these keep, and what is not checked, in words
    """

    arm: Arm
    scene: Scene
    capsules: Capsules
    pairs: Which
    grounded: Which
    boxed: Which
    judged: KeptDistances

    @classmethod
    def of(cls, arm: Arm, scene: Scene) -> Clearance:
        """Raises ModelError if floor or boxes are where the arm stands."""
        check_place(arm, scene)
        capsules = Capsules.of(arm, scene)
        links = np.flatnonzero(capsules.body > 0).tolist()
        apart = [(a, b) for a in range(len(capsules.body)) for b in range(a) if _are_apart(capsules, a, b)]
        grounded = [(a, end) for a in links for end in (0, 1)] if scene.floor is not None else []
        boxed = [(a, b) for b in range(len(scene.boxes)) for a in links]
        pairs = _columns(apart if arm.space else [])
        bare = KeptDistances.none(pairs.shape[1] + len(grounded) + len(boxed))
        whole = cls(arm, scene, capsules, pairs, grounded=_columns(grounded), boxed=_columns(boxed), judged=bare)
        return whole._with_margins()

    def least(self, q: Array) -> Array:
        """(N,) m at q (n, N): the smallest distance less its margin; negative: too close."""
        return least_of(self.distances(q))

    def worst(self, q: Array) -> Nearest:
        """Where q (n, N) comes closest."""
        return nearest_of(self.distances(q), self.names)

    def penalty(self, q: Array, soft: float) -> tuple[float, Array]:
        """Sum over samples and pairs of max(0, (soft - d)/soft)², d the distance less its margin, and its gradient.

        q (n, N) rad or m, soft in m. Returns the sum, and (n, N) 1/rad or 1/m; continuous but where the nearest points
        of two capsules jump.
        """
        R, p = body_frames(self.arm, q)
        found = self._distances(R, p, reach=soft)
        inside = np.maximum(soft - found.distance, 0.0) / soft
        force = (-2 / soft) * inside * found.normal
        # Force and moment about the base frame's origin on each body, and on all bodies that a joint carries.
        wrench = np.zeros((len(p), 6, q.shape[1]))
        for sign, points, bodies in zip((1.0, -1.0), found.points, found.bodies, strict=True):
            on_body = sign * (bodies == np.arange(len(p))[:, None])
            both = np.concatenate([force, np.cross(points, force, axis=0)])
            wrench += np.einsum("bt,ctN->bcN", on_body, both, optimize=True)
        carried = np.cumsum(wrench[:0:-1], axis=0)[::-1]
        gradient = np.empty_like(q)
        for k, joint in enumerate(self.arm.joints):
            along = np.einsum("abN,b->aN", R[k + 1], unit_axis(joint))
            asked = carried[k, :3]
            if joint.type == "revolute":
                asked = carried[k, 3:] - np.cross(p[k + 1], asked, axis=0)
            gradient[k] = (along * asked).sum(axis=0)
        return float((inside**2).sum()), gradient

    def distances(self, q: Array) -> Array:
        """(T, N) m at q (n, N), of every pair in the order of `names`, less radii and margins."""
        return self._distances(*body_frames(self.arm, q)).distance

    @cached_property
    def names(self) -> tuple[str, ...]:
        """(T,) what each distance is between, in words."""
        of = [self._name(k) for k in range(len(self.capsules.body))]
        return (
            *(f"{of[b]} and {of[a]}" for a, b in self.pairs.T),
            *(f"{of[a]} and the floor" for a, _ in self.grounded.T),
            *(f"{of[a]} and {self.scene.boxes[b].name}" for a, b in self.boxed.T),
        )

    def _name(self, capsule: int) -> str:
        return "the tool" if self.capsules.tool[capsule] else body_name(int(self.capsules.body[capsule]))

    @cached_property
    def unchecked(self) -> tuple[str, ...]:
        """What nobody looks at, a sentence each."""
        radii = {self._name(k): f"{radius:.3g} m" for k, radius in enumerate(self.capsules.radius)}
        said = ", ".join(f"{name} {radius}" for name, radius in radii.items())
        return (
            *surroundings_unchecked(self.scene),
            f"Links are capsules between joint origins, with radii from the scene or guessed from inertias ({said}); "
            "what sticks out of them is not checked.",
            *joints_unchecked(self.arm),
            *self.judged.unchecked,
        )

    def _distances(self, R: Array, p: Array, reach: float = np.inf) -> _Distances:
        """Of all pairs; a distance to a box above `reach` may be a lower bound."""
        own = self.capsules.body
        ends = np.einsum("eabN,esb->aesN", R[own], self.capsules.ends) + np.moveaxis(p[own], 1, 0)[:, :, None]
        boxes = len(self.judged.kept) - self.boxed.shape[1]
        near = reach + self.judged.kept[boxes:]
        parts = [self._between_links(ends), self._over_floor(ends), self._from_boxes(ends, near)]
        return _Distances(
            np.concatenate([part.distance for part in parts]) - self.judged.kept[:, None],
            np.concatenate([part.normal for part in parts], axis=1),
            tuple(np.concatenate([part.points[k] for part in parts], axis=1) for k in (0, 1)),  # type: ignore[arg-type]
            tuple(np.concatenate([part.bodies[k] for part in parts]) for k in (0, 1)),  # type: ignore[arg-type]
        )

    def _between_links(self, ends: Array) -> _Distances:
        a, b = self.pairs
        first, second = nearest_points(ends[:, a, 0], ends[:, a, 1], ends[:, b, 0], ends[:, b, 1])
        between = first - second
        length = np.sqrt((between**2).sum(axis=0))
        bodies = self.capsules.body[a], self.capsules.body[b]
        return _Distances(length, between / np.maximum(length, 1e-12), (first, second), bodies)

    def _over_floor(self, ends: Array) -> _Distances:
        a, end = self.grounded
        points = ends[:, a, end]
        up = upward(self.arm)
        height = np.einsum("a,atN->tN", up, points) - (self.scene.floor or 0.0)
        return _Distances(height, np.broadcast_to(up[:, None, None], points.shape), (points, points), self._at_rest(a))

    def _from_boxes(self, ends: Array, reach: Array) -> _Distances:
        a, b = self.boxed
        points, normal = np.zeros((2, 3, len(a), ends.shape[-1]))
        distance = np.zeros(points.shape[1:])
        for number, box in enumerate(self.scene.boxes):
            rows = np.flatnonzero(b == number)
            R, centre = pose(box.frame)
            start, end = (np.einsum("ba,btN->atN", R, ends[:, a[rows], k] - centre[:, None, None]) for k in (0, 1))
            half = np.array(box.size) / 2
            middle, _ = box_distance((start + end) / 2, half)
            at_least = middle - np.sqrt(((end - start) ** 2).sum(axis=0)) / 2
            near = at_least <= reach[rows, None]
            at, exact, toward = nearest_to_box(start[:, near], end[:, near], half)
            at_least[near] = exact
            distance[rows] = at_least
            where = np.zeros(points.shape[1:], dtype=bool)
            where[rows] = near
            normal[:, where] = R @ toward
            points[:, where] = R @ at + centre[:, None]
        return _Distances(distance, normal, (points, points), self._at_rest(a))

    def _at_rest(self, capsules: Which) -> tuple[Which, Which]:
        bodies = self.capsules.body[capsules]
        return bodies, np.zeros_like(bodies)

    def _with_margins(self) -> Clearance:
        """With the pairs that can come too close, and their margins."""
        sampled = self.distances(sampled_poses(self.arm))
        radius, around = self.capsules.radius, np.concatenate([self.grounded[0], self.boxed[0]])
        thickness = np.concatenate([radius[self.pairs].sum(axis=0), radius[around]])
        margins = np.repeat([self.scene.link_margin, self.scene.margin], [self.pairs.shape[1], len(around)])
        apart = np.concatenate([np.abs(np.subtract(*self.capsules.body[self.pairs])), np.zeros_like(around)])
        judged = KeptDistances.of(self.names, sampled, thickness, margins, apart)
        kept = judged.checked & (np.ptp(sampled, axis=1) > 1e-9)
        parts = np.split(kept, np.cumsum([self.pairs.shape[1], self.grounded.shape[1]]))
        pairs, grounded, boxed = (
            which[:, part] for which, part in zip((self.pairs, self.grounded, self.boxed), parts, strict=True)
        )
        return replace(self, pairs=pairs, grounded=grounded, boxed=boxed, judged=judged.of_these(kept))


def _are_apart(capsules: Capsules, a: int, b: int) -> bool:
    return abs(int(capsules.body[a]) - int(capsules.body[b])) > 1


def _columns(pairs: Iterable[tuple[int, int]]) -> Which:
    return np.array([*pairs], dtype=np.int64).reshape(-1, 2).T
