"""Further sensors, as the independent plant would have read them: they name, rule out, and are asked for."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.diagnosis.candidates import Candidate, FittedBase
from runtime.diagnosis.further_sensors import FurtherSensors, echo
from runtime.diagnosis.gates import LAG, RIGID, TURN, Gate, failed
from runtime.diagnosis.stages import diagnose
from runtime.diagnosis.verdict import Diagnosis
from runtime.identification.identify import identify
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.motion.band import rigid_inertia
from runtime.recordings.recording import Recording, RecordingError
from runtime.report import sensors
from runtime.report.diagnosed import document as diagnosed
from runtime.report.reasons import reason
from runtime.report.sensors import missing
from runtime.setting import SettingError
from runtime.simulation import simulate as simulation
from runtime.simulation.options import EXTRA, SimulationSettings
from tests import bank
from tests.judge.bodies import ARMS
from tests.judge.cases import Setting
from tests.judge.sensed import Sensed, pushing, sensed
from tests.kept import kept


def recorded(setting: Setting, *what: tuple[str, int, float], seed: int = 7) -> Sensed:
    return kept(sensed, setting, *what, seed=seed)


def named(found: Diagnosis) -> list[tuple[str, list[str]]]:
    return [(str(f.term), [str(r) for r in f.rivals]) for f in found.findings]


def doubts(model: Model, recording: Recording, *terms: Term) -> dict[str, str]:
    return kept(bank.doubts, model, [recording], terms)


ELASTICITY, DELAY = Term("elasticity", 1), Term("torque_delay", 1)


def spoken_of(found: Diagnosis) -> set[str]:
    """What is named, with its rivals."""
    return {name for term, rivals in named(found) for name in (term, *rivals)}


def test_a_link_side_encoder_tells_a_spring_from_a_gap() -> None:
    """One cosine shakes a spring much as it would a gap; the encoder sees a line or a dead zone. A gap may show in the
    torque, too, whose flanks are struck at instants of their own."""
    poor = Setting(excitation="one_cosine")
    made = recorded(poor, ("elasticity", 0, 1500.0))
    found = kept(diagnose, bank.model("judge1"), [made.plain])
    assert named(found)[0] == ("elasticity@1", [])
    assert named(kept(diagnose, bank.model("judge1"), [made.with_link]))[0] == ("elasticity@1", [])
    made = recorded(poor, ("backlash", 0, 3e-3))
    assert named(kept(diagnose, bank.model("judge1"), [made.plain]))[0][0] == "backlash@1"
    assert named(kept(diagnose, bank.model("judge1"), [made.with_link]))[0] == ("backlash@1", [])


def test_a_gap_without_width_is_a_spring() -> None:
    """A spring, whose link on flanks a hundredth of a milliradian apart moves alike: another integration of the same
    law is no evidence of a gap."""
    made = recorded(Setting(excitation="one_cosine"), ("elasticity", 0, 2400.0), seed=2)
    found = kept(diagnose, bank.model("judge1"), [made.plain])
    assert named(found)[0][0] == "elasticity@1"
    assert "backlash@1" not in spoken_of(found)


def test_a_spring_that_leaves_more_than_noise_rules_out_no_gap() -> None:
    """The blows in a wide gap follow from motion above the band: a soft spring comes as near as a simulation of them.
    The encoder shows the play, behind flanks so stiff that nothing tells them from rigid ones."""
    made = recorded(Setting(excitation="one_cosine"), ("backlash", 0, 4.8e-3), seed=2)
    found = kept(diagnose, bank.model("judge1"), [made.plain])
    assert "backlash@1" in spoken_of(found)
    assert "q1_link" in {x["signal"] for f in diagnosed(found).to_json()["findings"] for x in f["missing_signals"]}
    found = kept(diagnose, bank.model("judge1"), [made.with_link])
    assert named(found) == [("backlash@1", [])]
    low, high = diagnosed(found).to_json()["findings"][0]["parameters"]["gap"]["interval"]
    assert low < 4.8e-3 < high


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["one_cosine", "full"])
@pytest.mark.parametrize("seed", range(1, 7))
def test_a_spring_and_a_gap_never_rule_each_other_out_wrongly(seed: int, motion: str) -> None:
    """On the torque alone the true one is named, a rival, or what comes nearest where it explains less than half (a gap
    of which the flanks are heard above the band); with the link's encoder it is named, and first."""
    for effect, amount in (("elasticity", 1500.0), ("backlash", 3e-3)):
        made = recorded(Setting(excitation=motion), (effect, 0, (1.0, 0.6, 1.6)[seed % 3] * amount), seed=seed)
        plain = kept(diagnose, bank.model("judge1"), [made.plain])
        nearest = diagnosed(plain).to_json()["joints"][0]["reason"].partition(" comes nearest")[0]
        assert f"{effect}@1" in {*spoken_of(plain), nearest}, effect
        assert named(kept(diagnose, bank.model("judge1"), [made.with_link]))[0][0] == f"{effect}@1", effect


