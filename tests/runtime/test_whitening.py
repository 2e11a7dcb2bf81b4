"""Rows of an autoregression come out white, also where rows are missing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import toeplitz

from runtime.estimation.whitening import autoregression, whiten


def _covariance(reflections: list[float], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Filter (1, a1, ...) of these reflections, and the covariance (count, count) of what it makes of unit noise."""
    ar = np.array([1.0])
    for k in reflections:
        ar = np.append(ar, 0.0) + k * np.append(ar, 0.0)[::-1]
    order = len(ar) - 1
    # The equations of Yule and Walker, for the covariances of the first lags.
    lags = np.abs(np.subtract.outer(np.arange(order + 1), np.arange(order + 1)))
    system = np.array([[ar[lags[i] == j].sum() for j in range(order + 1)] for i in range(order + 1)])
    found = list(np.linalg.solve(system, np.eye(order + 1)[0]))
    while len(found) < count:
        found.append(-float(ar[1:] @ found[: -order - 1 : -1]) if order else 0.0)
    return ar, toeplitz(found[:count])


@settings(max_examples=30, deadline=None)
@given(
    reflections=st.lists(st.floats(-0.95, 0.95), min_size=0, max_size=5),
    runs=st.lists(st.tuples(st.integers(1, 12), st.integers(1, 3)), min_size=1, max_size=3),
)
def test_what_comes_out_is_white_up_to_every_gap(reflections: list[float], runs: list[tuple[int, int]]) -> None:
    use = np.concatenate([[True] * long + [False] * gap for long, gap in runs])
    ar, covariance = _covariance(reflections, len(use))
    passed = whiten(np.eye(len(use)), ar, use, np.zeros(len(use), dtype=np.intp)).T
    at = 0
    for long, gap in runs:
        run, at = slice(at, at + long), at + long + gap
        expected = pytest.approx(np.eye(long), abs=1e-6)
        assert passed[run, run] @ covariance[run, run] @ passed[run, run].T == expected
        assert not np.delete(passed[run], np.r_[run], axis=1).any()
    assert not passed[~use].any()


def test_nothing_is_filtered_from_one_stretch_of_time_to_the_next() -> None:
    rng, ar = np.random.default_rng(0), np.array([1.0, -1.2, 0.5])
    x, piece = rng.standard_normal((3, 20)), np.repeat([0, 1], 10)
    whole = whiten(x, ar, np.ones(20, dtype=bool), piece)
    apart = [whiten(part, ar, np.ones(10, dtype=bool), np.zeros(10, dtype=np.intp)) for part in np.split(x, 2, axis=1)]
    assert whole == pytest.approx(np.concatenate(apart, axis=1))


def test_rows_beside_a_gap_weigh_no_more_than_others() -> None:
    """A sharp spectrum, as rows in a band have one: zeros in the place of missing rows would make them many times
    larger."""
    rng = np.random.default_rng(1)
    ar, covariance = _covariance([0.9, 0.97, 0.5, 0.9, 0.4], 400)
    x = np.linalg.cholesky(covariance) @ rng.standard_normal((400, 50))
    use = np.arange(400) % 20 > 2
    found = autoregression(x[:, 0], use, np.zeros(400, dtype=np.intp))
    white = whiten(x.T, ar, use, np.zeros(400, dtype=np.intp))
    beside = np.arange(400) % 20 < 8
    assert np.mean(white[:, use & beside] ** 2) == pytest.approx(1.0, rel=0.1)
    assert np.mean(white[:, use & ~beside] ** 2) == pytest.approx(1.0, rel=0.1)
    assert found[0] == 1.0
