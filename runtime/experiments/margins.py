"""Margins between links and surroundings, where they are missed, and what is not checked: of capsules and of solids."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.experiments.nearest import box_distance
from runtime.experiments.scene import Scene
from runtime.experiments.settings import FREE_RANGE, SAMPLED_POSES
from runtime.model.kinematics import pose
from symbolic.model_file.arm import Arm


@dataclass(frozen=True)
class Nearest:
    """Where a motion comes closest: the distance less the margin in m, between what, and the sample's number."""

    distance: float
    between: str
    sample: int


def body_name(body: int) -> str:
    """Of the base or a link, in messages."""
    return f"link {body}" if body else "the base"


def upward(arm: Arm) -> Array:
    """(3,) direction against gravity; without gravity z of a spatial arm, and 0 of a planar one."""
    gravity = np.array(arm.gravity)
    if gravity.any():
        return -gravity / np.linalg.norm(gravity)
    return np.array([0.0, 0.0, 1.0 if arm.space else 0.0])


def check_place(arm: Arm, scene: Scene) -> None:
    """Raise ModelError if joint 1 lies below the floor or in a box, as the base's frame or a sign is wrong then."""
    first = np.array(arm.joints[0].origin.xyz)
    if scene.floor is not None:
        up = upward(arm)
        if not up.any():
            scene.place.fail(f"{arm.name} moves in a horizontal plane and has no floor; leave the floor out")
        if up @ first < scene.floor:
            scene.place.fail(
                f"the floor at {scene.floor:g} m is above joint 1 of {arm.name}, at {up @ first:.4g} m; expected its "
                "height above the base frame's origin, negative where the arm stands on a pedestal"
            )
    for box in scene.boxes:
        R, centre = pose(box.frame)
        depth, _ = box_distance(R.T @ (first - centre), np.array(box.size) / 2)
        if depth < 0:
            scene.place.fail(f"{box.name} holds joint 1 of {arm.name}; expected boxes in the base frame, in m")


def sampled_poses(arm: Arm) -> Array:
    """Poses (n, N) within the joints' limits, the same in every call."""
    ranges = np.array([joint.limits.position or (-FREE_RANGE, FREE_RANGE) for joint in arm.joints])
    return np.random.default_rng(0).uniform(ranges[:, :1], ranges[:, 1:], (len(ranges), SAMPLED_POSES))


@dataclass(frozen=True)
class KeptDistances:
    """What T pairs keep between each other.

    kept       (T,) m     checked   (T,) which pairs can be kept apart at all
    left_out   those that cannot, in words
    closer     those with a smaller margin than the scene's, and thinner those whose thickness cannot be true, in words
    """

    kept: Array
    checked: NDArray[np.bool_]
    left_out: tuple[str, ...] = ()
    closer: tuple[str, ...] = ()
    thinner: tuple[str, ...] = ()

    @classmethod
    def none(cls, count: int) -> KeptDistances:
        """Nothing of bare distances."""
        return cls(np.zeros(count), np.ones(count, dtype=bool))

    @classmethod
    def of(
        cls, names: Sequence[str], sampled: Array, thickness: Array, margins: Array, apart: NDArray[np.int64]
    ) -> KeptDistances:
        """Thickness and margin, as far as the arm's construction leaves room for them.

        sampled   (T, N) m, distances at random poses, of capsules between their axes     thickness, margins   (T,) m
        apart     (T,) number of joints between the two; 0 of links and surroundings
        A pair that is never farther apart than twice its margin keeps half of what there is. If links would overlap at
        most poses even so, they are thinner than their capsules, and keep half the largest distance of the axes; so
        does what overlaps surroundings at every pose. Links of this kind that are two joints apart, and pairs whose
        axes meet at every pose, are not checked.
        """
        best = sampled.max(axis=1, initial=-np.inf)
        room = np.minimum(margins, (best - thickness) / 2)
        tight = room < margins
        crowded = (sampled < (thickness + room)[:, None]).mean(axis=1) > 0.5
        thinner = tight & (thickness > 0) & np.where(apart > 0, crowded, best <= thickness)
        kept = np.where(thinner, best / 2, thickness + room)
        checked = (best > 1e-9) & ~(thinner & (apart == 2))
        words = [
            _least_by_name(names, values, checked & which)
            for values, which in ((room, tight & ~thinner), (kept, thinner & (np.ptp(sampled, axis=1) > 1e-9)))
        ]
        return cls(kept, checked, in_words(names, ~checked), *words)

    def of_these(self, which: NDArray[np.bool_]) -> KeptDistances:
        """Of some of the pairs, with the same words."""
        return replace(self, kept=self.kept[which], checked=self.checked[which])

    @property
    def unchecked(self) -> Iterator[str]:
        """In sentences."""
        if self.left_out:
            yield f"Not checked, as they are close at every pose: {'; '.join(self.left_out)}."
        if self.closer:
            yield f"Never far apart, and therefore checked with smaller margins: {'; '.join(self.closer)}."
        if self.thinner:
            yield (
                "Thicker as capsules than in truth, so that only axes nearer than this are too close: "
                f"{'; '.join(self.thinner)}."
            )


def _least_by_name(names: Sequence[str], values: Array, which: NDArray[np.bool_]) -> tuple[str, ...]:
    found: dict[str, float] = {}
    for k in np.flatnonzero(which).tolist():
        found[names[k]] = min(values[k], found.get(names[k], np.inf))
    return tuple(f"{name} {value:.2g} m" for name, value in found.items())


def in_words(names: Sequence[str], without: NDArray[np.bool_]) -> tuple[str, ...]:
    """The pairs that are left out, each once; those of which another part is checked are so called."""
    kept = {name for name, out in zip(names, without, strict=True) if not out}
    gone = dict.fromkeys(name for name, out in zip(names, without, strict=True) if out)
    return tuple(f"a part of {name}" if name in kept else name for name in gone)


def least_of(distances: Array) -> Array:
    """(N,) of distances (T, N); infinite without pairs."""
    return distances.min(axis=0, initial=np.inf)


def nearest_of(distances: Array, names: Sequence[str]) -> Nearest:
    """The smallest of distances (T, N) between pairs with these names (T,)."""
    if not distances.size:
        return Nearest(np.inf, "nothing", 0)
    pair, sample = divmod(int(distances.argmin()), distances.shape[1])
    return Nearest(float(distances[pair, sample]), names[pair], sample)


def surroundings_unchecked(scene: Scene) -> Iterator[str]:
    """What a scene does not say, a sentence each."""
    yield "People, cables, hoses, and what the scene does not list are not checked."
    if scene.floor is None:
        yield "No floor is stated (--floor): the arm may go below its base."
    if not scene.boxes:
        yield "No boxes are stated (--box, or [[box]] in a scene file): whatever stands around is not checked."
    if scene.tool is None:
        yield "No tool is stated ([tool] in a scene file): what reaches beyond the tip is not checked."
    yield (
        f"The motion as planned keeps {scene.margin:g} m from floor and boxes and {scene.link_margin:g} m between "
        "links; how far the arm strays from it is not checked."
    )


def joints_unchecked(arm: Arm) -> Iterator[str]:
    """What an arm's description leaves open, a sentence each."""
    if not arm.space:
        yield "Links are not checked against each other: a planar arm's file does not say which lie above which."
    else:
        yield "Neighbouring links are not checked against each other: their joints' limits keep them apart."
    slides = [str(k) for k, joint in enumerate(arm.joints, 1) if joint.type == "prismatic"]
    if slides:
        yield f"What spans from rail to carriage of joint {', '.join(slides)} is not checked."
