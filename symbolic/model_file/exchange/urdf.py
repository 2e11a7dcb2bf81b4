"""URDF read, and rewritten in place: an existing file gets the model's inertias, friction and gear ratios.

Meshes are not read. Source: the specification at wiki.ros.org/urdf/XML; ros2_control for <mechanical_reduction>.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar
from xml.sax.saxutils import quoteattr

from symbolic.model_file.arm import Frame
from symbolic.model_file.checks import ModelError, quote
from symbolic.model_file.exchange import xml_file
from symbolic.model_file.exchange.exporting import (
    WORDS,
    ExportedArm,
    ExportedJoint,
    body_of,
    inertial,
    number,
    parameters,
)
from symbolic.model_file.exchange.tree import (
    FREE,
    NOTHING,
    ChainJoint,
    StatedBody,
    Tree,
    TreeChain,
    TreeJoint,
    TreeLink,
    chain,
    gears_of,
    joints_of,
    label_of,
    shortened,
    some,
    turned,
)
from symbolic.model_file.exchange.xml_file import XmlNode
from symbolic.model_file.frames import Vector, impossible_moment, rotation, scaled
from symbolic.model_file.model_text import DIGITS

Made = TypeVar("Made", TreeLink, TreeJoint)
ZERO = (0.0, 0.0, 0.0)
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
REDUCTIONS = ("mechanicalReduction", "mechanical_reduction")
DYNAMICS = ("damping", "friction")


@dataclass(frozen=True)
class Reduction:
    """Turns of a motor a turn of its joint, above 0; by: of which transmission; node: where that stands, with a sign if
    the motor turns backwards."""

    by: str
    ratio: float
    node: XmlNode


def urdf_tree(root: XmlNode) -> Tree:
    """The robot that a URDF describes. Raises ModelError."""
    if any(node.tag.startswith("xacro:") for node in root.everything()):
        root.fail("is a xacro template and no URDF yet; expand it first: xacro FILE > robot.urdf")
    gears, doubted = reductions(root), _doubted_gears(root)
    links = _named(root, "link", _link)
    if not links:
        root.fail("the robot has no <link>; expected links and joints")
    joints = _named(root, "joint", lambda node: _joint(node, gears, doubted))
    return Tree(root.file, "URDF", root.attributes.get("name", ""), links, joints)


def _named(root: XmlNode, tag: str, made: Callable[[XmlNode], Made]) -> dict[str, Made]:
    found: dict[str, Made] = {}
    for node in root.all(tag):
        name = node.word("name")
        if name in found:
            node.fail(f"a second <{tag}> is called {quote(name)}; expected a name of its own")
        found[name] = made(node)
    return found


def _frame(node: XmlNode) -> Frame:
    """<origin> of an element; where it is left out, the frame itself."""
    origin = node.first("origin")
    if origin is None:
        return Frame()
    x, y, z = origin.numbers("xyz", 3, ZERO)
    roll, pitch, yaw = origin.numbers("rpy", 3, ZERO)
    return Frame((x, y, z), (roll, pitch, yaw))


def _link(node: XmlNode) -> TreeLink:
    solid = any(node.first(tag) is not None for tag in ("visual", "collision"))
    inertial = node.first("inertial")
    return TreeLink(node.word("name"), None if inertial is None else _body(inertial), solid)


def _body(inertial: XmlNode) -> StatedBody:
    mass = inertial.needed("mass").number("value")
    if mass < 0:
        inertial.fail(f"<mass> value is {mass:g}; expected a mass of 0 kg or more")
    stated, frame = inertial.first("inertia"), _frame(inertial)
    xx, xy, xz, yy, yz, zz = (0.0 if stated is None else _moment(stated, key) for key in MOMENTS)
    return StatedBody(mass, frame.xyz, turned((xx, xy, xz, yy, yz, zz), frame.rpy))


def _moment(stated: XmlNode, key: str) -> float:
    """Of an inertia; a product that is left out is 0, a moment that is left out nobody knows."""
    return stated.number(key, None if key[1] == key[2] else 0.0)


def _joint(node: XmlNode, gears: Mapping[str, Sequence[Reduction]], doubted: Mapping[str, Sequence[str]]) -> TreeJoint:
    name, kind = node.word("name"), node.word("type")
    parent, child = (node.needed(end).word("link") for end in ("parent", "child"))
    axis, limit, dynamics, mimic = (node.first(tag) for tag in ("axis", "limit", "dynamics", "mimic"))
    x, y, z = (1.0, 0.0, 0.0) if axis is None else axis.numbers("xyz", 3)
    position, speed, torque = (None, None, None) if limit is None else _limits(limit, kind)
    stated = {} if dynamics is None else {key: dynamics.number(key, 0.0) for key in DYNAMICS}
    return TreeJoint(
        name,
        kind,
        parent,
        child,
        _frame(node),
        (x, y, z),
        position,
        speed,
        torque,
        {key: value for key, value in stated.items() if value},
        gears=tuple((one.by, one.ratio) for one in gears.get(name, ())),
        mimics=None if mimic is None else mimic.word("joint"),
        doubts=(*(() if limit is None else _doubts(limit)), *doubted.get(name, ())),
    )


def _limits(limit: XmlNode, kind: str) -> tuple[tuple[float, float] | None, float | None, float | None]:
    """Position, speed and torque; what is 0, infinite or as good as infinite is no limit."""
    low, high = (limit.bound(key) or 0.0 for key in ("lower", "upper"))
    bounded = kind in ("revolute", "prismatic") and low < high and max(-low, high) < FREE
    endless = any(limit.attributes.get(key) is not None and limit.bound(key) is None for key in ("lower", "upper"))
    speed, torque = (limit.bound(key) for key in ("velocity", "effort"))
    return (
        (low, high) if bounded and not endless else None,
        speed if speed is not None and 0 < speed < FREE else None,
        torque if torque is not None and 0 < torque < FREE else None,
    )


def _doubts(limit: XmlNode) -> Iterator[str]:
    """What of <limit> cannot be one."""
    low, high = (limit.bound(key) for key in ("lower", "upper"))
    if low is not None and high is not None and low > high:
        yield f"its lower limit {low:g} is above the upper one, {high:g}"
    for key in ("velocity", "effort"):
        value = limit.bound(key)
        if value is not None and value < 0:
            yield f"its limit of {key} is {value:g}"


def reductions(root: XmlNode) -> dict[str, list[Reduction]]:
    """What the <transmission>s of a single joint state of its gears, by the joint's name."""
    found: dict[str, list[Reduction]] = {}
    for by, names, stated in _transmissions(root):
        for node in stated if len(names) == 1 else ():
            if ratio := _ratio(node):
                found.setdefault(names[0], []).append(Reduction(by, ratio, node))
    return found


