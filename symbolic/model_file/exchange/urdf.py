"""URDF read, and rewritten in place: an existing file gets the model's inertias, friction and gear ratios.

Its shapes are read in shapes.py. Source: the specification at wiki.ros.org/urdf/XML; ros2_control for
<mechanical_reduction>.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar
from xml.sax.saxutils import quoteattr

from symbolic.elements import Damper, DryFriction
from symbolic.model_file.arm import Frame
from symbolic.model_file.checks import ModelError, quote
from symbolic.model_file.exchange import xml_file
from symbolic.model_file.exchange.exporting import (
    ExportedArm,
    ExportedJoint,
    body_of,
    inertial,
    number,
)
from symbolic.model_file.exchange.tree import (
    FREE,
    ChainJoint,
    Tree,
    TreeChain,
    TreeJoint,
    TreeLink,
    chain,
    gears_of,
    joints_of,
    label_of,
    path_to,
    shortened,
    some,
)
from symbolic.model_file.exchange.xml_file import XmlNode
from symbolic.model_file.frames import (
    NO_BODY,
    StatedBody,
    Vector,
    impossible_moment,
    parameters,
    rotated,
    rotation,
    scaled,
)
from symbolic.model_file.model_text import DIGITS

Made = TypeVar("Made", TreeLink, TreeJoint)
ZERO = (0.0, 0.0, 0.0)
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
REDUCTIONS = ("mechanicalReduction", "mechanical_reduction")
DYNAMICS = ("damping", "friction")


@dataclass(frozen=True)
class Reduction:
    """A stated gear ratio (motor turns per joint turn, above 0).

    by     the transmission     node   the element with the number, negative if the motor turns backwards
    """

    by: str
    ratio: float
    node: XmlNode


def urdf_tree(root: XmlNode) -> Tree:
    """The robot that a URDF describes. Raises ModelError."""
    if any(node.tag.startswith("xacro:") for node in root.everything()):
        root.fail("is a xacro template, not a URDF; expand it first: xacro FILE > robot.urdf")
    gears, doubted = _transmissions(root)
    links = _named(root, "link", _link)
    if not links:
        root.fail("the robot has no <link>; expected links and joints")
    joints = _named(root, "joint", lambda node: _joint(node, gears, doubted))
    return Tree(root.file, "URDF", root.attributes.get("name", ""), links=links, joints=joints)


def _named(root: XmlNode, tag: str, made: Callable[[XmlNode], Made]) -> dict[str, Made]:
    found: dict[str, Made] = {}
    for node in root.all(tag):
        name = node.word("name")
        if name in found:
            node.fail(f"a second <{tag}> is named {quote(name)}; expected unique names")
        found[name] = made(node)
    return found


def frame_of(node: XmlNode) -> Frame:
    """<origin> of an element; identity if it is missing."""
    origin = node.first("origin")
    if origin is None:
        return Frame()
    x, y, z = origin.numbers("xyz", 3, ZERO)
    roll, pitch, yaw = origin.numbers("rpy", 3, ZERO)
    return Frame((x, y, z), (roll, pitch, yaw))


def _link(node: XmlNode) -> TreeLink:
    name, inertial = node.word("name"), node.first("inertial")
    solid = any(node.first(tag) is not None for tag in ("visual", "collision"))
    if inertial is None:
        return TreeLink(name, None, solid)
    mass = inertial.needed("mass").number("value")
    if mass < 0:
        inertial.fail(f"<mass> value is {mass:g}; expected a mass of 0 kg or more")
    stated, frame = inertial.first("inertia"), frame_of(inertial)
    # Missing products are 0, missing moments are an error.
    xx, xy, xz, yy, yz, zz = (
        0.0 if stated is None else stated.number(key, None if key[1] == key[2] else 0.0) for key in MOMENTS
    )
    return TreeLink(name, StatedBody(mass, frame.xyz, rotated((xx, xy, xz, yy, yz, zz), frame.rpy)), solid)


def _joint(node: XmlNode, gears: Mapping[str, Sequence[Reduction]], doubted: Mapping[str, Sequence[str]]) -> TreeJoint:
    name, kind = node.word("name"), node.word("type")
    parent, child = (node.needed(end).word("link") for end in ("parent", "child"))
    axis, limit, dynamics, mimic = (node.first(tag) for tag in ("axis", "limit", "dynamics", "mimic"))
    x, y, z = (1.0, 0.0, 0.0) if axis is None else axis.numbers("xyz", 3)
    position, speed, torque, doubts = (None, None, None, ()) if limit is None else _limits(limit, kind)
    stated = {} if dynamics is None else {key: dynamics.number(key, 0.0) for key in DYNAMICS}
    return TreeJoint(
        name,
        kind,
        parent,
        child=child,
        origin=frame_of(node),
        axis=(x, y, z),
        position=position,
        speed=speed,
        torque=torque,
        dynamics={key: value for key, value in stated.items() if value},
        gears=tuple((one.by, one.ratio) for one in gears.get(name, ())),
        mimics=None if mimic is None else mimic.word("joint"),
        doubts=(*doubts, *dict.fromkeys(doubted.get(name, ()))),
    )


def _limits(limit: XmlNode, kind: str) -> tuple[tuple[float, float] | None, float | None, float | None, Sequence[str]]:
    """Limits of position, speed and torque, and impossible ones; 0, infinite or huge values are no limits."""
    stated = {key: limit.bound(key) for key in ("lower", "upper", "velocity", "effort")}
    low, high = (stated[key] or 0.0 for key in ("lower", "upper"))
    bounded = kind in ("revolute", "prismatic") and low < high and max(-low, high) < FREE
    endless = any(limit.attributes.get(key) is not None and stated[key] is None for key in ("lower", "upper"))
    speed, torque = stated["velocity"] or 0.0, stated["effort"] or 0.0
    doubts = [f"its limit of {key} is {stated[key]:g}" for key in ("velocity", "effort") if (stated[key] or 0.0) < 0]
    if stated["lower"] is not None and stated["upper"] is not None and low > high:
        doubts.insert(0, f"its lower limit {low:g} is above the upper one, {high:g}")
    return (
        (low, high) if bounded and not endless else None,
        speed if 0 < speed < FREE else None,
        torque if 0 < torque < FREE else None,
        doubts,
    )


def _transmissions(root: XmlNode) -> tuple[dict[str, list[Reduction]], dict[str, list[str]]]:
    """Gear ratios from the <transmission>s that drive a single joint, and reasons for which others are rejected, by the
    joint's name. Rejected are ratios of 0 and those of several joints, such as differentials."""
    found: dict[str, list[Reduction]] = {}
    doubted: dict[str, list[str]] = {}
    for transmission in root.deep("transmission"):
        by = f"transmission {shortened(transmission.attributes.get('name') or 'without a name')}"
        names = list(dict.fromkeys(node.attributes.get("name", "") for node in transmission.deep("joint")))
        nodes = [node for tag in REDUCTIONS for node in transmission.deep(tag) if node.text.strip()]
        for node in nodes if len(names) == 1 else ():
            stated = XmlNode(node.tag, {"value": node.text.strip()}, node.file, node.line)
            if ratio := abs(stated.number("value")):
                found.setdefault(names[0], []).append(Reduction(by, ratio, node))
            else:
                doubted.setdefault(names[0], []).append(f"the gear of {by}, which is 0")
        for name in names if len(names) > 1 and nodes else ():
            others = some([other for other in names if other != name])
            doubted.setdefault(name, []).append(f"the gear of {by}, whose motors move {others} too")
    return found, doubted


