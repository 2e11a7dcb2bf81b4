"""A robot described as a tree of links and joints, and the serial arm in it: from a base link to a tip.

Fixed and locked joints merge their links into one body.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Literal

from symbolic.model_file.arm import Frame
from symbolic.model_file.checks import MAX_LABEL, ModelError, Place, nearest, printable, quote
from symbolic.model_file.frames import (
    LISTED,
    Rotation,
    Snapping,
    StatedBody,
    Vector,
    about,
    angles,
    composed,
    impossible_moment,
    listed,
    placed,
    rotation,
    scaled,
    together,
)
from symbolic.model_file.keys import MAX_JOINTS
from symbolic.model_file.model_text import DIGITS

NOWHERE = Frame()

MOVING: Mapping[str, Literal["revolute", "prismatic"]] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
}
"""Joint kinds that an arm may have, and their type in the model file."""
FREE = 1e9
"""A limit at or above this is no limit; written where URDF requires one."""


@dataclass(frozen=True)
class TreeLink:
    """A link. body: None where the file states none; solid: it has shapes, so that it is not just a frame."""

    name: str
    body: StatedBody | None
    solid: bool


@dataclass(frozen=True)
class TreeJoint:
    """A joint from one link to another.

    kind       one of MOVING, "fixed", or another word, which an arm cannot have
    origin     of the child's frame in the parent's at q = 0; axis in the child's frame
    position, speed, torque   limits; None where not stated
    dynamics   friction and springs by the simulators' words (see DescribedParameter.abroad)
    rotor      inertia at the output; None where not stated
    gears      every stated gear ratio (motor turns per joint turn), with its source
    mimics     the joint that it follows
    doubts     statements that are impossible or that a model file cannot express, an item each
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
        """Whether an arm may have such a joint."""
        return self.kind in MOVING

    @property
    def gear(self) -> float | None:
        """Motor turns per joint turn; None where the file states none or several different ones."""
        ratios = {ratio for _, ratio in self.gears}
        return ratios.pop() if len(ratios) == 1 else None


@dataclass(frozen=True)
class Tree:
    """A robot. file: for messages; language: URDF or MJCF; gravity: None where not stated."""

    file: str
    language: str
    name: str
    links: Mapping[str, TreeLink]
    joints: Mapping[str, TreeJoint]
    gravity: Vector | None = None
    notes: tuple[str, ...] = ()

    def above(self) -> dict[str, TreeJoint]:
        """The parent joint of each link; the root has none.

        Raises ModelError: a joint with a missing link, a link with two parent joints, or a loop.
        """
        found: dict[str, TreeJoint] = {}
        for joint in self.joints.values():
            for end, link in (("parent", joint.parent), ("child", joint.child)):
                if link not in self.links:
                    raise ModelError(
                        f"{self.file}: joint {quote(joint.name)}: its {end} {quote(link)} is not a link of the file"
                    )
            other = found.setdefault(joint.child, joint)
            if other is not joint:
                raise ModelError(
                    f"{self.file}: link {quote(joint.child)} has two parent joints, {quote(other.name)} and "
                    f"{quote(joint.name)}; expected a tree: remove one of them"
                )
        ends: set[str] = set()
        for name in self.links:
            way: set[str] = set()
            while name in found and name not in ends:
                if name in way:
                    through = quote(found[name].name)
                    raise ModelError(
                        f"{self.file}: link {quote(name)} is its own ancestor, through joint {through}; expected a tree"
                    )
                way.add(name)
                name = found[name].parent
            ends |= way
        return found

    def below(self) -> dict[str, list[TreeJoint]]:
        """The child joints of each link, in the file's order."""
        found: dict[str, list[TreeJoint]] = {name: [] for name in self.links}
        for joint in self.joints.values():
            found[joint.parent].append(joint)
        return found


LONGEST = 60
"""Maximum length of a name in a message."""
COMPARED = 1000
"""Maximum number of names that a mistyped one is compared with."""


