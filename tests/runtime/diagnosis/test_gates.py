"""The table of the gates, what a result against its limit means, and the figures that score and held-out errors are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.diagnosis.gates import GATES, LAG, RIGID, SCORE, Gate
from runtime.diagnosis.heard import Errors, heard
from runtime.diagnosis.score import Evidence, dispersion
from runtime.report import reasons


def test_every_gate_says_what_it_measures_why_and_from_where() -> None:
    assert len({gate.name for gate in GATES}) == len(GATES)
    assert all(gate.statistic and gate.unit and gate.reason and gate.source for gate in GATES)
    assert {gate.name for gate in GATES} == reasons.WORDED


@given(value=st.floats(-1e6, 1e6), spread=st.floats(0.0, 1e3), gate=st.sampled_from([LAG, RIGID, SCORE]))
def test_a_spread_counts_in_the_candidate_s_favour(value: float, spread: float, gate: Gate) -> None:
    exact, unsure = gate.asked(value), gate.asked(value, spread=spread)
    assert unsure.passes >= exact.passes
    assert exact.passes == (value > gate.limit if gate.opens == "above" else value < gate.limit)


@given(price=st.floats(5.0, 30.0), stretches=st.floats(1.0, 100.0))
def test_a_price_is_paid_by_student_s_likelihood_ratio(price: float, stretches: float) -> None:
    due = Evidence(1.0, 1.0, stretches, price).due
    assert (stretches + 1) / 2 * np.log1p(2 * due / stretches) == pytest.approx(price)
    assert Evidence(1.0, 1.0, 2 * stretches, price).due < due
    assert Evidence(1.0, 1.0, 1e9, price).due == pytest.approx(price, rel=1e-4)


@pytest.mark.parametrize("acts", [slice(None), slice(1000, 1400)])
def test_the_dispersion_is_one_of_noise_and_more_beside_a_wrong_law(acts: slice) -> None:
    """Of a law that acts everywhere, and of one that acts for a tenth of the time."""
    rng, own = np.random.default_rng(5), np.zeros(4000)
    own[acts] = np.sin(np.arange(4000.0) / 7)[acts]
    left = rng.standard_normal((200, 4000))
    found = [dispersion([4000], [r + 0.3 * own], [r])[0] for r in left]
    assert np.mean(found) == pytest.approx(1.0, abs=0.1)
    wrong = 0.6 * own * np.sign(np.sin(np.arange(4000.0) / 60))
    assert np.mean([dispersion([4000], [r + 0.3 * own], [r + wrong])[0] for r in left]) > 1.5


def test_no_size_of_a_torque_is_too_large_for_its_dispersion() -> None:
    """Limits are sought of torques that nothing in a recording bounds."""
    own, left = np.sin(np.arange(4000.0) / 7), np.random.default_rng(6).standard_normal(4000)
    usual, large = (dispersion([4000], [left + size * own], [left]) for size in (1.0, 1e200))
    assert large == pytest.approx(usual, rel=1e-9)


@pytest.mark.parametrize(("loss", "clear"), [(1.0, True), (1.2, True), (2.2, False)])
def test_what_other_joints_clearly_lose_is_charged(loss: float, clear: bool) -> None:
    """One joint's squared error falls to a half, the other's rises."""
    rng = np.random.default_rng(3)
    noise, more = rng.standard_normal((2, 4000)), rng.standard_normal((2, 4000))
    one = Errors((1.0, loss**0.5), (0.1, 0.1), (noise[0], noise[1] + (loss - 1) ** 0.5 * more[1]))
    other = Errors((2.0**0.5, 1.0), (0.1, 0.1), (noise[0] + more[0], noise[1]))
    said = heard(one, other, [(0,)])
    assert said.falls_to == pytest.approx(0.5 * loss, rel=0.1)
    assert said.clear == clear
