"""The statistics against cases whose answers are known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from runtime.diagnosis import gates
from runtime.diagnosis.candidates import Candidate, CandidateField
from runtime.diagnosis.evidence import CandidateBlock, CandidateRows, Ground, Rows, vuong
from runtime.model.terms import Term
from runtime.regression.settings import FOLDS, WHITE_LEAST
from runtime.regression.whitening import Whitening, autoregression

Array = NDArray[np.float64]


def rows(y: np.ndarray, base: np.ndarray, noise: np.ndarray | None = None) -> Rows:
    use = np.ones(len(y), dtype=bool)
    silent = np.zeros((len(base) + 1, len(y)))
    given = silent if noise is None else noise
    return Rows(y, base, given, np.arange(len(base)), use, np.zeros(len(y), dtype=int), 1.0)


def ground(*joints: Rows) -> Ground:
    free = np.full(max(int(r.index.max(initial=-1)) + 1 for r in joints), np.inf)
    return Ground.levelled(joints, -free, free)


def block(
    *columns: np.ndarray, fixed: np.ndarray | None = None, lower: float = -np.inf, joint: int = 0
) -> CandidateBlock:
    x = np.array(columns)
    first = np.zeros(x.shape[1]) if fixed is None else fixed
    return CandidateBlock(
        {joint: CandidateRows(np.vstack([first, x]))}, np.full(len(x), lower), np.full(len(x), np.inf)
    )


def test_quick_and_full_errors_agree() -> None:
    rng = np.random.default_rng(0)
    base, column, fixed = rng.standard_normal((3, 500)), rng.standard_normal(500), rng.standard_normal(500)
    found = ground(rows(rng.standard_normal(500), base))
    for lower in (-np.inf, 0.0):
        candidate = block(column, fixed=fixed, lower=lower)
        assert np.isclose(found.solve().sse - found.gain(candidate), found.solve(candidate).sse)
    x = np.vstack([base, column])
    y = found.rows[0].y - fixed
    free = float(np.sum((y - np.linalg.lstsq(x.T, y, rcond=None)[0] @ x) ** 2))
    assert np.isclose(found.solve(block(column, fixed=fixed)).sse, free)


def test_many_choices_gain_what_each_does() -> None:
    """Free, on a bound, without a column of its own, and with noise in it."""
    rng = np.random.default_rng(5)
    base = rng.standard_normal((3, 500))
    found = ground(rows(rng.standard_normal(500), base))
    columns = rng.standard_normal((6, 3, 500))
    columns[2, 1] = base[0] + base[1]
    columns[3] = 0.0
    noise = 0.2 * rng.standard_normal((6, 3, 500))
    bounds = np.array([0.0, -np.inf]), np.full(2, np.inf)
    gains = found.gains(CandidateBlock({0: CandidateRows(columns, noise)}, *bounds))
    for k, gain in enumerate(gains):
        assert np.isclose(gain, found.gain(CandidateBlock({0: CandidateRows(columns[k], noise[k])}, *bounds)))


def test_what_joints_share_counts_once() -> None:
    """A factor on one joint's torque is hidden by that joint's own inertia, but not by one that another shares."""
    rng = np.random.default_rng(6)
    first, second = rng.standard_normal((2, 400))
    one, two = rows(1.1 * first, first[None]), rows(second, second[None])
    shared = ground(one, two)
    assert shared.solve(block(first)).sse < 1e-9 < 1.0 < shared.solve().sse
    assert ground(one).solve().sse < 1e-9


def test_cross_validation_rewards_truth_and_punishes_noise() -> None:
    rng = np.random.default_rng(1)
    truth, noise = rng.standard_normal(2000), rng.standard_normal((30, 2000))
    found = ground(rows(0.5 * truth + rng.standard_normal(2000), np.ones((1, 2000))))
    base = found.equations().held_out[0].sum()
    assert found.equations(block(truth)).held_out[0].sum() < 0.85 * base
    assert found.equations(block(*noise)).held_out[0].sum() > base


def test_what_one_stretch_alone_tells_hides_no_effect() -> None:
    """A change of the moment at which a load is taken up shows in one fold; where that is left out, the noise of the
    others would say what it is."""
    rng = np.random.default_rng(7)
    truth, moment = rng.standard_normal(2000), 1e-3 * rng.standard_normal(2000)
    moment[1040:1050] = 1.0
    found = ground(rows(0.3 * truth + rng.standard_normal(2000), np.vstack([np.ones(2000), moment])))
    alone = found.equations().held_out[0].sum()
    leaning = replace(found, changes=(1,))
    before, after = (leaning.equations(b).held_out[0].sum() for b in (None, block(truth)))
    assert alone > 1.5 * before
    assert before == pytest.approx(1.09 * 2000, rel=0.1)
    assert 1 - after / before == pytest.approx(0.09 / 1.09, abs=0.03)


def test_autoregression_is_recovered() -> None:
    """Beside what counts as white in any residual."""
    rng = np.random.default_rng(2)
    e, r = rng.standard_normal(20_000), np.zeros(20_000)
    for k in range(2, len(r)):
        r[k] = 1.2 * r[k - 1] - 0.5 * r[k - 2] + e[k]
    found = rows(r, np.ones((1, len(r))))
    ar = autoregression(r, found.use, found.piece)
    covariance = autocovariance(np.array([1.0, -1.2, 0.5]), len(ar))
    beside = toeplitz(covariance + WHITE_LEAST * covariance[0] * np.eye(1, len(ar))[0])
    expected = np.append(1.0, np.linalg.solve(beside[1:, 1:], -covariance[1:]))
    assert np.allclose(ar, expected, atol=0.05)
    left = np.sqrt(expected @ toeplitz(covariance) @ expected)
    assert np.isclose(np.std(found.whitening(r)(r)), left, rtol=0.02)


def bic_fall(joints: Ground, candidate: CandidateBlock) -> float:
    """Of whitened rows, by what makes the candidate's residual white."""
    left = joints.solve(candidate).residual
    by = [row.whitening(r) for row, r in zip(joints.rows, left, strict=True)]
    white = joints.whitened(by, left)
    return white.equations().bic - white.equations(candidate.whitened(by)).bic


