"""The study of the paper: its tables within the agreed distance, its claims, its experiments."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from runtime.documents.paper import ClaimEntry
from runtime.model.loader import Model
from runtime.study import figures, published
from runtime.study.identification import Table1
from runtime.study.study import Row, Study, StudyCase
from runtime.workspace.source import CompiledArm, Source
from tests.runtime.conftest import Run


@pytest.fixture(scope="module")
def source() -> Source:
    return Source.shipped("vishard4")


@pytest.fixture(scope="module")
def model(source: Source) -> Model:
    return source.compiled.model()


@pytest.fixture(scope="module")
def study(model: Model) -> Study:
    return Study(model, Path(), 0, lambda _: None)


@pytest.fixture(scope="module")
def executing(source: Source, study: Study) -> Study:
    """The same with one trial of each case, and its plans."""
    made = Study(study.model, source.compiled.controller(), 1, lambda _: None)
    made._plans = study._plans
    return made


def test_table_2_within_three_percent_or_what_the_print_shows(study: Study) -> None:
    for row in study.table2:
        assert row.simulation == pytest.approx(row.paper.simulation, rel=0.03, abs=0.2), row.case


def test_the_springs_savings_of_scenario_1(study: Study) -> None:
    assert [claim for claim in study.claims("table2") if not claim.holds] == []


@pytest.mark.slow
def test_savings_do_not_depend_on_friction_at_any_cycle_time(study: Study) -> None:
    assert sorted(study.spread) == [1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.4, 2.6, 2.8, 3.0]
    # Costs are printed with one decimal. At 1 s, where the stiffest spring is too soft, it is 2.01.
    assert round(max(study.spread.values()), 1) <= 2.0


@pytest.mark.slow
def test_table_3_within_twenty_percent_and_ten_on_average(study: Study) -> None:
    off = [abs(row.simulation / row.paper.simulation - 1.0) for row in study.table3]
    assert max(off) <= 0.20
    assert sum(off) / len(off) <= 0.10


@pytest.mark.slow
def test_what_section_5b_says_of_the_springs_in_contact(study: Study) -> None:
    told = [claim for claim in study.claims("table3") if "joint 4" not in claim.text]
    assert [claim for claim in told if not claim.holds] == []


@pytest.mark.parametrize("table", ["table2", pytest.param("table3", marks=pytest.mark.slow)])
def test_bare_cases_have_no_spring_and_sprung_ones_one_that_can_be_bought(study: Study, table: str) -> None:
    for row in getattr(study, table):
        assert (row.stiffness is not None) == row.case.sprung
        bought = row.plan.scenario.springs[0].catalogue if row.case.sprung else (row.stiffness,)
        assert row.stiffness in bought


def test_the_arm_is_the_calibrated_one(model: Model) -> None:
    """D_44, the one figure of the inertia that follows from Table II."""
    D = model.inertia([0.0, 0.0, 0.0, 0.0])
    assert D[3, 3] == pytest.approx(0.2365, abs=5e-5)


def test_the_figures_of_contact_show_the_plan_and_what_was_executed(study: Study, executing: Study) -> None:
    case = StudyCase("D", 1.6, 600.0)
    row = Row(case, study.plan(case), executing.execute(case), published.TABLE_3[1.6, 600.0, "D"])
    softer = figures.figure7([row]).axes[1]
    planned, executed = (np.asarray(line.get_ydata()) for line in softer.lines[:2])
    # 5 cm are planned; the damper at the plate, which the model has not, takes some of them.
    assert planned.min() == pytest.approx(-0.51, abs=1e-3)
    assert planned.min() + 0.003 < executed.min() < -0.46
    motor, spring = figures.figure8([row]).axes[0].lines
    assert np.asarray(spring.get_ydata()).min() >= 0.0
    assert np.ptp(np.asarray(motor.get_ydata())) > 5.0
    # What the paper prints stands beside: 4.5 cm at the softer plate, 13 to 16 N²m²s left at joint 4.
    printed = softer.lines[3].get_ydata()[0]
    assert printed == pytest.approx(-0.46 - 0.045)
    assert "paper 4.5" in softer.texts[0].get_text()
    assert "paper 13 to 16" in figures.figure8([row]).axes[0].texts[0].get_text()


def test_without_compensation_friction_costs_and_joint_4_turns_early(study: Study, executing: Study) -> None:
    runs = {letter: executing.execute(StudyCase(letter, 1.2)) for letter in "BD"}
    planned = {letter: study.plan(StudyCase(letter, 1.2)).cost for letter in "BD"}
    friction = planned["D"] - planned["B"]
    assert 0.5 * friction < runs["B"].cost - planned["B"] < 1.2 * friction
    assert runs["D"].cost == pytest.approx(planned["D"], rel=0.05)
    assert runs["B"].reversal == pytest.approx(published.REVERSAL["B"], abs=0.03)
    assert runs["B"].reversal > runs["D"].reversal > -1.5708


@pytest.mark.parametrize(("unclaimed", "status"), [("", 1), ("the geometry is not published", 0)])
def test_the_exit_status_says_whether_the_study_keeps_what_it_claims(
    unclaimed: str, status: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, tendon: Run
) -> None:
    """What is known not to come out is said with the reason, and costs no exit status."""
    text = "the spring leaves joint 4"
    claim = ClaimEntry(text=text, paper="13 to 16", ours="12 to 25", holds=False, unclaimed=unclaimed)
    table = Table1(()).entry()
    monkeypatch.setattr(CompiledArm, "model", lambda _: None)
    monkeypatch.setattr(CompiledArm, "controller", lambda _: tmp_path)
    found = SimpleNamespace(entry=lambda: msgspec.structs.replace(table, claims=[claim]))
    monkeypatch.setattr(Study, "table1", found)
    ended, out, _ = tendon("paper", "table1")
    assert ended == status
    assert 'Not reproduced: "the spring leaves joint 4 13 to 16", here 12 to 25; ' in out
    assert (f"not claimed: {unclaimed}." if unclaimed else "it should come out.") in out