def test_a_link_side_encoder_says_whether_the_transmission_gives_way() -> None:
    """A delay and an elasticity without slow motion: each is ruled out where the other is the truth."""
    quick, shape = Setting(excitation="no_slow"), {"stiffness": 1500.0, "damping": 1.0}
    fitted = kept(identify, bank.model("judge1"), [recorded(quick, ("torque_delay", 0, 4e-3)).with_link])
    base = FittedBase(fitted)
    soft = Candidate(ELASTICITY, shape, 2, 0.0, np.inf)
    (closed,) = failed(FurtherSensors(base).results(base.system, soft, base.block(ELASTICITY, shape), np.ones(1)))
    assert closed.gate is LAG
    recording = recorded(quick, ("elasticity", 0, 1500.0)).with_link
    assert not doubts(bank.model("judge1"), recording, ELASTICITY, DELAY)["elasticity@1"]
    fitted = kept(identify, bank.model("judge1"), [recording])
    base = FittedBase(fitted)
    late, block = Candidate(DELAY, {}, 0, 0.0, np.inf), base.block(DELAY, {})
    parts = np.append(1.0, base.system.with_block(block).solution.coefficients[len(base.system.unknown) :])
    closed = failed(FurtherSensors(base).results(base.system, late, block, parts))
    assert RIGID in [result.gate for result in closed]


def test_a_link_side_encoder_finds_the_soft_joint() -> None:
    """Short strokes: what the soft joint 2 does to joint 1 looks like joint 1's own as well."""
    made = recorded(Setting(joints=2, excitation="small"), ("elasticity", 1, 600.0), seed=11)
    both = ELASTICITY, Term("elasticity", 2)
    without, known = (doubts(bank.model("judge2"), r, *both) for r in (made.plain, made.with_link))
    assert without == {"elasticity@1": "", "elasticity@2": ""}
    assert known["elasticity@1"].startswith("the link-side encoder does not show it")
    assert not known["elasticity@2"]


def test_an_output_sensor_tells_the_motor_side_from_the_link_side() -> None:
    """Slow strokes: a spring passes for friction of either direction. Full motion: friction of a place for a stop."""
    arm, bent, spring = bank.model("judge1"), Term("viscous_asymmetric", 1), Term("linear_spring", 1)
    pulls = recorded(Setting(excitation="slow"), ("linear_spring", 0, 0.6))
    assert doubts(arm, pulls.plain, bent, spring) == {
        "linear_spring@1": "",
        "viscous_asymmetric@1": "",
    }
    found = doubts(arm, pulls.with_output, bent, spring)
    assert not found["linear_spring@1"]
    assert found["viscous_asymmetric@1"].startswith("the torque sensor at the output feels it")
    patch, stop = Term("friction_patch", 1), Term("end_stop", 1)
    rubs = recorded(Setting(), ("friction_patch", 0, 0.5))
    assert not doubts(arm, rubs.plain, stop)["end_stop@1"]
    found = doubts(arm, rubs.with_output, patch, stop)
    assert not found["friction_patch@1"]
    assert "does not feel it" in found["end_stop@1"]


