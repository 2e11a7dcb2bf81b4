"""The collision shapes of a URDF, in the frames of a model file's joints.

Source: the specification at wiki.ros.org/urdf/XML/link; where ROS looks for package://NAME/...
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from functools import reduce
from pathlib import Path
from urllib.parse import unquote

from symbolic.model_file.arm import Arm, CollisionShape, Frame
from symbolic.model_file.checks import ModelError, quote
from symbolic.model_file.exchange import xml_file
from symbolic.model_file.exchange.tree import Tree, TreeJoint, label_of, path_to, shortened, some
from symbolic.model_file.exchange.urdf import frame_of, urdf_tree
from symbolic.model_file.exchange.xml_file import XmlNode
from symbolic.model_file.frames import angles, applied, composed, rotation, scaled, transposed


def collision_shapes(path: Path, arm: Arm) -> tuple[list[CollisionShape], list[str]]:
    """The shapes of all links of a URDF with the arm's joints, and what is lacking, a sentence each.

    Shapes on joints that the arm does not have, such as fingers, stand where those joints are at 0.
    Raises ModelError: no URDF, or a joint of the arm that it does not have.
    """
    root = xml_file.read(path)
    if root.tag != "robot":
        root.fail(f"its root is <{root.tag}>; expected a URDF, whose <collision> elements are the arm's shapes")
    tree = urdf_tree(root)
    frames, held = _link_frames(tree, arm)
    shapes: list[CollisionShape] = []
    lacking: list[str] = []
    bare = set(range(1, len(arm.joints) + 1))
    for node in root.all("link"):
        link = node.word("name")
        body, frame = frames[link]
        for collision in node.all("collision"):
            one = _shape(collision, path, body, link, composed(frame, frame_of(collision)))
            if isinstance(one, str):
                lacking.append(f"Link {shortened(link)} is not checked whole: {one}.")
            else:
                shapes.append(one)
                bare.discard(body)
    if bare:
        lacking.append(f"{path.name} has no usable shape for link {', '.join(map(str, sorted(bare)))}: not checked.")
    if held:
        lacking.append(f"Shapes behind {some(held)}, which the arm does not move, are checked with these joints at 0.")
    return shapes, lacking


def _link_frames(tree: Tree, arm: Arm) -> tuple[dict[str, tuple[int, Frame]], list[str]]:
    """Body and pose in its joint's frame of every link; and the joints, not of the arm, that move others' shapes."""
    above = tree.above()
    numbers = _numbers(tree, arm)
    first = next(joint for joint, number in numbers.items() if number == 1)
    # The arm's base may be any link before joint 1, wherever the file's root is.
    base = composed(arm.joints[0].origin, _inverse(_chained(path_to(tree.joints[first].child, above))))
    frames: dict[str, tuple[int, Frame]] = {}
    held: dict[str, None] = {}
    for link in tree.links:
        way = path_to(link, above)
        last = max((k for k, joint in enumerate(way) if joint.name in numbers), default=-1)
        behind = way[last + 1 :]
        held |= {joint.name: None for joint in behind if joint.kind != "fixed" and tree.links[link].solid}
        frame = _chained(behind)
        frames[link] = (numbers[way[last].name], frame) if last >= 0 else (0, composed(base, frame))
    return frames, list(held)


def _numbers(tree: Tree, arm: Arm) -> dict[str, int]:
    """The arm's joints by their names in the file."""
    labels = {label_of(name): name for name in tree.joints}
    found = {}
    for number, joint in enumerate(arm.joints, 1):
        if joint.name not in labels:
            said = "has no name" if joint.name is None else f"is {quote(joint.name)}"
            raise ModelError(
                f"{tree.file}: joint {number} of {arm.name} {said}; expected the name of a joint of this file: "
                f"{some(list(tree.joints))}"
            )
        found[labels[joint.name]] = number
    return found


def _chained(joints: Iterable[TreeJoint]) -> Frame:
    return reduce(composed, (joint.origin for joint in joints), Frame())


def _inverse(frame: Frame) -> Frame:
    turned = transposed(rotation(frame.rpy))
    return Frame(scaled(-1.0, applied(turned, frame.xyz)), angles(turned))


def _shape(collision: XmlNode, path: Path, body: int, link: str, frame: Frame) -> CollisionShape | str:
    """The shape of a <collision>, or why there is none."""
    geometry = collision.needed("geometry")
    for kind, keys in _KEYS.items():
        node = geometry.first(kind)
        if node is not None:
            size = node.numbers("size", 3) if kind == "box" else tuple(node.number(key) for key in keys)
            if min(size) <= 0:
                node.fail(f"<{kind}> has the size {min(size):g}; expected sizes above 0, in m")
            return CollisionShape(body, link, frame, kind, size)  # type: ignore[arg-type]
    node = geometry.first("mesh")
    if node is None:
        return "its <geometry> is none of box, sphere, cylinder, capsule and mesh"
    name = node.word("filename")
    mesh = next((place for place in _places(name, path) if place.is_file()), None)
    if mesh is None:
        return f"its mesh {shortened(name)} was not found; ROS_PACKAGE_PATH may name the folder of its package"
    return CollisionShape(body, link, frame, "mesh", node.numbers("scale", 3, (1.0, 1.0, 1.0)), mesh)


_KEYS: Mapping[str, tuple[str, ...]] = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}


def _places(name: str, path: Path) -> Iterator[Path]:
    """Where a mesh may be: beside the URDF; of a package, in a folder around the URDF or where ROS keeps packages."""
    scheme, _, rest = name.rpartition("://")
    rest = unquote(rest) if scheme else rest
    if scheme == "file":
        yield Path(rest)
    elif scheme in ("package", "model"):
        package, _, inside = rest.partition("/")
        for folder in path.resolve().parents:
            if folder.name == package:
                yield folder / inside
            yield folder / package / inside
        for variable, below in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
            for place in filter(None, os.environ.get(variable, "").split(os.pathsep)):
                root = Path(place) / below
                yield root / package / inside
                if root.name == package:
                    yield root / inside
    elif not scheme:
        yield path.resolve().parent / rest
