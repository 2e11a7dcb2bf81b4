"""The table of the gates, and what a result against its limit means."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.gates import BIC, GATES, LAG, RIGID, SHARE, Gate, failed
from runtime.model.terms import Term
from runtime.report import reasons

NUMBERS = st.floats(-1e6, 1e6)


def test_every_gate_says_what_it_measures_why_and_from_where() -> None:
    assert len({gate.name for gate in GATES}) == len(GATES)
    assert all(gate.statistic and gate.unit and gate.reason and gate.source for gate in GATES)
    assert {gate.name for gate in GATES} == reasons.WORDED


@given(value=NUMBERS, spread=st.floats(0.0, 1e3), gate=st.sampled_from([LAG, RIGID, BIC]))
def test_a_spread_counts_in_the_candidate_s_favour(value: float, spread: float, gate: Gate) -> None:
    exact, unsure = gate.asked(value), gate.asked(value, spread=spread)
    assert unsure.passes >= exact.passes
    assert exact.passes == (value > gate.limit if gate.opens == "above" else value < gate.limit)


def test_a_recording_that_was_not_fitted_answers_for_a_share_of_half_of_what_it_must_be() -> None:
    def weighed(share: float, delta_bic: float) -> Candidate:
        results = (BIC.asked(delta_bic), SHARE.asked(share))
        return Candidate(Term("cable", 1), {}, 0, 1.0, 1.0, results=results)

    least = SHARE.limit
    assert weighed(1.1 * least, 2 * BIC.limit).passes
    assert weighed(0.6 * least, 2 * BIC.limit).answerable
    assert not weighed(0.4 * least, 2 * BIC.limit).answerable
    assert not weighed(0.6 * least, BIC.limit / 2).answerable
    assert not weighed(1.1 * least, 2 * BIC.limit).answerable
    assert [r.gate for r in failed(weighed(0.6 * least, BIC.limit / 2).results)] == [BIC, SHARE]