def test_the_users_own_rigid_torque_replaces_an_arm_that_the_file_cannot_say() -> None:
    """Gravity acts and the file has none, nor could it have; only the friction of joint 2 is missing."""
    made = recorded(Setting(joints=2), ("gravity", 0, 9.81), ("stribeck", 1, 0.5))
    found = kept(diagnose, bank.model("judge2"), [made.with_rigid])
    assert named(found) == [("stribeck@2", [])]
    assert found.findings[0].share() > 0.9
    assert reason(found).startswith("the model lacks stribeck")
    assert {p["fit"] for p in diagnosed(found).to_json()["parameters"]} == {None}
    last = found.steps[-1].fit
    assert np.array_equal(last.prediction.lumps, bank.model("judge2").lump_values)
    torque = last.inference.values[Term("stribeck", 2)]["torque"]
    assert torque.interval is not None
    assert torque.interval[0] < 0.5 < torque.interval[1]
    with pytest.raises(RecordingError, match=r"judge\.csv: has no tau1_rigid"):
        kept(diagnose, bank.model("judge2"), [made.with_rigid], [made.plain])


def test_a_measured_force_is_no_residual() -> None:
    """A hand that pushes the end-effector: unknown it is named as something, known it is not."""
    made = recorded(Setting(), ("push", 0, 4.0))
    torque, length, q = pushing(made.plain.t, 4.0), ARMS[1][0].length, made.link[0]
    # Across the link, on the arm: its torque about the joint is length times the force.
    force = torque / length * np.array([-np.sin(q), np.cos(q)])
    without = kept(diagnose, bank.model("judge1"), [made.plain])
    known = kept(diagnose, bank.model("judge1"), [replace(made.plain, force=force)])
    assert without.verdict != "clean"
    assert known.verdict == "clean"
    assert known.steps[0].fitted.rms[0] < 0.1 * without.steps[0].fitted.rms[0]


def test_signals_that_would_tell_rivals_apart() -> None:
    made = recorded(Setting(temperature=False))
    motion = kept(identify, bank.model("judge1"), [made.plain]).motion

    def columns(one: str, other: str) -> list[tuple[str, ...]]:
        return [m.columns for m in missing(bank.model("judge1"), motion, Term(one, 1), [Term(other, 1)])]

    assert columns("elasticity", "torque_delay") == [("q1_link",), ("tau1_link",)]
    assert columns("elasticity", "backlash") == [("q1_link",)]
    assert columns("stribeck", "thermal_friction") == [("temperature1",)]
    assert columns("end_stop", "stribeck") == [("tau1_link",)]
    assert columns("stribeck", "viscous_power") == []
    (weight,) = missing(bank.model("judge1"), motion, Term("payload"), [Term("gravity")])
    assert weight.sentence() == "fx and fy (the force on the end-effector) would tell it from gravity"


def test_what_a_simulation_records_is_what_it_hides(drive: Model) -> None:
    """The deflection carries the torque of the output sensor: T = k delta + d delta_d."""
    hidden = simulation.parse_hidden("elasticity@1:stiffness=1500,damping=1", drive)
    made, _ = simulation.simulate(drive, [hidden], SimulationSettings(noise=0.0, signals=",".join(EXTRA)))
    assert made.q_link is not None
    assert made.tau_link is not None
    assert made.temperature[0] is not None
    assert made.q_desired is not None
    deflection = made.q_desired - made.q_link
    carried = 1500.0 * deflection + np.gradient(deflection, 1e-3, axis=1)
    step = simulation.COUNT["revolute"]
    # The link's count makes 1500 and, through the damping, a thousand times half a count.
    assert np.abs(carried - made.tau_link).max() < 0.01 * np.abs(made.tau_link).max() + 2500 * step
    with pytest.raises(SettingError, match='found "q1_link", expected some of q_link'):
        SimulationSettings(signals="q1_link")


