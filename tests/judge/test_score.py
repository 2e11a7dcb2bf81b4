"""The table of scores: what is hidden stands first, and is worth more than it costs."""

from __future__ import annotations

import pytest

from runtime.diagnosis.search import compared
from runtime.diagnosis.stages import begin
from runtime.diagnosis.steps import Trail
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import parse_hidden, simulate
from runtime.workspace.source import Source
from tests.judge.score import beside, searched, table


@pytest.fixture(scope="module")
def given() -> Trail:
    """The drive with friction at low speed hidden in eight seconds."""
    model = Source.shipped("drive").compiled.model()
    made, _ = simulate(model, [parse_hidden("stribeck@1", model)], SimulationSettings(3, seconds=8.0))
    return begin(model, [made])


def test_the_hidden_effect_stands_first_and_is_worth_its_price(given: Trail) -> None:
    first = table(compared(given).ranking.candidates).splitlines()[1]
    term, gain, dispersion, score, price, *_ = first.split()
    assert term == "stribeck@1"
    assert float(score) == pytest.approx(float(gain) / max(float(dispersion), 1.0), rel=0.05)
    assert float(score) > float(price)


def test_with_it_in_the_model_nothing_is_worth_its_price(given: Trail) -> None:
    stribeck = parse_hidden("stribeck@1", given.model).term
    assert not any(c.passes for c in compared(beside(given, [stribeck])).ranking.candidates)


def test_the_search_adds_it_and_says_so(given: Trail) -> None:
    lines = "\n".join(searched(given)).splitlines()
    assert any(line.startswith("+ stribeck@1") for line in lines)
    assert lines[-2:] == ["1 refits; found: stribeck@1", "joint 1: effect, found"]
