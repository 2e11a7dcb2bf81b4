"""Products of blocks: what is exchanged or added comes out as if all had been multiplied anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.regression.rows import Block, Columns, JointRows
from runtime.regression.system import LinearSystem

ROWS, JOINTS = 60, 2
SIZES = (3, 1, 2)


def _joints(rng: np.random.Generator) -> list[JointRows]:
    """Of which some rows do not count."""
    return [
        JointRows(rng.standard_normal(ROWS), rng.random(ROWS) > 0.1, np.zeros(ROWS, dtype=int), rng.uniform(0.5, 2.0))
        for _ in range(JOINTS)
    ]


def _block(key: int, version: int, rng: np.random.Generator) -> Block:
    """The first acts on both joints, the others on one."""
    size = 1 + SIZES[key]
    columns = {
        j: Columns(rng.standard_normal((size, ROWS)), 0.1 * rng.standard_normal((size, ROWS)))
        for j in ((0, 1) if key == 0 else (key - 1,))
    }
    free = np.full(SIZES[key], np.inf)
    return Block(key, columns, -free, free, version=(key, version))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), moved=st.integers(0, len(SIZES) - 1))
def test_an_exchanged_block_leaves_the_same_products(seed: int, moved: int) -> None:
    rng = np.random.default_rng(seed)
    joints, blocks = _joints(rng), [_block(k, 0, rng) for k in range(len(SIZES))]
    before = LinearSystem.of(joints, blocks)
    blocks[moved] = _block(moved, 1, rng)
    made, fresh = LinearSystem.of(joints, blocks, before), LinearSystem.of(joints, blocks)
    assert np.array_equal(made.gram, fresh.gram)
    assert np.array_equal(made.gram, made.gram.T)


def test_products_are_those_of_all_rows() -> None:
    """Of every joint the torque and the blocks, weighted and compensated, also of blocks that are added one by one."""
    rng = np.random.default_rng(1)
    joints, blocks = _joints(rng), [_block(k, 0, rng) for k in range(len(SIZES))]
    system, added = LinearSystem.of(joints, blocks), LinearSystem.of(joints, blocks[:1])
    for block in blocks[1:]:
        added = added.with_block(block)
    size, expected = 1 + sum(1 + k for k in SIZES), 0.0
    for j, rows in enumerate(joints):
        x, noise, at = np.zeros((size, ROWS)), np.zeros((size, ROWS)), 1
        x[0] = rows.tau
        for block in blocks:
            if j in block.columns:
                own = block.columns[j]
                x[at : at + len(own.rows)], noise[at : at + len(own.rows)] = own.rows, own.noise
            at += 1 + len(block.lower)
        x, noise = (rows.weight * rows.used(part) for part in (x, noise))
        expected = expected + x @ x.T - noise @ noise.T
    np.testing.assert_allclose(system.gram, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(added.gram, system.gram, rtol=1e-12, atol=1e-12)
    theta = rng.standard_normal(sum(SIZES))
    for ours, theirs in zip(added.residual(theta), system.residual(theta), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_torque_that_is_added_is_one_that_was_measured(seed: int) -> None:
    """Two routes to one solution: more of a block in the products, and the same torque in the samples."""
    rng = np.random.default_rng(seed)
    joints, blocks = _joints(rng), [replace(_block(k, 0, rng), version=None) for k in range(len(SIZES))]
    blocks = [replace(b, columns={j: Columns(c.rows) for j, c in b.columns.items()}) for b in blocks]
    added = rng.standard_normal(1 + SIZES[-1])
    system = LinearSystem.of(joints, blocks[:-1]).with_block(blocks[-1])
    more = blocks[-1].torque(added)
    there = [replace(rows, tau=rows.tau + more.get(j, 0.0)) for j, rows in enumerate(joints)]
    measured = LinearSystem.of(there, blocks[:-1])
    for ours, theirs in (
        (system.solve(added), measured.with_block(blocks[-1]).solution),
        (system.solve_before(added), measured.solution),
    ):
        np.testing.assert_allclose(ours.coefficients, theirs.coefficients, rtol=1e-8, atol=1e-10)
        assert np.isclose(ours.sse, theirs.sse)


def test_some_of_the_rows_are_a_system_of_their_own() -> None:
    """As if the others had never been recorded."""
    rng = np.random.default_rng(3)
    joints, blocks = _joints(rng), [_block(k, 0, rng) for k in range(len(SIZES))]
    at = np.arange(10, 50)
    kept = [replace(r, tau=r.tau[at], use=r.use[at] & (at != 20), piece=r.piece[at]) for r in joints]
    parts = [
        replace(b, columns={j: Columns(c.rows[:, at], c.noise[:, at]) for j, c in b.columns.items()}) for b in blocks
    ]
    ours = LinearSystem.of(joints, blocks).merged().restricted(kept, [at] * JOINTS)
    theirs = LinearSystem.of(kept, parts).over(kept)
    np.testing.assert_allclose(ours.gram, theirs.gram, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(ours.level, theirs.level, rtol=1e-9)
