"""Least squares from normal equations under bounds and a positive definite inertia matrix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from runtime.arrays import Array, Mask

Sides = NDArray[np.int8]
"""(K,) 1 for a coefficient on its lower bound, -1 for one on its upper bound, 0 for the others."""

RANK: Final = 1e-9
"""ratio of eigenvalues of a scaled Gram matrix; a direction below is rounding; double precision, squared columns."""
WELL_POSED: Final = 1e-3
"""smallest pivot of a scaled Cholesky factor; below, directions may be unseen, and eigenvalues decide; far above the
root of RANK, so that both ways agree."""
OPTIMAL: Final = 1e-10
"""part of the largest moment per column's size; where the cost falls by less towards the inside, a bound is kept."""


def solve(gram: Array, moment: Array, near: Array | None = None) -> Array:
    """Least squares from normal equations; directions that the data do not see stay at `near` (K,), None: at zero.

    gram (K, K), moment (K,). A Gram matrix that is compensated for noise may have directions of negative
    size: noise is all that they hold, and they count as unseen.
    """
    if not len(moment):
        return moment
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    there = size > 0
    if not there.all():
        theta = np.zeros(len(moment)) if near is None else near.copy()
        if there.any():
            theta[there] = solve(gram[np.ix_(there, there)], moment[there], None if near is None else near[there])
        return theta
    scaled = gram / np.outer(size, size)
    factor, failed = lapack.dpotrf(scaled, lower=True)
    if not failed and np.diagonal(factor).min() > WELL_POSED:
        answer: Array = lapack.dpotrs(factor, moment / size, lower=True)[0] / size
        return answer
    begin = np.zeros(len(moment)) if near is None else near
    rest = moment / size - scaled @ (begin * size)
    found = _beside_unseen(scaled, rest)
    if found is None:
        value, vector = np.linalg.eigh(scaled)
        seen = value > RANK * value[-1]
        found = vector[:, seen] @ ((vector[:, seen].T @ rest) / value[seen])
    return begin + found / size


def _beside_unseen(scaled: Array, moment: Array) -> Array | None:
    """(K,) the shortest solution where some directions are surely unseen and all others surely seen: columns that
    depend on others to rounding. A pivoted Cholesky factor takes a tenth of the time of eigenvalues; None where only
    these decide."""
    clear, rounding = 1e-6, 1e-12
    factor, order, rank, _ = lapack.dpstrf(scaled, tol=clear, lower=True)
    order, lower = order - 1, np.tril(factor)[:, :rank]
    seen, unseen = lower[:rank], lower[rank:]
    rest = scaled[np.ix_(order[rank:], order[rank:])] - unseen @ unseen.T
    if not rank or np.abs(rest).max(initial=0.0) > rounding:
        return None
    through = lapack.dtrtrs(seen, unseen.T, lower=True, trans=1)[0]
    ordered = moment[order]
    if np.abs(ordered[rank:] - through.T @ ordered[:rank]).max(initial=0.0) > rounding * np.abs(moment).max():
        return None
    basic = np.append(lapack.dpotrs(seen, ordered[:rank], lower=True)[0], np.zeros(len(moment) - rank))
    null = np.vstack([-through, np.eye(len(moment) - rank)])
    found = np.empty(len(moment))
    found[order] = basic - null @ np.linalg.solve(null.T @ null, null.T @ basic)
    return found


def inverse(gram: Array) -> Array:
    """(K, K) by which `solve` answers any moment."""
    found, there = np.zeros(gram.shape), np.flatnonzero(np.diag(gram) > 0)
    part, size = np.ix_(there, there), np.sqrt(np.diag(gram)[there])
    if len(there):
        value, vector = np.linalg.eigh(gram[part] / np.outer(size, size))
        seen = value > RANK * value[-1]
        found[part] = (vector[:, seen] / value[seen]) @ vector[:, seen].T / np.outer(size, size)
    return found


def rank(gram: Array) -> int:
    """Number of separate directions that the data see."""
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    there = size > 0
    if not there.any():
        return 0
    value = np.linalg.eigvalsh(gram[np.ix_(there, there)] / np.outer(size[there], size[there]))
    return int(np.sum(value > RANK * value[-1]))


