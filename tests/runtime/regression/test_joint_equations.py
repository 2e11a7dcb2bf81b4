"""A joint's equations in blocks: what is exchanged comes out as if all had been multiplied anew."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from runtime.regression.joint_equations import Block, JointEquations

Array = NDArray[np.float64]
ROWS = 40
SIZES = (3, 1, 2)


def _block(key: int, at: NDArray[np.intp], rng: np.random.Generator) -> Block:
    return Block(key, at, rng.standard_normal((1 + len(at), ROWS)), 0.1 * rng.standard_normal((1 + len(at), ROWS)))


def _blocks(rng: np.random.Generator) -> list[Block]:
    places = np.split(rng.permutation(9)[: sum(SIZES)], np.cumsum(SIZES)[:-1])
    return [_block(key, at, rng) for key, at in enumerate(places)]


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), moved=st.integers(0, len(SIZES) - 1))
def test_an_exchanged_block_leaves_the_same_equations(seed: int, moved: int) -> None:
    rng = np.random.default_rng(seed)
    blocks = _blocks(rng)
    before = JointEquations.of(blocks, None)
    blocks[moved] = _block(len(SIZES), blocks[moved].unknowns, rng)
    fresh, made = JointEquations.of(blocks, None), JointEquations.of(blocks, before)
    assert np.array_equal(made.gram, fresh.gram)
    assert np.array_equal(made.gram, made.gram.T)


def test_equations_are_those_of_all_columns() -> None:
    rng = np.random.default_rng(1)
    blocks = _blocks(rng)
    equations = JointEquations.of(blocks, None)
    x, noise = (np.vstack([getattr(b, name)[1:] for b in blocks]) for name in ("rows", "noise"))
    fixed, fixed_noise = (sum(getattr(b, name)[0] for b in blocks) for name in ("rows", "noise"))
    theta, y = rng.standard_normal(len(x)), rng.standard_normal(ROWS)
    for ours, whole in (
        (equations.gram, x @ x.T - noise @ noise.T),
        (equations.noise_moment, noise @ fixed_noise),
        (equations.fixed, fixed),
        (equations.moment(y), x @ y),
        (equations.torque(theta), theta @ x),
    ):
        np.testing.assert_allclose(ours, whole, rtol=1e-12, atol=1e-12)
    assert np.array_equal(equations.unknowns, np.concatenate([b.unknowns for b in blocks]))