@dataclass(frozen=True)
class ChainJoint:
    """A joint of the arm with the body that it moves.

    joint        as in the tree     origin   in the previous joint's frame
    body         None where unknown     links   the links that it consists of
    doubt        why a stated inertia was rejected, or ""
    loose        those of the links that are attached by movable joints, held at a fixed position
    loose_body   these links as one body
    """

    joint: TreeJoint
    origin: Frame
    body: StatedBody | None
    links: tuple[str, ...]
    doubt: str
    loose: tuple[str, ...]
    loose_body: StatedBody

    @property
    def type(self) -> Literal["revolute", "prismatic"]:
        """The joint's type in a model file."""
        return MOVING[self.joint.kind]


@dataclass(frozen=True)
class TreeChain:
    """A serial arm between two links.

    held       movable joints off the path from base to tip, held at a fixed position
    root       the tree's root link     mounting   the rotation of the base in the root
    """

    tree: Tree
    base: str
    tip_link: str
    joints: tuple[ChainJoint, ...]
    tip: Frame
    held: tuple[str, ...]
    root: str
    mounting: Rotation
    notes: tuple[str, ...]


def chain(tree: Tree, base: str | None, tip: str | None, locked: Mapping[str, float]) -> TreeChain:
    """The arm from the link `base` (None: the root) to the link `tip` (None: the only end).

    locked   joint -> fixed position, rad or m
    Raises ModelError, which says what to pass instead.
    """
    notes, snapping = list(_lock_notes(tree, locked)), Snapping()
    tree = replace(tree, joints={name: _settled(tree, joint, locked, snapping) for name, joint in tree.joints.items()})
    above, below = tree.above(), tree.below()
    roots = [name for name in tree.links if name not in above]
    if base is None and len(roots) > 1:
        raise ModelError(
            f"{tree.file}: {len(roots)} links have no parent: {some(roots)}; say where the arm begins: --base LINK"
        )
    root = roots[0] if base is None else _link(tree, base, "--base")
    end, note = (_link(tree, tip, "--tip"), "") if tip is not None else _only_end(tree, root, below)
    way, before = _way(tree, above, root, end), path_to(root, above)
    joints: list[ChainJoint] = []
    held: list[str] = []
    origin = Frame()
    for joint in way:
        origin = composed(origin, joint.origin)
        if joint.kind != "fixed":
            carried = list(_carried(joint.child, below, {one.name for one in way}, held))
            joints.append(_chain_joint(tree, joint, origin, carried))
            origin = Frame()
    turning = [joint.name for joint in before if joint.kind not in ("fixed", "prismatic")]
    if turning:
        notes.insert(
            0,
            f"{shortened(root)} is moved by {some(turning)}: gravity is taken with "
            f"{'it' if len(turning) == 1 else 'them'} at 0 (--lock JOINT=VALUE for another position)",
        )
    used = (*before, *way, *(above[link] for joint in joints for link in joint.links))
    return TreeChain(
        tree,
        root,
        end,
        joints=tuple(joints),
        tip=origin,
        held=tuple(held),
        root=before[0].parent if before else root,
        mounting=rotation(reduce(composed, (joint.origin for joint in before), Frame()).rpy),
        notes=(*([note] if note else []), *notes, *snapping.notes({_place(joint.name) for joint in used})),
    )


def _settled(tree: Tree, joint: TreeJoint, locked: Mapping[str, float], snapping: Snapping) -> TreeJoint:
    """The joint with exact quarter turns; fixed where it is locked."""
    where = _place(joint.name)
    axis = snapping.axis(Place(tree.file, where), where, joint.axis) if joint.kind in MOVING else joint.axis
    origin = snapping.frame(where, joint.origin)
    if joint.name not in locked:
        return replace(joint, origin=origin, axis=axis)
    value = locked[joint.name]
    if value and MOVING[joint.kind] == "prismatic":
        origin = composed(origin, Frame(scaled(value / math.hypot(*axis), axis)))
    elif value:
        origin = composed(origin, Frame(rpy=angles(about(axis, value))))
    return replace(joint, origin=origin, axis=axis, kind="fixed")


def path_to(link: str, above: Mapping[str, TreeJoint]) -> list[TreeJoint]:
    """The joints from the root to a link."""
    way: list[TreeJoint] = []
    while link in above:
        way.append(above[link])
        link = above[link].parent
    return way[::-1]


# --- which links ---