@given(part=st.floats(-2.0, 2.0), seed=st.integers(0, 2**16))
def test_an_echo_is_within_its_error(part: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    torque = rng.standard_normal(2000)
    found = echo(torque, part * torque + 0.5 * rng.standard_normal(2000))
    assert found is not None
    # Six standard errors of ten stretches' estimate of them.
    assert abs(found.part - part) < 6 * max(found.spread, 0.5 / np.sqrt(2000))


def test_a_rigid_torque_without_rotors_leaves_them_to_be_fitted() -> None:
    """The user's own model knows gravity, which the file has not, and no rotor."""
    made = recorded(Setting(), ("gravity", 0, 9.81))
    whole = made.with_rigid
    assert whole.tau_rigid is not None
    rotor = ARMS[1][0].rotor
    acceleration = np.gradient(np.gradient(made.q, made.plain.t, axis=1), made.plain.t, axis=1)
    bare = replace(whole, tau_rigid=whole.tau_rigid - rotor * acceleration)
    for recording, lacking in ((whole, 0.0), (bare, rotor)):
        found = kept(diagnose, bank.model("judge1"), [recording])
        assert found.verdict == "clean"
        (entry,) = diagnosed(found).to_json()["rotors"]
        assert entry["fit"] == pytest.approx(lacking, abs=2e-3)
        assert entry["interval"][0] < lacking < entry["interval"][1]


def test_a_rigid_torque_of_its_own_leaves_no_effect_of_the_files_geometry() -> None:
    fitted = kept(identify, bank.model("judge1"), [recorded(Setting()).with_rigid])
    terms = {t.effect for t in FittedBase(fitted).terms()}
    assert not terms & {"gravity", "payload", "elasticity", "backlash"}
    assert {"load_friction", "torque_ripple", "lugre"} <= terms


def test_no_gravity_is_in_the_inertia_of_a_rigid_torque() -> None:
    """Slow motion under gravity: 60 N m of posture beside 2 of acceleration."""
    t = np.arange(20_000) / 1000
    omegas = 2 * np.pi * np.array([0.2, 0.33, 0.71])
    q = np.sum([np.sin(w * t + k) / w for k, w in enumerate(omegas)], axis=0)[None]
    qdd = np.sum([-w * np.sin(w * t + k) for k, w in enumerate(omegas)], axis=0)[None]
    plain = recorded(Setting()).plain
    slow = replace(plain, t=t, run=np.zeros(len(t), dtype=np.int64), q=q, tau=0 * q, segments=(slice(0, len(t)),))
    inertia = rigid_inertia([replace(slow, tau_rigid=0.4 * qdd + 60 * np.sin(q + 0.3))])
    assert inertia == pytest.approx(0.4, rel=0.01)


def test_what_sensors_were_worth() -> None:
    """What a sensor alone rules out, what it speaks against beside the torque, and that it changed nothing."""

    def weighed(effect: str, *closed: Gate) -> Candidate:
        results = tuple(gate.asked(np.inf if gate.opens == "below" else -np.inf) for gate in closed)
        return Candidate(Term(effect, 1), {}, 0, 1.0, np.inf, results=results)

    measured = SimpleNamespace(n=2, has=lambda name, joint: (name, joint) in (("twist", 0), ("tau_link", 1)))
    named = weighed("elasticity")
    everything = [
        named,
        weighed("cable", LAG),
        weighed("linear_spring", TURN, RIGID),
        weighed("viscous_cubic", TURN),
        weighed("friction_patch"),
    ]
    link, output = sensors.of(measured, everything, [named])  # type: ignore[arg-type]
    assert (link.columns, output.columns) == (("q1_link",), ("tau2_link",))
    assert (link.decided, link.against) == ((Term("cable", 1),), (Term("linear_spring", 1),))
    assert str(link) == "q1_link: alone rules out cable@1; speaks with the torque against linear_spring@1"
    assert str(output) == "tau2_link: changed nothing: without it the same would have been found"
