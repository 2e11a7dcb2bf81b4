"""The animated picture of the arm: its links, its joints and their residual at every frame.

All coordinates are computed here, as whole numbers on a drawing; the script in the page only shows them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.model.loader import Model, carried, joint_places, tip_place
from runtime.motion.settings import MORE_THAN_NOISE

Whole = NDArray[np.int64]

MOST_FRAMES = 400
"""Frames of a picture; the script interpolates between them."""
LEVELS = (MORE_THAN_NOISE, 2 * MORE_THAN_NOISE)
"""Residuals, in noise floors, above which a mark changes its colour."""
_POINTER = 0.3
"""Drawn length of a last link that has none, relative to the arm's reach, so that its rotation is visible."""
_AXES = 0.18
"""Part of how far the arm is seen to reach; length of the base's axes."""


@dataclass(frozen=True)
class Course:
    """A motion by name: the joints' positions (n, F) at the frames, rad or m."""

    name: str
    q: Array


@dataclass(frozen=True)
class JointMarks:
    """Residual torque of the joints at the frames, in noise floors (n, F); NaN while a joint is at rest."""

    name: str
    ratio: Array


@dataclass(frozen=True)
class ArmMotion:
    """A motion of an arm, recorded or planned.

    t         (F,) s, of the frames
    courses   one or two: a second is drawn over the first, which is then dashed
    marks     none, one or two: the first is a joint's ring, the second or the same its disc
    goes_on   its end is its beginning
    """

    model: Model
    t: Array
    courses: tuple[Course, ...]
    marks: tuple[JointMarks, ...] = ()
    goes_on: bool = False


