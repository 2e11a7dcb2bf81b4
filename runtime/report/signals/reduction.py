"""Long signals for a drawing: the smallest and largest value of every block of samples, about one a pixel column."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_FINEST = 64
"""Samples of the shortest blocks that are kept: what is shorter is reduced anew at every view."""
_COARSER = 8
"""Blocks that the next level takes for one."""


@dataclass(frozen=True)
class _Level:
    """Of blocks of `size` samples the smallest and the largest values, (L, B) each."""

    size: int
    least: Array
    most: Array

    def coarser(self) -> _Level:
        return _Level(self.size * _COARSER, *_reduced(self.least, self.most, _COARSER))


@dataclass(frozen=True)
class Pyramid:
    """Signals over one time, reduced beforehand so that every view of them costs the same.

    t       (M,) s, never falling
    names   of the lines
    levels  the samples themselves, then ever longer blocks
    """

    t: Array
    names: tuple[str, ...]
    levels: tuple[_Level, ...]

    @classmethod
    def of(cls, t: Array, lines: Mapping[str, Array]) -> Pyramid:
        """Over times (M,), of lines (M,); a line's NaN is a place where it is not drawn."""
        values = np.array([lines[name] for name in lines], dtype=float).reshape(len(lines), len(t))
        levels = [_Level(1, values, values)]
        if len(t) > _FINEST:
            levels.append(_Level(_FINEST, *_reduced(values, values, _FINEST)))
        while levels[-1].least.shape[1] > _FINEST:
            levels.append(levels[-1].coarser())
        return cls(t, tuple(lines), tuple(levels))

    def columns(self, begin: float, end: float, columns: int) -> Array:
        """(1 + 2 L, B) of the samples from `begin` to `end`, s, and one block on either side of them: the time of each
        block's first sample, then the smallest and the largest value of each line.

        columns   of the drawing, at least 1; B is at most 2 `columns` + 2
        """
        first, last = np.searchsorted(self.t, [begin, end], side="left")
        level = self._level(int(last - first), columns)
        blocks = level.least.shape[1]
        start = max(0, first // level.size - 1)
        stop = min(blocks, -(-last // level.size) + 1)
        together = max(1, -(-int(stop - start) // (2 * columns)))
        least, most = _reduced(level.least[:, start:stop], level.most[:, start:stop], together)
        times = self.t[start * level.size : stop * level.size : level.size * together]
        out = np.empty((1 + 2 * len(self.names), len(times)))
        out[0], out[1::2], out[2::2] = times, least, most
        return out

    def _level(self, samples: int, columns: int) -> _Level:
        """The one of the longest blocks that has at least a block a column."""
        enough = [level for level in self.levels if level.size * columns <= samples]
        return enough[-1] if enough else self.levels[0]


def _reduced(least: Array, most: Array, together: int) -> tuple[Array, Array]:
    """Every `together` neighbours as one, the last of those that are left."""
    if together == 1 or not least.shape[1]:
        return least, most
    starts = np.arange(0, least.shape[1], together)
    whole = least.shape[1] // together
    if least.shape[1] == whole * together:
        shape = (len(least), whole, together)
        return np.fmin.reduce(least.reshape(shape), axis=2), np.fmax.reduce(most.reshape(shape), axis=2)
    return np.fmin.reduceat(least, starts, axis=1), np.fmax.reduceat(most, starts, axis=1)
