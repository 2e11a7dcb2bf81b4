"""Dry friction that grows over a displacement, by springs and sliders side by side: the bristle's other form."""

from __future__ import annotations

from pathlib import Path

import pytest

from runtime.diagnosis.diagnose import diagnose
from runtime.workspace import open_model
from tests.judge.cases import cases, make
from tests.judge.situations import SITUATIONS


def rivals(effect: str, amount: float, folder: Path) -> dict[str, list[str]]:
    """What is named where an effect is hidden in one joint that is recorded at 100 Hz, with the rivals of each."""
    (case,) = cases([effect], [1], [1.0], [4], SITUATIONS["hz100"])
    made = make(case, [amount])
    path = folder / "arm.toml"
    path.write_text(made.model)
    found = diagnose(open_model(path), [made.recording])
    return {f.term.effect: [r.effect for r in f.rivals] for f in found.findings}


@pytest.mark.usefixtures("cache")
def test_what_takes_the_dry_friction_over_is_its_presliding(tmp_path: Path) -> None:
    """Maxwell slip of all the dry friction: elements over the position come nearer to it than a bristle, and are none
    the less a bristle's work."""
    named = rivals("lugre_maxwell", 300.0, tmp_path)
    assert "lugre" in {*named, *(r for others in named.values() for r in others)}


@pytest.mark.usefixtures("cache")
def test_a_loop_beside_the_dry_friction_is_a_springs(tmp_path: Path) -> None:
    """What leaves the dry friction as it was is not its presliding."""
    named = rivals("spring_hysteresis", 0.3, tmp_path)
    assert "spring_hysteresis" in named
    assert "lugre" not in named["spring_hysteresis"]
