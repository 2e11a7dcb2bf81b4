"""What stands around an arm: floor, boxes and a tool, of a scene file in TOML or of the command line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from runtime.experiments.settings import LINK_MARGIN, OPEN_END, SURROUNDINGS_MARGIN
from symbolic.model_file.arm import Frame, Vector
from symbolic.model_file.checks import MAX_BYTES, Place, parse_toml, printable, quote, read_text
from symbolic.model_file.fields import (
    FieldRow,
    Inner,
    Label,
    Number,
    NumberRow,
    Real,
    Several,
    WholeNumber,
    read,
    rows,
)

_AXES = ("x", "y", "z")
_BOX = "AXIS=LOW:HIGH of x, y and z in m, as in --box x=0.3:0.8,y=-0.2:0.2,z=0:0.4; an end left out is far away"
_NO_FILE = Place("the scene")


@dataclass(frozen=True)
class SceneBox:
    """A box at rest. frame: of its centre in the base frame; size (3,) m, its whole edges."""

    name: str
    frame: Frame
    size: Vector


@dataclass(frozen=True)
class SceneTool:
    """A capsule on the last link: ends (3,) m in the tip's frame, radius in m."""

    start: Vector
    end: Vector
    radius: float


@dataclass(frozen=True)
class Scene:
    """What an arm must not touch.

    floor        m, height above the base frame's origin, against gravity; None: there is none
    margin       m, kept from floor and boxes          link_margin   m, kept between links
    radii        of links, m, by joint; 0: the base    place         of the file, for messages
    """

    floor: float | None = None
    boxes: tuple[SceneBox, ...] = ()
    margin: float = SURROUNDINGS_MARGIN
    link_margin: float = LINK_MARGIN
    tool: SceneTool | None = None
    radii: Mapping[int, float] = field(default_factory=dict)
    place: Place = _NO_FILE

    @classmethod
    def of(cls, floor: float | None = None, boxes: Sequence[str] = (), path: Path | None = None) -> Scene:
        """The file's scene, if there is one, with these boxes besides, and this floor in place of its own.

        boxes   texts such as x=0.3:0.8,y=-0.2:0.2,z=0:0.4, m
        Raises ModelError.
        """
        scene = cls() if path is None else read_scene(path)
        if floor is not None and not math.isfinite(floor):
            Place("--floor").fail(f"is {floor}; expected a height in m above the base frame's origin")
        return replace(
            scene,
            floor=scene.floor if floor is None else floor,
            boxes=(*scene.boxes, *map(parse_box, boxes)),
        )


SCENE = (
    Real("floor", "height above the base frame's origin, against gravity; default: no floor", unit="m", default=None),
    Number("margin", "kept from floor and boxes", low=0.0, unit="m", default=SURROUNDINGS_MARGIN),
    Number("link_margin", "kept between links", low=0.0, unit="m", default=LINK_MARGIN),
    Several(
        "box",
        "a box at rest, in the base frame; repeatable",
        (
            Label("name", "for messages; default: box 1, box 2, ...", default=""),
            NumberRow("centre", "of its middle", names=_AXES, unit="m"),
            NumberRow("size", "whole edges", names=_AXES, unit="m"),
            NumberRow(
                "rpy",
                "roll, pitch and yaw, as in URDF",
                names=("roll", "pitch", "yaw"),
                unit="rad",
                default=(0.0, 0.0, 0.0),
            ),
        ),
        default=(),
    ),
    Inner(
        "tool",
        "what is mounted at the tip: length and radius, or size",
        (
            Number(
                "length", "of a capsule along z of the tip's frame, from its origin", low=0.0, unit="m", default=None
            ),
            Number("radius", "of that capsule", positive=True, unit="m", default=None),
            NumberRow(
                "size", "whole edges of a box that begins at the tip, along its z", names=_AXES, unit="m", default=None
            ),
        ),
        default=None,
    ),
    Several(
        "link",
        "what is known of a link; repeatable",
        (
            WholeNumber("joint", "that moves it, counted from 1; 0: the base", low=0.0),
            Number("radius", "of its capsules; default: from its inertia", positive=True, unit="m"),
        ),
        default=(),
    ),
)


