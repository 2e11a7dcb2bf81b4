"""From places of an arm in metres to whole numbers on a drawing: the view, and the scale in which all of it fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

WIDTH, LOWEST, HIGHEST = 1000, 420, 760
"""Of a drawing: its units across, and between which heights it is chosen."""
_MARGIN = 70
_ELEVATION, _ASIDE = np.radians(24.0), np.radians(35.0)
_FLAT = 1e-9
"""Part of an extent below which there is none."""


@dataclass(frozen=True)
class View:
    """An orthographic view: u (3,) points right and v (3,) up, in base axes."""

    u: Array
    v: Array

    def seen(self, p: Array) -> Array:
        """(2, ...) m of places (3, ...)."""
        return np.tensordot(np.array([self.u, self.v]), p, axes=1)


IN_THE_PLANE = View(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))


def in_space(p: Array) -> View:
    """From above, and aside from where the places (3, N) spread least: z is up.

    An arm that moves in a plane is not seen edge on so.
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
    """A view at a scale: units per m, and the m at the drawing's middle."""

    view: View
    scale: float
    middle: Array
    height: int

    def points(self, p: Array) -> Whole:
        """(2, ...) units from the upper left corner, of places (3, ...)."""
        apart = self.view.seen(p) - self.middle.reshape(2, *[1] * (p.ndim - 1))
        flipped = apart * np.array([self.scale, -self.scale]).reshape(2, *[1] * (p.ndim - 1))
        corner = np.array([WIDTH, self.height]).reshape(2, *[1] * (p.ndim - 1)) / 2
        return np.rint(flipped + corner).astype(np.int64)


def fitted(view: View, places: Sequence[Array]) -> DrawingBoard:
    """The board that shows all places, (3, N) each."""
    seen = np.concatenate([view.seen(p).reshape(2, -1) for p in places], axis=1)
    low, high = seen.min(axis=1), seen.max(axis=1)
    extent = np.maximum(high - low, _FLAT * max(1.0, float(np.abs(seen).max())))
    room = WIDTH - 2 * _MARGIN
    scale = min(room / extent[0], (HIGHEST - 2 * _MARGIN) / extent[1])
    height = int(np.clip(np.ceil(scale * extent[1]) + 2 * _MARGIN, LOWEST, HIGHEST))
    return DrawingBoard(view, float(scale), (low + high) / 2, height)
