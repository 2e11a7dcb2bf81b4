"""URDF read: links, joints and transmissions, without meshes, by the standard library's XML.

Source: the specification at wiki.ros.org/urdf/XML; ros2_control for <mechanical_reduction>.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from symbolic.model_file.arm import Frame
from symbolic.model_file.checks import quote
from symbolic.model_file.exchange.bodies import StatedBody, turned
from symbolic.model_file.exchange.chain import shortened, some
from symbolic.model_file.exchange.tree import FREE, Tree, TreeJoint, TreeLink
from symbolic.model_file.exchange.xml_file import XmlNode

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