def _ratio(reduction: XmlNode) -> float:
    """The number that stands in it, without its sign."""
    read = XmlNode(reduction.tag, {"value": reduction.text.strip()}, reduction.file, reduction.line)
    return abs(read.number("value"))


def _doubted_gears(root: XmlNode) -> dict[str, list[str]]:
    """What is stated and not taken, by the joint's name: gears of 0, and of motors that move the joint together with
    others, as those of a differential do."""
    found: dict[str, list[str]] = {}
    for by, names, stated in _transmissions(root):
        if len(names) == 1 and any(_ratio(node) == 0 for node in stated):
            found.setdefault(names[0], []).append(f"the gear of {by}, which is 0")
        for name in names if len(names) > 1 and stated else ():
            others = some([other for other in names if other != name])
            found.setdefault(name, []).append(f"the gear of {by}, whose motors move {others} too")
    return found


def _transmissions(root: XmlNode) -> Iterator[tuple[str, list[str], list[XmlNode]]]:
    """What each <transmission> is called, its joints, and the elements of its reductions."""
    for transmission in root.deep("transmission"):
        names = dict.fromkeys(node.attributes.get("name", "") for node in transmission.deep("joint"))
        stated = [node for tag in REDUCTIONS for node in transmission.deep(tag) if node.text.strip()]
        yield f"transmission {shortened(transmission.attributes.get('name') or 'without a name')}", list(names), stated


Stated = float | tuple[float, float] | None
"""A limit or a ratio."""
SAME_PLACE = 1e-6
"""m, and of a rotation's entries; a joint of the file that is off by more stands elsewhere than that of the model."""


@dataclass(frozen=True)
class _Edit:
    """Bytes start to end of the file are replaced."""

    start: int
    end: int
    text: str


@dataclass(frozen=True)
class Rewritten:
    """The bytes of a file into which a model was written; kept: what it says otherwise than the model, an item each."""

    data: bytes
    kept: tuple[str, ...]


