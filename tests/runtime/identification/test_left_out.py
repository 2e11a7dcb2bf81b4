"""Masses and inertias that a model file leaves out: found from recordings, held against nobody, asked for by name."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.diagnosis.stages import diagnose
from runtime.fit_warnings import warnings
from runtime.identification.compare import compare
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import fit_document, identify, prepared
from runtime.loop.improve import improve
from runtime.model.terms import Term, structure
from runtime.motion.band import credible_inertia
from runtime.report.diagnosed import document as diagnosed
from runtime.report.reasons import reason
from runtime.simulation import simulate
from runtime.simulation.options import SimulationSettings
from runtime.simulation.plant import Plant
from runtime.workspace.source import Source
from symbolic.model_file.checks import ModelError
from tests import wrist
from tests.kept import kept
from tests.runtime.conftest import ROOT, Run, recorded
from tests.variants import slow

DRIVE = (ROOT / "symbolic" / "arms" / "drive.toml").read_text(encoding="utf-8")
Sourced = Callable[[str], Source]


def bare(text: str) -> str:
    """The file without any inertia."""
    return re.sub(r"(?m)^(mass|com|inertia|rotor_inertia) *=.*\n", "", text)


@pytest.fixture
def sourced(cache: Path, tmp_path: Path) -> Sourced:  # noqa: ARG001 - the cache is where it is compiled
    def make(text: str) -> Source:
        path = tmp_path / "arm.toml"
        path.write_text(text, encoding="utf-8")
        return Source.read(path, None)

    return make


@pytest.mark.parametrize("hidden", [slow("stribeck"), slow(None), slow("linear_spring"), slow("lugre")])
def test_a_drive_without_any_inertia_is_diagnosed_as_with_its_own(sourced: Sourced, hidden: str | None) -> None:
    recording = recorded(hidden, seed=1)
    true, unknown = (kept(diagnose, sourced(text).compiled.model(), [recording]) for text in (DRIVE, bare(DRIVE)))
    assert [f.term for f in unknown.findings] == [f.term for f in true.findings]
    assert [str(f.term) for f in unknown.findings] == ([f"{hidden}@1"] if hidden else [])
    assert unknown.verdict == true.verdict
    assert "model file" not in reason(unknown)
    found = json.loads(json.dumps(diagnosed(unknown).to_json(), allow_nan=False))["parameters"]
    assert [p["model"] for p in found] == [None]
    # The drive's own inertia: plants.py's rotor and link.
    assert found[0]["fit"] == pytest.approx(0.2365, rel=0.01)


def test_an_arm_without_any_inertia_is_identified_and_then_simulates(sourced: Sourced) -> None:
    source = sourced(bare(wrist.MODEL))
    fitted = kept(identify, source.compiled.model(), [wrist.record(wrist.CoupledMotor(), seed=5)])
    model = source.with_text(source.edits.set(fit_document(fitted)).text).compiled.model()
    np.testing.assert_allclose(model.lump_values, fitted.coefficients[: len(model.lumps)], rtol=1e-6)
    true = sourced(wrist.MODEL).compiled.model()
    stated = dict(zip((lump.name for lump in true.lumps), true.lump_values, strict=True))
    for name, value in zip((lump.name for lump in model.lumps), model.lump_values, strict=True):
        assert value == pytest.approx(stated.get(name, 0.0), rel=0.02, abs=0.002)
    made, _ = simulate.simulate(model, settings=SimulationSettings(seconds=10))
    assert np.isfinite(made.tau).all()
    Plant(model, {}, 1e-3).advance([0.1, 0.1])


def test_a_file_that_leaves_numbers_open_has_no_error_as_written(sourced: Sourced) -> None:
    found = kept(compare, sourced(bare(DRIVE)).compiled.model(), [recorded(None, seed=2)])
    assert found.written is None
    assert found.document([]).to_json()["joints"][0]["as_written"] is None
    assert not any("physical" in warning for warning in warnings(found.fit))


def test_what_no_row_tells_stays_open(sourced: Sourced) -> None:
    """The first joint is held: the second's inertias are seen as their sum, and nothing is made up of the rest."""
    recording = wrist.record(wrist.CoupledMotor(), seed=3)
    held = np.zeros_like(recording.q)
    rng = np.random.default_rng(0)
    q = np.array([held[0], recording.q[1]])
    t = recording.t
    acceleration = np.gradient(np.gradient(q[1], t), t)
    tau = np.array([held[0], 0.08 * acceleration + 0.8 * np.sign(np.gradient(q[1], t))])
    source = sourced(bare(wrist.MODEL))
    smooth = replace(recording, q=q, tau=tau + 0.03 * rng.standard_normal(q.shape))
    document = fit_document(kept(identify, source.compiled.model(), [smooth]))
    assert {p.name for p in document.inertial if p.fit is None} == {"J1", "h2", "hy2"}
    with pytest.raises(ModelError, match="J1, h2, hy2"):
        _ = source.with_text(source.edits.set(document).text).compiled.model().lump_values


