"""Least squares under constraints, against closed forms."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from runtime.regression.bounded import Alike, bounded, minimise, rank, solve


@given(st.integers(0, 10_000), st.integers(1, 8))
@settings(max_examples=40, deadline=None)
def test_solve_is_least_squares(seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    x, y = rng.standard_normal((40, size)) * 10.0 ** rng.uniform(-4, 4, size), rng.standard_normal(40)
    theta = solve(x.T @ x, x.T @ y)
    expected = np.linalg.lstsq(x, y, rcond=None)[0]
    assert np.allclose(x @ theta, x @ expected, atol=1e-6 * np.linalg.norm(y))


def test_an_unseen_direction_stays_zero() -> None:
    """Two equal columns share their coefficient, whatever rounding makes of the Gram matrix."""
    column = np.random.default_rng(1).standard_normal(50)
    x = np.stack([column, column], axis=1)
    assert np.allclose(solve(x.T @ x, x.T @ (4 * column)), [2.0, 2.0])


def test_a_bound_that_is_wrong_is_released() -> None:
    """Both coefficients leave their bounds when the other is free; held for good, the answer would be (0, 0)."""
    gram, moment = np.array([[1.0, -0.9], [-0.9, 1.0]]), np.array([0.1, -1.0])
    assert np.allclose(bounded(gram, moment, np.zeros(2), np.full(2, np.inf)), [0.1, 0.0], atol=1e-12)


@st.composite
def bounded_problems(draw: st.DrawFn) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """x (rows, K), y (rows,), lower and upper (K,): from one bound to two on every coefficient, correlated columns."""
    size = draw(st.integers(2, 7))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    x = rng.standard_normal((40, size)) @ (np.eye(size) + draw(st.floats(0, 3)) * rng.standard_normal((size, size)))
    x *= 10.0 ** rng.uniform(-3, 3, size)
    y = rng.standard_normal(40) + x @ (rng.standard_normal(size) / np.linalg.norm(x, axis=0)) * 6
    scale = 1 / np.linalg.norm(x, axis=0)
    lower = np.where(rng.random(size) < 0.6, rng.uniform(-2, 1, size) * scale, -np.inf)
    upper = np.where(rng.random(size) < 0.6, np.maximum(lower, 0) + rng.uniform(0.01, 2, size) * scale, np.inf)
    return x, y, lower, upper


@given(bounded_problems())
@settings(max_examples=300, deadline=None)
def test_bounded_is_optimal(problem: tuple[NDArray, NDArray, NDArray, NDArray]) -> None:
    """Against scipy's solver, and the conditions of Karush, Kuhn and Tucker, with any number of bounds."""
    x, y, lower, upper = problem
    # A direction that the data do not see stays where it is, so that there the least is another's.
    assume(rank(x.T @ x) == x.shape[1])
    theta = bounded(x.T @ x, x.T @ y, lower, upper)
    assert np.all((theta >= lower) & (theta <= upper))
    reference = lsq_linear(x, y, (lower, upper), method="bvls", tol=1e-14).x
    cost, least = np.sum((y - x @ theta) ** 2), np.sum((y - x @ reference) ** 2)
    assert cost <= least * (1 + 1e-9)
    fall = x.T @ (y - x @ theta) / np.linalg.norm(x, axis=0) / np.linalg.norm(y)
    assert np.all(np.abs(fall[(theta > lower) & (theta < upper)]) < 1e-6)
    assert np.all(fall[theta == lower] < 1e-6)
    assert np.all(fall[theta == upper] > -1e-6)


