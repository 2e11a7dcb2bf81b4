"""What is known of a joint's rows and of the columns on them, and the products of these.

Everything that a system decides follows from products of rows; they are computed once for each pair of equal blocks.
Products of a realisation of the encoders' noise are subtracted from all of them (bias-compensated least squares,
Stoica & Söderström 1982).
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from runtime.arrays import Array, Mask
from runtime.regression.noise import Whitening, autoregression

Places = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class JointRows:
    """The rows of one joint.

    tau (M,) N m (N); noise (M,): what a realisation of the encoders' noise adds to it, None where there is none; use
    (M,): rows that count, at least some; piece (M,): the stretch of time of a row; weight: 1/σ; eliminated (M, K):
    combinations of rows that were taken out; unaffected (M,): rows that none of them reaches, None: all that count;
    dependent: how many rows follow from others; version: equal for equal torques of the same rows, None: of no other.
    """

    tau: Array
    use: Mask
    piece: Places
    weight: float = 1.0
    eliminated: sparse.csr_array | None = None
    unaffected: Mask | None = None
    dependent: int = 0
    noise: Array | None = None
    version: Hashable = None

    @cached_property
    def at(self) -> Places:
        """(m,) places of the rows that count."""
        return np.flatnonzero(self.use)

    @property
    def count(self) -> int:
        """Number of rows that count, m."""
        return len(self.at)

    @property
    def independent(self) -> int:
        """Number of rows that count and do not follow from others."""
        return max(1, self.count - self.dependent)

    def used(self, x: Array) -> Array:
        """Rows that count of x (..., M): (..., m)."""
        return np.ascontiguousarray(x if self.count == len(self.use) else np.take(x, self.at, axis=-1))

    @property
    def torque(self) -> Columns:
        """The torque as one row."""
        return Columns(self.tau[None], None if self.noise is None else self.noise[None])

    def spread(self, x: Array) -> Array:
        """x (..., m) over all rows (..., M), zero in those that do not count."""
        if self.count == len(self.use):
            return x
        out = np.zeros((*x.shape[:-1], len(self.use)))
        out[..., self.at] = x
        return out

    def whitening(self, residual: Array) -> Whitening:
        """The filter that makes a residual (M,) white: its autoregression where no row was affected by elimination."""
        ar = autoregression(residual, self.use if self.unaffected is None else self.unaffected, self.piece)
        return Whitening.of(ar, self.use, self.piece, self.eliminated)


@dataclass(frozen=True, eq=False)
class Columns:
    """What a term has of one joint's rows: (1 + k, M), the part without free coefficient, then the columns.

    noise (1 + k, M): what a realisation of the encoders' noise adds to them; None where there is none. white (k,):
    variance of further white noise in the columns. With S choices of a term's shape the first axis has that size.
    """

    rows: Array
    noise: Array | None = None
    white: Array | None = None


@dataclass(frozen=True, eq=False)
class Block:
    """A term's columns by joint (0-based), and the bounds (k,) of its coefficients.

    key: the term's; version: equal for equal columns; near (k,): where a coefficient stays of which no row says
    anything, None: at zero
    """

    key: Hashable
    columns: Mapping[int, Columns]
    lower: Array
    upper: Array
    near: Array | None = None
    version: Hashable = None

    @property
    def finite(self) -> Mask:
        """Of each choice of the shape (S,), or () of a single one, whether all numbers have a square: a simulation can
        overflow for one shape on one stretch of motion."""
        rows = [x for part in self.columns.values() for x in (part.rows, part.noise) if x is not None]
        # The largest and the least of them are as good as all magnitudes, and NaN is among them.
        ends = [(np.max(x, axis=(-2, -1)), np.min(x, axis=(-2, -1))) for x in rows]
        largest = 1e100  # far beyond it, squares overflow
        there = [(high < largest) & (low > -largest) for high, low in ends]
        return np.asarray(np.all(there, axis=0))

    def choice(self, which: int | Mask) -> Block:
        """One choice of the shape, or some of them (S,)."""
        columns = {
            joint: replace(part, rows=part.rows[which], noise=None if part.noise is None else part.noise[which])
            for joint, part in self.columns.items()
        }
        return replace(self, columns=columns)

    def whitened(self, by: Sequence[Whitening]) -> Block:
        """The block with the rows of every joint whitened."""
        columns = {
            joint: Columns(by[joint](part.rows), None if part.noise is None else by[joint](part.noise))
            for joint, part in self.columns.items()
        }
        return replace(self, columns=columns)

    def torque(self, theta: Array) -> dict[int, Array]:
        """By joint (M,), of theta (1 + k,): how much of the part without coefficient, and coefficients."""
        return {joint: theta @ part.rows for joint, part in self.columns.items()}

    def noise(self, theta: Array) -> dict[int, Array]:
        """By joint (M,), the same of the encoders' noise."""
        return {joint: theta @ part.noise for joint, part in self.columns.items() if part.noise is not None}


