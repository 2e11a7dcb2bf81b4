"""What a clean recording "would have seen" is hidden in the plant, a little beyond its limit and well below it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from runtime.diagnosis.diagnose import Diagnosis, diagnose
from runtime.model.loader import Model
from tests.variants import slow

from .bench import LEVEL, Bench, Setting, bench, specimen
from .bodies import ARMS, BELIEVED, model_text
from .limits import hidden
from .line import opened
from .motion import desired

SEED = 31
BEYOND, WITHIN = 1.3, 0.5


@pytest.fixture(scope="module")
def plant() -> Bench:
    rng = np.random.default_rng(SEED)
    rows = specimen(ARMS[1], BELIEVED, rng)
    return bench(Setting(), desired(rng, 1), rng, False, rows)


@pytest.fixture(scope="module")
def model() -> Model:
    return opened(model_text(ARMS[1], BELIEVED)).compiled.model()


@pytest.fixture(scope="module")
def clean(plant: Bench, model: Model) -> dict[str, Any]:
    found = diagnose(model, [plant.recording(plant.run([]))]).document().to_json()
    assert found["verdict"] == "clean"
    return found


def limit(clean: dict[str, Any], effect: str) -> dict[str, Any]:
    return next(x for x in clean["would_have_seen"] if x["effect"] == effect)


def with_hidden(plant: Bench, model: Model, limit: dict[str, Any], times: float) -> Diagnosis:
    """With noise of another draw than that from which the limit was computed."""
    what = hidden(limit, times)
    assert what is not None
    noise = LEVEL * np.random.default_rng(SEED + 1).standard_normal(plant.noise.shape)
    other = replace(plant, noise=noise)
    return diagnose(model, [other.recording(other.run([what]))])


@pytest.mark.parametrize("effect", ["stribeck", "elasticity", *(slow(x) for x in ("load_friction", "payload"))])
def test_what_would_have_been_seen_is_seen(effect: str, plant: Bench, model: Model, clean: dict[str, Any]) -> None:
    found = with_hidden(plant, model, limit(clean, effect), BEYOND)
    assert [f.term.effect for f in found.findings][:1] == [effect]


@pytest.mark.parametrize("effect", ["linear_spring", slow("torque_ripple")])
def test_half_of_a_limit_is_not_named(effect: str, plant: Bench, model: Model, clean: dict[str, Any]) -> None:
    assert not with_hidden(plant, model, limit(clean, effect), WITHIN).findings


def test_limits_say_what_they_assume_and_are_given_only_where_there_are_any(clean: dict[str, Any]) -> None:
    seen = {x["effect"]: x for x in clean["would_have_seen"]}
    assert set(seen["stribeck"]) == {"effect", "joint", "parameter", "above", "unit", "with"}
    assert seen["stribeck"]["parameter"] == "torque"
    assert 0.05 < seen["stribeck"]["with"]["speed"] < 0.5
    assert seen["elasticity"]["parameter"] == "stiffness"
    assert "below" in seen["elasticity"]
    # An offset hides in two dry frictions; a scale of the only torque, in all parameters together.
    assert not {"offset", "torque_scale"} & set(seen)
