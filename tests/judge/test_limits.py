"""What a clean recording "would have seen" is hidden in the plant, a little beyond its limit and well below it."""

from __future__ import annotations

from typing import Any

import pytest

from runtime.diagnosis.stages import diagnose
from runtime.diagnosis.verdict import Diagnosis
from runtime.report.diagnosed import document as diagnosed
from tests import bank
from tests.judge import specimens
from tests.kept import kept
from tests.variants import slow

BEYOND, WITHIN = 1.3, 0.5


@pytest.fixture(scope="module")
def clean() -> dict[str, Any]:
    found = diagnosed(kept(diagnose, bank.model("judge1"), [kept(specimens.clean)])).to_json()
    assert found["verdict"] == "clean"
    return found


def limit(clean: dict[str, Any], effect: str) -> dict[str, Any]:
    return next(x for x in clean["would_have_seen"] if x["effect"] == effect)


def with_hidden(limit: dict[str, Any], times: float) -> Diagnosis:
    return kept(diagnose, bank.model("judge1"), [kept(specimens.at_limit, limit, times)])


@pytest.mark.parametrize("effect", ["stribeck", "elasticity", slow("load_friction"), slow("payload")])
def test_what_would_have_been_seen_is_seen(effect: str, clean: dict[str, Any]) -> None:
    found = with_hidden(limit(clean, effect), BEYOND)
    assert [f.term.effect for f in found.findings][:1] == [effect]


@pytest.mark.parametrize("effect", ["linear_spring", slow("torque_ripple")])
def test_half_of_a_limit_is_not_named(effect: str, clean: dict[str, Any]) -> None:
    assert not with_hidden(limit(clean, effect), WITHIN).findings


def test_limits_say_what_they_assume_and_are_given_only_where_there_are_any(clean: dict[str, Any]) -> None:
    seen = {x["effect"]: x for x in clean["would_have_seen"]}
    assert set(seen["stribeck"]) == {"effect", "joint", "parameter", "above", "unit", "with"}
    assert seen["stribeck"]["parameter"] == "torque"
    assert 0.05 < seen["stribeck"]["with"]["speed"] < 0.5
    assert seen["elasticity"]["parameter"] == "stiffness"
    assert "below" in seen["elasticity"]
    # An offset hides in two dry frictions; a scale of the only torque, in all parameters together.
    assert not {"offset", "torque_scale"} & set(seen)
