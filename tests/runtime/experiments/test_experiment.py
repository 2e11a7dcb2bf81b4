"""Experiments: pieces within the limits, separations that follow the physics, motions that do what they promise."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.cli import output
from runtime.diagnosis.ranking import rank
from runtime.diagnosis.stages import begin
from runtime.experiments import design
from runtime.experiments.asking import ExperimentError, parse_joints, parse_ranges, parse_rivals
from runtime.experiments.design import SimulatedDiagnosis, confirm, propose
from runtime.experiments.options import ExperimentSettings
from runtime.experiments.pieces import BROAD, Envelope, in_sequence, pieces
from runtime.experiments.selection import Freedom, Repertoire, TorqueLimit, peaks
from runtime.experiments.separation import MotionPieces, TrialArm, narrowed, stated
from runtime.model.loader import Model
from runtime.model.terms import Term, structure
from runtime.simulation.motion_file import read_motion
from runtime.simulation.options import SimulationSettings
from runtime.simulation.settings import MARGIN, RATE
from runtime.simulation.simulate import SimulationError, simulate
from runtime.workspace.source import Source
from tests.kept import kept
from tests.runtime.conftest import Run

DRIVE = Path(__file__).resolve().parents[3] / "symbolic" / "arms" / "drive.toml"
SMALL = "linear_spring@1:stiffness=0.4,rest=0,gravity:gx=1,gy=0"
"""Over the range of the ordinary excitation, these two are one."""


def _bench(model: Model, between: str) -> TrialArm:
    return TrialArm.of(model, parse_rivals(between, model), ExperimentSettings())


def _sine(hertz: float, size: float, seconds: float = 10.0) -> np.ndarray:
    return size * np.sin(2 * np.pi * hertz * np.arange(round(seconds * RATE)) / RATE)[None]


def _two_sines(size: float) -> np.ndarray:
    """Of one sine, the inertia's torque would be a spring's."""
    return 0.5 * (_sine(0.2, size, 20.0) + _sine(0.35, size, 20.0))


# --- what is asked ---


def test_commas_part_rivals_and_their_values(drive: Model) -> None:
    text = "elasticity@1:stiffness=3000,damping=2, torque_delay@1,gravity:gx=1"
    found = [(str(r.term), r.values) for r in parse_rivals(text, drive)]
    assert found == [
        ("elasticity@1", {"stiffness": 3000.0, "damping": 2.0}),
        ("torque_delay@1", {}),
        ("gravity", {"gx": 1.0}),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stribek@1", '--between stribek@1: there is no effect "stribek"'),
        ("stribeck@1,stribeck@1:speed=0.1", "stribeck@1 is named twice"),
        ("viscous@1", "drive has viscous@1 already"),
        ("stribeck@2", 'found joint "2", expected 1 to 1'),
        ("", "--between"),
    ],
)
def test_what_is_no_experiment_is_one_line(drive: Model, text: str, message: str) -> None:
    with pytest.raises(ExperimentError) as caught:
        parse_rivals(text, drive)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_verb_has_help_and_refuses_in_one_line(tendon: Run) -> None:
    status, out, _ = tendon("experiment", "--help")
    assert status == 0
    assert "Example: tendon experiment" in out
    for more in (("--between", "viscous@1"), ("--between", "stribeck@1", "--out", "nowhere/motion.csv")):
        status, out, err = tendon("experiment", DRIVE, *more)
        assert status == output.BAD_INPUT
        said = [line for line in err.splitlines() if not line.endswith("…")]  # progress
        assert (out, len(said)) == ("", 1)


def test_rivals_may_be_given_one_by_one(tendon: Run) -> None:
    """None of them is dropped: here both the first and the last are looked at."""
    twice = ("--between", "stribeck@1:speed=0.1", "--between", "elasticity@1", "--between", "stribeck@1")
    status, _, err = tendon("experiment", DRIVE, *twice)
    assert status == output.BAD_INPUT
    assert "stribeck@1 is named twice" in err


def test_without_noise_nothing_is_proposed(drive: Model) -> None:
    with pytest.raises(ExperimentError, match="give a noise above 0"):
        propose(drive, parse_rivals("stribeck@1", drive), ExperimentSettings(noise=0.0))


@pytest.mark.parametrize(("allowed", "ended", "made"), [({"budget": 1}, "budget", 1), ({"time_limit": 0.1}, "time", 0)])
def test_a_search_that_is_cut_says_so(drive: Model, allowed: dict[str, Any], ended: str, made: int) -> None:
    """Where not all diagnoses could be made, nothing is claimed."""
    proposal = propose(drive, parse_rivals("stribeck@1", drive), ExperimentSettings(**allowed))
    assert not proposal.separated
    assert f"the search was cut after {made} of 4 diagnoses; a longer one decides" in proposal.reason
    assert proposal.document().ordinary_trials == []
    assert (proposal.search.ended, proposal.search.iterations) == (ended, made)


@pytest.mark.parametrize(
    ("joints", "ranges", "message"),
    [
        ("2", [], "--joints 2: '2' is no joint of drive; it has 1 to 1"),
        (None, ["q1=1:0"], "--range q1=1:0: expected LOW below HIGH"),
        (None, ["q1=low:1"], "expected JOINT=LOW:HIGH in rad or m, as q2=-1:0.5"),
        (None, ["q1=nan:1"], "expected LOW below HIGH"),
        (None, ["q1=0:inf"], "expected LOW below HIGH"),
        (None, ["arm=0:1"], "'arm' is no joint of drive"),
    ],
)
def test_no_joint_and_no_range_is_one_line(joints: str | None, ranges: list[str], message: str, drive: Model) -> None:
    rivals = parse_rivals("stribeck@1", drive)
    with pytest.raises(ExperimentError) as caught:
        parse_ranges(ranges, drive) if joints is None else parse_joints(joints, drive, rivals)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_joints_that_rest_and_a_narrower_range(model: Model) -> None:
    """Of four joints two move, one within half a radian; a joint at which a rival shows must move."""
    rivals = parse_rivals("stribeck@2:torque=1,speed=0.1", model)
    moving, ranges = parse_joints("2,4", model, rivals), parse_ranges(["q2=-0.4:0.1"], model)
    assert (moving, ranges) == ([1, 3], {1: (-0.4, 0.1)})
    bench = TrialArm.of(narrowed(model, ranges), rivals, ExperimentSettings(), moving)
    found = Repertoire.of(bench, TorqueLimit.of(bench), Freedom())
    for path in (bench.ordinary_path, *(in_sequence([part], found.envelopes)[0] for part in found.parts)):
        assert (np.ptp(path[[0, 2]], axis=1) == 0).all()
        assert -0.4 <= path[1].min() < path[1].max() <= 0.1
    with pytest.raises(ExperimentError, match="stribeck@2 shows at joint 2 only"):
        parse_joints("1,4", model, rivals)


# --- pieces of motion ---


@settings(max_examples=15, deadline=None)
@given(
    reach=st.floats(0.2, 3.0),
    speed=st.floats(0.5, 6.0),
    middle=st.floats(-2.0, 2.0),
    ease=st.floats(0.3, 1.0),
    subject=st.sampled_from([[0], [1], [0, 1]]),
)
def test_pieces_keep_to_range_and_speed_from_rest_to_rest(
    reach: float, speed: float, middle: float, ease: float, subject: list[int]
) -> None:
    joints = [Envelope(middle, reach, speed, 1.0, 5.0), Envelope(-middle, 2 * reach, 0.5 * speed, 1.0, 5.0)]
    for piece in pieces(joints, subject, range(2), lambda: np.zeros((2, 100))):
        path, ((start, stop),) = in_sequence([piece.make(ease)], joints)
        assert path.shape[1] / RATE > stop > start
        for row, joint in zip(path, joints, strict=True):
            assert np.abs(row - joint.middle).max() <= joint.reach * (1 + 1e-9), piece.name
            assert np.abs(np.diff(row)).max() * RATE <= joint.speed * 1.001, piece.name
            assert row[[0, -1]] == pytest.approx(joint.middle, abs=1e-9), piece.name
        if len(subject) == 1 and "alone" in piece.name:
            assert np.ptp(path[1 - subject[0]]) == 0
    for piece in pieces(joints, [0], [0], lambda: np.zeros((2, 100))):
        assert np.ptp(piece.make(ease)[1]) == 0, piece.name


def test_stated_torque_limit_holds_for_all_rivals(tmp_path: Path) -> None:
    text = DRIVE.read_text().replace("gear_ratio = 100", "gear_ratio = 100\nlimits = {torque = 4.0}")
    (tmp_path / "weak.toml").write_text(text)
    bench = _bench(Source.read(tmp_path / "weak.toml", None).compiled.model(), "spring_hysteresis@1")
    limit = TorqueLimit.of(bench)
    found = Repertoire.of(bench, limit, Freedom())
    assert len(found.parts) > 5
    for part in found.parts:
        assert peaks(bench, in_sequence([part], found.envelopes)[0]).max() <= MARGIN * 4.0
    with pytest.raises(SimulationError, match="no motion keeps to the torque limits"):
        Repertoire.of(bench, TorqueLimit(0.01 * limit.largest), Freedom())


def test_a_delay_asks_for_no_more_torque(tmp_path: Path) -> None:
    bench = _bench(Source.read(DRIVE, None).compiled.model(), "torque_delay@1:time=0.05")
    plain, late = peaks(bench, bench.ordinary_path)
    assert late == pytest.approx(plain, rel=1e-6)
    most = 2.0 * plain.max()
    text = DRIVE.read_text().replace("gear_ratio = 100", f"gear_ratio = 100\nlimits = {{torque = {most}}}")
    (tmp_path / "weak.toml").write_text(text)
    bench = _bench(Source.read(tmp_path / "weak.toml", None).compiled.model(), "torque_delay@1:time=0.05")
    assert BROAD[0] in Repertoire.of(bench, TorqueLimit.of(bench), Freedom()).names


# --- separations ---


def test_known_values_are_stated_in_a_copy(drive: Model) -> None:
    _, values = simulate(drive, settings=SimulationSettings(seconds=10.0))
    known = stated(drive, values)
    assert structure(known) == values
    assert structure(drive) == {term: {} for term in values}


def test_a_spring_leaves_gravity_over_a_wide_range_only(drive: Model) -> None:
    bench = _bench(drive, SMALL)
    narrow, wide = (MotionPieces.of(bench, _two_sines(size)).weigh() for size in (0.4, 1.2))
    for pair in bench.pairs:
        # The cubic term of the sine: three times the angle, relative to the torque nine times.
        relative = [w[pair].rms / w[pair[0], None].rms for w in (narrow, wide)]
        assert 5 < relative[1] / relative[0] < 15


def test_a_special_case_is_explained_in_full_and_does_not_explain(drive: Model) -> None:
    bench = _bench(drive, "linear_spring@1:stiffness=2,rest=0.1,cable@1:c1=0,c2=1,c3=2,c4=0")
    found = MotionPieces.of(bench, _two_sines(0.9)).weigh()
    assert found[0, 1].rms < 1e-3 < 1 < found[1, 0].rms
    assert found[0, None].rms > 5


def test_an_elasticity_passes_for_inertia_at_one_frequency(drive: Model) -> None:
    bench = _bench(drive, "elasticity@1:stiffness=3000,damping=3")
    several = sum((_sine(f, 0.5 / f**2, 20.0) for f in (0.7, 2.0, 4.0, 8.0)), np.zeros((1, 20_000)))
    one, many = (MotionPieces.of(bench, path).weigh()[0, None].rms for path in (_sine(2.0, 0.25, 20.0), several))
    # What is left of one sine rings from its sudden start.
    assert many > max(1.0, 5 * one)


def test_pieces_add_up_to_the_motion(drive: Model) -> None:
    bench = _bench(drive, "stribeck@1,lugre@1")
    joints = [Envelope.of(joint) for joint in drive.joints]
    parts = [_sine(0.2, 0.5, 8.0), _sine(1.0, 0.2, 8.0)]
    path, spans = in_sequence(parts, joints)
    apart, whole = MotionPieces.of(bench, path, spans), MotionPieces.of(bench, path)
    for pair, separation in whole.weigh().items():
        # The pauses, where nothing moves, are in no piece; rounding of the band's rows at their edges remains.
        assert apart.weigh().get(pair).strength == pytest.approx(separation.strength, rel=0.02)  # type: ignore[union-attr]
    assert apart.weigh([0], 4)[0, 1].strength == pytest.approx(2 * apart.weigh([0])[0, 1].strength)


# --- what the diagnosis makes of it ---


@pytest.mark.parametrize(
    ("hidden", "named", "rivals", "problem"),
    [
        ("stribeck", ["stribeck"], [], None),
        ("stribeck", ["stribeck"], ["cable"], None),
        ("stribeck", ["stribeck"], ["lugre"], "stribeck@1 is named, but not told from lugre@1"),
        ("stribeck", ["stribeck", "lugre"], [], "stribeck@1 is named, but not told from lugre@1"),
        ("stribeck", ["lugre"], ["stribeck"], "with stribeck@1 hidden, lugre@1 is named"),
        ("stribeck", [], [], "with stribeck@1 hidden, nothing is named (clean)"),
        (None, [], [], None),
        (None, ["cable"], [], "with nothing hidden, cable@1 is named"),
    ],
)
def test_an_answer_is_right_if_it_rules_the_rival_out(
    hidden: str | None, named: list[str], rivals: list[str], problem: str | None
) -> None:
    answer = SimulatedDiagnosis(
        None if hidden is None else Term(hidden, 1),
        (Term("lugre", 1),),
        0,
        "clean",
        tuple(Term(t, 1) for t in named),
        tuple(Term(t, 1) for t in rivals),
    )
    assert (answer.problem, answer.right) == (problem, problem is None)


def test_one_oscillation_does_not_separate_what_two_radians_would(drive: Model) -> None:
    a, b = parse_rivals(SMALL, drive)
    answer = kept(confirm, TrialArm.of(drive, [a, b], ExperimentSettings(seed=3)), _two_sines(0.3), [3])
    assert not answer
    assert answer.problem


def test_a_transmission_is_known_by_all_the_joints_that_it_reaches(cache: Path) -> None:  # noqa: ARG001
    """The ordinary excitation meets the plate in one stretch only: held out, that stretch tells of nothing else. A soft
    joint beside it shakes the arm nearly alike."""
    bench = _bench(Source.read(Path("vishard4"), None).compiled.model(), "elasticity@2,torque_delay@2")
    trail = kept(begin, bench.model, [bench.record(bench.ordinary_path, bench.rivals[0], 2)])
    step = trail.last
    soft = [Term("elasticity", joint) for joint in (1, 2, 3, 4)]
    base = trail.last.base
    ranking = rank(base, [*soft, Term("stribeck", 2), Term("torque_scale", 2)], step.floors)
    assert ranking.best is not None
    assert ranking.best.term == soft[1]
    assert ranking.best.shape["stiffness"] == pytest.approx(bench.rivals[0].values["stiffness"], rel=0.1)


def test_the_proposed_motion_separates_where_the_ordinary_one_does_not(
    drive: Model, tendon: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(design, "propose", lambda model, rivals, settings, *_: kept(propose, model, rivals, settings))
    status, out, _ = tendon("experiment", DRIVE, "--between", SMALL, "--out", "motion.csv", "--json", "-")
    found = json.loads(out)
    assert (status, found["separated"], found["out"]) == (0, True, "motion.csv")
    assert any(not t["right"] for t in found["ordinary_trials"])
    assert {t["hidden"]["effect"] for t in found["trials"]} == {"linear_spring", "gravity"}
    assert all(s["after"] > 3 * s["before"] for s in found["separations"] if s["explained_by"])
    path = read_motion(Path("motion.csv"), drive.n)
    # read_motion leaves the last sample out.
    assert path.shape[1] == pytest.approx(found["motion"]["seconds"] * RATE, abs=1)
    (joint,) = found["motion"]["joints"]
    assert joint["position_limits"][0] < path.min()
    assert path.max() < joint["position_limits"][1]
    assert np.abs(np.diff(path)).max() * RATE < joint["speed_limit"]


@pytest.mark.slow
def test_where_no_motion_separates_it_says_what_would(drive: Model, tendon: Run) -> None:
    # Over a radian to either side, the polynomial is the sine.
    between = "gravity:gx=3,gy=0,cable@1:c1=2,c2=0,c3=1,c4=0"
    status, out, _ = tendon("experiment", DRIVE, "--between", between, "--out", "motion.csv")
    verdict = out.splitlines()[0]
    assert status == output.NO
    assert verdict.startswith("NOT SEPARATED: No motion within the limits was found: ")
    assert "not told from" in verdict
    assert "with twice the range" in verdict
    assert "twice the speed" not in verdict
    assert not Path("motion.csv").exists()
    found = Repertoire.of(_bench(drive, between), TorqueLimit.of(_bench(drive, between)), Freedom())
    assert not any(choice.enough for choice in found.choices())
