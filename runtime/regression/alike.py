"""Least squares of many problems that are alike: what does not hang on their moments is computed once."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from runtime.regression.least_squares import bounded
from runtime.regression.settings import KEPT_ENDS, OPTIMAL, WELL_POSED

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Sides = NDArray[np.int8]
"""(K,) 1 for a coefficient on its lower bound, -1 for one on its upper bound, 0 for the others."""


@dataclass(frozen=True)
class Alike:
    """As `bounded`, of several problems with the same bounds.

    grams (F, K, K); lower, upper (K,); ends: on which bounds coefficients stood in problems like these, the likely
    first, kept up to date; core: the same problems without their last coefficients, of which others know more already
    Problems that are alike end on the same bounds: what one of them has found is tried on the others, all at once. It
    is the answer where nothing falls towards the inside (Karush, Kuhn and Tucker), as there is one least square of Gram
    matrices that are positive; of others, `bounded` goes its own way.
    """

    grams: Array
    lower: Array
    upper: Array
    ends: list[Sides] = field(default_factory=list)
    core: Alike | None = None

    def solve(self, moments: Array) -> Array:
        """(F, K) coefficients, moments (F, K)."""
        found, left = np.tile(self.lower, (len(self.grams), 1)), np.ones(len(self.grams), dtype=bool)
        if self._least_pivot > 0:
            for sides in list(self.ends) or [np.zeros(len(self.lower), dtype=np.int8)]:
                if left.any():
                    self._try(sides, moments, found, left)
        while left.any():
            first = int(np.argmax(left))
            found[first] = bounded(self.grams[first], moments[first], self.lower, self.upper)
            sides = np.where(found[first] == self.lower, 1, np.where(found[first] == self.upper, -1, 0)).astype(np.int8)
            self._try(sides, moments, found, left)
            left[first] = False
        return found

    def _try(self, sides: Sides, moments: Array, found: Array, left: Mask) -> None:
        """Write the answers of those of the problems left that end with these coefficients on their bounds."""
        ending = self._ending(sides)
        if ending is None:
            return
        theta = times(ending.inverse, moments) + ending.offset
        ended = left & ((theta >= self.lower) & (theta <= self.upper)).all(axis=1)
        if ended.any() and ending.inward.any():
            fall = (moments - times(self.grams, theta)) / self._reach
            most = OPTIMAL * np.abs(moments / self._reach).max(axis=1, initial=0.0)
            ended &= (fall * ending.inward).max(axis=1, initial=0.0) <= most
        if ended.any():
            found[ended], left[ended] = theta[ended], False
            self._remember(sides, int(ended.sum()))

    def _remember(self, sides: Sides, count: int) -> None:
        """In front where most of the problems end so, else behind the first."""
        key = sides.tobytes()
        others = [e for e in self.ends if e.tobytes() != key]
        place = 0 if 2 * count > len(self.grams) else 1
        self.ends[:] = [*others[:place], sides, *others[place:]][:KEPT_ENDS]

    @cached_property
    def _reach(self) -> Array:
        """(F, K) sizes of the columns; infinite for those of none."""
        square = np.diagonal(self.grams, axis1=1, axis2=2)
        return np.sqrt(np.where(square > 0, square, np.inf))

    @cached_property
    def _told(self) -> Mask:
        """(K,) coefficients of which any of the problems says something."""
        told: Mask = (self.lower < self.upper) & np.isfinite(self._reach).any(axis=0)
        return told

    @cached_property
    def _least_pivot(self) -> float:
        """Of all that is told; 0 where the problems are not alike."""
        if not np.all(np.isfinite(self._reach[:, self._told])):
            return 0.0
        border = self._border(np.zeros(len(self.lower), dtype=np.int8))
        if self.core is None or border is None:
            return _least_factor(self._scaled(self._told))
        size = self._reach[:, border.place]
        return min(self.core._least_pivot, _least_factor(border.left / (size[:, :, None] * size[:, None])))

    def _scaled(self, part: Mask) -> Array:
        """Of some coefficients, with unit diagonals: (F, K', K')."""
        size, place = self._reach[:, part], np.flatnonzero(part)
        found: Array = self.grams[:, place[:, None], place] / (size[:, :, None] * size[:, None])
        return found

    @cached_property
    def _endings(self) -> dict[bytes, _Ending | None]:
        return {}

    def _ending(self, sides: Sides) -> _Ending | None:
        key = sides.tobytes()
        if key not in self._endings:
            self._endings[key] = self._made(np.where(self._told, sides, 0))
        return self._endings[key]

    def _made(self, sides: Sides) -> _Ending | None:
        """None where one of them has no such bound, or where something may be unseen."""
        free, least = self._told & (sides == 0), self._least_pivot
        if not np.isfinite(np.where(sides > 0, self.lower, self.upper)[sides != 0]).all():
            return None
        if least == 0 or (least <= WELL_POSED and _least_factor(self._scaled(free)) <= WELL_POSED):
            return None
        inverse = self._inverse(sides)
        resting = np.clip(0.0, self.lower, self.upper)
        at = np.where(sides > 0, self.lower, np.where(sides < 0, self.upper, resting))
        at[free] = 0.0
        offset = at - times(inverse, self.grams @ at) if at.any() else np.zeros_like(self._reach)
        return _Ending(inverse, offset, sides.astype(float))

    def _inverse(self, sides: Sides) -> Array:
        """(F, K, K) of the coefficients that are free, zero elsewhere."""
        border = self._border(sides)
        if border is not None:
            return border.inverse(np.zeros_like(self.grams))
        free = self._told & (sides == 0)
        inverse, size, place = np.zeros_like(self.grams), self._reach[:, free], np.flatnonzero(free)
        inverse[:, place[:, None], place] = np.linalg.inv(self._scaled(free)) / (size[:, :, None] * size[:, None])
        return inverse

    def _border(self, sides: Sides) -> _Border | None:
        """Of the coefficients that are free; None without a core, and where it knows nothing of such an end."""
        if self.core is None:
            return None
        inner = len(self.core.lower)
        ending = self.core._ending(sides[:inner])
        if ending is None:
            return None
        place = inner + np.flatnonzero((self._told & (sides == 0))[inner:])
        across = self.grams[:, :inner][:, :, place]
        taken = ending.inverse @ across
        return _Border(ending.inverse, place, taken, self.grams[:, place[:, None], place] - _turned(across) @ taken)


def _least_factor(matrices: Array) -> float:
    """The least of the Cholesky factors' diagonals, of a part of the coefficients no less than of all; 0 where one of
    the matrices (F, K, K) is not positive."""
    try:
        factors = np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        return 0.0
    return float(np.diagonal(factors, axis1=1, axis2=2).min(initial=1.0))


def _turned(matrices: Array) -> Array:
    return matrices.swapaxes(1, 2)


def times(matrices: Array, vectors: Array) -> Array:
    """(F, K) products of matrices (F, K, K) and vectors (F, K)."""
    product: Array = (matrices @ vectors[:, :, None])[:, :, 0]
    return product


@dataclass(frozen=True)
class _Border:
    """Further coefficients about a core whose inverse (F, C, C) is known: place (k,) among all; taken (F, C, k), what
    the core takes over of them, and left (F, k, k) what it does not (Schur's complement).

    Source: inverse by bordering, Golub & Van Loan, Matrix Computations.
    """

    core: Array
    place: NDArray[np.intp]
    taken: Array
    left: Array

    def inverse(self, out: Array) -> Array:
        """(F, K, K), written into zeros."""
        inner, solved = self.core.shape[1], np.linalg.inv(self.left)
        across = -self.taken @ solved
        out[:, :inner, :inner] = self.core - across @ _turned(self.taken)
        out[:, :inner, self.place] = across
        out[:, self.place, :inner] = _turned(across)
        out[:, self.place[:, None], self.place] = solved
        return out


@dataclass(frozen=True)
class _Ending:
    """Of some coefficients on their bounds: solutions are inverse (F, K, K) @ moments + offset (F, K); inward (K,) is
    which way off the bound, 0 for those that are free."""

    inverse: Array
    offset: Array
    inward: Array
