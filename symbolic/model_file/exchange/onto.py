"""A URDF rewritten in place: inertias and friction of an arm's joints are the model's, and not a byte more changes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from symbolic.model_file.checks import ModelError, quote
from symbolic.model_file.exchange import urdf, xml_file
from symbolic.model_file.exchange.chain import TreeChain, chain
from symbolic.model_file.exchange.exporting import ExportedArm
from symbolic.model_file.exchange.importing import label_of
from symbolic.model_file.exchange.tree import Tree, TreeJoint
from symbolic.model_file.exchange.written import dynamics, inertial
from symbolic.model_file.exchange.xml_file import XmlNode
from symbolic.model_file.frames import rotation

SAME_PLACE = 1e-6
"""m, and of a rotation's entries; a joint of the file that is off by more stands elsewhere than that of the model."""


@dataclass(frozen=True)
class _Edit:
    """Bytes start to end of the file are replaced."""

    start: int
    end: int
    text: str


def urdf_onto(made: ExportedArm, path: Path) -> bytes:
    """The file with the model's bodies and friction at the joints of the same names; what is fixed to a link of the arm
    is part of its body, and loses its own.

    Raises ModelError: no such joint, or one that stands elsewhere.
    """
    root = xml_file.read(path)
    if root.tag != "robot":
        root.fail(f"its root is <{root.tag}>; expected a URDF to write into")
    tree = urdf.tree(root)
    found = _chain(tree, made)
    _check_places(tree, found, made)
    data = path.read_bytes()
    if data[:2] in (b"\xfe\xff", b"\xff\xfe"):
        root.fail("is written in UTF-16; save it as UTF-8")
    links = {node.word("name"): node for node in root.all("link")}
    joints = {node.word("name"): node for node in root.all("joint")}
    edits: list[_Edit] = []
    for stated, joint in zip(found.joints, made.joints, strict=True):
        own, *fixed = stated.links
        edits.append(_put(data, links[own], "inertial", "\n".join(inertial(joint.body, "    ")).strip()))
        edits += [_removed(data, node) for name in fixed if (node := links[name].first("inertial")) is not None]
        edits.append(_put(data, joints[stated.joint.name], "dynamics", dynamics(joint)))
    for edit in sorted(edits, key=lambda edit: edit.start, reverse=True):
        data = data[: edit.start] + edit.text.encode() + data[edit.end :]
    return data


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
    others = {joint.name: 0.0 for joint in tree.joints.values() if joint.name not in names and joint.moves}
    return chain(tree, _root(tree, own[0]), own[-1].child, others)


def _root(tree: Tree, joint: TreeJoint) -> str:
    """The link at the bottom of all."""
    above, link = tree.above(), joint.parent
    while link in above:
        link = above[link].parent
    return link


def _check_places(tree: Tree, found: TreeChain, made: ExportedArm) -> None:
    """Every joint but the first, whose base may be another, stands where the model has it."""
    if len(found.joints) != len(made.joints):
        raise ModelError(f"{tree.file}: its joints stand in another order than the model's")
    for k, (there, own) in enumerate(zip(found.joints, made.joints, strict=True)):
        if there.joint.name != own.name and label_of(there.joint.name) != own.name:
            raise ModelError(f"{tree.file}: joint {quote(own.name)} comes elsewhere in the chain than in the model")
        if k > 0 and not _same(there.origin.xyz, own.joint.origin.xyz):
            raise ModelError(f"{tree.file}: joint {quote(own.name)} stands elsewhere than in the model: another arm?")
        left, right = (rotation(frame.rpy) for frame in (there.origin, own.joint.origin))
        if k > 0 and not all(_same(a, b) for a, b in zip(left, right, strict=True)):
            raise ModelError(
                f"{tree.file}: joint {quote(own.name)} is turned otherwise than in the model: another arm?"
            )


def _same(left: tuple[float, float, float], right: tuple[float, float, float]) -> bool:
    return all(abs(a - b) < SAME_PLACE for a, b in zip(left, right, strict=True))
