"""Noise compensation knows its limits: a guessed inertia, a coarse encoder, a link without inertia."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.diagnosis.stages import conclude, diagnose
from runtime.diagnosis.steps import Trail
from runtime.identification.identify import fit_document, identify, prepared, unsound
from runtime.model.loader import Model
from runtime.motion.band import credible_inertia
from runtime.motion.motion import prepare
from runtime.recordings.recording import Recording, RecordingError
from runtime.report.reasons import reason
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import simulate
from runtime.workspace.source import Source
from tests.kept import kept
from tests.runtime.conftest import ROOT

DRIVE = (ROOT / "symbolic" / "arms" / "drive.toml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def coarse(drive: Model) -> Recording:
    """Positions in steps of 0.01 rad: below 8 Hz alone they tell an acceleration."""
    run = simulate(drive, settings=SimulationSettings(seconds=30.0, seed=3))[0]
    return replace(run, q=1e-2 * np.round(run.q / 1e-2))


def arm(folder: Path, inertia: float, rotor: float, effects: str = "") -> Model:
    """The drive with other inertias in its file."""
    text = DRIVE.replace("rotor_inertia = 0.10 ", f"rotor_inertia = {rotor} ")
    text = text.replace("inertia = 0.0565 ", f"inertia = {inertia} ").replace("mass = 2.0 ", "mass = 1e-6 ")
    path = folder / "drive.toml"
    path.write_text(text + effects, encoding="utf-8")
    return Source.read(path, None).compiled.model()


def test_a_guessed_inertia_does_not_choose_the_band(tmp_path: Path, coarse: Recording) -> None:
    """One a thousandth of the true one lets the encoder's noise in, which then passes for a motion without inertia."""
    found = kept(identify, arm(tmp_path, 1.4e-4, 1e-4), [coarse])
    assert found.motion.band.cutoff == pytest.approx(8.0)
    assert found.inference.lumps[0].value == pytest.approx(0.2365, rel=0.02)
    assert unsound(found) == {}


def test_an_inertia_that_is_nearly_right_chooses_it(coarse: Recording) -> None:
    assert credible_inertia(np.array([np.nan]), [coarse]) == pytest.approx([0.2365], rel=0.5)
    assert credible_inertia(np.array([0.2]), [coarse]) == pytest.approx([0.2])
    still = replace(coarse, q=1e-4 * np.random.default_rng(0).standard_normal(coarse.q.shape))
    assert credible_inertia(np.array([1e-9]), [still]) == pytest.approx([1e-9])


def test_a_fit_that_compensation_has_spoilt_is_refused(drive: Model, coarse: Recording) -> None:
    """In a band of 50 Hz most of the accelerations is noise: neither clean nor an effect."""
    band = replace(prepared(drive, [coarse]).band, cutoffs=np.array([50.0]))
    found = conclude(Trail.begun(drive, prepare([coarse], band, drive), None, ["coarse.csv"]))
    assert (found.verdict, found.decisive.why) == ("refused", "unsound fit")
    failed = unsound(found.found.first.fit)[0]
    assert (failed.check, failed.joint) == ("worse than none", 0)
    assert failed.value > 1
    assert f"joint 1: the fit is worse than no model (error {100 * failed.value:.0f} %)" in reason(found)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_sound_fit_is_not(drive: Model, seed: int) -> None:
    run = simulate(drive, settings=SimulationSettings(seconds=20.0, seed=seed))[0]
    assert unsound(kept(identify, drive, [run])) == {}


def test_a_link_without_inertia_warns_of_nothing(tmp_path: Path) -> None:
    """Its elasticity has no torque, and where noise turns the inertia's sign none that is a number."""
    model = arm(tmp_path, 1e-6, 0.2365)
    run, _ = simulate(model, settings=SimulationSettings(seconds=20.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert kept(diagnose, model, [run]).verdict == "clean"
        believed = arm(tmp_path, 1e-6, 0.2365, "[joint.effects.elasticity]\n")
        fit_document(kept(identify, believed, [run])).to_json()


def test_an_effect_that_cannot_be_placed_is_one_line(tmp_path: Path, drive: Model) -> None:
    """Without dry friction, no data give its bristles a stiffness."""
    run, _ = simulate(drive, settings=SimulationSettings(seconds=20.0))
    path = tmp_path / "drive.toml"
    path.write_text(DRIVE.split("[joint.effects.")[0] + "[joint.effects.lugre]\n", encoding="utf-8")
    with pytest.raises(RecordingError, match=r"lugre@1 cannot be placed: .* no scale"):
        kept(identify, Source.read(path, None).compiled.model(), [run])


@pytest.mark.parametrize("rate", [300.0, 700.0])
def test_columns_that_overflow_are_left_out(drive: Model, rate: float) -> None:
    """Weak transmissions along a motion at a low rate, and rates that divide no millisecond."""
    run, _ = simulate(drive, settings=SimulationSettings(seconds=30.0, seed=3))
    t = np.arange(0.0, run.t[-1], 1 / rate)
    q, tau = (np.interp(t, run.t, x[0])[None] for x in (run.q, run.tau))
    plain = Recording(
        run.path,
        np.round(t, 3),
        np.zeros(len(t), dtype=np.int64),
        q,
        tau,
        run.types,
        segments=(slice(0, len(t)),),
        temperature=(None,),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        limits = kept(diagnose, drive, [plain]).seen
    assert np.isfinite([limit.value for limit in limits]).all()