def _lock_notes(tree: Tree, locked: Mapping[str, float]) -> Iterator[str]:
    """Notes on joints locked outside their range. Raises ModelError for a joint that cannot be locked."""
    for name, value in locked.items():
        joint, place = tree.joints.get(name), f"{tree.file}: --lock {shortened(name)}"
        if joint is None:
            able = (one.name for one in tree.joints.values() if one.kind in MOVING)
            raise ModelError(f"{place}: no such joint; {_meant(name, able)}")
        if joint.kind not in MOVING:
            raise ModelError(f"{place}: the joint is {shortened(joint.kind)}; only {_or(MOVING)} can be locked")
        low, high = joint.position or (-math.inf, math.inf)
        if not low <= value <= high:
            yield f"{shortened(name)} is locked at {value:g}, outside its range of {low:g} to {high:g}"


def _link(tree: Tree, name: str, option: str) -> str:
    if name not in tree.links:
        raise ModelError(f"{tree.file}: {option} {shortened(name)}: no such link; {_meant(name, tree.links)}")
    return name


def _only_end(tree: Tree, root: str, below: Mapping[str, Sequence[TreeJoint]]) -> tuple[str, str]:
    """The link at which the arm ends, and a note if other links end there too (behind the same joint). Frames in front
    of a moving joint are not ends."""
    ends: dict[str, list[str]] = {}
    passed = {""}
    count = {"": 0}
    todo: list[tuple[str, str]] = [(root, "")]
    while todo:
        link, last = todo.pop()
        if not below[link]:
            ends.setdefault(last, []).append(link)
        for joint in reversed(below[link]):
            moves = joint.kind != "fixed"
            todo.append((joint.child, joint.name if moves else last))
            if moves:
                passed.add(last)
                count[joint.name] = count[last] + 1
    outermost = [links for joint, links in ends.items() if joint not in passed]
    if not outermost:
        raise ModelError(f"{tree.file}: no joint moves beyond {quote(root)}; say where the arm begins: --base LINK")
    if len(outermost) > 1:
        # The end of an arm is behind many joints, a camera is not.
        behind = sorted(filter(None, ends), key=lambda joint: -min(count[joint], MAX_JOINTS))
        names = [link for joint in behind for link in ends[joint]]
        raise ModelError(
            f"{tree.file}: {len(names)} links end the chains from {quote(root)}: {some(names)}; choose one: --tip LINK"
        )
    (links,) = outermost
    order = list(tree.links)
    links = sorted(links, key=lambda link: (link != TOOL, order.index(link)))
    others = f"; {some(links[1:])} {'ends' if len(links) == 2 else 'end'} at the same joint" if links[1:] else ""
    return links[0], f"the arm ends at {links[0]}{others} (--tip LINK for another)" if others else ""


TOOL = "tool0"
"""The flange's name in drivers of industrial arms (ROS-Industrial, REP-199)."""


def _way(tree: Tree, above: Mapping[str, TreeJoint], base: str, tip: str) -> list[TreeJoint]:
    """The joints from the base to the tip. Raises ModelError unless an arm can have those that move."""
    way = path_to(tip, above)
    first = next((k for k, joint in enumerate(way) if joint.parent == base), None)
    if first is None and tip != base:
        raise ModelError(
            f"{tree.file}: {quote(tip)} is not a descendant of {quote(base)}; expected a --tip that is connected "
            "to the --base by joints"
        )
    way = way[len(way) if first is None else first :]
    moving = [joint for joint in way if joint.kind != "fixed"]
    for joint in moving:
        _check_moves(tree, joint)
    between = f"between {quote(base)} and {quote(tip)}"
    if not moving:
        raise ModelError(f"{tree.file}: no joint moves {between}; choose others with --base and --tip")
    if len(moving) > MAX_JOINTS:
        raise ModelError(
            f"{tree.file}: {len(moving)} joints move {between}: {some([joint.name for joint in moving])}; expected at "
            f"most {MAX_JOINTS}: lock some with --lock JOINT=VALUE, or begin later or end earlier with --base and --tip"
        )
    return way


