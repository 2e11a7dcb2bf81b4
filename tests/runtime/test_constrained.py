"""Least squares under constraints, against closed forms."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from runtime.constrained import bounded, minimise, solve


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


@given(st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_bounds_hold_and_one_bound_is_optimal(seed: int) -> None:
    """Within the bounds always; where a single coefficient is bounded, equal to scipy's solver."""
    rng = np.random.default_rng(seed)
    x, y = rng.standard_normal((40, 4)), rng.standard_normal(40)
    lower, upper = np.array([0.0, -np.inf, -np.inf, -np.inf]), np.full(4, np.inf)
    theta = bounded(x.T @ x, x.T @ y, lower, upper)
    assert theta[0] >= 0
    assert np.allclose(theta, lsq_linear(x, y, (lower, upper), tol=1e-12).x, atol=1e-6)


def test_a_cut_is_respected() -> None:
    """min |theta − (1, −2)|² with theta_1 > 0 lies at (1, 0)."""
    cut = np.array([0.0, 1.0])
    free = np.full(2, np.inf)
    theta = minimise(np.eye(2), np.array([1.0, -2.0]), -free, free, lambda x: cut if x @ cut <= 0 else None)
    assert np.allclose(theta, [1.0, 0.0], atol=1e-5)
    assert theta[1] > 0


def test_an_unseen_direction_stays_near_what_is_stated() -> None:
    column = np.random.default_rng(1).standard_normal(50)
    x = np.stack([column, column, np.zeros(50)], axis=1)
    # The sum is seen, the difference and the third coefficient are not.
    theta = solve(x.T @ x, x.T @ (4 * column), np.array([5.0, 1.0, -7.0]))
    assert np.allclose(theta, [4.0, 0.0, -7.0])


def test_a_cut_counts_from_the_origin_whatever_is_stated() -> None:
    """The first coefficient is seen and cut at 0, the second unseen: it stays."""
    gram, moment = np.diag([1.0, 0.0]), np.array([-2.0, 0.0])
    cut, free = np.array([1.0, 0.0]), np.full(2, np.inf)
    near = np.array([3.0, 5.0])
    theta = minimise(gram, moment, -free, free, lambda x: cut if x @ cut <= 0 else None, near)
    assert np.allclose(theta, [0.0, 5.0], atol=1e-5)