def bounded(gram: Array, moment: Array, lower: Array, upper: Array, near: Array | None = None) -> Array:
    """argmin ½ θᵀ gram θ − momentᵀ θ with lower <= θ <= upper; unseen directions as in `solve`.

    gram (K, K); moment, lower, upper, near (K,). Source: the active-set method BVLS, Stark & Parker, "Bounded-variable
    least squares", Computational Statistics 10, 1995. It begins with all coefficients on the bounds that they would
    leave otherwise, and releases one of them at a time while that lowers the cost. A Gram matrix that is compensated
    for noise need not be positive: a release that brings nothing is taken back, so that there is an end.
    """
    inside = solve(gram, moment, near)
    if np.all((inside >= lower) & (inside <= upper)):
        return inside
    theta, held = _held_where_broken(gram, moment, lower, upper=upper, near=near)
    fixed, refused = lower == upper, np.zeros(len(theta), dtype=bool)
    while (loose := held & ~fixed & ~refused).any():
        # How much the cost falls with a coefficient that leaves its bound, per unit of its column's size.
        size = np.sqrt(np.where(np.diag(gram) > 0, np.diag(gram), np.inf))
        fall = (moment - gram @ theta) / size
        inward = np.where(loose, np.where(theta > lower, -fall, fall), 0.0)
        at = int(np.argmax(inward))
        if inward[at] <= OPTIMAL * float(np.max(np.abs(moment) / size)):
            break
        tried, now_held = _released(gram, moment, lower, upper=upper, near=near, theta=theta, held=held, at=at)
        if _cost(gram, moment, tried) < _cost(gram, moment, theta):
            theta, held, refused = tried, now_held, np.zeros(len(theta), dtype=bool)
        else:
            refused[at] = True
    return theta


def of_size(square: Array, centre: Array, size: float, near: Array, slack: float) -> Array:
    """(k,) argmin (y - centre)ᵀ square (y - centre) with |y| = size, or y = 0 where that is less yet.

    slack   places on both sides of a sphere that differ by less than it are alike: then the nearest to `near` (k,)
    A quadratic has one more local minimum on a sphere than the least one: Martínez, SIAM J. Optimization 4, 1994.
    """
    axes = np.linalg.eigh(square)[1].T
    starts = [x for x in (near, centre, *axes, *-axes) if np.any(x)]
    ends = np.array([_down_on_sphere(square, centre, size * x / np.linalg.norm(x)) for x in starts])
    cost = np.einsum("si,ij,sj->s", ends - centre, square, ends - centre)
    if centre @ square @ centre < cost.min():
        return np.zeros_like(centre)
    alike = cost <= cost.min() + (slack if np.any(near) else 0.0)
    return np.array(ends[np.argmax(np.where(alike, ends @ near, -np.inf))])


def tangents(y: Array) -> Array:
    """(k, k - 1) orthonormal directions in which y (k,) keeps its size; all (k, k) where it is nothing."""
    return np.linalg.svd(y[None])[2][1:].T if np.any(y) else np.eye(len(y))


def _down_on_sphere(square: Array, centre: Array, y: Array) -> Array:
    """A local minimum from y on, by Newton's steps within the sphere; where it bends upwards, by its bend's size."""
    size, most, small = np.linalg.norm(y), 100, 1e-10

    def cost(x: Array) -> float:
        return float((x - centre) @ square @ (x - centre))

    for _ in range(most):
        flat, slope = tangents(y), square @ (y - centre)
        bend, vector = np.linalg.eigh(flat.T @ square @ flat - (slope @ y) / size**2 * np.eye(len(y) - 1))
        bend = np.maximum(np.abs(bend), small * np.abs(square).max())
        step = -flat @ vector @ ((vector.T @ flat.T @ slope) / bend)
        step *= min(1.0, size / max(2 * float(np.linalg.norm(step)), 1e-300))
        while np.linalg.norm(step) > small * size:
            there = y + step
            there = there * size / np.linalg.norm(there)
            if cost(there) < cost(y):
                y = there
                break
            step = step / 2
        else:
            break
    return y


def _held_where_broken(
    gram: Array, moment: Array, lower: Array, upper: Array, near: Array | None
) -> tuple[Array, Mask]:
    """A place within the bounds to begin from, optimal in the coefficients that are not held there (K,)."""
    held = lower == upper
    theta = np.where(held, lower, 0.0)
    for _ in range(len(theta) + 1):
        theta = _with_held(gram, moment, near, theta=theta, held=held)
        broken = ~held & ((theta < lower) | (theta > upper))
        if not broken.any():
            break
        held |= broken
        theta = np.where(held, np.clip(theta, lower, upper), theta)
    return theta, held


def _released(
    gram: Array,
    moment: Array,
    lower: Array,
    upper: Array,
    near: Array | None,
    theta: Array,
    held: Mask,
    at: int,
) -> tuple[Array, Mask]:
    """From theta with coefficient `at` free, too: as far towards each optimum as the bounds let it, holding what
    meets them."""
    held = held.copy()
    held[at] = False
    while True:
        goal = _with_held(gram, moment, near, theta=theta, held=held)
        broken = ~held & ((goal < lower) | (goal > upper))
        if not broken.any():
            return goal, held
        bound = np.where(goal > upper, upper, lower)
        part = np.full(len(theta), np.inf)
        part[broken] = (bound[broken] - theta[broken]) / (goal[broken] - theta[broken])
        step = float(part.min())
        held |= part <= step
        theta = np.where(part <= step, bound, np.clip(theta + step * (goal - theta), lower, upper))


