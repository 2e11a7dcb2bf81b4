"""Effects that hang on each other: the load that friction reads, rivals followed to their ends, one effect in another
form, and what a held-out recording says; on a plant written apart from the library."""

from __future__ import annotations

from pathlib import Path

import pytest

from runtime.diagnosis.diagnose import Diagnosis, diagnose, finding_entry
from runtime.diagnosis.gates import weigh
from runtime.diagnosis.search import Search
from runtime.diagnosis.steps import Finding, Step
from runtime.identification.identify import identify, identify_motion
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.workspace.source import Source
from tests import bank
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
    values = found.steps[-1].identification.inference.values
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
    assert "another form" in finding_entry(found, 0).remainder


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
    small = kept(diagnose, opened(), [kept(record, plant, 8, size=0.25)])
    wide = kept(diagnose, opened(), [kept(record, plant, 8, size=0.25)], [kept(record, plant, 9)])
    assert small.findings[0].rivals
    assert named(wide) == ["gravity"]
    assert len(wide.findings[0].rivals) < len(small.findings[0].rivals)


def test_what_the_data_no_longer_tell_is_taken_back_and_nothing_else(opened) -> None:
    """A load friction was found; a spring and an offset that are not there stand beside it."""
    recording = kept(record, Upright(gravity=9.81, by_load=0.2), 10)
    search = kept(bank.advanced, opened(gravity=9.81), [recording])
    assert [str(f.term) for f in search.findings] == ["load_friction@1"]
    for effect in ("linear_spring", "offset"):
        search.findings.append(forced(search, Term(effect, 1)))
        search.steps.append(search.findings[-1].after)
    search.take_back_untold()
    assert [str(f.term) for f in search.findings] == ["load_friction@1"]
    assert search.steps[-1].added == Term("load_friction", 1)
    assert len(search.steps) == 2
    search.take_back_untold()
    assert len(search.findings) == 1


def forced(search: Search, term: Term) -> Finding:
    """A term added against all gates."""
    field, before = search.ground(), search.steps[-1]
    candidate = field.search(term)
    assert candidate is not None
    verdict = weigh(field, [candidate], before.floors)
    shapes = {**before.shapes, term: dict(candidate.shape)}
    after = Step.of(term, identify_motion(search.model, search.motion, shapes, start=before.identification.fit))
    return Finding(verdict.ranked[0], (), verdict, before, after)
