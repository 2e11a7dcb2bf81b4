"""Margins between links and surroundings, where they are missed, and what is not checked: of capsules and of solids."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runtime.experiments.nearest import box_distance
from runtime.experiments.scene import Scene
from runtime.experiments.settings import FREE_RANGE, LINK_MARGIN, SAMPLED_POSES
from runtime.model.kinematics import pose
from symbolic.model_file.arm import Arm

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Nearest:
    """Where a motion comes closest: the distance less the margin in m, between what, and the sample's number."""

    distance: float
    between: str
    sample: int


def body_name(body: int) -> str:
    """Of the base or a link, in messages."""
    return f"link {body}" if body else "the base"


def upward(arm: Arm) -> Array | None:
    """(3,) direction against gravity; z of a spatial arm without gravity, None of a planar one."""
    gravity = np.array(arm.gravity)
    if gravity.any():
        return -gravity / np.linalg.norm(gravity)
    return np.array([0.0, 0.0, 1.0]) if arm.space else None


def check_place(arm: Arm, scene: Scene) -> None:
    """Raise ModelError if joint 1 lies below the floor or in a box, as the base's frame or a sign is wrong then."""
    first = np.array(arm.joints[0].origin.xyz)
    if scene.floor is not None:
        up = upward(arm)
        if up is None:
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
class PairMargins:
    """What T pairs keep between each other.

    margins    (T,) m     checked   (T,) which pairs can be kept apart at all
    left_out   the pairs that are not checked, in words     closer   those with a smaller margin than the scene's
    """

    margins: Array
    checked: NDArray[np.bool_]
    left_out: tuple[str, ...] = ()
    closer: tuple[str, ...] = ()

    @classmethod
    def none(cls, count: int) -> PairMargins:
        """Of bare distances."""
        return cls(np.zeros(count), np.ones(count, dtype=bool))

    @classmethod
    def of(cls, scene: Scene, names: Sequence[str], bare: Array, links: NDArray[np.bool_]) -> PairMargins:
        """The scene's margins, or half the largest distance of pairs that are never farther apart than twice that.

        bare    (T, N) m, distances at sampled poses     links   (T,) which pairs are of two links
        Not checked are pairs that overlap at every pose, and of those links that are close by construction the ones
        that would be too close at most poses: their capsules are thicker than they are.
        """
        stated, best = np.where(links, scene.link_margin, scene.margin), bare.max(axis=1, initial=-np.inf)
        margins = np.minimum(stated, best / 2)
        close = links & (best < 2 * np.maximum(stated, LINK_MARGIN))
        crowded = close & ((bare < margins[:, None]).mean(axis=1) > 0.5)
        checked = (best > 0) & ~crowded
        smaller: dict[str, float] = {}
        for k in np.flatnonzero(checked & (margins < stated)).tolist():
            smaller[names[k]] = min(margins[k], smaller.get(names[k], np.inf))
        closer = tuple(f"{name} {margin:.2g} m" for name, margin in smaller.items())
        return cls(margins, checked, in_words(names, ~checked), closer)

    def of_these(self, which: NDArray[np.bool_]) -> PairMargins:
        """Of some of the pairs, with the same words."""
        return replace(self, margins=self.margins[which], checked=self.checked[which])

    @property
    def unchecked(self) -> Iterator[str]:
        """In sentences."""
        if self.left_out:
            yield f"Not checked, as they are close at every pose: {'; '.join(self.left_out)}."
        if self.closer:
            yield f"Never far apart, and therefore checked with smaller margins: {'; '.join(self.closer)}."


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