Stated = float | tuple[float, float] | None
"""A limit or a ratio, as a file states it."""
SAME_PLACE = 1e-6
"""Tolerance for equal poses: m, and entries of a rotation matrix."""


@dataclass(frozen=True)
class _Edit:
    """Replaces the bytes start to end of the file."""

    start: int
    end: int
    text: str


def urdf_onto(made: ExportedArm, path: Path) -> tuple[bytes, list[str]]:
    """Write the model's bodies, friction and gear ratios into a URDF, at the joints of the same names.

    Links fixed to a link of the arm become part of its body and lose their own inertia; links on other movable joints,
    such as fingers, keep theirs. Returns the new file, and its statements that differ from the model and are kept.
    Raises ModelError: no such joint, a joint with another pose, or a body lighter than the links attached to it.
    """
    root = xml_file.read(path)
    if root.tag != "robot":
        root.fail(f"its root is <{root.tag}>; expected a URDF to write into")
    tree = urdf_tree(root)
    found = _chain(tree, made)
    data = path.read_bytes()
    if data[:2] in (b"\xfe\xff", b"\xff\xfe"):
        root.fail("is written in UTF-16; save it as UTF-8")
    links = {node.word("name"): node for node in root.all("link")}
    joints = {node.word("name"): node for node in root.all("joint")}
    gears, _ = _transmissions(root)
    edits: list[_Edit] = []
    for stated, joint in zip(found.joints, made.joints, strict=True):
        own, *carried = stated.links
        fixed = [name for name in carried if name not in stated.loose]
        body = _without_loose(tree, stated, joint.body)
        parts = [node for name in fixed if (node := links[name].first("inertial")) is not None]
        edits += [_Edit(node.start, _end(data, node), "") for node in parts]
        if parts or not _is_body(tree.links[own].body, body):
            edits.append(_put(data, links[own], "inertial", "\n".join(inertial(body, "    ")).strip()))
        there = joints[stated.joint.name]
        if (dynamics := _dynamics(there.first("dynamics"), joint)) is not None:
            stated_as = " ".join(f"{key}={quoteattr(value)}" for key, value in dynamics.items())
            edits.append(_put(data, there, "dynamics", f"<dynamics {stated_as}/>"))
        for one in gears[stated.joint.name] if stated.joint.gear is not None else ():
            if not _equal(one.ratio, joint.joint.gear_ratio):
                # The sign, which is the motor's direction, stays.
                sign = "-" if one.node.text.strip().startswith("-") else ""
                ratio = sign + number(joint.joint.gear_ratio)
                edits.append(_Edit(_tag_end(data, one.node.start), one.node.close, ratio))
    for edit in sorted(edits, key=lambda edit: edit.start, reverse=True):
        data = data[: edit.start] + edit.text.encode() + data[edit.end :]
    return data, list(_kept(found, made))


