"""A motor that turns with two joints is named, and told from what turns with one, on equations written by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from runtime.diagnosis.diagnose import Diagnosis, diagnose
from runtime.model.loader import Model
from runtime.workspace import open_model
from tests import wrist
from tests.variants import slow


@pytest.fixture(scope="module")
def pair(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Model:  # noqa: ARG001 - it is compiled there
    path = tmp_path_factory.mktemp("wrist") / "wrist.toml"
    path.write_text(wrist.MODEL)
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
