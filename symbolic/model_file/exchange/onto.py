"""A URDF rewritten in place: inertias, friction and gears of an arm's joints are the model's, and not a byte more
changes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

from symbolic.model_file.checks import ModelError, quote
from symbolic.model_file.exchange import xml_file
from symbolic.model_file.exchange.bodies import NOTHING, StatedBody
from symbolic.model_file.exchange.chain import ChainJoint, TreeChain, chain, joints_of, some
from symbolic.model_file.exchange.exporting import WORDS, ExportedArm, ExportedJoint, body_of, parameters
from symbolic.model_file.exchange.chain import gears_of, label_of
from symbolic.model_file.exchange.tree import Tree, TreeJoint
from symbolic.model_file.exchange.urdf import Reduction, reductions, urdf_tree
from symbolic.model_file.exchange.written import inertial, number
from symbolic.model_file.exchange.xml_file import XmlNode
from symbolic.model_file.frames import Vector, impossible_moment, rotation, scaled
from symbolic.model_file.model_text import DIGITS

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