def _without_loose(tree: Tree, stated: ChainJoint, body: StatedBody) -> StatedBody:
    """The model's body minus the links attached by movable joints, at joint position 0.

    Raises ModelError if the remainder is not a possible body.
    """
    loose = stated.loose_body
    if loose.is_nothing:
        return body
    whole, part = parameters(body), parameters(loose)
    left = [a - b for a, b in zip(whole, part, strict=True)]
    made = body_of(left) if left[0] > 0 else NO_BODY
    if made.mass <= 0 or impossible_moment(made.inertia) is not None:
        raise ModelError(
            f"{tree.file}: joint {quote(stated.joint.name)}: the links attached there by movable joints "
            f"({some(stated.loose)}; {loose.mass:.4g} kg) leave no possible body of the model's {body.mass:.4g} kg; "
            "export without --onto"
        )
    return made


def _is_body(stated: StatedBody | None, body: StatedBody) -> bool:
    """Whether a link's stated body equals the model's, up to the digits that model files have."""
    if stated is None:
        return False
    there, own = parameters(stated), parameters(body)
    # Mass, first moments and inertias, each relative to the largest of its kind.
    return all(
        max(abs(a - b) for a, b in zip(there[kind], own[kind], strict=True)) <= SAME_NUMBER * max(map(abs, own[kind]))
        for kind in (slice(1), slice(1, 4), slice(4, None))
    )