def _check_moves(tree: Tree, joint: TreeJoint) -> None:
    place = f"{tree.file}: joint {quote(joint.name)}"
    if joint.mimics is not None:
        raise ModelError(
            f"{place} follows {quote(joint.mimics)} (mimic), which an arm's joint cannot; lock it: --lock "
            f"{shortened(joint.name)}=VALUE, or end before it: --tip {shortened(joint.parent)}"
        )
    if joint.kind not in MOVING:
        close = nearest(joint.kind, (*MOVING, "fixed"))
        meant = f" (did you mean {quote(close)}?)" if close else ""
        raise ModelError(
            f"{place} is {shortened(joint.kind)}{meant}; an arm has {_or(MOVING)} joints: begin behind it: --base "
            f"{shortened(joint.child)}, or end before it: --tip {shortened(joint.parent)}"
        )


# --- what moves with what ---


def _place(name: str) -> str:
    return f"joint {shortened(name)}"


def _carried(
    link: str, below: Mapping[str, Sequence[TreeJoint]], on_the_way: Set[str], held: list[str]
) -> Iterator[_Carried]:
    """The links that move rigidly with a link, itself first, with their poses in its frame. Movable joints that are
    held fixed for this are appended to `held`."""
    todo = [_Carried(link, Frame(), loose=False)]
    while todo:
        one = todo.pop()
        yield one
        for joint in below[one.link]:
            moves = joint.kind != "fixed"
            if moves and joint.name in on_the_way:
                continue
            if moves:
                held.append(joint.name)
            todo.append(_Carried(joint.child, composed(one.frame, joint.origin), one.loose or moves))


@dataclass(frozen=True)
class _Carried:
    """A link that moves with another. loose: attached by a movable joint."""

    link: str
    frame: Frame
    loose: bool


def _chain_joint(tree: Tree, joint: TreeJoint, origin: Frame, carried: Sequence[_Carried]) -> ChainJoint:
    """The joint with its links as one body; unknown where its own link has shapes but no stated mass."""
    links = tuple(one.link for one in carried)
    bodies, loose, silent = [], [], []
    for one in carried:
        link = tree.links[one.link]
        if link.body is not None and not link.body.is_nothing:
            bodies.append(placed(link.body, one.frame))
            loose += bodies[-1:] if one.loose else []
        elif link.solid:
            silent.append(one.link)
    body, doubt = None, ""
    if joint.child not in silent and (bodies or tree.links[joint.child].body is not None):
        body = together(bodies)
        wrong = impossible_moment(body.inertia)
        if wrong is not None:
            doubt = f"the inertia of {some(links)} has the negative principal moment {wrong:.3g} kg m^2"
    held = tuple(one.link for one in carried if one.loose)
    return ChainJoint(joint, origin, body, links, doubt=doubt, loose=held, loose_body=together(loose))


# --- words ---


def joints_of(which: Sequence[bool]) -> str:
    """The selected joints of the arm, in words."""
    return (
        "all joints"
        if all(which) and len(which) > 1
        else listed([f"joint {k}" for k, is_it in enumerate(which, 1) if is_it])
    )


def _or(words: Mapping[str, str]) -> str:
    *first, last = words
    return f"{', '.join(first)} or {last}"


def _meant(name: str, known: Iterable[str]) -> str:
    names = list(known)
    close = nearest(name, names[:COMPARED])
    return f"did you mean {quote(close)}?" if close else f"it has {some(names)}"


def shortened(name: str) -> str:
    """A name for a message: printable, at most LONGEST letters."""
    return printable(name if len(name) <= LONGEST else f"{name[: LONGEST - 3]}...")


def some(names: Sequence[str]) -> str:
    """A list of names for a message, at most LISTED of them."""
    shown = ", ".join(shortened(name) for name in names[:LISTED])
    return shown if len(names) <= LISTED else f"{shown} and {len(names) - LISTED} more"


def label_of(name: str) -> str:
    """A joint's name with only the characters that a model file allows."""
    return re.sub(r"[^A-Za-z0-9_ .:/()-]", "_", name).lstrip(" .:/()-")[:MAX_LABEL] or "joint"


def gears_of(joint: TreeJoint) -> str:
    return some([f"{ratio:.{DIGITS}g} of {by}" for by, ratio in joint.gears])