@given(
    bounded_problems(), st.lists(st.sampled_from([1, 0, -1]), min_size=7, max_size=7), st.booleans(), st.integers(0, 6)
)
@settings(max_examples=100, deadline=None)
def test_folds_together_are_as_each_alone(
    problem: tuple[NDArray, NDArray, NDArray, NDArray], guess: list[int], silent: bool, inner: int
) -> None:
    """Whatever coefficients are thought to end on which bound, where one of them has no column, and where the first of
    them are a core of which more is known."""
    x, y, lower, upper = problem
    if silent:
        x[:, 0] = 0.0
    folds = np.array_split(np.arange(len(y)), 4)
    rest = [np.setdiff1d(np.arange(len(y)), fold) for fold in folds]
    grams, moments = np.array([x[r].T @ x[r] for r in rest]), np.array([x[r].T @ y[r] for r in rest])
    ends = [np.array(guess[: len(lower)], dtype=np.int8)]
    core = Alike(grams[:, :inner, :inner], lower[:inner], upper[:inner]) if 0 < inner < len(lower) else None
    alike = Alike(grams, lower, upper, ends, core)
    found = alike.solve(moments)
    assert np.array_equal(found, alike.solve(moments))
    for theta, gram, moment in zip(found, grams, moments, strict=True):
        alone = bounded(gram, moment, lower, upper)
        scale = np.sqrt(np.maximum(np.diag(gram), np.diag(gram).max() * 1e-12))
        assert np.allclose(theta * scale, alone * scale, atol=1e-7 * np.abs(alone * scale).max())


@given(st.integers(0, 10_000), st.integers(1, 6))
@settings(max_examples=100, deadline=None)
def test_bounds_hold_where_the_gram_matrix_is_not_positive(seed: int, size: int) -> None:
    """Compensation for noise may leave directions of negative size: there is an end, and it lies within the bounds."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((10, size))
    gram = x.T @ x - rng.uniform(0, 12) * np.eye(size)
    moment, lower, upper = rng.standard_normal(size) * 5, -rng.random(size), rng.random(size)
    theta = bounded(gram, moment, lower, upper)
    assert np.all((theta >= lower) & (theta <= upper))


def test_a_cut_is_respected() -> None:
    """min |theta − (1, −2)|² with theta_1 > 0 lies at (1, 0)."""
    cut = np.array([0.0, 1.0])
    free = np.full(2, np.inf)
    theta = minimise(np.eye(2), np.array([1.0, -2.0]), -free, free, lambda x: cut[None] if x @ cut <= 0 else None)
    assert np.allclose(theta, [1.0, 0.0], atol=1e-5)
    assert theta[1] > 0


def test_an_unseen_direction_stays_near_what_is_stated() -> None:
    column = np.random.default_rng(1).standard_normal(50)
    x = np.stack([column, column, np.zeros(50)], axis=1)
    # The sum is seen, the difference and the third coefficient are not.
    theta = solve(x.T @ x, x.T @ (4 * column), np.array([5.0, 1.0, -7.0]))
    assert np.allclose(theta, [4.0, 0.0, -7.0])


@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.integers(1, 4))
@settings(max_examples=60, deadline=None)
def test_dependent_columns_give_the_shortest_step_from_what_is_stated(seed: int, size: int, dependent: int) -> None:
    """The pseudoinverse of the scaled columns, by singular values of the rows instead of from their Gram matrix."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((60, size)) @ rng.permutation(
        np.hstack([np.eye(size), rng.uniform(-1, 1, (size, dependent))]), axis=1
    )
    x, y, near = x * 10.0 ** rng.uniform(-2, 2, x.shape[1]), rng.standard_normal(60), rng.standard_normal(x.shape[1])
    scale = np.linalg.norm(x, axis=0)
    expected = near + np.linalg.pinv(x / scale, rcond=1e-6) @ (y - x @ near) / scale
    assert np.allclose(
        solve(x.T @ x, x.T @ y, near) * scale, expected * scale, rtol=0, atol=1e-6 * np.abs(near * scale).max()
    )


def test_a_cut_counts_from_the_origin_whatever_is_stated() -> None:
    """The first coefficient is seen and cut at 0, the second unseen: it stays."""
    gram, moment = np.diag([1.0, 0.0]), np.array([-2.0, 0.0])
    cut, free = np.array([1.0, 0.0]), np.full(2, np.inf)
    near = np.array([3.0, 5.0])
    theta = minimise(gram, moment, -free, free, lambda x: cut[None] if x @ cut <= 0 else None, near)
    assert np.allclose(theta, [0.0, 5.0], atol=1e-5)