def urdf_onto(made: ExportedArm, path: Path) -> Rewritten:
    """The file with the model's bodies, friction and gears at the joints of the same names; what is fixed to a link of
    the arm is part of its body, and loses its own. What hangs on joints off its way, such as fingers, keeps its own.

    Raises ModelError: no such joint, one that stands elsewhere, or a body lighter than what hangs on it.
    """
    root = xml_file.read(path)
    if root.tag != "robot":
        root.fail(f"its root is <{root.tag}>; expected a URDF to write into")
    tree = urdf_tree(root)
    found = _chain(tree, made)
    _check_places(tree, found, made)
    data = path.read_bytes()
    if data[:2] in (b"\xfe\xff", b"\xff\xfe"):
        root.fail("is written in UTF-16; save it as UTF-8")
    links = {node.word("name"): node for node in root.all("link")}
    joints = {node.word("name"): node for node in root.all("joint")}
    gears = reductions(root)
    edits: list[_Edit] = []
    for stated, joint in zip(found.joints, made.joints, strict=True):
        own, *carried = stated.links
        fixed = [name for name in carried if name not in stated.loose]
        body = _without_loose(tree, stated, joint.body)
        parts = [node for name in fixed if (node := links[name].first("inertial")) is not None]
        edits += [_removed(data, node) for node in parts]
        if parts or not _is_body(tree.links[own].body, body):
            edits.append(_put(data, links[own], "inertial", "\n".join(inertial(body, "    ")).strip()))
        there = joints[stated.joint.name]
        if not _is_dynamics(there.first("dynamics"), dynamics := _dynamics(there, joint)):
            edits.append(_put(data, there, "dynamics", _element("dynamics", dynamics)))
        if stated.joint.gear is not None:
            edits += _geared(data, gears[stated.joint.name], joint.joint.gear_ratio)
    for edit in sorted(edits, key=lambda edit: edit.start, reverse=True):
        data = data[: edit.start] + edit.text.encode() + data[edit.end :]
    return Rewritten(data, tuple(_kept(found, made)))


def _without_loose(tree: Tree, stated: ChainJoint, body: StatedBody) -> StatedBody:
    """Of a body that the model has, what is left beside those that move by joints of their own, held where they are 0.

    Raises ModelError where that is no body.
    """
    loose = stated.loose_body
    if loose.is_nothing:
        return body
    whole, part = parameters(body), parameters(loose)
    left = [a - b for a, b in zip(whole, part, strict=True)]
    made = body_of(left) if left[0] > 0 else NOTHING
    if made.mass <= 0 or impossible_moment(made.inertia) is not None:
        raise ModelError(
            f"{tree.file}: joint {quote(stated.joint.name)}: beside what hangs there by joints of its own "
            f"({some(stated.loose)}; {loose.mass:.4g} kg) no body is left of the model's {body.mass:.4g} kg; "
            "leave --onto out"
        )
    return made


def _is_body(stated: StatedBody | None, body: StatedBody) -> bool:
    """Whether what a file states of a link is the model's body, but for the digits to which models are written."""
    if stated is None:
        return False
    there, own = parameters(stated), parameters(body)
    # Mass, its moments and inertias, each beside the largest of its kind.
    return all(
        max(abs(a - b) for a, b in zip(there[kind], own[kind], strict=True)) <= SAME_NUMBER * max(map(abs, own[kind]))
        for kind in (slice(1), slice(1, 4), slice(4, None))
    )


def _is_dynamics(there: XmlNode | None, wanted: Mapping[str, str]) -> bool:
    """Whether <dynamics> says what is wanted, in whatever digits."""
    if there is None or there.attributes.keys() != wanted.keys():
        return False
    return all(
        value == wanted[key] or there.number(key) == float(wanted[key]) for key, value in there.attributes.items()
    )


def _element(tag: str, attributes: Mapping[str, str]) -> str:
    return f"<{tag} {' '.join(f'{key}={quoteattr(value)}' for key, value in attributes.items())}/>"


def _dynamics(there: XmlNode, joint: ExportedJoint) -> dict[str, str]:
    """What <dynamics> of a joint says: with what the model does not know, and with what other programs read, as it
    was."""
    before = there.first("dynamics")
    attributes = {} if before is None else dict(before.attributes)
    for word in WORDS["urdf"]:
        if word not in joint.unknown or word not in attributes:
            attributes[word] = number(joint.dynamics.get(word, 0.0))
    return attributes


def _geared(data: bytes, stated: Sequence[Reduction], ratio: float) -> Iterator[_Edit]:
    """Another ratio in what transmissions state; the sign, the motor's direction, stays."""
    for one in stated:
        if not _equal(one.ratio, ratio):
            sign = "-" if one.node.text.strip().startswith("-") else ""
            yield _Edit(_tag_end(data, one.node.start), one.node.close, sign + number(ratio))


def _kept(found: TreeChain, made: ExportedArm) -> Iterator[str]:
    """What of the file stays otherwise than the model has it."""
    pairs = [(there.joint, own.joint) for there, own in zip(found.joints, made.joints, strict=True)]
    unstated = [not there.gears and own.gear_ratio != 1 for there, own in pairs]
    if any(unstated):
        yield f"gear_ratio of {joints_of(unstated)}, for which it states none"
    for k, (there, _) in enumerate(pairs, 1):
        if there.gears and there.gear is None:
            yield f"gear_ratio of joint {k}, for which it states several ({gears_of(there)})"
    for key in ("position", "speed", "torque"):
        other = [not _equal(getattr(there, key), getattr(own.limits, key)) for there, own in pairs]
        if any(other):
            yield f"limits.{key} of {joints_of(other)}"