def frames(count: int, most: int = MOST_FRAMES) -> NDArray[np.intp]:
    """Indices of at most `most` of `count` samples, evenly spaced from the first."""
    return np.arange(0, count, max(1, -(-count // most)))


def picture(motion: ArmMotion, what: str) -> dict[str, Any]:
    """Variables of the page's template; `what` is the caption."""
    return _Picture(motion).page(what)


@dataclass(frozen=True)
class _Picture:
    """A motion as drawn."""

    motion: ArmMotion

    @cached_property
    def corners(self) -> list[list[tuple[Array, bool]]]:
        """Corners of the arm in each course."""
        return [_corners(self.motion.model, course.q) for course in self.motion.courses]

    @property
    def paths(self) -> list[list[Array]]:
        """Positions of the corners, (3, F) each."""
        return [[place for place, _ in path] for path in self.corners]

    @property
    def joints(self) -> list[int]:
        """Indices of the corners with a joint."""
        return [k for k, (_, joint) in enumerate(self.corners[-1]) if joint]

    @cached_property
    def axes(self) -> Array:
        """Ends of the base's axes, a column each."""
        reach = max(float(np.abs(place).max()) for path in self.paths for place in path) or 1.0
        return _AXES * reach * np.eye(3)[:, : 3 if self.motion.model.spatial else 2]

    @cached_property
    def board(self) -> DrawingBoard:
        shown = [p for path in self.paths for p in path]
        view = in_space(np.concatenate(shown, axis=1)) if self.motion.model.spatial else IN_THE_PLANE
        return fitted(view, [*shown, self.axes])

    @cached_property
    def bodies(self) -> list[Whole]:
        """Corners on the drawing (F, corners, 2), for each course."""
        return [self.board.points(np.stack(path, axis=1)).transpose(2, 1, 0) for path in self.paths]

    def page(self, what: str) -> dict[str, Any]:
        motion = self.motion
        return {
            "what": what,
            "width": WIDTH,
            "height": self.board.height,
            "axes": list(zip("xyz", self.board.points(self.axes).T.tolist(), strict=False)),
            "base": self.board.points(np.zeros(3)).tolist(),
            "courses": [
                {
                    "name": course.name,
                    "ghost": course is not motion.courses[-1],
                    "way": _text(body[:, -1]),
                    "first": _text(body[0]),
                }
                for course, body in zip(motion.courses, self.bodies, strict=True)
            ],
            "joints": [self._joint(j) for j in range(motion.model.n)],
            "marks": [m.name for m in motion.marks],
            "rests": any(bool(np.isnan(m.ratio).any()) for m in motion.marks),
            "limits": [f"{level:g}" for level in LEVELS],
            "seconds": f"{motion.t[-1] - motion.t[0]:.3g}",
            "last": len(motion.t) - 1,
            "data": self.data(),
        }

    def data(self) -> Markup:
        """Data of the script for every frame: numbers alone, without text of a user."""
        motion = self.motion
        document = {
            "t": np.rint(1000 * (motion.t - motion.t[0])).astype(int).tolist(),
            "begins": round(float(motion.t[0]), 3),
            "loop": motion.goes_on,
            "bodies": [body.reshape(len(body), -1).tolist() for body in self.bodies],
            "joints": self.joints,
            "marks": [_tenths(m.ratio) for m in motion.marks],
            "levels": [_levels(m.ratio) for m in motion.marks],
        }
        return Markup(json.dumps(document, separators=(",", ":"), allow_nan=False))

    def _joint(self, joint: int) -> dict[str, Any]:
        info = self.motion.model.joints[joint]
        x, y = self.bodies[-1][0, self.joints[joint]].tolist()
        level = [_levels(m.ratio)[0][joint] for m in self.motion.marks]
        return {"slides": info.type == "prismatic", "x": x, "y": y, "levels": level}


# --- places ---


def _corners(model: Model, q: Array) -> list[tuple[Array, bool]]:
    """Corners of the arm from its base to its tip, (3, F) each, and whether a joint is there.

    A prismatic joint is drawn where the moved part begins.
    """
    corners = [(np.zeros((3, q.shape[1])), False)]
    for base, moved in joint_places(model, q):
        corners += [(base, True)] if moved is base else [(base, False), (moved, True)]
    return [*corners, (_end(model, q), False)]


def _end(model: Model, q: Array) -> Array:
    """Position (3, F) of the tip; of a last link without length, a point that turns with it."""
    home = tip_place(model, np.zeros((model.n, 1)))[:, 0]
    last = np.zeros(3)
    last[: len(model.places[-1])] = model.places[-1]
    if not np.allclose(home, last) or model.joints[-1].type == "prismatic":
        return tip_place(model, q)
    return carried(model, q, model.n, home + np.array([_POINTER * _reach(model), 0.0, 0.0]))


def _reach(model: Model) -> float:
    """Reach of the arm at zero positions, m; 1 for an arm without lengths."""
    home = tip_place(model, np.zeros((model.n, 1)))[:, 0]
    return max([float(np.linalg.norm(home)), *(float(np.linalg.norm(p)) for p in model.places)]) or 1.0


# --- numbers of the frames ---


def _tenths(ratio: Array) -> list[list[int]]:
    """Tenths of a noise floor (F, n); −1 where unknown."""
    whole = np.where(np.isnan(ratio), -1, np.rint(10 * np.nan_to_num(ratio)))
    found: list[list[int]] = np.minimum(whole, 10**6).astype(int).T.tolist()
    return found


def _levels(ratio: Array) -> list[str]:
    level = np.where(np.isnan(ratio), 0, 1 + sum((ratio > limit).astype(int) for limit in LEVELS))
    return ["".join(map(str, row)) for row in level.T]


def _text(points: Whole) -> str:
    """Points (N, 2) as text of an SVG polyline, without repeated ones."""
    moved = np.append(True, np.any(np.diff(points, axis=0) != 0, axis=1))
    return " ".join(f"{x},{y}" for x, y in points[moved])


# --- from metres to a drawing ---

WIDTH, LOWEST, HIGHEST = 1000, 420, 760
"""Width of a drawing, and the range of its height, in its units."""
_MARGIN = 70
_ELEVATION, _ASIDE = np.radians(24.0), np.radians(35.0)
_FLAT = 1e-9
"""Relative extent that counts as zero."""


@dataclass(frozen=True)
class View:
    """An orthographic view: u (3,) points right and v (3,) up, in base axes."""

    u: Array
    v: Array

    def seen(self, p: Array) -> Array:
        """Coordinates (2, ...) in the view, m, of positions (3, ...)."""
        return np.tensordot(np.array([self.u, self.v]), p, axes=1)


IN_THE_PLANE = View(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))


def in_space(p: Array) -> View:
    """A view of the points (3, N) from above and from the side on which they spread most; z is up.

    So the plane of a planar motion is never seen edge-on.
    """
    level = p[:2] - p[:2].mean(axis=1, keepdims=True)
    (xx, xy), (_, yy) = level @ level.T
    along = 0.5 * np.arctan2(2 * xy, xx - yy) if xx + yy > 0 else 0.0
    turn = along - _ASIDE
    u = np.array([np.cos(turn), np.sin(turn), 0.0])
    away = np.array([-np.sin(turn), np.cos(turn), 0.0])
    return View(u, np.sin(_ELEVATION) * away + np.array([0.0, 0.0, np.cos(_ELEVATION)]))


@dataclass(frozen=True)
class DrawingBoard:
    """A view with a scale, units per m, and the point at the middle of the drawing, m."""

    view: View
    scale: float
    middle: Array
    height: int

    def points(self, p: Array) -> Whole:
        """Coordinates (2, ...) from the upper left corner, in the drawing's units, of positions (3, ...)."""
        apart = self.view.seen(p) - self.middle.reshape(2, *[1] * (p.ndim - 1))
        flipped = apart * np.array([self.scale, -self.scale]).reshape(2, *[1] * (p.ndim - 1))
        corner = np.array([WIDTH, self.height]).reshape(2, *[1] * (p.ndim - 1)) / 2
        return np.rint(flipped + corner).astype(np.int64)


def fitted(view: View, places: Sequence[Array]) -> DrawingBoard:
    """The board that shows all positions, (3, N) each."""
    seen = np.concatenate([view.seen(p).reshape(2, -1) for p in places], axis=1)
    low, high = seen.min(axis=1), seen.max(axis=1)
    extent = np.maximum(high - low, _FLAT * max(1.0, float(np.abs(seen).max())))
    room = WIDTH - 2 * _MARGIN
    scale = min(room / extent[0], (HIGHEST - 2 * _MARGIN) / extent[1])
    height = int(np.clip(np.ceil(scale * extent[1]) + 2 * _MARGIN, LOWEST, HIGHEST))
    return DrawingBoard(view, float(scale), (low + high) / 2, height)
