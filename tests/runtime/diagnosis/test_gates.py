"""The table of the gates, and what a result against its limit means."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from runtime.diagnosis.gates import GATES, LAG, RIGID, SCORE, Gate
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