@pytest.mark.parametrize("seed", range(3))
def test_evidence_at_a_joint_does_not_hang_on_what_other_joints_leave(seed: int) -> None:
    """An error that is slow leaves little once it is white; beside joints whose errors are white it counts in full."""
    rng = np.random.default_rng(seed)
    slow = lfilter([1.0], [1.0, -0.98], rng.standard_normal(2000))
    column = lfilter([1.0], [1.0, -0.95], rng.standard_normal(2000))
    base = rng.standard_normal((1, 2000))
    alone = rows(slow + 0.3 * column, base)
    alone = replace(alone, weight=1 / float(np.std(alone.y)))
    others = [replace(rows(rng.standard_normal(2000), base), index=np.array([k])) for k in (1, 2, 3)]
    expected = bic_fall(ground(alone), block(column))
    assert expected > 100
    assert bic_fall(ground(alone, *others), block(column)) == pytest.approx(expected, rel=0.2)


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
    realisation = np.stack([rng.standard_normal(50_000), np.zeros(50_000)])
    assert abs(ground(rows(y, measured[None])).solve().coefficients[0] - 1.5) < 0.05
    compensated = ground(rows(y, measured[None], realisation))
    assert abs(compensated.solve().coefficients[0] - 3.0) < 0.1
    assert np.isclose(compensated.solve().sse, float(np.sum((y - 3 * measured) ** 2)), rtol=0.1)


def test_unknowns_left_out_are_as_good_as_never_there() -> None:
    rng = np.random.default_rng(7)
    base = rng.standard_normal((3, 300))
    y = rng.standard_normal(300)
    assert np.isclose(ground(rows(y, base)).without([1]).solve().sse, ground(rows(y, base[[0, 2]])).solve().sse)


def test_vuong_tells_better_from_equal() -> None:
    rng = np.random.default_rng(4)
    r = rng.standard_normal(5000)
    assert vuong(r, 1.1 * r + 0.3 * rng.standard_normal(5000)) > 2.33
    assert abs(vuong(r + 0.05 * rng.standard_normal(5000), r + 0.05 * rng.standard_normal(5000))) < 2.33


def test_folds_are_contiguous_and_even() -> None:
    use = np.random.default_rng(5).random(997) > 0.3
    row = Rows(np.zeros(997), np.zeros((0, 997)), np.zeros((1, 997)), np.zeros(0, int), use, np.zeros(997, int), 1.0)
    sizes = [f.stop - f.start for f in row.folds]
    assert len(sizes) == FOLDS
    assert sum(sizes) == use.sum()
    assert max(sizes) - min(sizes) <= 1


class _Field:
    """Of two joints: a candidate of each term, whose error on the excerpt is its joint's number."""

    model = SimpleNamespace(n=2)
    replaced = staticmethod(lambda _: ())
    without = staticmethod(lambda ground, _: ground)
    trial = staticmethod(lambda term, _: term)
    watched = staticmethod(lambda term: term.joint == 2)

    @property
    def excerpt(self) -> tuple[None, _Field]:
        return None, self

    def search(self, term: Term) -> Candidate:
        return Candidate(term, {"speed": 0.1}, 1, 1.0, False)

    def refine(self, candidate: Candidate) -> Candidate:
        return candidate

    def equations(self, block: Term | None) -> SimpleNamespace:
        error = 100.0 if block is None else float(block.joint or 0)
        return SimpleNamespace(held_out=[np.array([error])], sse=error)


def test_no_candidate_is_weighed_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one that is hopeful at its joint, leaves least there and has an encoder on either side."""
    weighed: list[Term] = []
    monkeypatch.setattr(gates, "weigh", lambda _, candidates, __: weighed.extend(c.term for c in candidates))
    terms = [Term(f"effect{k}", joint) for joint in (1, 2) for k in range(12)]
    gates.rank(cast(CandidateField, _Field()), terms, (1.0, 1.0))
    assert {t.joint for t in weighed} == {1, 2}
    assert len(weighed) == len(set(weighed))
