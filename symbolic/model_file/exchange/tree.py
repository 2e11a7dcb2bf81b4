"""A robot as other programs describe it: links joined into a tree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from symbolic.model_file.arm import Frame
from symbolic.model_file.checks import ModelError, quote
from symbolic.model_file.exchange.bodies import StatedBody
from symbolic.model_file.frames import Vector

MOVING: Mapping[str, Literal["revolute", "prismatic"]] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
}
"""Kinds of joints that an arm may have -> their type in the model file."""
FREE = 1e9
"""A limit from which on it is none: where URDF wants one."""


@dataclass(frozen=True)
class TreeLink:
    """body: None where the file states none; solid: it is drawn or collides, so that it is no mere frame."""

    name: str
    body: StatedBody | None
    solid: bool


@dataclass(frozen=True)
class TreeJoint:
    """A joint from one link to another.

    kind       one of MOVING, "fixed", or another word, which no arm may have
    origin     of the child's frame in the parent's at q = 0; axis in the child's frame
    position, speed, torque   limits, None: not stated
    dynamics   what simulators' files say of friction and springs at it, by their word (see DescribedParameter.abroad)
    rotor      inertia at the output; None: not stated
    gears      every statement of turns of a motor a turn of the joint: by whom, and how many
    mimics     the joint that it follows
    doubts     what the file states of it that cannot be or that an arm has no words for, an item each
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Frame = field(default_factory=Frame)
    axis: Vector = (0.0, 0.0, 1.0)
    position: tuple[float, float] | None = None
    speed: float | None = None
    torque: float | None = None
    dynamics: Mapping[str, float] = field(default_factory=dict)
    rotor: float | None = None
    gears: tuple[tuple[str, float], ...] = ()
    mimics: str | None = None
    doubts: tuple[str, ...] = ()

    @property
    def moves(self) -> bool:
        """Whether it could be held somewhere."""
        return self.kind in MOVING

    @property
    def gear(self) -> float | None:
        """Turns of the motor a turn of the joint; None where the file states none, or several that differ."""
        ratios = {ratio for _, ratio in self.gears}
        return ratios.pop() if len(ratios) == 1 else None


@dataclass(frozen=True)
class Tree:
    """file: for messages; language: URDF or MJCF; gravity: None where the file says nothing of it."""

    file: str
    language: str
    name: str
    links: Mapping[str, TreeLink]
    joints: Mapping[str, TreeJoint]
    gravity: Vector | None = None
    notes: tuple[str, ...] = ()

    def above(self) -> dict[str, TreeJoint]:
        """The joint that each link hangs on; the root has none.

        Raises ModelError: a joint of a link that is not there, a link that hangs on two joints, or on itself.
        """
        found: dict[str, TreeJoint] = {}
        for joint in self.joints.values():
            for end, link in (("parent", joint.parent), ("child", joint.child)):
                if link not in self.links:
                    raise ModelError(
                        f"{self.file}: joint {quote(joint.name)}: its {end} {quote(link)} is no link of the file"
                    )
            other = found.setdefault(joint.child, joint)
            if other is not joint:
                raise ModelError(
                    f"{self.file}: link {quote(joint.child)} hangs on two joints, {quote(other.name)} and "
                    f"{quote(joint.name)}; expected a tree: take one of them out"
                )
        self._check_roots(found)
        return found

    def _check_roots(self, above: Mapping[str, TreeJoint]) -> None:
        """From every link one comes, upwards, to an end. Raises ModelError."""
        ends: set[str] = set()
        for name in self.links:
            way: dict[str, None] = {}
            while name in above and name not in ends:
                if name in way:
                    joint = quote(above[name].name)
                    raise ModelError(
                        f"{self.file}: link {quote(name)} hangs on itself, by joint {joint}; expected a tree"
                    )
                way[name] = None
                name = above[name].parent
            ends.update(way)

    def below(self) -> dict[str, list[TreeJoint]]:
        """The joints that hang on each link, in the file's order."""
        found: dict[str, list[TreeJoint]] = {name: [] for name in self.links}
        for joint in self.joints.values():
            found[joint.parent].append(joint)
        return found