def scene_file_rows() -> list[FieldRow]:
    """Every key of the scene file, with unit, meaning and default, for a guide."""
    return rows(SCENE)


def read_scene(path: Path) -> Scene:
    """The scene of a TOML file. Raises ModelError."""
    place = Place(printable(str(path)))
    text = read_text(path, MAX_BYTES, "a scene in TOML")
    given = read(place, parse_toml(text, place), SCENE)
    radii = {one["joint"]: one["radius"] for one in given["link"]}
    if len(radii) < len(given["link"]):
        place.fail("two [[link]] tables for one joint; expected at most one")
    return Scene(
        given["floor"],
        tuple(_box(place.inside(f"box {k}"), k, box) for k, box in enumerate(given["box"], 1)),
        margin=given["margin"],
        link_margin=given["link_margin"],
        tool=None if given["tool"] is None else _tool(place.inside("tool"), given["tool"]),
        radii=radii,
        place=place,
    )


def _box(place: Place, number: int, given: Mapping[str, Any]) -> SceneBox:
    _check_edges(place, given["size"])
    return SceneBox(given["name"] or f"box {number}", Frame(given["centre"], given["rpy"]), given["size"])


def _check_edges(place: Place, size: Sequence[float]) -> None:
    if min(size) <= 0:
        place.fail(f"size has the edge {min(size):g}; expected three whole edges in m, each above 0")


def _tool(place: Place, given: Mapping[str, Any]) -> SceneTool:
    """A box becomes the capsule along its longest edge that holds it."""
    length, radius, size = given["length"], given["radius"], given["size"]
    if (length is None) != (radius is None) or (length is None) == (size is None):
        place.fail("expected length and radius of a capsule, or size of a box")
    if size is None:
        return SceneTool((0.0, 0.0, 0.0), (0.0, 0.0, length), radius)
    _check_edges(place, size)
    longest = size.index(max(size))
    ends = [[0.0, 0.0, size[2] / 2] for _ in range(2)]
    ends[0][longest] -= size[longest] / 2
    ends[1][longest] += size[longest] / 2
    (ax, ay, az), (bx, by, bz) = ends
    across = [edge for axis, edge in enumerate(size) if axis != longest]
    return SceneTool((ax, ay, az), (bx, by, bz), math.hypot(*across) / 2)


def parse_box(text: str) -> SceneBox:
    """The box of a text such as x=0.3:0.8,y=-0.2:0.2,z=0:0.4, m; an end that is left out is far away. Raises
    ModelError."""
    place = Place(f"--box {printable(text)}")
    ends: dict[str, tuple[float, float]] = {}
    for part in text.split(","):
        axis, _, interval = part.strip().partition("=")
        low, colon, high = interval.partition(":")
        if axis not in _AXES or not colon:
            place.fail(f"found {quote(part)}; expected {_BOX}")
        if axis in ends:
            place.fail(f"{axis} is there twice; expected each axis once")
        least, most = _end(place, low, -OPEN_END), _end(place, high, OPEN_END)
        if least >= most:
            place.fail(f"{axis} goes from {least:g} to {most:g}; expected the smaller end first")
        ends[axis] = least, most
    (x, y, z), (a, b, c) = zip(
        *((sum(pair) / 2, pair[1] - pair[0]) for pair in (ends.get(axis, (-OPEN_END, OPEN_END)) for axis in _AXES)),
        strict=True,
    )
    return SceneBox(f"the box {printable(text)}", Frame((x, y, z)), (a, b, c))


def _end(place: Place, text: str, open_end: float) -> float:
    if not text.strip():
        return open_end
    try:
        value = float(text)
    except ValueError:
        place.fail(f"{quote(text)} is no number; expected {_BOX}")
    if not abs(value) <= abs(open_end):
        place.fail(f"{text.strip()} is beyond {abs(open_end):g} m; leave that end out")
    return value
