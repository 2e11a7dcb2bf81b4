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
    def noise_moment(self) -> Array:
        """(K,) of the columns' noise with that of the fixed part."""
        fixed = np.asarray(sum(b.noise[0] for b in self.blocks))
        return np.concatenate([b.noise[1:] @ fixed for b in self.blocks])

    def moment(self, y: Array) -> Array:
        """(K,) of the columns with a torque y (m,)."""
        return np.concatenate([b.rows[1:] @ y for b in self.blocks])

    def torque(self, theta: Array) -> Array:
        """(m,) of coefficients theta (K,), less the fixed part."""
        return np.asarray(sum(theta[self._places[b.key]] @ b.rows[1:] for b in self.blocks))


def _places(blocks: Sequence[Block]) -> dict[Hashable, NDArray[np.intp]]:
    """By key, where in the columns of all of them one's stand."""
    found, start = {}, 0
    for block in blocks:
        found[block.key] = np.arange(start, start + len(block.unknowns))
        start += len(block.unknowns)
    return found
