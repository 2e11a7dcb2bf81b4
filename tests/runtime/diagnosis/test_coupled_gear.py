"""A motor that turns with two joints is named, and told from what turns with one, on equations written by hand."""

from __future__ import annotations

import pytest

from runtime.diagnosis.stages import diagnose
from runtime.diagnosis.verdict import Diagnosis
from tests import bank, spatial_wrist, wrist
from tests.judge.cases import Case, Setting
from tests.kept import kept
from tests.variants import slow


def named(found: Diagnosis) -> list[str]:
    return [str(f.term) for f in found.findings]


@pytest.mark.parametrize("ratio", [1.0, slow(-1.0)])
def test_friction_and_inertia_of_a_coupled_motor_are_found_at_both_joints(ratio: float) -> None:
    found = bank.diagnosed("pair coupled" if ratio > 0 else "pair coupled backwards")
    assert named(found) == ["coupled_gear@1"]
    assert found.findings[0].rivals == ()
    last = found.steps[-1].fit
    values = last.inference.values[found.findings[0].term]
    assert values["ratio"].value == ratio
    for name, truth in (("coulomb", 0.5), ("viscous", 0.4)):
        assert values[name].value == pytest.approx(truth, rel=0.01)
    # Between parallel axes the motor's inertia is one of the links': only together.
    assert values["inertia"].with_others
    assert max(s.relative for s in found.steps[-1].joints) < 0.005


def test_dry_friction_of_a_coupled_motor_alone_needs_no_gear() -> None:
    found = bank.diagnosed("pair rubbing")
    assert named(found) == ["coupled_friction@1"]


def test_without_a_coupled_motor_nothing_is_named() -> None:
    assert bank.diagnosed("pair clean").verdict == "clean"


@pytest.mark.parametrize("fluid", [10.0, slow(40.0)])
def test_drag_of_a_fluid_at_both_joints_is_no_coupled_motor(fluid: float) -> None:
    """It acts on both links, by the square of speeds that depend on both rates."""
    recording = kept(wrist.record, bank.NONE, 4, wrist.Resistance(fluid))
    found = kept(diagnose, bank.model("wrist"), [recording])
    assert not [name for name in named(found) if name.startswith("coupled")]


@pytest.mark.parametrize("seed", [3400, slow(3401), slow(3402)])
def test_a_torque_at_one_joint_by_the_other_s_rate_is_no_coupled_motor(seed: int) -> None:
    case = Case("drag_across", "unknown", ("drag_across",), Setting(joints=2), 0.7, seed, ("unexplained",))
    assert "coupled" not in kept(bank.judged, case).named


def test_a_coupled_motor_is_found_where_the_rates_are_alike() -> None:
    recording = kept(wrist.record, wrist.CoupledMotor(0.2, 0.16, 0.012), 3, wrist.Resistance(), 0.95)
    assert named(kept(diagnose, bank.model("wrist"), [recording])) == ["coupled_gear@1"]


@pytest.mark.parametrize("seed", [4, slow(3), slow(5), slow(6)])
def test_a_coupled_wrist_in_space_is_no_dry_friction_of_two_joints(seed: int) -> None:
    """Of six joints the last two show it; nine seconds, with every rotor's inertia, friction and offset unknown."""
    motor, recording = bank.COUPLED, kept(spatial_wrist.record, bank.COUPLED, seed, 9.0)
    found = kept(diagnose, bank.model("six"), [recording])
    assert named(found) == ["coupled_gear@5"]
    assert found.findings[0].rivals == ()
    last = found.steps[-1]
    values = last.fit.inference.values[found.findings[0].term]
    assert values["ratio"].value == 1.0
    for name, truth in (("coulomb", motor.dry), ("viscous", motor.viscous), ("inertia", motor.inertia)):
        low, high = values[name].interval
        assert low - 0.5 * (high - low) < truth < high + 0.5 * (high - low)
    assert max(s.relative for s in last.joints[4:]) < 0.005


def test_what_other_joints_lack_as_well_takes_no_place_of_a_coupled_wrist() -> None:
    """Some 370 rows a joint and 60 unknowns: beside a spring at joint 4 the gates that weigh all joints at once would
    hold something against each finding, and an effect of another joint would pass them."""
    search = bank.searched("six coupled and more")
    assert sorted(str(f.term) for f in search.findings) == ["coupled_gear@5", "linear_spring@4", "load_friction@3"]
    assert max(search.steps[-1].fitted.relative[2:]) < 0.007


def test_without_a_coupled_wrist_in_space_nothing_is_named() -> None:
    assert bank.diagnosed("six clean").verdict == "clean"
