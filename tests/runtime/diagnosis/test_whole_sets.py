"""Effects that hang on each other: the load that friction reads, rivals followed to their ends, one effect in another
form, and what a held-out recording says; on a plant written apart from the library."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from runtime.diagnosis.ranking import weigh
from runtime.diagnosis.search import with_rivals_decided
from runtime.diagnosis.stages import begin, diagnose, follow
from runtime.diagnosis.steps import Step, Trail
from runtime.diagnosis.verdict import Diagnosis
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import identify
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.recordings.recording import Recording
from runtime.report.diagnosed import finding_entry
from runtime.workspace.source import Source
from tests import spatial_wrist
from tests.kept import kept
from tests.upright import Upright, model, record
from tests.variants import slow


@pytest.fixture
def opened(cache: Path, tmp_path: Path):  # noqa: ARG001
    def opened(effects: str = "", gravity: float = 0.0) -> Model:
        path = tmp_path / "upright.toml"
        path.write_text(model(effects, gravity))
        return Source.read(path, None).compiled.model()

    return opened


def named(found: Diagnosis) -> list[str]:
    return [str(f.term) for f in found.findings]


@pytest.mark.parametrize("seed", [1, slow(2), slow(3), slow(4)])
def test_gravity_that_is_left_out_belongs_to_the_load(seed: int, opened) -> None:
    found = kept(diagnose, opened(), [kept(record, Upright(gravity=9.81, by_load=0.1 + 0.05 * seed), seed)])
    assert sorted(named(found)) == ["gravity", "load_friction@1"]
    values = found.steps[-1].fit.inference.values
    # A weight that hardly turns is nearly an offset, which the friction of the two directions holds, too.
    assert values[Term("gravity")]["gy"].value == pytest.approx(-9.81, rel=0.1)
    friction = values[Term("load_friction", 1)]["coefficient"]
    assert friction.value == pytest.approx(0.1 + 0.05 * seed, rel=0.05)


def test_what_an_effect_of_the_file_carries_belongs_to_the_load(opened) -> None:
    """Gravity that the file does not state but has as an effect, its values unknown."""
    known = opened("[joint.effects.load_friction]\n[effects.gravity]")
    fitted = kept(identify, known, [kept(record, Upright(gravity=9.81, by_load=0.2), 5)]).inference.values
    assert fitted[Term("load_friction", 1)]["coefficient"].value == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize("seed", [6, slow(7)])
def test_another_form_is_one_finding_with_a_remainder(seed: int, opened) -> None:
    found = kept(diagnose, opened(), [kept(record, Upright(pack=4.0), seed)])
    assert named(found) == ["cable@1"]
    assert "another form" in finding_entry(found, found.findings[0]).remainder


def test_what_sticks_at_a_turn_does_not_bend_the_friction(opened) -> None:
    """Where noise is low, a joint that sticks while it turns holds a torque that no law of its rate has."""
    known = kept(
        identify, opened("[joint.effects.stribeck]"), [kept(record, Upright(stribeck=0.35, noise=0.03), 3, substeps=25)]
    )
    values = known.inference.values
    assert values[Term("coulomb_asymmetric", 1)]["positive"].value == pytest.approx(2.0, rel=0.01)
    assert values[Term("viscous", 1)]["coefficient"].value == pytest.approx(1.2, rel=0.01)


def test_a_held_out_recording_chooses_between_rivals(opened) -> None:
    """Over a small range a weight and a spring are one; over a large one that was not fitted they are not."""
    plant = Upright(gravity=9.81)
    small = kept(diagnose, opened(), [kept(record, plant, 8, size=0.15)])
    wide = kept(diagnose, opened(), [kept(record, plant, 8, size=0.15)], [kept(record, plant, 9)])
    assert small.findings[0].rivals
    assert named(wide) == ["gravity"]
    assert len(wide.findings[0].rivals) < len(small.findings[0].rivals)


def test_a_held_out_recording_judges_a_term_where_it_acts(cache: Path, tmp_path: Path) -> None:  # noqa: ARG001
    """What another joint leaves is most of the arm's error, and hides what a wrist's friction takes away."""
    path = tmp_path / "wrist.toml"
    path.write_text(spatial_wrist.MODEL, encoding="utf-8")
    fitted, held = (disturbed_at_the_first_joint(seed) for seed in (3, 4))
    found = diagnose(Source.read(path, None).compiled.model(), [fitted], [held])
    assert named(found) == ["load_friction@3"]
    before, after = (step.held_out.relative for step in found.steps)
    assert after[2] < 0.7 * before[2]
    assert sum(e * e for e in after) > 0.98 * sum(e * e for e in before)


def disturbed_at_the_first_joint(seed: int) -> Recording:
    """A wrist with friction that grows with the load, and a slow torque from outside at joint 1."""
    motor = spatial_wrist.CoupledMotor(dry=0.0, viscous=0.0, inertia=0.0)
    made = spatial_wrist.record(motor, seed, 20.0, spatial_wrist.Beside(load=0.02))
    slow_part = lfilter([1.0], [1.0, -0.99], np.random.default_rng(seed).standard_normal(made.tau.shape[1]))
    tau = made.tau.copy()
    tau[0] += 0.3 * np.std(tau[0]) * slow_part / np.std(slow_part)
    return replace(made, tau=tau)


def test_what_a_later_finding_makes_needless_is_dropped(opened) -> None:
    """A spring and an offset that are not there stand in the trail before load friction is sought."""
    trail = begin(opened(gravity=9.81), [kept(record, Upright(gravity=9.81, by_load=0.2), 10)])
    for effect in ("linear_spring", "offset"):
        trail = trail.to(forced(trail, Term(effect, 1)))
    found = follow(trail)
    assert [str(f.term) for f in found.findings] == ["load_friction@1"]
    spring, load, offset = (Term(effect, 1) for effect in ("linear_spring", "load_friction", "offset"))
    assert found.left == {frozenset({spring, load, offset}), frozenset({load, offset})}


def test_a_likelier_rival_is_swapped_in(opened) -> None:
    """A spring stands where gravity is, which bends the load that friction reads."""
    recording = kept(record, Upright(gravity=9.81, by_load=0.2), 10)
    trail = begin(opened(), [recording])
    trail = trail.to(replace(forced(trail, Term("linear_spring", 1), Term("gravity")), rivals=(Term("gravity"),)))
    trail = trail.to(forced(trail, Term("load_friction", 1)))
    found = with_rivals_decided(trail)
    assert sorted(str(f.term) for f in found.findings) == ["gravity", "load_friction@1"]
    assert found.last.fitted.rms[0] < trail.last.fitted.rms[0]


def forced(trail: Trail, term: Term, *rivals: Term) -> Step:
    """A term added against all gates, weighed beside some rivals."""
    before = trail.last
    ranking = weigh(before.base, [c for t in (term, *rivals) if (c := before.base.search(t))], before.floors)
    candidate = ranking.of(term)
    assert candidate is not None
    shapes = {**before.shapes, term: dict(candidate.shape)}
    after = Step.of(fit_motion(trail.model, trail.motion, shapes, start=before.fit))
    return after.after(before, candidate, ranking)
