"""The statistics against cases whose answers are known."""

from __future__ import annotations

import gc
import weakref
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from runtime.arrays import Array
from runtime.regression.noise import Whitening, autoregression
from runtime.regression.rows import Block, Columns, JointRows
from runtime.regression.settings import WHITE_LEAST
from runtime.regression.system import LinearSystem


@dataclass(frozen=True)
class Joint:
    """One joint's torque (M,), base (b, M), its noise (b, M) and the numbers of its unknowns."""

    y: Array
    base: Array
    noise: Array | None = None
    unknowns: tuple[int, ...] = ()


def system(*joints: Joint) -> LinearSystem:
    """All unknowns free."""
    of = [one.unknowns or tuple(range(len(one.base))) for one in joints]
    rows = [whole(one.y) for one in joints]
    blocks = []
    for k in range(max(n for own in of for n in own) + 1):
        at = [(j, own.index(k)) for j, own in enumerate(of) if k in own]
        columns = {j: columns_of(joints[j], i) for j, i in at}
        blocks.append(Block(f"base {k}", columns, np.full(1, -np.inf), np.full(1, np.inf)))
    return LinearSystem.of(rows, blocks).over(rows)


def columns_of(joint: Joint, k: int) -> Columns:
    silent = np.zeros_like(joint.y)
    noise = None if joint.noise is None else np.array([silent, joint.noise[k]])
    return Columns(np.array([silent, joint.base[k]]), noise)


def whole(y: Array, weight: float = 1.0) -> JointRows:
    return JointRows(y, np.ones(len(y), dtype=bool), np.zeros(len(y), dtype=int), weight)


def block(*columns: Array, fixed: Array | None = None, lower: float = -np.inf, joint: int = 0) -> Block:
    x = np.array(columns)
    first = np.zeros(x.shape[1]) if fixed is None else fixed
    bounds = np.full(len(x), lower), np.full(len(x), np.inf)
    return Block("candidate", {joint: Columns(np.vstack([first, x]))}, *bounds)


def test_quick_and_full_errors_agree() -> None:
    rng = np.random.default_rng(0)
    base, column, fixed = rng.standard_normal((3, 500)), rng.standard_normal(500), rng.standard_normal(500)
    found = system(Joint(rng.standard_normal(500), base))
    for lower in (-np.inf, 0.0):
        candidate = block(column, fixed=fixed, lower=lower)
        single = replace(candidate, columns={0: Columns(candidate.columns[0].rows[None])})
        assert np.isclose(found.sse - found.gains(single)[0], found.with_block(candidate).sse)
    x = np.vstack([base, column])
    y = found.joints[0].tau - fixed
    free = float(np.sum((y - np.linalg.lstsq(x.T, y, rcond=None)[0] @ x) ** 2))
    assert np.isclose(found.with_block(block(column, fixed=fixed)).solution.sse, free)


def test_many_choices_gain_what_each_does() -> None:
    """Free, on a bound, without a column of its own, and with noise in it."""
    rng = np.random.default_rng(5)
    base = rng.standard_normal((3, 500))
    found = system(Joint(rng.standard_normal(500), base))
    columns = rng.standard_normal((6, 3, 500))
    columns[2, 1] = base[0] + base[1]
    columns[3] = 0.0
    noise = 0.2 * rng.standard_normal((6, 3, 500))
    bounds = np.array([0.0, -np.inf]), np.full(2, np.inf)
    every = Block("candidate", {0: Columns(columns, noise)}, *bounds)
    for k, gain in enumerate(found.gains(every)):
        assert np.isclose(gain, found.gains(every.choice(np.arange(6) == k))[0])


def test_a_system_is_freed_at_once() -> None:
    """Without the garbage collector, which a verb runs seldom: systems of candidates would fill the memory."""
    rng = np.random.default_rng(2)
    made = system(Joint(rng.standard_normal(400), rng.standard_normal((2, 400)))).with_block(
        block(rng.standard_normal(400))
    )
    gone = weakref.ref(made)
    gc.disable()
    try:
        assert made.solution.sse > 0
        del made
        assert gone() is None
    finally:
        gc.enable()


def test_what_joints_share_counts_once() -> None:
    """A factor on one joint's torque is hidden by that joint's own inertia, but not by one that another shares."""
    rng = np.random.default_rng(6)
    first, second = rng.standard_normal((2, 400))
    one, two = Joint(1.1 * first, first[None]), Joint(second, second[None])
    shared = system(one, two)
    assert shared.with_block(block(first)).solution.sse < 1e-9 < 1.0 < shared.solution.sse
    assert system(one).solution.sse < 1e-9


def test_autoregression_is_recovered() -> None:
    """Beside what counts as white in any residual."""
    rng = np.random.default_rng(2)
    e, r = rng.standard_normal(20_000), np.zeros(20_000)
    for k in range(2, len(r)):
        r[k] = 1.2 * r[k - 1] - 0.5 * r[k - 2] + e[k]
    found = whole(r)
    ar = autoregression(r, found.use, found.piece)
    covariance = autocovariance(np.array([1.0, -1.2, 0.5]), len(ar))
    beside = toeplitz(covariance + WHITE_LEAST * covariance[0] * np.eye(1, len(ar))[0])
    expected = np.append(1.0, np.linalg.solve(beside[1:, 1:], -covariance[1:]))
    assert np.allclose(ar, expected, atol=0.05)
    left = np.sqrt(expected @ toeplitz(covariance) @ expected)
    assert np.isclose(np.std(found.whitening(r)(r)), left, rtol=0.02)


