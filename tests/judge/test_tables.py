"""Several recordings of one arm: the same arm, another one, and the same arm at another temperature; and the table of
scores."""

from __future__ import annotations

import re

import pytest

from runtime.diagnosis.search import compared
from runtime.diagnosis.stages import begin, diagnose
from runtime.diagnosis.verdict import Diagnosis
from runtime.report import loop, terminal
from runtime.report.diagnosed import document as diagnosed
from runtime.report.page.reports import report
from runtime.report.summary import ResultSummary
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import parse_hidden, simulate
from tests import bank
from tests.judge.score import beside, searched, table
from tests.judge.specimens import of_two_joints
from tests.kept import kept


def both(change: str | None = None) -> Diagnosis:
    """Of two recordings of one specimen, the second after a change."""
    recordings = [kept(of_two_joints, 1, "run1.csv"), kept(of_two_joints, 2, "run2.csv", change)]
    return kept(diagnose, bank.model("judge2"), recordings)


def test_recordings_of_one_arm_agree() -> None:
    found = diagnosed(both()).to_json()
    assert found["verdict"] == "clean", found["reason"]
    assert found["inconsistent"] == []
    assert [r["recording"] for r in found["recordings"]] == ["run1.csv", "run2.csv"]
    for row, common in zip(found["recordings"][0]["parameters"], found["parameters"], strict=True):
        assert set(row) >= {"joint", "name", "unit", "model", "fit", "interval"}
        assert row["fit"] == pytest.approx(common["fit"], rel=0.05)


def test_another_payload_is_another_arm() -> None:
    found = diagnosed(both("payload")).to_json()
    assert found["verdict"] == "refused", found["reason"]
    assert found["findings"] == []
    worst = found["inconsistent"][0]
    assert worst["recordings"] == ["run1.csv", "run2.csv"]
    assert worst["values"][1] > worst["values"][0]
    for text in ("run1.csv", "run2.csv", worst["name"]):
        assert text in found["reason"]


def test_thinner_grease_is_said_and_refused() -> None:
    found = diagnosed(both("thinner grease")).to_json()
    assert found["verdict"] == "refused", found["reason"]
    assert found["findings"] == []
    assert "viscous@1 coefficient is " in found["reason"]


def test_page_and_terminal_show_both_tables(capsys: pytest.CaptureFixture[str]) -> None:
    found = both("payload")
    page = report(found).html()
    assert "Each recording alone" in page
    assert page.count("differs</span>") == len(diagnosed(found).to_json()["inconsistent"])
    terminal.show(loop.diagnosis(ResultSummary(found).document))
    out = capsys.readouterr().out
    assert re.search(r"each recording alone +run1.csv +run2.csv", out)
    assert "They disagree on " in out


def test_what_is_hidden_stands_first_and_is_worth_its_price() -> None:
    """Friction at low speed in eight seconds of the drive."""
    model = bank.model("drive")
    hidden = parse_hidden("stribeck@1", model)
    trail = begin(model, [simulate(model, [hidden], SimulationSettings(3, seconds=8.0))[0]])
    term, gain, dispersion, score, price, *_ = table(compared(trail).ranking.candidates).splitlines()[1].split()
    assert term == "stribeck@1"
    assert float(score) == pytest.approx(float(gain) / max(float(dispersion), 1.0), rel=0.05)
    assert float(score) > float(price)
    assert not any(c.passes for c in compared(beside(trail, [hidden.term])).ranking.candidates)
    lines = searched(trail)
    assert any(line.startswith("+ stribeck@1") for line in lines)
    assert lines[-2:] == ["1 refits; found: stribeck@1", "joint 1: effect, found"]