def _dynamics(there: XmlNode | None, joint: ExportedJoint) -> dict[str, str] | None:
    """Attributes of <dynamics>: the model's values; attributes that are unknown to the model stay as they are. None if
    the element already states these numbers."""
    before = {} if there is None else there.attributes
    wanted = dict(before)
    for word, kind, value in (("damping", Damper, joint.damping), ("friction", DryFriction, joint.friction)):
        if kind not in joint.unknown or value or word not in wanted:
            wanted[word] = number(value)
    if there is None or before.keys() != wanted.keys():
        return wanted
    same = all(value == wanted[key] or there.number(key) == float(wanted[key]) for key, value in before.items())
    return None if same else wanted


def _kept(found: TreeChain, made: ExportedArm) -> Iterator[str]:
    """Statements of the file that differ from the model and are kept."""
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
"""Relative tolerance for equal numbers: model files have DIGITS digits."""


def _equal(left: Stated, right: Stated) -> bool:
    """Whether two numbers or pairs are equal up to rounding, or both None."""
    if left is None or right is None:
        return left is right
    ends = [[end] if isinstance(end, float) else end for end in (left, right)]
    return all(math.isclose(a, b, rel_tol=SAME_NUMBER) for a, b in zip(*ends, strict=True))


_TAG = re.compile(rb"""<[^"'>]*(?:"[^"]*"[^"'>]*|'[^']*'[^"'>]*)*>""")
"""A whole tag, with any attributes."""


def _put(data: bytes, node: XmlNode, tag: str, text: str) -> _Edit:
    """An edit that replaces the child element `tag` by `text`, or inserts it at the beginning."""
    there = node.first(tag)
    if there is not None:
        return _Edit(there.start, _end(data, there), text)
    opening = _tag_end(data, node.start)
    if _is_empty(data, node):
        return _Edit(opening - 2, opening, f">\n    {text}\n  </{node.tag}>")
    return _Edit(opening, opening, f"\n    {text}")


def _tag_end(data: bytes, start: int) -> int:
    match = _TAG.match(data, start)
    assert match, "a tag that has been parsed"
    return match.end()


def _end(data: bytes, node: XmlNode) -> int:
    return _tag_end(data, node.start if _is_empty(data, node) else node.close)


def _is_empty(data: bytes, node: XmlNode) -> bool:
    end = _tag_end(data, node.start)
    return data[end - 2 : end] == b"/>"


def _chain(tree: Tree, made: ExportedArm) -> TreeChain:
    """The file's chain from the first to the last of the model's joints; other joints in between are locked at 0.

    Raises ModelError unless every joint has the model's pose, except for the first, whose base may differ.
    """
    by_label = {label_of(joint.name): joint for joint in tree.joints.values()}
    names = set()
    for joint in made.joints:
        if joint.name not in by_label:
            raise ModelError(f"{tree.file}: has no joint {quote(joint.name)}, which the model has")
        last = by_label[joint.name]
        names.add(last.name)
    way = path_to(last.child, tree.above())
    others = {joint.name: 0.0 for joint in way if joint.name not in names and joint.moves}
    found = chain(tree, way[0].parent, last.child, others)
    if len(found.joints) != len(made.joints):
        raise ModelError(f"{tree.file}: its joints are in another order than the model's")
    for k, (there, own) in enumerate(zip(found.joints, made.joints, strict=True)):
        place = f"{tree.file}: joint {quote(own.name)} has another"
        if there.joint.name != own.name and label_of(there.joint.name) != own.name:
            raise ModelError(f"{place} position in the chain than in the model")
        left, right = (rotation(frame.rpy) for frame in (there.origin, own.joint.origin))
        axes = (scaled(1 / math.hypot(*axis), axis) for axis in (there.joint.axis, own.joint.axis))
        for what, same in (
            ("origin", k == 0 or _same(there.origin.xyz, own.joint.origin.xyz)),
            ("type or axis", there.type == own.joint.type and _same(*axes)),
            ("rotation", k == 0 or all(_same(a, b) for a, b in zip(left, right, strict=True))),
        ):
            if not same:
                raise ModelError(f"{place} {what} than in the model: another arm?")
    return found


def _same(left: Vector, right: Vector) -> bool:
    return all(abs(a - b) < SAME_PLACE for a, b in zip(left, right, strict=True))
