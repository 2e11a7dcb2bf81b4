"""One linear system for every question of a diagnosis: rows a joint, a block of columns a term.

    tau_j = sum over blocks of (f_j + X_j theta) + e_j        at every joint j

f is the part of a term's torque without free coefficient, X its columns; unknowns theta that joints share (the base
inertial parameters) stand once. A fit, a candidate, a pair, a detection limit and the twist of a link encoder are this
system with other blocks. The samples are needed for its products of rows, for residuals and for whitening alone.

Columns come from measured positions and carry noise. The products of a realisation of that noise are subtracted from
all products (bias-compensated least squares, Stoica & Söderström 1982). Without this, any term that can switch the
inertia off where the motion is slow "explains" the encoder's noise. `level` adds to every squared error what noise the
system without candidates lets through, so that ratios of errors are those of real residuals.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.regression.bounded import Alike, Sides, inverse, minimise, rank, solve
from runtime.regression.noise import Whitening
from runtime.regression.rows import Block, Columns, JointAt, JointProducts, JointRows, RowStack, joint_columns, merged
from runtime.regression.settings import LEAST_OWN

Places = NDArray[np.intp]
JointColumns = tuple[Array, Array, Places]
Torques = Mapping[int, Array]
"""By joint (0-based), (..., M)."""


@dataclass(frozen=True, eq=False)
class BlockPlace:
    """The place of a block in a system: its part without coefficient stands at row `start`, its columns behind it."""

    key: Hashable
    start: int
    lower: Array
    upper: Array
    near: Array

    @classmethod
    def of(cls, block: Block, start: int) -> BlockPlace:
        near = np.zeros(len(block.lower)) if block.near is None else block.near
        return cls(block.key, start, block.lower, block.upper, near)

    @property
    def rows(self) -> Places:
        """(k,) of its columns."""
        return np.arange(self.start + 1, self.start + 1 + len(self.lower))


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """Torques of all joints and the blocks that explain them.

    gram    (R, R) products of all rows, compensated and weighted: the torque first, then each block's
    blocks  in the order of their rows      stacks  by joint what there is of the rows
    level   squared error that noise in the columns makes without candidates; a constant of all of them
    zero    keys of blocks that are left out
    base    the system without the last block, where that was added to one
    """

    joints: tuple[JointRows, ...]
    blocks: tuple[BlockPlace, ...]
    stacks: tuple[tuple[RowStack, ...], ...]
    gram: Array
    level: float = 0.0
    zero: frozenset[Hashable] = frozenset()
    base: LinearSystem | None = None
    _local: tuple[JointProducts, ...] = ()
    _own: tuple[JointColumns, ...] = ()

    @classmethod
    def of(cls, joints: Sequence[JointRows], blocks: Sequence[Block], like: LinearSystem | None = None) -> LinearSystem:
        """Of all blocks at once. like: a system of the same rows, of which products of equal keys are taken."""
        places, start = [], 1
        for block in blocks:
            places.append(BlockPlace.of(block, start))
            start += 1 + len(block.lower)
        local = []
        for j, rows in enumerate(joints):
            parts: list[tuple[Hashable, int, Mapping[int, Columns]]] = [(rows.version or rows, 0, {j: rows.torque})]
            pairs = zip(places, blocks, strict=True)
            parts += [(b.version or b.key, p.start, b.columns) for p, b in pairs if j in b.columns]
            local.append(JointProducts.of(j, rows, parts, like._local[j] if like is not None else None))
        gram = np.zeros((start, start))
        for rows, part in zip(joints, local, strict=True):
            gram[np.ix_(part.index, part.index)] += rows.weight**2 * part.gram
        stacks = tuple(tuple(part.stacks.values()) for part in local)
        return cls(tuple(joints), tuple(places), stacks, gram, _local=tuple(local))

    def with_block(self, block: Block) -> LinearSystem:
        """The system with one more block."""
        start, size = len(self.gram), 1 + len(block.lower)
        gram = np.zeros((start + size, start + size))
        gram[:start, :start] = self.gram
        stacks = list(self.stacks)
        for joint, columns in block.columns.items():
            rows = self.joints[joint]
            own = RowStack.of(start, columns, rows)
            for other in stacks[joint]:
                gram[np.ix_(own.index, other.index)] += rows.weight**2 * own.products(other)
            gram[np.ix_(own.index, own.index)] += rows.weight**2 * own.products(own)
            if columns.white is not None:
                inside = np.arange(start + 1, start + size)
                gram[inside, inside] -= rows.weight**2 * rows.count * columns.white
            stacks[joint] = (*stacks[joint], own)
        gram[:start, start:] = gram[start:, :start].T
        place = BlockPlace.of(block, start)
        return replace(
            self, blocks=(*self.blocks, place), stacks=tuple(stacks), gram=gram, base=self, _local=(), _own=()
        )

    def without(self, keys: Collection[Hashable]) -> LinearSystem:
        """The system without some blocks; its noise level stays. It is kept."""
        gone = self.zero | frozenset(keys)
        if gone == self.zero:
            return self
        if gone not in self._reduced:
            self._reduced[gone] = replace(self, zero=gone, base=None, _own=self._columns)
        return self._reduced[gone]

    @cached_property
    def _reduced(self) -> dict[frozenset[Hashable], LinearSystem]:
        return {}

    def merged(self) -> LinearSystem:
        """The system as the base of candidates: all rows of a joint stand in one array."""
        stacks = tuple((merged(parts),) if parts else () for parts in self.stacks)
        return replace(self, stacks=stacks, base=None, _local=(), _own=())

    def over(self, joints: Sequence[JointRows]) -> LinearSystem:
        """The system with rows that are weighted otherwise, merged and levelled."""
        return self._anew(joints, self.merged().stacks)

    def levelled(self) -> LinearSystem:
        """The system with the noise level of its own solution."""
        plain = replace(self, level=0.0)
        level, direction = 0.0, plain.solution.direction
        for rows, parts in zip(self.joints, self.stacks, strict=True):
            for _, noise in (part.combined(direction) for part in parts):
                if noise is not None:
                    level += rows.weight**2 * float(noise @ noise)
        return replace(plain, level=level)

    def without_noise(self) -> LinearSystem:
        """The system without compensation for noise in its columns."""
        stacks = [[RowStack(x.index, x.rows, None) for x in parts] for parts in self.stacks]
        return self._anew(self.joints, stacks)

    def alone(self, joint: int) -> LinearSystem:
        """The equations of one joint (0-based) by themselves, which then is joint 0, without compensation for noise and
        without bounds."""
        stack = merged(self.stacks[joint])
        made = self._anew([self.joints[joint]], [[RowStack(stack.index, stack.rows, None)]])
        free = tuple(
            replace(b, lower=np.full_like(b.lower, -np.inf), upper=np.full_like(b.upper, np.inf)) for b in self.blocks
        )
        return replace(made, blocks=free)

    def restricted(self, joints: Sequence[JointRows], places: Sequence[Places]) -> LinearSystem:
        """The system on some of its rows, levelled. joints: the rows that are kept; places (M',) by joint, where each
        of them stood; of those that count, all counted."""
        stacks = []
        for rows, kept, place, parts in zip(self.joints, joints, places, self.stacks, strict=True):
            among = np.searchsorted(rows.at, place[kept.at])
            stacks.append(
                tuple(
                    RowStack(x.index, x.rows[:, among], None if x.noise is None else x.noise[:, among]) for x in parts
                )
            )
        return self._anew(joints, stacks)

    def whitened(self, by: Sequence[Whitening], residual: Sequence[Array]) -> LinearSystem:
        """The system with the rows of every joint whitened and weighted by what is left of a residual (M,): a joint
        whose error is slow would otherwise count for little among others. All rows count then, and as many are
        independent as before."""
        joints, stacks, rounding = [], [], 1e-12
        for rows, white, left, parts in zip(self.joints, by, residual, self.stacks, strict=True):
            rms = float(np.linalg.norm(white(left))) / np.sqrt(rows.independent)
            every = np.ones_like(rows.use)
            joints.append(
                JointRows(
                    white(rows.tau),
                    every,
                    rows.piece,
                    weight=1 / rms if rms > rounding else rows.weight,
                    unaffected=rows.unaffected,
                    dependent=len(every) - rows.independent,
                )
            )
            stacks.append(
                tuple(
                    RowStack(
                        x.index,
                        white(rows.spread(x.rows)),
                        None if x.noise is None else white(rows.spread(x.noise)),
                    )
                    for x in parts
                )
            )
        return self._anew(joints, stacks)

    def _anew(self, joints: Sequence[JointRows], stacks: Sequence[Sequence[RowStack]]) -> LinearSystem:
        """The same blocks over other rows, levelled."""
        gram = np.zeros_like(self.gram)
        for rows, parts in zip(joints, stacks, strict=True):
            for one in parts:
                for other in parts:
                    gram[np.ix_(one.index, other.index)] += rows.weight**2 * one.products(other)
        own = tuple(tuple(parts) for parts in stacks)
        return replace(self, joints=tuple(joints), stacks=own, gram=gram, base=None, _local=(), _own=()).levelled()

    # unknowns --------------------------------------------------------------------------------------------------------

    @cached_property
    def unknown(self) -> Places:
        """(K,) rows of the columns of all blocks, in their order."""
        return np.concatenate([np.zeros(0, dtype=np.intp), *(b.rows for b in self.blocks)])

    @cached_property
    def slices(self) -> dict[Hashable, slice]:
        """By key of a block, its coefficients among all."""
        ends = np.cumsum([0, *(len(b.lower) for b in self.blocks)])
        return {b.key: slice(int(low), int(high)) for b, (low, high) in zip(self.blocks, pairwise(ends), strict=True)}

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """(K,) lower and upper; both zero of blocks that are left out."""
        ends = [(np.zeros(0), np.zeros(0))]
        for b in self.blocks:
            none = np.zeros(len(b.lower))
            ends.append((none, none) if b.key in self.zero else (b.lower, b.upper))
        lower, upper = map(np.concatenate, zip(*ends, strict=True))
        return lower, upper

    @cached_property
    def count(self) -> int:
        """Number of independent rows of all joints."""
        return sum(rows.independent for rows in self.joints)

    @cached_property
    def rank(self) -> int:
        """Number of separate directions that the columns span."""
        return rank(self._whole.grams[0])

    @cached_property
    def _torque(self) -> Array:
        found = np.zeros(len(self.gram))
        found[0] = 1.0
        found[[b.start for b in self.blocks if b.key not in self.zero]] = -1.0
        return found

    @cached_property
    def _whole(self) -> Alike:
        core = None if self.base is None else self.base._whole
        return Alike(self.normal[None], *self.bounds, ends=self._ends, core=core)

    @cached_property
    def _ends(self) -> list[Sides]:
        """On which bounds coefficients may end: where those of the base do, whatever other systems over it have found,
        so that no solution depends on the order of candidates."""
        if self.base is None:
            return []
        sides = self.base._sides
        return [np.append(sides, np.zeros(len(self.unknown) - len(sides), dtype=np.int8))]

    @cached_property
    def _sides(self) -> Sides:
        theta, (lower, upper) = self._coefficients, self.bounds
        return np.where(theta == lower, 1, np.where(theta == upper, -1, 0)).astype(np.int8)

    # solutions -------------------------------------------------------------------------------------------------------

    @property
    def solution(self) -> Solution:
        """Least squares on all rows, every coefficient within its bounds; the system does not keep it, as the two would
        keep each other until the garbage collector comes."""
        return Solution(self, self._torque, self.gram @ self._torque)

    @cached_property
    def _coefficients(self) -> Array:
        return self.solution.coefficients

    @cached_property
    def sse(self) -> float:
        """Squared error of the solution on all rows."""
        return self.solution.sse

    def solve(self, added: Array) -> Solution:
        """The same with more of the last block in the measured torque: added (1 + k,), of its part without coefficient
        and of its columns."""
        torque = self._torque.copy()
        torque[self.blocks[-1].start :] += added
        return Solution(self, torque, self.gram @ torque)

    def solve_before(self, added: Array) -> Solution:
        """The system before the last block was added, with more of that block in the measured torque."""
        assert self.base is not None
        torque = np.append(self.base._torque, added)
        return Solution(self.base, torque, self.gram @ torque)

    @cached_property
    def normal(self) -> Array:
        """(K, K) Gram matrix of the columns on all rows."""
        return self.gram[np.ix_(self.unknown, self.unknown)]

    def least(
        self, violated: Callable[[Array], Array | None] = lambda _: None, held: Mapping[int, float] | None = None
    ) -> Array:
        """(K,) least squares that `violated` accepts, see `minimise`. Directions that no row sees stay near where the
        blocks have them; held: coefficients by their place, with their values."""
        near = np.concatenate([np.zeros(0), *(b.near for b in self.blocks)])
        moment = (self.gram @ self._torque)[self.unknown]
        lower, upper = (bound.copy() for bound in self.bounds)
        for place, value in (held or {}).items():
            lower[place] = upper[place] = value
        return minimise(self.normal, moment, lower, upper=upper, violated=violated, near=near)

    def towards(self, theta: Array, violated: Callable[[Array], Array | None]) -> Array:
        """(K,) as `least`, where the moments are those of what theta leaves with the noise that is in it: down the
        slope of the squared residual, which is compared, and not of the compensated error."""
        moment = self.normal @ theta
        for rows, own in zip(self.joints, self.at(theta), strict=True):
            moment[own.unknown] += rows.weight**2 * (own.columns @ own.left)
        return minimise(self.normal, moment, *self.bounds, violated=violated, near=theta)

    def shift(self, theta: Array, along: Array) -> Array:
        """(F,) from coefficients theta to those of least squares without bounds, in directions along (K, F)."""
        moment = (self.gram @ self._direction(theta))[self.unknown]
        return solve(along.T @ self.normal @ along, along.T @ moment)

    def residual(self, theta: Array) -> tuple[Array, ...]:
        """By joint (M,), of coefficients theta (K,): N m (N), zero in rows that do not count."""
        return self._combined(self._direction(theta))

    def _direction(self, theta: Array, torque: Array | None = None) -> Array:
        direction = (self._torque if torque is None else torque).copy()
        direction[self.unknown] -= theta
        return direction

    def _combined(self, direction: Array) -> tuple[Array, ...]:
        found = []
        for rows, parts in zip(self.joints, self.stacks, strict=True):
            total = np.zeros(rows.count)
            for part in parts:
                total += part.combined(direction)[0]
            found.append(rows.spread(total))
        return tuple(found)

    # what a block would change ---------------------------------------------------------------------------------------

    @cached_property
    def projection(self) -> Array:
        """(K, K) pseudo-inverse of the Gram matrix over unknowns that are within their bounds."""
        theta, (lower, upper) = self._coefficients, self.bounds
        free = np.flatnonzero((theta > lower) & (theta < upper))
        found = np.zeros((len(theta), len(theta)))
        found[np.ix_(free, free)] = inverse(self._whole.grams[0][np.ix_(free, free)])
        return found

    def at(self, theta: Array) -> tuple[JointAt, ...]:
        """Every joint at coefficients theta (K,)."""
        direction, found = self._direction(theta), []
        for rows, parts, columns in zip(self.joints, self.stacks, self._columns, strict=True):
            left, heard = zip(*(part.combined(direction) for part in parts), strict=True)
            none = np.zeros(rows.count)
            found.append(JointAt(sum(left, none), sum((x for x in heard if x is not None), none), *columns))
        return tuple(found)

    @cached_property
    def _columns(self) -> tuple[JointColumns, ...]:
        number = np.full(len(self.gram), -1)
        number[self.unknown] = np.arange(len(self.unknown))
        return self._own or tuple(joint_columns(parts, number) for parts in self.stacks)

    @cached_property
    def _beside(self) -> tuple[JointAt, ...]:
        return self.at(self._coefficients)

    def plain_normal(self, at: Sequence[JointAt]) -> Array:
        """(K, K) `normal` without compensation for noise in the columns."""
        found = np.zeros((len(self.unknown), len(self.unknown)))
        for rows, own in zip(self.joints, at, strict=True):
            found[np.ix_(own.unknown, own.unknown)] += rows.weight**2 * own.columns @ own.columns.T
        return found

    def scores(self, at: Sequence[JointAt], stretches: Sequence[Places]) -> Array:
        """(S, K) weighted sums of columns times residual over S stretches; stretches: by joint (M,), of each row."""
        every = np.unique(np.concatenate(stretches))
        found = np.zeros((len(every), len(self.unknown)))
        for rows, own, each in zip(self.joints, at, stretches, strict=True):
            stretch = each[rows.at]
            starts = np.flatnonzero(np.diff(stretch, prepend=-1))
            if len(starts):
                sums = np.add.reduceat(own.columns * (rows.weight**2 * own.left), starts, axis=1)
                np.add.at(found, (np.searchsorted(every, stretch[starts])[:, None], own.unknown), sums.T)
        return found

    def products(self, at: Sequence[JointAt], torques: Torques) -> Array:
        """(K,) weighted sums of columns times torques (M,)."""
        found = np.zeros(len(self.unknown))
        for joint, torque in torques.items():
            rows, own = self.joints[joint], at[joint]
            found[own.unknown] += rows.weight**2 * (own.columns @ rows.used(torque))
        return found

    def beside(self, joint: int) -> tuple[Array, Array, Array]:
        """Rows of a joint (0-based) that count, weighted: the residual (m,), the columns (b, m), and the part (b, b) of
        the projection that belongs to these."""
        own, weight = self._beside[joint], self.joints[joint].weight
        return weight * own.left, weight * own.columns, self.projection[np.ix_(own.unknown, own.unknown)]

    def columns(self, joint: int) -> Array:
        """(b, m) columns of a joint (0-based) on the rows that count, not weighted."""
        return self._beside[joint].columns

    def gains(self, blocks: Block) -> Array:
        """(S,) by how much each of S choices of a block lowers the squared error, the system's own unknowns not held by
        their bounds: quick, for searches. Noise counts where it is given."""
        k, size = len(blocks.lower), len(self.unknown)
        count = len(next(iter(blocks.columns.values())).rows)
        moment, square = np.zeros((count, k + 1)), np.zeros((count, k + 1, k + 1))
        cross = np.zeros((count, k + 1, size))
        for joint, part in blocks.columns.items():
            rows, own = self.joints[joint], self._beside[joint]
            x, weight = rows.used(part.rows), rows.weight**2
            moment += weight * (x @ own.left)
            square += weight * (x @ x.swapaxes(1, 2))
            cross[:, :, own.unknown] += weight * (x @ own.columns.T)
            if part.noise is not None:
                noise = rows.used(part.noise)
                moment -= weight * (noise @ own.left_noise)
                square -= weight * (noise @ noise.swapaxes(1, 2))
                cross[:, :, own.unknown] -= weight * (noise @ own.noise.T)
        own_square = square - cross @ self.projection @ cross.swapaxes(1, 2)
        seen = np.diagonal(own_square, axis1=1, axis2=2) > LEAST_OWN * np.diagonal(square, axis1=1, axis2=2)
        moment = np.where(seen, moment, 0.0)
        # What is not seen gets a square of its own and no moment: then it stays at zero, and the others as they are.
        own_square = np.where(seen[:, :, None] & seen[:, None, :], own_square, np.eye(k + 1))
        fall = np.where(seen[:, 0], 2 * moment[:, 0] - own_square[:, 0, 0], 0.0)
        if k:
            target, inner = moment[:, 1:] - own_square[:, 1:, 0], own_square[:, 1:, 1:]
            theta = np.where(seen[:, 1:], Alike(inner, blocks.lower, blocks.upper).solve(target), 0.0)
            fall += np.einsum("sk,sk->s", theta, 2 * target - np.einsum("skl,sl->sk", inner, theta))
        return fall

    def beyond(self, torques: Torques) -> Array:
        """(count,) rows of all joints that count, weighted: what the system cannot take over of torques (M,)."""
        used = {joint: self.joints[joint].used(torque) for joint, torque in torques.items()}
        taken, found = self.projection @ self.products(self._beside, torques), []
        for joint, (rows, own) in enumerate(zip(self.joints, self._beside, strict=True)):
            found.append(rows.weight * (used.get(joint, 0.0) - taken[own.unknown] @ own.columns))
        return np.concatenate(found)

    def own(self, torques: Torques) -> tuple[Array, Array]:
        """Weighted squares (...) of what the system cannot take over of torques (..., M), and of them whole."""
        ahead = next(iter(torques.values())).shape[:-1] if torques else ()
        square, cross = np.zeros(ahead), np.zeros((*ahead, len(self.unknown)))
        for joint, torque in torques.items():
            rows, own = self.joints[joint], self._beside[joint]
            x = rows.used(torque)
            square += rows.weight**2 * np.einsum("...m,...m->...", x, x)
            cross[..., own.unknown] += rows.weight**2 * (x @ own.columns.T)
        return np.maximum(square - ((cross @ self.projection) * cross).sum(axis=-1), 0.0), square

    def held(self, theta: Array) -> tuple[float, float]:
        """How much of a torque of the last block, theta (1 + k,), the measurement holds already, and its standard
        deviation if rows are white."""
        assert self.base is not None
        base, whole, own = self.base, self.gram, slice(self.blocks[-1].start, None)
        against = np.column_stack([whole[:, own] @ theta, whole[:, : own.start] @ base._torque])
        taken = base.projection @ against[base.unknown]
        left = theta @ (against[own] - whole[own][:, base.unknown] @ taken)
        kept, cross = float(left[0]), float(left[1])
        if kept <= 0:
            return 0.0, float("inf")
        return cross / kept, float(np.sqrt(max(base.sse, 0.0) / base.count / kept))


@dataclass(frozen=True, eq=False)
class Solution:
    """Least squares of a system for one torque.

    torque (R,): the combination of all rows that is explained; against (R,): its products with them. Errors are
    weighted as the rows are.
    """

    system: LinearSystem
    torque: Array
    against: Array

    @cached_property
    def coefficients(self) -> Array:
        """(K,) of all rows, each within its bounds."""
        found: Array = self.system._whole.solve(self.against[None, self.system.unknown])[0]
        return found

    @property
    def direction(self) -> Array:
        """(R,) of the residual among all rows of the system."""
        return self.system._direction(self.coefficients)

    @cached_property
    def residual(self) -> tuple[Array, ...]:
        """By joint (M,) N m (N), zero in rows that do not count."""
        return self.system.residual(self.coefficients)

    @cached_property
    def sse(self) -> float:
        """Squared error on all rows."""
        theta, moment = self.coefficients, self.against[self.system.unknown]
        left = self.against @ self.torque + theta @ (self.system.normal @ theta - 2 * moment)
        return float(left) + self.system.level