def _with_held(gram: Array, moment: Array, near: Array | None, theta: Array, held: Mask) -> Array:
    free, answer = ~held, theta.copy()
    rest = moment[free] - gram[np.ix_(free, held)] @ theta[held]
    answer[free] = solve(gram[np.ix_(free, free)], rest, None if near is None else near[free])
    return answer


def _cost(gram: Array, moment: Array, theta: Array) -> float:
    return float(theta @ (0.5 * (gram @ theta) - moment))


def minimise(
    gram: Array,
    moment: Array,
    lower: Array,
    upper: Array,
    violated: Callable[[Array], Array | None],
    near: Array | None = None,
) -> Array:
    """argmin ½ θᵀ gram θ − momentᵀ θ with lower <= θ <= upper and c·θ > 0 for every cut of `violated`.

    `violated(θ)` gives cuts (C, K) of which θ breaks at least one, or None: on good data always None, and the answer is
    that of `bounded`. Directions that the data do not see stay at `near` (K,), None: at zero.
    """
    theta = bounded(gram, moment, lower, upper=upper, near=near)
    cuts = violated(theta)
    if cuts is None:
        return theta
    scale = np.sqrt(np.maximum(np.diag(gram), 0.0))
    scale = np.where(scale > 0, scale, 1.0)
    begin = np.zeros(len(theta)) if near is None else near
    # What the program seeks is counted from there, so that its ridge holds it there.
    program = _Program.of(gram / np.outer(scale, scale), (moment - gram @ begin) / scale)
    lowest, highest = (lower - begin) * scale, (upper - begin) * scale
    # Each cut is a posture at which D was not positive definite; good data need a few. Within a margin of a millionth
    # of the torque their neighbours are met as well.
    most, margin, known = 30, 1e-6 * float(np.linalg.norm(theta * scale)), dict[bytes, Array]()
    for _ in range(most):
        before = len(known)
        known |= {cut.tobytes(): cut for cut in cuts / scale}
        if len(known) == before:
            break  # to rounding it meets them all
        a = np.array(list(known.values()))
        a /= np.maximum(np.linalg.norm(a, axis=1), 1e-300)[:, None]
        scaled = program.solve(lowest, highest, a, margin - a @ (begin * scale))
        theta = begin + _snapped(scaled, lowest, highest) / scale
        cuts = violated(theta)
        if cuts is None:
            break
    return theta


def _snapped(theta: Array, lower: Array, upper: Array) -> Array:
    near = 1e-8 * float(np.max(np.abs(theta), initial=0.0))
    theta = np.where(theta < lower + near, lower, theta)
    return np.where(theta > upper - near, upper, theta)


@dataclass(frozen=True)
class _Program:
    """argmin ½ xᵀ g x − mᵀ x under bounds and cuts, as the least distance |u| with x = back (u + goal).

    Directions of no positive size, of which the data say nothing, are given a ridge: a Gram matrix that is compensated
    for noise need have none. The dual of the least distance is one of non-negative least squares: Lawson & Hanson,
    Solving Least Squares Problems, 1974, chapter 23.
    """

    back: Array
    goal: Array

    @classmethod
    def of(cls, g: Array, m: Array) -> _Program:
        value, vector = np.linalg.eigh(g)
        positive = float(np.sum(value[value > 0])) or 1.0
        back = vector / np.sqrt(np.maximum(value, 1e-12 * positive / len(m)))
        return cls(back, back.T @ m)

    def solve(self, lower: Array, upper: Array, a: Array, least: Array) -> Array:
        """x (K,) with lower <= x <= upper and a x >= least."""
        from scipy.optimize import nnls  # where it is used: it takes longer to load than a fit

        has_lower, has_upper = np.isfinite(lower), np.isfinite(upper)
        push = np.vstack([a @ self.back, self.back[has_lower], -self.back[has_upper]])
        need = np.concatenate([least, lower[has_lower], -upper[has_upper]]) - push @ self.goal
        size = np.maximum(np.linalg.norm(push, axis=1), 1e-300)
        push, need = push / size[:, None], need / size
        pressing = nnls(np.vstack([push.T, need]), np.append(np.zeros(len(self.goal)), 1.0))[0] > 0
        # What presses is met exactly, and not to the accuracy of the dual.
        shift = np.zeros(len(self.goal))
        if pressing.any():
            shift = np.linalg.lstsq(push[pressing], need[pressing], rcond=None)[0]
        x: Array = self.back @ (self.goal + shift)
        return x


@dataclass(frozen=True)
class Alike:
    """As `bounded`, of several problems with the same bounds.

    grams (F, K, K); lower, upper (K,); ends: on which bounds coefficients may end; core: the same problems without
    their last coefficients, of which others know more already
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
            for sides in self.ends or [np.zeros(len(self.lower), dtype=np.int8)]:
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
