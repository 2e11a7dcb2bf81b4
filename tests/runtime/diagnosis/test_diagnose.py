"""Naming the missing effect: on recordings of others, on plants written apart from the library, and silence."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from runtime.diagnosis.stages import diagnose
from runtime.diagnosis.verdict import Diagnosis
from runtime.identification.identify import prepared
from runtime.loop.improve import improve
from runtime.model.loader import Model
from runtime.motion import repeats
from runtime.recordings import recording
from runtime.recordings.columns import RecordedArm
from runtime.recordings.recording import Recording
from runtime.report.diagnosed import document as diagnosed
from runtime.report.diagnosed import improved
from runtime.report.reasons import reason
from runtime.simulation import simulate
from runtime.simulation.options import SimulationSettings
from runtime.workspace.source import Source
from tests.kept import kept
from tests.runtime.conftest import ROOT, SHARED, recorded
from tests.variants import slow

Shared = Callable[[str, Model], Recording]


def named(diagnosis: Diagnosis) -> list[str]:
    return [str(f.term) for f in diagnosis.findings]


def shared_model(name: str) -> Model:
    path = SHARED / "hidden" / name
    if not path.exists():
        pytest.skip(f"hidden/{name} is not here: the folder shared/data is not part of the project")
    return Source.read(path, None).compiled.model()


@pytest.mark.parametrize(
    ("recording", "model", "truth"),
    [
        ("a", "drive1.toml", []),
        ("b", "drive1.toml", ["stribeck@1"]),
        ("c", "drive1.toml", ["elasticity@1"]),
        ("f", "arm2.toml", ["load_friction@2"]),
    ],
)
def test_recordings_of_another_simulator(recording: str, model: str, truth: list[str], shared: Shared) -> None:
    loaded = shared_model(model)
    found = kept(diagnose, loaded, [shared(f"hidden/recording_{recording}.csv.gz", loaded)])
    assert named(found) == truth
    assert found.verdict == ("effect" if truth else "clean")
    assert found.seen
    # "never a traceback, plain JSON": what the command prints can be read back without loss.
    assert json.loads(json.dumps(diagnosed(found).to_json(), allow_nan=False)) == diagnosed(found).to_json()


def test_a_disturbance_from_outside_is_not_physics(shared: Shared) -> None:
    loaded = shared_model("drive1.toml")
    found = kept(diagnose, loaded, [shared("hidden/recording_e.csv.gz", loaded)])
    assert found.verdict == "unexplained"
    assert "3.7" in reason(found)


def with_a_stop(model: Model, beyond: float, brushed: float, stiffness: float, seed: int) -> Recording:
    """A drive that goes `beyond` a stop at 1 rad once, near 21.5 s, and so far that it brushes it at 12.8 s."""
    t = np.arange(0.0, 30.0, 0.001)
    way = 0.5 * np.sin(2.1 * t) + 0.3 * np.sin(5.3 * t + 1.0) + 0.2 * np.sin(9.7 * t)
    once, before = (np.exp(-(((t - at) / 0.4) ** 2)) for at in (21.5, 12.8))
    near = np.abs(t - 12.8) < 1.0

    def short_of(amount: float) -> float:
        return float((way + amount * before)[near].max()) - 1.0 - brushed

    made, _ = simulate.simulate(
        model, [], SimulationSettings(seed=seed), (way + beyond * once + brentq(short_of, 0.0, 1.0) * before)[None]
    )
    return replace(made, tau=made.tau + stiffness * np.maximum(made.q - 1.0, 0.0))


def test_what_happened_once_is_decided_by_a_second_recording(drive: Model) -> None:
    """A stop that was touched for half a second explains nothing of the stretches beside it."""
    first, second = (with_a_stop(drive, 0.4, -0.1, 1.4, seed) for seed in (1, 2))
    once = kept(diagnose, drive, [first])
    assert once.verdict == "unexplained"
    assert "end_stop@1 is not named: it acts in 1.1 of 40 stretches" in reason(once)
    assert reason(once).endswith("give that as --held-out")
    assert named(kept(diagnose, drive, [first], [second])) == ["end_stop@1"]


def test_a_stop_inside_the_limits_of_the_file_is_said(tmp_path: Path) -> None:
    """At 1 rad, where the file lets the joint go to 3; where the file ends at 1.05, the stop is that limit."""
    text = (ROOT / "symbolic" / "arms" / "drive.toml").read_text()
    for limit, said in ((3.0, True), (1.05, False)):
        path = tmp_path / f"limit{limit}.toml"
        path.write_text(text.replace("[joint.link]", f"[joint.limits]\nposition = [-2, {limit}]\n[joint.link]"))
        model = Source.read(path, None).compiled.model()
        found = kept(diagnose, model, [with_a_stop(model, 0.5, 0.003, 10.0, 1)])
        assert named(found) == ["end_stop@1"]
        assert ("rad, inside the limits of the file, -2 to 3 rad" in reason(found)) is said


def test_noise_of_a_stop_that_is_only_brushed_does_not_speak_against_it(drive: Model) -> None:
    """By 3 mrad at one time: what that says of its stiffness is nothing beside what the other says."""
    found = kept(diagnose, drive, [with_a_stop(drive, 0.5, 0.003, 10.0, 1)])
    assert named(found) == ["end_stop@1"]
    values = found.steps[-1].fit.inference.values[found.findings[0].term]
    assert values["stiffness"].value == pytest.approx(10.0, rel=0.02)
    assert values["position"].value == pytest.approx(1.0, abs=0.005)


@pytest.mark.parametrize(
    "hidden", ["parallel_spring", "viscous_asymmetric", *(slow(x) for x in ("torque_ripple", "lugre"))]
)
def test_effects_of_an_independent_plant(hidden: str, drive: Model) -> None:
    found = kept(diagnose, drive, [recorded(hidden, 11)])
    assert named(found) == [f"{hidden}@1"]
    finding = found.findings[0]
    assert finding.share() > 0.8
    assert finding.fitted.rms[0] < 1.15 * finding.joints[0].floor.spectrum


def test_an_effect_that_a_later_one_contains_is_no_finding_beside_it(tmp_path: Path) -> None:
    """A gap with a spring behind it, seen on the link: elasticity is found first, and backlash takes its place."""
    drive = Source.shipped("drive").compiled.model()
    hidden = [simulate.parse_hidden("backlash@1", drive)]
    made, present = simulate.simulate(drive, hidden, SimulationSettings(seconds=20.0, signals="q_link"))
    recording.write(tmp_path / "run.csv", made)
    found = kept(diagnose, drive, [recording.read(tmp_path / "run.csv", RecordedArm.without_model(drive.n))])
    assert named(found) == ["backlash@1"]
    assert [str(s.added) for s in found.steps[1:]] == ["backlash@1"]
    (finding,) = found.findings
    gap = finding.fit.inference.values[finding.term]["gap"]
    assert gap.value == pytest.approx(present[finding.term]["gap"], rel=0.05)


@pytest.mark.parametrize("seed", [21, slow(22), slow(23)])
def test_silence_where_nothing_is_hidden(seed: int, drive: Model) -> None:
    found = kept(diagnose, drive, [recorded(None, seed)])
    assert found.verdict == "clean"
    assert not found.findings


def test_a_contradicted_inertia_is_said_first(drive: Model) -> None:
    """The commonest error of all is a wrong number in the model file."""
    loaded = drive
    text = (ROOT / "symbolic" / "arms" / "drive.toml").read_text()
    source = Source.shipped("drive")
    wrong = source.with_text(text.replace("mass = 2.0", "mass = 6.0")).compiled.model()
    assert wrong.lump_values[0] > loaded.lump_values[0] * 1.3
    found = kept(diagnose, wrong, [recorded(None, 21)])
    assert reason(found).startswith("check the model file first: J1 is")
    assert found.verdict == "clean"


def test_a_value_that_is_a_little_wrong_is_said_once_and_last(drive: Model) -> None:
    text = (ROOT / "symbolic" / "arms" / "drive.toml").read_text()
    wrong = Source.shipped("drive").with_text(text.replace("mass = 2.0", "mass = 3.0")).compiled.model()
    assert drive.lump_values[0] * 1.12 < wrong.lump_values[0] < drive.lump_values[0] * 1.25
    said = reason(kept(diagnose, wrong, [recorded(None, 21)]))
    assert said.startswith("the residual is noise")
    assert "; the model file is a little off, too: J1 is " in said
    assert said.count("J1") == 1


def test_repeated_motion_is_found(drive: Model) -> None:
    """The plant makes its motion twice; every stretch pairs with the one a period later."""
    recording = recorded("linear_spring", 3)
    motion = prepared(drive, [recording])
    found = repeats.find(motion)[0]
    assert found.seconds > 15
    lags = {round(float(motion.row_time(0)[p.second[0]] - motion.row_time(0)[p.first[0]]), 1) for p in found.pairs}
    assert any(abs(lag - recording.t[-1] / 2) < 1.0 for lag in lags)


def test_emps_from_the_base_model_to_the_floor(emps: Model, shared: Shared) -> None:
    """The error falls on both files at every step; nothing is claimed that explains nothing there."""
    fitted, held = (shared(f"emps/{name}.csv.gz", emps) for name in ("identification", "validation"))
    source = Source.shipped("emps")
    result = kept(improve, source, [fitted], [held])
    history = improved(result).to_json()["history"]
    added = [step["added"] for step in history]
    # Friction that grows less than the speed does has two laws here, of which neither is likelier by much.
    assert "viscous_asymmetric@1" in added[1:3]
    assert {"viscous_power@1", "velocity_strengthening@1"} & set(added[1:3])
    for key in ("relative", "held_out_relative"):
        errors = [step[key][0] for step in history]
        assert errors == sorted(errors, reverse=True)
    assert history[-1]["relative"][0] < 0.025
    assert history[-1]["held_out_relative"][0] < 0.03
    assert not {"load_friction@1", "thermal_friction@1"} & set(added)
    refitted = kept(diagnose, source.with_text(result.model_text).compiled.model(), [fitted], [held])
    assert named(refitted) == []


@pytest.mark.parametrize("width", [0.01, slow(0.003)])
def test_what_no_sensor_of_torque_resolves_is_not_named(width: float) -> None:
    """Friction rounded by a hyperbolic tangent, without noise: of any error, however small, some law explains most."""
    t = np.arange(0.0, 20.0, 1e-3)
    q, qd, qdd = np.zeros((3, len(t)))
    for frequency, speed in ((0.7, 1.2), (1.9, 0.9), (4.3, 0.4)):
        q += speed / frequency * np.sin(frequency * t)
        qd += speed * np.cos(frequency * t)
        qdd -= speed * frequency * np.sin(frequency * t)
    tau = 0.3 * qdd + 0.6 * np.tanh(qd / width) + 0.2 * qd
    whole = np.zeros(len(t), dtype=np.int64)
    run = Recording(Path("run.csv"), t, whole, q[None], tau[None], ("revolute",), (slice(0, len(t)),), (None,))
    result = improve(Source.shipped("drive"), [run])
    assert (named(result.found), [v.verdict for v in result.left.joints]) == ([], ["clean"])
    assert "less than the 0.1 % of the torque that could be named" in reason(result.left)


def test_the_improved_file_is_the_file_that_was_fitted(tmp_path: Path) -> None:
    source = Source.shipped("drive")
    result = kept(improve, source, [recorded("linear_spring", 3)])
    assert named(result.found) == named(kept(diagnose, source.compiled.model(), [recorded("linear_spring", 3)]))
    path = tmp_path / "better.toml"
    path.write_text(result.model_text)
    again = kept(diagnose, Source.read(path, None).compiled.model(), [recorded("linear_spring", 4)])
    assert named(again) == []
    assert again.steps[0].fitted.rms[0] < 1.3 * result.steps[-1].fitted.rms[0]


ROD = "{ length = 0.3, mass = 0.4, com = [0.15, 0], inertia = 0.003 }, effects = { coulomb = {}, viscous = {} }"
ROD = f'name = "rod"\ngravity = [0, 0]\njoint = [{{ type="revolute", gear_ratio=1, rotor_inertia=0, link={ROD} }}]'


def swung(stiffness: float, seed: int) -> Recording:
    """About hanging down, by little: a weight that restores it is a spring."""
    rng, t, whole = np.random.default_rng(seed), np.arange(4000) / 200, np.zeros(4000, dtype=np.int64)
    w = 2 * np.pi * np.array([[0.11], [0.37], [1.3]]) * rng.uniform(0.8, 1.2, (3, 1))
    waves = np.array([[0.12], [0.08], [0.03]]) * np.exp(1j * (w * t + rng.uniform(0, 6, (3, 1))))
    q, qd, qdd = (np.sum(waves * (1j * w) ** k, axis=0).imag for k in range(3))
    tau = 0.022 * qdd + 0.1 * qd + 0.2 * np.sign(qd) + stiffness * np.sin(q) + 0.01 * rng.standard_normal(4000)
    return Recording(Path("run.csv"), t, whole, q[None], tau[None], ("revolute",), (slice(0, len(t)),), (None,))


@pytest.mark.parametrize(("stiffness", "first"), [(0.4 * 0.15 * 9.81, "gravity"), (0.3, "linear_spring")])
def test_weight_of_the_size_that_masses_predict_is_named_before_a_spring(stiffness: float, first: str) -> None:
    model = Source.shipped("drive").with_text(ROD).compiled.model()
    found = diagnose(model, [swung(stiffness, 1)], [swung(stiffness, 2)]).findings[0]
    assert found.term.effect == first
    assert {"gravity", "linear_spring"} <= {t.effect for t in (found.term, *found.rivals)}