SAME_NUMBER = 10.0 ** -(DIGITS - 1)
"""Part of a number that is rounded away where a model is written."""


def _equal(left: Stated, right: Stated) -> bool:
    """Whether two numbers, or two pairs of them, are one but for rounding; or nothing is stated twice."""
    if left is None or right is None:
        return left is right
    ends = [[end] if isinstance(end, float) else end for end in (left, right)]
    return all(math.isclose(a, b, rel_tol=SAME_NUMBER) for a, b in zip(*ends, strict=True))


_TAG = re.compile(rb"""<[^"'>]*(?:"[^"]*"[^"'>]*|'[^']*'[^"'>]*)*>""")
"""A tag from its bracket to its bracket, whatever stands in its attributes."""


def _put(data: bytes, node: XmlNode, tag: str, text: str) -> _Edit:
    """The element `tag` in a node is `text`, in place of the one that is there, or else at its beginning."""
    there = node.first(tag)
    if there is not None:
        return _Edit(there.start, _end(data, there), text)
    opening = _tag_end(data, node.start)
    if _is_empty(data, node):
        return _Edit(opening - 2, opening, f">\n    {text}\n  </{node.tag}>")
    return _Edit(opening, opening, f"\n    {text}")


def _removed(data: bytes, node: XmlNode) -> _Edit:
    return _Edit(node.start, _end(data, node), "")


def _tag_end(data: bytes, start: int) -> int:
    match = _TAG.match(data, start)
    assert match, "a tag that has been parsed"
    return match.end()


def _end(data: bytes, node: XmlNode) -> int:
    """Behind an element."""
    return _tag_end(data, node.start if _is_empty(data, node) else node.close)


def _is_empty(data: bytes, node: XmlNode) -> bool:
    """Whether it is one tag that opens and closes."""
    end = _tag_end(data, node.start)
    return data[end - 2 : end] == b"/>"


def _chain(tree: Tree, made: ExportedArm) -> TreeChain:
    """The file's arm from the first to the last of the model's joints; others in between are held where they are 0."""
    by_label = {label_of(joint.name): joint for joint in tree.joints.values()}
    own: list[TreeJoint] = []
    for joint in made.joints:
        if joint.name not in by_label:
            raise ModelError(f"{tree.file}: no joint is called {quote(joint.name)}, as one of the model is")
        own.append(by_label[joint.name])
    names = {joint.name for joint in own}
    way = list(_down(tree, own[-1].child))
    others = {joint.name: 0.0 for joint in way if joint.name not in names and joint.moves}
    return chain(tree, way[-1].parent, own[-1].child, others)


def _down(tree: Tree, link: str) -> Iterator[TreeJoint]:
    """The joints from a link to the bottom of all."""
    above = tree.above()
    while link in above:
        yield above[link]
        link = above[link].parent


def _check_places(tree: Tree, found: TreeChain, made: ExportedArm) -> None:
    """Every joint but the first, whose base may be another, stands where the model has it."""
    if len(found.joints) != len(made.joints):
        raise ModelError(f"{tree.file}: its joints stand in another order than the model's")
    for k, (there, own) in enumerate(zip(found.joints, made.joints, strict=True)):
        if there.joint.name != own.name and label_of(there.joint.name) != own.name:
            raise ModelError(f"{tree.file}: joint {quote(own.name)} comes elsewhere in the chain than in the model")
        if k > 0 and not _same(there.origin.xyz, own.joint.origin.xyz):
            raise ModelError(f"{tree.file}: joint {quote(own.name)} stands elsewhere than in the model: another arm?")
        if there.type != own.joint.type or not _same(_direction(there.joint.axis), _direction(own.joint.axis)):
            raise ModelError(f"{tree.file}: joint {quote(own.name)} moves otherwise than in the model: another arm?")
        left, right = (rotation(frame.rpy) for frame in (there.origin, own.joint.origin))
        if k > 0 and not all(_same(a, b) for a, b in zip(left, right, strict=True)):
            raise ModelError(
                f"{tree.file}: joint {quote(own.name)} is turned otherwise than in the model: another arm?"
            )


def _direction(axis: Vector) -> Vector:
    return scaled(1 / math.hypot(*axis), axis)


def _same(left: Vector, right: Vector) -> bool:
    return all(abs(a - b) < SAME_PLACE for a, b in zip(left, right, strict=True))