def test_the_band_follows_the_inertia_that_the_recordings_show() -> None:
    assert credible_inertia(np.array([np.nan]), [recorded(None, seed=4)])[0] == pytest.approx(0.2365, rel=0.1)


@pytest.mark.slow
def test_a_transmission_tells_the_rotor_from_its_link(sourced: Sourced) -> None:
    source = sourced(bare(DRIVE))
    better = kept(improve, source, [recorded("elasticity", seed=1)])
    assert [str(f.term) for f in better.findings] == ["elasticity@1"]
    fitted = better.steps[-1].fit
    values = fitted.inference.values[better.findings[0].term]
    for estimate, truth in ((values["stiffness"], 3000.0), (fitted.inference.open[0], 0.10)):
        assert estimate.interval is not None
        assert estimate.interval[0] < truth < estimate.interval[1]
        assert estimate.value == pytest.approx(truth, rel=0.15)
    # The written file says so, and is a whole one.
    model = source.with_text(better.model_text).compiled.model()
    assert model.joints[0].rotor_inertia == pytest.approx(fitted.inference.open[0].value, rel=1e-6)
    assert model.lumps_known


def test_a_rotor_that_a_transmission_told_goes_with_it(sourced: Sourced) -> None:
    """A fit without the transmission, begun at one with it, is the fit without."""
    model = sourced(bare(DRIVE)).compiled.model()
    motion = prepared(model, [recorded("elasticity", seed=1)])
    known = structure(model)
    without = fit_motion(model, motion, known)
    told = fit_motion(
        model, motion, {**known, Term("elasticity", 1): {"stiffness": 4000.0, "damping": 1.0}}, start=without
    )
    again = fit_motion(model, motion, known, start=told)
    assert again.coefficients == pytest.approx(without.coefficients, rel=1e-2)


def test_friction_by_a_load_without_gravity_is_told_with_the_rotor_only(sourced: Sourced) -> None:
    text = bare(DRIVE).replace("[joint.effects.viscous]", "[joint.effects.viscous]\n[joint.effects.load_friction]")
    source = sourced(text)
    truth = DRIVE.replace("rotor_inertia = 0.10", "rotor_inertia = 0.12")
    told = truth.replace("[joint.effects.viscous]", "[joint.effects.viscous]\n[joint.effects.load_friction]")
    made, _ = simulate.simulate(sourced(told).compiled.model(), settings=SimulationSettings(seconds=20))
    found = kept(diagnose, source.compiled.model(), [made])
    assert found.verdict == "clean"
    inference = found.steps[-1].fit.inference
    others = inference.values[Term("load_friction", 1)]["coefficient"].with_others
    assert "rotor_inertia 1" in others
    assert {p["name"] for p in diagnosed(found).to_json()["parameters"]} == {"J1", "rotor_inertia"}


def test_a_verb_that_needs_a_number_asks_for_it_by_name(sourced: Sourced, tendon: Run) -> None:
    source = sourced(re.sub(r"(?m)^(mass|rotor_inertia) *=.*\n", "", DRIVE))
    status, _, err = tendon("firmware", "arm.toml", "--target", "host")
    assert status == 2
    (said,) = (line for line in err.splitlines() if not line.endswith("…"))
    assert said.startswith("drive: this needs numbers that the model file leaves out (joint 1: mass, rotor_inertia)")
    assert "tendon identify" in said
    assert sorted(p.name for p in source.path.parent.iterdir()) == ["arm.toml"]


def test_a_plan_asks_for_the_values_of_effects_by_name(sourced: Sourced, tendon: Run) -> None:
    """Before it is sought, since none of them is 0 for being unknown."""
    folder = sourced(DRIVE).path.parent
    ends = "".join(f"[points.{name}]\nq1 = {q}\nrest = true\n" for name, q in (("a", 0.0), ("b", 0.5)))
    (folder / "there.toml").write_text(
        'name = "there"\nmodel = "arm.toml"\ncycle_time = 1.0\nperiodic = false\n'
        f'{ends}[[phase]]\nfrom = "a"\nto = "b"\npart = 1.0\ndegree = 5\n'
    )
    status, _, err = tendon("optimize", "there.toml", "--out", "plan.json")
    assert status == 2
    (said,) = (line for line in err.splitlines() if not line.endswith("…"))
    assert said == (
        "drive: this needs values that the model file leaves out (coulomb_asymmetric@1: positive, negative; "
        "viscous@1: coefficient; viscous_cubic@1: coefficient); state them, or find them with tendon identify MODEL "
        "RECORDING --write"
    )
    assert not (folder / "plan.json").exists()
    assert tendon("optimize", "there.toml", "--no-friction", "--out", "plan.json")[0] == 0