def gained(of: LinearSystem, candidate: Block) -> float:
    """Of the log-likelihood on whitened rows, by what makes the candidate's residual white."""
    left = of.with_block(candidate).solution.residual
    by = [rows.whitening(r) for rows, r in zip(of.joints, left, strict=True)]
    white = of.whitened(by, left)
    after = white.with_block(candidate.whitened(by)).solution.sse
    return 0.5 * white.count * float(np.log(white.solution.sse / after))


@pytest.mark.parametrize("seed", range(3))
def test_evidence_at_a_joint_does_not_hang_on_what_other_joints_leave(seed: int) -> None:
    """An error that is slow leaves little once it is white; beside joints whose errors are white it counts in full."""
    rng = np.random.default_rng(seed)
    slow = lfilter([1.0], [1.0, -0.98], rng.standard_normal(2000))
    column = lfilter([1.0], [1.0, -0.95], rng.standard_normal(2000))
    base = rng.standard_normal((1, 2000))
    one = Joint(slow + 0.3 * column, base, None, (0,))
    others = [Joint(rng.standard_normal(2000), base, None, (k,)) for k in (1, 2, 3)]
    weights = [1 / float(np.std(one.y)), 1.0, 1.0, 1.0]
    both = [
        of.over([whole(rows.tau, weight) for rows, weight in zip(of.joints, weights, strict=False)])
        for of in (system(one), system(one, *others))
    ]
    expected = gained(both[0], block(column))
    assert expected > 50
    assert gained(both[1], block(column)) == pytest.approx(expected, rel=0.2)


@pytest.mark.parametrize("missing", ["none", "rows", "stretch"])
@pytest.mark.parametrize("eliminated", [False, True])
def test_whitening_is_least_squares_with_the_noise_s_own_covariance(missing: str, eliminated: bool) -> None:
    """Two routes to one number: the filter and its projections, and the inverse of the Toeplitz covariance of the rows
    that count, within what no eliminated combination reaches."""
    ar, size = np.array([1.0, -1.2, 0.5]), 300
    rng = np.random.default_rng(8)
    covariance = toeplitz(autocovariance(ar, size))
    use = np.ones(size, dtype=bool)
    use[{"none": [], "rows": [7, 90, 91, 200], "stretch": list(range(100, 180))}[missing]] = False
    directions = np.zeros((size, 2))
    directions[40:45, 0], directions[220:230, 1] = 1.0, np.sin(np.arange(10))
    directions = directions[:, : 2 * eliminated]
    x, y = rng.standard_normal((2, size))
    white = Whitening.of(ar, use, np.zeros(size, int), sparse.csr_array(directions))
    out = white(np.array([x, y]))
    precision = np.linalg.inv(covariance[np.ix_(use, use)])
    known = directions[use]
    taken = precision @ known @ np.linalg.solve(known.T @ precision @ known, known.T @ precision)
    expected = x[use] @ (precision - taken) @ y[use]
    assert np.isclose(out[0] @ out[1], expected, rtol=1e-6)
    # Whatever the eliminated combinations hold, nothing of it is left.
    moved = white(x + directions @ rng.uniform(-1e3, 1e3, directions.shape[1]))
    assert np.allclose(moved, out[0], atol=1e-5)
    assert np.allclose(white(np.where(use, x, 1e3)), out[0], atol=1e-9)


def autocovariance(ar: Array, size: int) -> Array:
    """Of the process whose filter this is and whose innovations have a variance of 1, from its impulse response."""
    response = lfilter([1.0], ar, np.eye(1, 4096)[0])
    return np.array([response[k:] @ response[: len(response) - k] for k in range(size)])


def test_noise_in_a_regressor_does_not_bias_its_coefficient() -> None:
    """Errors in variables shrink the plain estimate to a half here; the compensated one stays at 3."""
    rng = np.random.default_rng(3)
    clean = rng.standard_normal(50_000)
    y = 3 * clean + 0.1 * rng.standard_normal(50_000)
    measured = clean + rng.standard_normal(50_000)
    assert abs(system(Joint(y, measured[None])).solution.coefficients[0] - 1.5) < 0.05
    compensated = system(Joint(y, measured[None], rng.standard_normal((1, 50_000))))
    assert abs(compensated.solution.coefficients[0] - 3.0) < 0.1
    assert np.isclose(compensated.solution.sse, float(np.sum((y - 3 * measured) ** 2)), rtol=0.1)
    assert abs(compensated.without_noise().solution.coefficients[0] - 1.5) < 0.05


def test_unknowns_left_out_are_as_good_as_never_there() -> None:
    rng = np.random.default_rng(7)
    base = rng.standard_normal((3, 300))
    y = rng.standard_normal(300)
    others = system(Joint(y, base[[0, 2]])).solution.sse
    assert np.isclose(system(Joint(y, base)).without(["base 1"]).solution.sse, others)
