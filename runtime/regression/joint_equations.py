"""One joint's equations in blocks, a term's columns each: what a search leaves as it is, is not multiplied again."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Block:
    """What the arm or a term has of a joint's rows that count.

    key: equal for equal blocks of a joint; unknowns (k,): of the problem, to which its columns belong; rows, noise
    (1 + k, m): the part without free coefficient and the columns, and what noise of the encoders adds to them
    """

    key: Hashable
    unknowns: NDArray[np.intp]
    rows: Array
    noise: Array

    def times(self, other: Block) -> Array:
        """(k, k') of their columns, compensated."""
        product: Array = self.rows[1:] @ other.rows[1:].T - self.noise[1:] @ other.noise[1:].T
        return product


@dataclass(frozen=True)
class JointEquations:
    """A joint's blocks and the Gram matrix (K, K) of all their columns, compensated."""

    blocks: tuple[Block, ...]
    gram: Array

    @classmethod
    def of(cls, blocks: Sequence[Block], like: JointEquations | None) -> JointEquations:
        """like: equations of the same joint that may have some of these blocks."""
        old = {} if like is None else like._places
        new = _places(blocks)
        gram = np.zeros((sum(len(b.unknowns) for b in blocks),) * 2)
        kept = [b.key for b in blocks if b.key in old]
        if like is not None and kept:
            here, there = (np.concatenate([places[key] for key in kept]) for places in (new, old))
            gram[here[:, None], here] = like.gram[there[:, None], there]
        for n, one in enumerate(blocks):
            # In one order whatever is there already, so that equal blocks have equal products to the last digit.
            for other in blocks[: n + 1]:
                if one.key not in old or other.key not in old:
                    product = one.times(other)
                    gram[new[one.key][:, None], new[other.key]] = product
                    gram[new[other.key][:, None], new[one.key]] = product.T
        return cls(tuple(blocks), gram)

    @cached_property
    def _places(self) -> Mapping[Hashable, NDArray[np.intp]]:
        return _places(self.blocks)

    @cached_property
    def unknowns(self) -> NDArray[np.intp]:
        """(K,) of the problem, to which the columns belong."""
        return np.concatenate([b.unknowns for b in self.blocks])

    @cached_property
    def fixed(self) -> Array:
        """(m,) the part without free coefficient."""
        return np.asarray(sum(b.rows[0] for b in self.blocks))

    @cached_property
    def fixed_noise(self) -> Array:
        """(m,) what noise of the encoders adds to the part without free coefficient."""
        return np.asarray(sum(b.noise[0] for b in self.blocks))

    @cached_property
    def noise_moment(self) -> Array:
        """(K,) of the columns' noise with that of the fixed part."""
        return np.concatenate([b.noise[1:] @ self.fixed_noise for b in self.blocks])

    def moment(self, y: Array) -> Array:
        """(K,) of the columns with a torque y (m,)."""
        return np.concatenate([b.rows[1:] @ y for b in self.blocks])

    def torque(self, theta: Array) -> Array:
        """(m,) of coefficients theta (K,), less the fixed part."""
        return np.asarray(sum(theta[self._places[b.key]] @ b.rows[1:] for b in self.blocks))


@dataclass(frozen=True)
class Alternatives:
    """A joint's equations in S ways that share most of their blocks: what they share is multiplied once.

    same         what all ways share
    unknowns     (K,) of the problem: of what is shared, then of what each way has for itself
    rows, noise  (S, 1 + k, m) of what each has for itself, as in `Block`; one for all where they share everything
    """

    same: JointEquations
    unknowns: NDArray[np.intp]
    rows: Array
    noise: Array

    @classmethod
    def of(cls, same: JointEquations, own: Sequence[Sequence[Block]]) -> Alternatives:
        """own: by way its blocks, those of all ways for the same unknowns."""
        unknowns = np.concatenate([same.unknowns, *(b.unknowns for b in own[0])])
        if not own[0]:
            nothing = np.zeros((1, 1, len(same.fixed)))
            return cls(same, unknowns, nothing, nothing)
        rows, noise = ([_one_below_other(parts) for parts in ways] for ways in _parts_of(own))
        return cls(same, unknowns, np.array(rows), np.array(noise))

    @cached_property
    def grams(self) -> Array:
        """(S, K, K) compensated."""
        shared = len(self.same.unknowns)
        gram = np.empty((len(self.rows), len(self.unknowns), len(self.unknowns)))
        gram[:, :shared, :shared] = self.same.gram
        (columns, noise), rows, stray = self._shared, self.rows[:, 1:], self.noise[:, 1:]
        across = columns @ rows.transpose(0, 2, 1) - noise @ stray.transpose(0, 2, 1)
        gram[:, :shared, shared:], gram[:, shared:, :shared] = across, across.transpose(0, 2, 1)
        gram[:, shared:, shared:] = rows @ rows.transpose(0, 2, 1) - stray @ stray.transpose(0, 2, 1)
        return gram

    def moments(self, torque: Array) -> Array:
        """(S, K) of the columns with a torque (m,) less the parts without free coefficient, compensated."""
        left = (torque - self.same.fixed) - self.rows[:, 0]
        off = self.same.fixed_noise + self.noise[:, 0]
        columns, noise = self._shared
        own = self.rows[:, 1:] @ left[:, :, None] + self.noise[:, 1:] @ off[:, :, None]
        return np.concatenate([left @ columns.T + off @ noise.T, own[:, :, 0]], axis=1)

    def errors(self, torque: Array, theta: Array) -> Array:
        """(S,) squared, of a torque (m,) and each way's coefficients theta (S, K)."""
        shared = len(self.same.unknowns)
        explained = theta[:, :shared] @ self._shared[0] + (theta[:, None, shared:] @ self.rows[:, 1:])[:, 0]
        left = (torque - self.same.fixed) - self.rows[:, 0] - explained
        return np.einsum("sm,sm->s", left, left)

    @cached_property
    def _shared(self) -> tuple[Array, Array]:
        """(K', m) all columns that are shared, and their noise."""
        blocks = self.same.blocks
        return np.concatenate([b.rows[1:] for b in blocks]), np.concatenate([b.noise[1:] for b in blocks])


def _parts_of(own: Sequence[Sequence[Block]]) -> tuple[list[list[Array]], list[list[Array]]]:
    """By way, the rows and the noise of its blocks."""
    return [[b.rows for b in way] for way in own], [[b.noise for b in way] for way in own]


def _one_below_other(parts: Sequence[Array]) -> Array:
    """(1 + k, m) of several blocks: their parts without free coefficient added, and all columns."""
    return np.concatenate([np.sum([part[:1] for part in parts], axis=0), *(part[1:] for part in parts)])


def _places(blocks: Sequence[Block]) -> dict[Hashable, NDArray[np.intp]]:
    """By key, where in the columns of all of them one's stand."""
    found, start = {}, 0
    for block in blocks:
        found[block.key] = np.arange(start, start + len(block.unknowns))
        start += len(block.unknowns)
    return found
