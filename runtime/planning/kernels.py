"""The blocks of a program in numbers, place by place, and what a solver of dense systems needs of them.

A block's place sees few numbers z of the unknowns x, so that a sum over places of Gᵀ Σ G is formed in z, where it is
as small as the Hessian is, and goes to x together with it: the many rows of constraints cost next to nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from runtime.planning.batch import Batch, Instructions, Machine
from runtime.planning.blocks import ProgramBlock

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BlockSlopes:
    """What of a block changes with z at every place: Jacobians of its rows (N, rows, nz), and of the squares in its
    cost (N, s, nz), which are `squares` (N, s)."""

    rows: Array
    squares: Array
    of_squares: Array


@dataclass(frozen=True)
class PlacedBlock:
    """A block with its places as dense arrays: unknowns (k,) of x that it sees, maps (N, nz, k) from them to z."""

    block: ProgramBlock
    machine: Machine

    @cached_property
    def unknowns(self) -> NDArray[np.int64]:
        return np.unique(self.block.places.indices).astype(np.int64)

    @cached_property
    def maps(self) -> Array:
        dense = self.block.places[:, self.unknowns].toarray()
        return np.ascontiguousarray(
            dense.reshape(self.block.count, self.block.expression.z.numel(), len(self.unknowns))
        )

    @cached_property
    def _flat(self) -> Array:
        return self.maps.reshape(-1, len(self.unknowns))

    def _batch(self, instructions: Instructions) -> Batch:
        return Batch(self.machine, instructions, self.block.count)

    @cached_property
    def _value(self) -> Batch:
        return self._batch(self.block.expression.instructions.value)

    @cached_property
    def _slope(self) -> Batch:
        return self._batch(self.block.expression.instructions.slope)

    @cached_property
    def _curvature(self) -> Batch:
        return self._batch(self.block.expression.instructions.curvature)

    def seen(self, x: Array) -> Array:
        """(N, nz) z at every place."""
        return (self._flat @ x[self.unknowns]).reshape(self.block.count, -1)

    def value(self, x: Array, p: Array) -> tuple[float, Array]:
        """Cost, and rows (N, rows)."""
        batch = self._value
        batch.inputs[0][:], batch.inputs[1][:] = self.seen(x), p
        cost, rows = batch()
        return float(self.block.weights @ cost.ravel()), rows.reshape(self.block.count, -1).copy()

    def slope(self, x: Array, p: Array) -> tuple[Array, BlockSlopes]:
        """Gradient (N, nz) of the weighted cost by z, and what else changes with z."""
        batch = self._slope
        batch.inputs[0][:], batch.inputs[1][:] = self.seen(x), p
        gradient, jacobian, squares, of_squares = batch()
        slopes = [np.ascontiguousarray(part.transpose(0, 2, 1)) for part in (jacobian, of_squares)]
        found = BlockSlopes(slopes[0], squares[:, 0].copy(), slopes[1])
        whole = gradient[:, 0] + 2 * by_row(found.squares, found.of_squares)
        return self.block.weights[:, None] * whole, found

    def curvature(self, x: Array, p: Array, slopes: BlockSlopes, scale: float, y: Array) -> Array:
        """(N, nz, nz) of scale · cost + y (N, rows) · rows, where the slopes are those."""
        batch, weight = self._curvature, scale * self.block.weights
        batch.inputs[0][:], batch.inputs[1][:] = self.seen(x), p
        batch.inputs[2][:], batch.inputs[3][:], batch.inputs[4][:] = weight[:, None], y, slopes.squares
        inner = slopes.of_squares.transpose(0, 2, 1) @ slopes.of_squares
        found: Array = batch()[0] + 2 * weight[:, None, None] * inner
        return found

    def add_transposed(self, total: Array, v: Array) -> None:
        """Adds what v (N, nz), by z, is by x."""
        total[self.unknowns] += v.ravel() @ self._flat

    def add_congruence(self, total: Array, m: Array) -> None:
        """Adds what m (N, nz, nz), by z twice, is by x."""
        whole = self._flat.T @ (m @ self.maps).reshape(-1, len(self.unknowns))
        total[np.ix_(self.unknowns, self.unknowns)] += whole

    def ahead(self, dx: Array) -> Array:
        """(N, nz) by how much z changes with x."""
        return (self._flat @ dx[self.unknowns]).reshape(self.block.count, -1)


@dataclass(frozen=True)
class Kernels:
    """All blocks of a program. Rows stand in one vector, block after block, place after place."""

    blocks: tuple[PlacedBlock, ...]
    size: int

    @classmethod
    def of(cls, blocks: Sequence[ProgramBlock], machine: Machine) -> Kernels:
        return cls(tuple(PlacedBlock(b, machine) for b in blocks), blocks[0].places.shape[1])

    @cached_property
    def _ends(self) -> list[slice]:
        ends = np.cumsum([0, *(b.block.expression.rows.numel() * b.block.count for b in self.blocks)]).tolist()
        return [slice(a, b) for a, b in pairwise(ends)]

    def value(self, x: Array, p: Array) -> tuple[float, Array]:
        """Cost, and all rows (m,)."""
        parts = [block.value(x, p) for block in self.blocks]
        return sum(cost for cost, _ in parts), np.concatenate([rows.ravel() for _, rows in parts])

    def slope(self, x: Array, p: Array) -> tuple[Array, list[BlockSlopes]]:
        """Gradient (nx,) of the cost, and the slopes of each block."""
        gradient, found = np.zeros(self.size), []
        for block in self.blocks:
            slope, slopes = block.slope(x, p)
            block.add_transposed(gradient, slope)
            found.append(slopes)
        return gradient, found

    def condensed(
        self, x: Array, p: Array, slopes: Sequence[BlockSlopes], scale: float, y: Array, sigma: Array
    ) -> Array:
        """(nx, nx): Hessian of scale · cost + y · rows, and Jᵀ diag(sigma) J, where the slopes are those."""
        total = np.zeros((self.size, self.size))
        for block, here, place in zip(self.blocks, slopes, self._ends, strict=True):
            G, own = here.rows, here.rows.shape[:2]
            m = block.curvature(x, p, here, scale, y[place].reshape(own))
            m += G.transpose(0, 2, 1) @ (sigma[place].reshape(own)[:, :, None] * G)
            block.add_congruence(total, m)
        return total

    def transposed(self, slopes: Sequence[BlockSlopes], y: Array) -> Array:
        """(nx,) Jᵀ y."""
        total = np.zeros(self.size)
        for block, here, place in zip(self.blocks, slopes, self._ends, strict=True):
            block.add_transposed(total, by_row(y[place].reshape(here.rows.shape[:2]), here.rows))
        return total

    def ahead(self, slopes: Sequence[BlockSlopes], dx: Array) -> Array:
        """(m,) J dx."""
        parts = zip(self.blocks, slopes, strict=True)
        return np.concatenate([(here.rows @ block.ahead(dx)[:, :, None]).ravel() for block, here in parts])

    def chosen(self, slopes: Sequence[BlockSlopes], rows: NDArray[np.bool_]) -> Array:
        """(k, nx) rows of J that are chosen, dense."""
        found = []
        for block, here, place in zip(self.blocks, slopes, self._ends, strict=True):
            at, which = np.nonzero(rows[place].reshape(here.rows.shape[:2]))
            if len(at):
                dense = np.zeros((len(at), self.size))
                dense[:, block.unknowns] = by_row(here.rows[at, which], block.maps[at])
                found.append(dense)
        return np.concatenate(found) if found else np.zeros((0, self.size))


def by_row(v: Array, matrices: Array) -> Array:
    """(N, k) vᵀ M at every place, v (N, r) and matrices (N, r, k)."""
    product: Array = (v[:, None] @ matrices)[:, 0]
    return product
