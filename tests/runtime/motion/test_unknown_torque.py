"""Unknown torques are eliminated from the rows, whatever they were, and white noise stays white."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from runtime.arrays import Mask
from runtime.model.loader import Model
from runtime.motion import rests
from runtime.motion.filters import LowPass, low_pass
from runtime.motion.rests import SAME_DIRECTION, UNKNOWN_OVER_NOISE, UnknownTorque
from runtime.motion.settings import LITTLE

SAMPLES, RATE = 4000, 1000.0


@pytest.fixture(scope="module")
def band(drive: Model) -> LowPass:
    return low_pass(30.0, RATE, drive.library)


def resting(*runs: tuple[int, int], size: int = SAMPLES) -> Mask:
    """Samples of so many from each first one."""
    found = np.zeros(size, dtype=bool)
    for first, length in runs:
        found[first : first + length] = True
    return found


def left_in(without: UnknownTorque, band: LowPass, unknown: Mask, seed: int) -> float:
    """The most that torques of at most 1 at these samples leave in rows that count: noise, steps and one sign."""
    rng = np.random.default_rng(seed)
    shapes = [np.ones(len(unknown)), rng.uniform(-1, 1, len(unknown)), np.sign(np.sin(np.arange(len(unknown)) / 9))]
    return max(float(np.abs(without(band(unknown * x))[without.counts]).max(initial=0.0)) for x in shapes)


def projector(without: UnknownTorque) -> NDArray[np.float64]:
    return without(np.eye(len(without.left)))


RUNS = st.lists(st.tuples(st.integers(0, SAMPLES - 700), st.integers(1, 700)), min_size=1, max_size=6)


@settings(max_examples=15, deadline=None)
@given(runs=RUNS, seed=st.integers(0, 99), quiet=st.sampled_from([0.0, 0.002, 0.02]))
def test_no_torque_at_rest_is_left_in_a_row(band: LowPass, runs: list[tuple[int, int]], seed: int, quiet: float):
    """Short rests and long ones, beside and over each other: at most the threshold of each combination that is kept."""
    unknown = resting(*runs)
    without = UnknownTorque.of(band, unknown, quiet)
    least = max(UNKNOWN_OVER_NOISE * quiet, SAME_DIRECTION)
    assert left_in(without, band, unknown, seed) < 3 * least


def test_without_the_elimination_it_would_be_in_the_rows(band: LowPass):
    unknown = resting((1000, 20))
    assert np.abs(band(unknown.astype(np.float64))).max() > 0.5


def test_what_no_rest_reaches_is_as_it_was(band: LowPass):
    rest = resting((2000, 15))
    without, x = UnknownTorque.of(band, rest, 0.005), np.random.default_rng(1).standard_normal(SAMPLES)
    rows, far = band(x), band(rest.astype(np.float64)) == 0.0
    assert far.sum() > 100
    assert np.array_equal(without(rows)[far], rows[far])
    assert without.counts[far].all()


def test_equations_stay_equations(band: LowPass):
    """The rows of a sum are the sum of rows, and a known torque that follows from regressors still does."""
    without = UnknownTorque.of(band, resting((700, 30), (760, 10), (2500, 400)), 0.005)
    rng = np.random.default_rng(2)
    columns, theta = rng.standard_normal((5, SAMPLES)), rng.standard_normal(5)
    assert without(band(theta @ columns)) == pytest.approx(theta @ without(band(columns)), abs=1e-10)


def test_white_noise_stays_white_in_what_is_left(band: LowPass):
    """Its covariance is a projector: 1 in every direction that is left, 0 in the others, and `left` on its diagonal."""
    without = UnknownTorque.of(band, resting((700, 30), (1500, 5), (2500, 60)), 0.005)
    p = projector(without)
    covariance = p @ p.T
    values = np.linalg.eigvalsh(covariance)
    assert np.all((np.abs(values) < 1e-4) | (np.abs(values - 1) < 1e-4))
    assert np.sum(values < 0.5) == without.directions.shape[1]
    assert np.diag(covariance) == pytest.approx(without.left, abs=1e-4)
    assert np.array_equal(without.counts, without.left > LITTLE)


def test_rests_close_to_each_other_take_no_more_than_there_is(band: LowPass):
    """Combinations that two rests share, all but, are weighed once: no direction is taken twice, none is added."""
    unknown = resting((1000, 10), (1012, 10), (1030, 3))
    without = UnknownTorque.of(band, unknown, 0.005)
    values = np.linalg.eigvalsh(projector(without))
    assert values.min() > -1e-9
    assert values.max() < 1 + 1e-9
    assert np.sum(values < 0.5) < without.directions.shape[1]
    assert left_in(without, band, unknown, 5) < 3 * UNKNOWN_OVER_NOISE * 0.005


@pytest.mark.parametrize("start", [0, 900, 990, 1005, 1015])
def test_a_window_counts_no_row_that_needs_what_lies_outside(band: LowPass, start: int):
    """A rest within, at, or over an end of the window."""
    unknown = resting((1000, 20))
    start -= start % band.factor
    window = slice(start, start + 2000)
    without = UnknownTorque.of(band, unknown, 0.005).cut(window, band)
    assert np.array_equal(without.samples, unknown[window])
    assert left_in(without, band, unknown[window], 4) < 3 * UNKNOWN_OVER_NOISE * 0.005
    if start >= 900:
        reached = band(unknown[window].astype(np.float64)) != 0.0
        assert not without.counts[reached].any()


def test_the_wider_the_rest_the_less_is_left(band: LowPass):
    kept = [UnknownTorque.of(band, resting((1500, width)), 0.005).left.sum() for width in (1, 5, 20, 80, 400)]
    assert kept == sorted(kept, reverse=True)
    assert kept[0] > kept[-1] + 10


def test_a_turn_is_unknown_for_as_long_as_the_rate_is():
    """Noise over acceleration, and how late the smoothing answers: not a period of the band."""
    t = np.arange(1000) / RATE
    for acceleration in (0.2, 2.0, 20.0):
        unknown = rests.at_rest(acceleration * (t - 0.5), 1 / RATE, 20.0, 0.01)
        width = unknown.sum() / RATE
        assert width == pytest.approx(2 * 0.01 / acceleration + 2 / (4 * np.pi * 20.0), abs=5 / RATE)


def test_what_is_taken_out_is_the_projection_on_all_combinations(band: LowPass) -> None:
    x = np.random.default_rng(3).standard_normal((2, 3, len(band.centres(SAMPLES))))
    without = UnknownTorque.of(band, resting((300, 40), (310, 90), (900, 5), (1000, 300), (2500, 700)), 1e-2)
    every = without.directions.toarray()
    taken = every @ np.linalg.solve(every.T @ every + SAME_DIRECTION**2 * np.eye(every.shape[1]), every.T)
    assert np.abs(without(x) - x @ (np.eye(len(every)) - taken)).max() < 1e-9
    assert np.abs(without(x) - x).max() > 0.1


def test_rests_that_leave_no_rows_are_let_in_if_the_band_does_not_resolve_them(band: LowPass):
    """Stopped every 12 ms for 8 ms, which a band of 30 Hz does not see; and for 200 ms beside that, which it does."""
    quick, lasting = resting(*((k, 8) for k in range(350, 3980, 12))), resting((100, 200))
    both = UnknownTorque.of(band, quick | lasting, 0.01)
    assert both.too_much
    assert np.array_equal(both.resolved(band).samples, lasting)
    assert not UnknownTorque.of(band, quick, 0.01).resolved(band).directions.shape[1]


def test_rests_that_are_as_quick_but_few_leave_enough(band: LowPass):
    assert not UnknownTorque.of(band, resting(*((k, 8) for k in range(500, 3500, 300))), 0.01).too_much


def test_many_turns_are_eliminated_as_far_as_half_of_the_rows_allow(band: LowPass) -> None:
    """A joint that turns twelve times a second leaves less than half; its friction at the turns stays out but for what
    is below the noise, where a torque that is known there would let in all of it."""
    turns = resting(*((k, 16) for k in range(300, 3900, 80)))
    strict = UnknownTorque.of(band, turns, 0.03)
    found = strict.relaxed(band)
    assert strict.too_much
    assert not found.too_much
    assert 0 < found.directions.shape[1] < strict.directions.shape[1]
    friction = np.where(turns, np.random.default_rng(2).choice([-1.0, 1.0], SAMPLES // 80).repeat(80), 0.0)
    let_in = band(friction)
    assert np.linalg.norm(found(let_in)[found.counts]) < 0.2 * np.linalg.norm(let_in[found.counts])


def test_turns_that_take_nearly_all_rows_are_let_in(band: LowPass) -> None:
    """Where friction below the noise is not all that must stay, too little would be left of what moves."""
    turns = resting(*((k, 12) for k in range(300, 3900, 60)))
    assert not UnknownTorque.of(band, turns, 0.01).relaxed(band).directions.shape[1]