@dataclass(frozen=True, eq=False)
class RowStack:
    """Rows of one joint that stand at `index` (r,) among all of a system: rows (r, m) and noise (r, m)."""

    index: Places
    rows: Array
    noise: Array | None

    @classmethod
    def of(cls, start: int, columns: Columns, rows: JointRows) -> RowStack:
        """Of the rows that count, without those that are zero throughout."""
        used, noise = rows.used(columns.rows), None if columns.noise is None else rows.used(columns.noise)
        index = np.arange(start, start + len(used))
        there = used.any(axis=1) if noise is None else used.any(axis=1) | noise.any(axis=1)
        if not there.all():
            index, used, noise = index[there], used[there], None if noise is None else noise[there]
        return cls(index, used, noise)

    def products(self, other: RowStack) -> Array:
        """(r, r') with other rows, compensated for the noise in both."""
        found: Array = self.rows @ other.rows.T
        if self.noise is not None and other.noise is not None:
            found -= self.noise @ other.noise.T
        return found

    def combined(self, direction: Array) -> tuple[Array, Array | None]:
        """(m,) of the rows and of their noise, of a direction (R,) among all rows of the system."""
        own = direction[self.index]
        return own @ self.rows, None if self.noise is None else own @ self.noise


@dataclass(frozen=True, eq=False)
class JointAt:
    """One joint at some coefficients of a system, on the rows that count: left, left_noise (m,) the residual and what
    of it is noise; columns, noise (b, m) of those unknowns (b,) that have any."""

    left: Array
    left_noise: Array
    columns: Array
    noise: Array
    unknown: Places


def joint_columns(parts: Sequence[RowStack], number: Places) -> tuple[Array, Array, Places]:
    """One joint's columns and their noise (b, m), on the rows that count, of those unknowns (b,) that have any; number
    (R,) of the unknowns of a system, -1 for what is none."""
    columns, noise, unknown = [], [], []
    for part in parts:
        own = number[part.index] >= 0
        columns.append(part.rows[own])
        noise.append(np.zeros_like(columns[-1]) if part.noise is None else part.noise[own])
        unknown.append(number[part.index[own]])
    return np.vstack(columns), np.vstack(noise), np.concatenate(unknown)


@dataclass(frozen=True, eq=False)
class JointProducts:
    """One joint's products (r, r) of its stacks by key, unweighted; order: keys and first rows of these."""

    stacks: Mapping[Hashable, RowStack]
    gram: Array
    order: Sequence[tuple[Hashable, int]]

    @classmethod
    def of(
        cls,
        joint: int,
        rows: JointRows,
        parts: Sequence[tuple[Hashable, int, Mapping[int, Columns]]],
        like: JointProducts | None,
    ) -> JointProducts:
        """parts: key, first row among all of the system, and columns by joint; like: of the same joint (0-based), of
        which equal keys are taken."""
        if like is not None and [(key, start) for key, start, _ in parts] == like.order:
            return like
        old, starts = ({}, {}) if like is None else (like.places, dict(like.order))
        stacks: dict[Hashable, RowStack] = {}
        for key, start, columns in parts:
            kept = like.stacks[key] if like is not None and key in old else None
            if kept is None:
                stacks[key] = RowStack.of(start, columns[joint], rows)
            else:
                stacks[key] = kept if start == starts[key] else replace(kept, index=kept.index + start - starts[key])
        size, order = sum(len(s.index) for s in stacks.values()), [(key, start) for key, start, _ in parts]
        made = cls(stacks, np.zeros((size, size)), order)
        new, both = made.places, [key for key in stacks if key in old]
        if like is not None and both:
            here, there = (np.concatenate([np.arange(p[k].start, p[k].stop) for k in both]) for p in (new, old))
            made.gram[here[:, None], here] = like.gram[there[:, None], there]
        keys = list(stacks)
        fresh = [n for n, key in enumerate(keys) if key not in old]
        for n, one in enumerate(keys):
            # In one order whatever is there already, so that equal blocks have equal products to the last digit.
            for m in range(n + 1) if n in fresh else [m for m in fresh if m < n]:
                other = keys[m]
                product = stacks[one].products(stacks[other])
                made.gram[new[one], new[other]] = product
                made.gram[new[other], new[one]] = product.T
        return made

    @cached_property
    def places(self) -> Mapping[Hashable, slice]:
        """By key, the places of its rows."""
        ends = np.cumsum([0, *(len(s.index) for s in self.stacks.values())])
        return {key: slice(*map(int, span)) for key, span in zip(self.stacks, pairwise(ends), strict=True)}

    @property
    def index(self) -> Places:
        """(r,) of its rows among all of the system."""
        return np.concatenate([s.index for s in self.stacks.values()])


def merged(parts: Sequence[RowStack]) -> RowStack:
    """All rows of a joint in one array."""
    noise = None
    if any(x.noise is not None for x in parts):
        noise = np.vstack([np.zeros_like(x.rows) if x.noise is None else x.noise for x in parts])
    return RowStack(np.concatenate([x.index for x in parts]), np.vstack([x.rows for x in parts]), noise)
