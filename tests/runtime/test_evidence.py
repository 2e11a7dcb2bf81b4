"""The statistics against cases whose answers are known."""

from __future__ import annotations

import numpy as np

from runtime.evidence import FOLDS, Block, Rows, time_folds, vuong


def rows(y: np.ndarray, base: np.ndarray, noise: np.ndarray | None = None) -> Rows:
    use = np.ones(len(y), dtype=bool)
    free = np.full(len(base), np.inf)
    silent = np.zeros((len(base) + 1, len(y)))
    given = silent if noise is None else noise
    return Rows.levelled(y, base, given, (-free, free), use, np.zeros(len(y), dtype=int), time_folds(use))


def block(*columns: np.ndarray) -> Block:
    x = np.array(columns)
    return Block(
        x, np.zeros(x.shape[1]), np.full(len(x), -np.inf), np.full(len(x), np.inf), np.zeros((len(x) + 1, x.shape[1]))
    )


def test_quick_and_full_errors_agree() -> None:
    rng = np.random.default_rng(0)
    base, column, fixed = rng.standard_normal((3, 500)), rng.standard_normal(500), rng.standard_normal(500)
    found = rows(rng.standard_normal(500), base)
    candidate = Block(column[None], fixed, np.array([0.0]), np.array([np.inf]), np.zeros((2, 500)))
    assert np.isclose(found.sse(candidate), found.solve(candidate).sse)
    x = np.vstack([base, column])
    y = found.y - fixed
    free = float(np.sum((y - np.linalg.lstsq(x.T, y, rcond=None)[0] @ x) ** 2))
    assert found.solve(candidate).sse >= free - 1e-9


def test_cross_validation_rewards_truth_and_punishes_noise() -> None:
    rng = np.random.default_rng(1)
    truth, noise = rng.standard_normal(2000), rng.standard_normal((30, 2000))
    found = rows(0.5 * truth + rng.standard_normal(2000), np.ones((1, 2000)))
    base = found.cross_validate([None])[0].sum()
    assert found.cross_validate([block(truth)])[0].sum() < 0.85 * base
    assert found.cross_validate([block(*noise)])[0].sum() > base


def test_autoregression_is_recovered() -> None:
    rng = np.random.default_rng(2)
    e, r = rng.standard_normal(20_000), np.zeros(20_000)
    for k in range(2, len(r)):
        r[k] = 1.2 * r[k - 1] - 0.5 * r[k - 2] + e[k]
    found = rows(r, np.ones((1, len(r))))
    ar = found.autoregression(r)
    assert np.allclose(ar[:3], [1.0, -1.2, 0.5], atol=0.04)
    assert np.allclose(ar[3:], 0.0, atol=0.04)
    assert np.isclose(np.std(found.whiten(r[None], ar)[0]), 1.0, atol=0.02)


def test_noise_in_a_regressor_does_not_bias_its_coefficient() -> None:
    """Errors in variables shrink the plain estimate to a half here; the compensated one stays at 3."""
    rng = np.random.default_rng(3)
    clean = rng.standard_normal(50_000)
    y = 3 * clean + 0.1 * rng.standard_normal(50_000)
    measured = clean + rng.standard_normal(50_000)
    realisation = np.stack([rng.standard_normal(50_000), np.zeros(50_000)])
    assert abs(rows(y, measured[None]).solve().coefficients[0] - 1.5) < 0.05
    compensated = rows(y, measured[None], realisation)
    assert abs(compensated.solve().coefficients[0] - 3.0) < 0.1
    assert np.isclose(compensated.solve().sse, float(np.sum((y - 3 * measured) ** 2)), rtol=0.1)


def test_vuong_tells_better_from_equal() -> None:
    rng = np.random.default_rng(4)
    r, use = rng.standard_normal(5000), np.ones(5000, dtype=bool)
    assert vuong(r, 1.1 * r + 0.3 * rng.standard_normal(5000), use) > 2.33
    assert abs(vuong(r + 0.05 * rng.standard_normal(5000), r + 0.05 * rng.standard_normal(5000), use)) < 2.33


def test_folds_are_contiguous_and_even() -> None:
    use = np.random.default_rng(5).random(997) > 0.3
    fold = time_folds(use)
    assert np.all(np.diff(fold) >= 0)
    assert np.ptp(np.bincount(fold[use], minlength=FOLDS)) <= 1
