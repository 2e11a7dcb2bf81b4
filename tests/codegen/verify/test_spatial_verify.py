"""tendon verify of an arm in space: every target equals SymPy, and what they compute is proved."""

from __future__ import annotations

import json

import pytest
import spatial_arms

from codegen.tape.numbering import Node
from codegen.tape.tape import Tape
from codegen.verify import proof, verify
from symbolic.model import derive


@pytest.fixture(scope="module")
def report() -> verify.VerifyReport:
    return verify.verify(spatial_arms.drawn("rpr", 4), samples=3, seed=0, effects=())


def test_all_targets_of_all_functions_are_equal(report: verify.VerifyReport) -> None:
    functions = {case.function for case in report.cases}
    assert {"inverse_dynamics", "forward_dynamics", "tip_rotation", "tip_load", "moment_jacobian"} <= functions
    assert {case.target for case in report.cases if case.function == "coriolis"} == set(verify.TARGETS)
    assert report.equal


def test_the_report_has_its_proofs(report: verify.VerifyReport) -> None:
    proofs = json.loads(json.dumps(report.to_json()))["proofs"]
    assert [p["function"] for p in proofs][:2] == ["frames", "inverse_dynamics"]
    assert all(p["equal"] and p["differs"] is None for p in proofs)
    assert proofs[1]["points"] == proof.POINTS


def test_a_wrong_tape_makes_the_report_unequal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal targets of a wrong equation are not enough."""
    right = Tape.of

    def wrong(function, lowering="exact"):  # type: ignore[no-untyped-def]
        tape = right(function, lowering)
        if function.name != "gravity":
            return tape
        k = next(i for i, node in enumerate(tape.nodes) if node.op == "mul")
        nodes = [Node("add", node.args) if i == k else node for i, node in enumerate(tape.nodes)]
        return Tape(tuple(nodes), tape.outputs, tape.names)

    monkeypatch.setattr(Tape, "of", wrong)
    found = proof.prove_model(derive(spatial_arms.drawn("rr", 3, gravity=(1.0, 2.0, -9.0))), 0)
    assert [p.function for p in found if not p.equal] == ["gravity"]
