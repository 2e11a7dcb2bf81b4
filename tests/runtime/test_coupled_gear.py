"""A motor that turns with two joints is named, and told from what turns with one, on equations written by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from runtime.diagnosis.diagnose import Diagnosis, begin, diagnose
from runtime.model.loader import Model
from runtime.workspace.source import open_model
from tests import spatial_wrist, wrist
from tests.variants import slow


@pytest.fixture(scope="module")
def pair(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Model:  # noqa: ARG001 - it is compiled there
    path = tmp_path_factory.mktemp("wrist") / "wrist.toml"
    path.write_text(wrist.MODEL)
    return open_model(path)


@pytest.fixture(scope="module")
def six(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Model:  # noqa: ARG001 - it is compiled there
    path = tmp_path_factory.mktemp("wrist") / "spatial_wrist.toml"
    path.write_text(spatial_wrist.MODEL)
    return open_model(path)


def named(found: Diagnosis) -> list[str]:
    return [str(f.term) for f in found.findings]


@pytest.mark.parametrize("ratio", [1.0, slow(-1.0)])
def test_friction_and_inertia_of_a_coupled_motor_are_found_at_both_joints(pair: Model, ratio: float) -> None:
    found = diagnose(pair, [wrist.record(wrist.CoupledMotor(0.5, 0.4, 0.03, ratio), seed=3)])
    assert named(found) == ["coupled_gear@1"]
    assert found.findings[0].rivals == ()
    last = found.steps[-1].identification
    values = last.inference.values[found.findings[0].term]
    assert values["ratio"].value == ratio
    for name, truth in (("coulomb", 0.5), ("viscous", 0.4)):
        assert values[name].value == pytest.approx(truth, rel=0.01)
    # Between parallel axes the motor's inertia is one of the links': only together.
    assert values["inertia"].with_others
    assert max(s.relative for s in found.steps[-1].joints) < 0.005


def test_dry_friction_of_a_coupled_motor_alone_needs_no_gear(pair: Model) -> None:
    found = diagnose(pair, [wrist.record(wrist.CoupledMotor(dry=0.4), seed=3)])
    assert named(found) == ["coupled_friction@1"]


def test_without_a_coupled_motor_nothing_is_named(pair: Model) -> None:
    assert diagnose(pair, [wrist.record(wrist.CoupledMotor(), seed=3)]).verdict == "clean"


@pytest.mark.parametrize("seed", [4, slow(3), slow(5), slow(6)])
def test_a_coupled_wrist_in_space_is_no_dry_friction_of_two_joints(six: Model, seed: int) -> None:
    """Of six joints the last two show it; nine seconds, with every rotor's inertia, friction and offset unknown."""
    motor = wrist.CoupledMotor(1.4, 0.7, 0.01)
    found = diagnose(six, [spatial_wrist.record(motor, seed, seconds=9.0)])
    assert named(found) == ["coupled_gear@5"]
    assert found.findings[0].rivals == ()
    last = found.steps[-1]
    values = last.identification.inference.values[found.findings[0].term]
    assert values["ratio"].value == 1.0
    for name, truth in (("coulomb", motor.dry), ("viscous", motor.viscous), ("inertia", motor.inertia)):
        low, high = values[name].interval
        assert low - 0.5 * (high - low) < truth < high + 0.5 * (high - low)
    assert max(s.relative for s in last.joints[4:]) < 0.005


def test_what_other_joints_lack_as_well_takes_no_place_of_a_coupled_wrist(six: Model) -> None:
    """Some 370 rows a joint and 60 unknowns: beside a spring at joint 4 the gates that weigh all joints at once would
    hold something against each finding, and an effect of another joint would pass them."""
    recording = spatial_wrist.record(wrist.CoupledMotor(1.4, 0.7, 0.01), 4, 9.0, spatial_wrist.Beside(1.0, 0.05))
    search = begin(six, [recording])
    while search.open and search.advance() is not None:
        pass
    assert sorted(str(f.term) for f in search.findings) == ["coupled_gear@5", "linear_spring@4", "load_friction@3"]
    assert max(search.steps[-1].fitted.relative[2:]) < 0.007


def test_without_a_coupled_wrist_in_space_nothing_is_named(six: Model) -> None:
    assert diagnose(six, [spatial_wrist.record(wrist.CoupledMotor(), 4, seconds=9.0)]).verdict == "clean"
