"""Dry friction that grows over a displacement: by bristles, and by springs and sliders side by side."""

from __future__ import annotations

from pathlib import Path

import pytest

from runtime.diagnosis.stages import diagnose
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import identify
from runtime.model.terms import Term, structure
from runtime.workspace.source import Source
from tests.judge.cases import Setting, cases, make
from tests.judge.recorder import Logger
from tests.judge.situations import SITUATIONS
from tests.kept import kept


def rivals(effect: str, amount: float, folder: Path) -> dict[str, list[str]]:
    """What is named where an effect is hidden in one joint that is recorded at 100 Hz, with the rivals of each."""
    (case,) = cases([effect], [1], [1.0], [4], SITUATIONS["hz100"])
    made = make(case, [amount])
    path = folder / "arm.toml"
    path.write_text(made.model)
    found = kept(diagnose, Source.read(path, None).compiled.model(), [made.recording])
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


@pytest.mark.usefixtures("cache")
def test_bristles_are_as_stiff_at_slow_sampling(tmp_path: Path) -> None:
    """At 100 Hz a joint goes through most of its presliding between two samples; what bends over the way is as stiff
    none the less."""
    (case,) = cases(["lugre"], [1], [1.0], [4], Setting(excitation="brief", logger=Logger(every=10)))
    made = make(case, [300.0])
    path = tmp_path / "arm.toml"
    path.write_text(made.model)
    model, term = Source.read(path, None).compiled.model(), Term("lugre", 1)
    plain = kept(identify, model, [made.recording])
    known = {**structure(model), term: {"stiffness": 300.0}}
    found = fit_motion(model, plain.motion, known, start=plain).inference.values[term]["stiffness"]
    assert found.value == pytest.approx(300.0, rel=0.05)
    assert found.interval is not None
    assert found.interval[0] < 300.0 < found.interval[1]
