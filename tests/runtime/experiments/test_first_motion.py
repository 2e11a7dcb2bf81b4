"""The first motion of an arm: what it tells, and that no possible arm leaves its limits along it."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.cli import output
from runtime.experiments.clearance import Clearance
from runtime.experiments.excitation import ExcitationSearch, NoRoom
from runtime.experiments.first import derivatives
from runtime.experiments.first_proposal import ArmToMove, FirstProposal, propose_first
from runtime.experiments.fourier import FourierMotion, harmonics_of
from runtime.experiments.information import InstantOutputs
from runtime.experiments.options import ExperimentSettings, FirstMotionSettings
from runtime.experiments.pieces import Envelope
from runtime.experiments.possible_arms import PossibleArms
from runtime.experiments.scene import Scene
from runtime.progress import on_cores
from runtime.simulation.motion_file import read_motion
from runtime.simulation.simulate import torque_along
from runtime.workspace.source import Source
from tests.runtime.conftest import Run

pytestmark = pytest.mark.xdist_group("first motion")
ROOMY = Envelope(middle=0.2, reach=1.0, speed=2.0, scale=1.0, acceleration=6.0)


@cache
def _proposed(name: str, **chosen: float) -> FirstProposal:
    """A motion of a minute, as good as it gets in some iterations."""
    source = Source.shipped(name)
    likely, assumed = source.compiled.with_likely_numbers()
    to_move = ArmToMove(source.compiled.model(), likely.model(), likely.arm, assumed, NoRoom(), ["collisions"])
    return propose_first(to_move, ExperimentSettings(budget=200), FirstMotionSettings(**{"seconds": 60.0, **chosen}))


# --- Fourier motions ---


@settings(max_examples=20, deadline=None)
@given(period=st.floats(4.0, 20.0), fastest=st.floats(0.5, 3.0), seed=st.integers(0, 100))
def test_a_period_begins_at_rest_and_comes_back(period: float, fastest: float, seed: int) -> None:
    series = FourierMotion([ROOMY, ROOMY], (0, 1), period, harmonics_of(period, fastest))
    x = series.random(np.random.default_rng(seed))
    q, qd, qdd = series.shape(x, np.array([0.0, period]))
    assert q[:, 0] == pytest.approx(q[:, 1], abs=1e-9)
    assert np.abs(qd[:, 0]).max() < 1e-9 * np.abs(x).max() + 1e-12
    assert np.abs(qdd[:, 0]).max() < 1e-8
    # Rates and accelerations are those of the positions.
    t, h = np.linspace(0.1, period - 0.1, 7), 1e-4
    (before, _, _), (after, _, _) = series.shape(x, t - h), series.shape(x, t + h)
    now, rate, acceleration = series.shape(x, t)
    assert (after - before) / (2 * h) == pytest.approx(rate, abs=1e-5)
    assert (after - 2 * now + before) / h**2 == pytest.approx(acceleration, abs=1e-4)


def test_a_joint_that_rests_does_not_move() -> None:
    series = FourierMotion([ROOMY, ROOMY], (1,), 5.0, harmonics_of(5.0, 2.0))
    q, _, _ = series.shape(series.random(np.random.default_rng(0)), np.linspace(0, 5, 50))
    assert (q[0] == ROOMY.middle).all()
    assert np.ptp(q[1]) > 0.1


# --- information ---


@pytest.mark.parametrize("name", ["drive", "vishard4"])
def test_gradients_are_those_of_the_information_and_of_all_limits(name: str) -> None:
    """Along random directions, by central differences; beyond the limits, too."""
    limits = _proposed(name).ready.limits
    n = limits.information.arms.model.n
    series = FourierMotion(limits.envelopes, tuple(range(n)), 5.0, harmonics_of(5.0, 2.0))
    t = np.arange(100) * 0.05
    information = replace(limits.information, count=100)
    search = ExcitationSearch(information, series, NoRoom(), t, 60.0, torque=limits.torque, tip_speed=limits.tip_speed)
    rng, h = np.random.default_rng(3), 1e-6
    for size in (0.3, 3.0):
        x = size * series.random(rng).ravel()
        along = rng.standard_normal(x.shape)
        _, gradient = search._loss(x, 1e3)
        slope = (search._loss(x + h * along, 1e3)[0] - search._loss(x - h * along, 1e3)[0]) / (2 * h)
        assert gradient @ along == pytest.approx(slope, rel=1e-5, abs=1e-4)


def test_the_columns_are_the_regressor_and_the_torque_is_that_of_a_simulation() -> None:
    """Two routes: CasADi's columns, and the generated C with the effects of identification, away from reversals."""
    information = _proposed("ur10").ready.limits.information
    arms, N = information.arms, information.count
    rng = np.random.default_rng(0)
    q, qd, qdd = rng.uniform(-1, 1, (3, 6, N))
    qd = np.sign(qd) * (0.2 + np.abs(qd))
    made = information.outputs(q, qd, qdd)
    assert made.Y.transpose(1, 2, 0) == pytest.approx(arms.model.regressor(q, qd, qdd), abs=1e-9)
    tau = torque_along(arms.model, q, qd, qdd, 100.0, arms.values)
    assert np.abs(made.tau.T - tau).max() < 1e-6
    zero = InstantOutputs(np.zeros_like(made.Y), np.zeros_like(made.E), np.zeros_like(made.tau), np.zeros(N))
    assert all((part == 0).all() for part in information.slopes(q, qd, qdd, zero))


def test_information_grows_with_time_and_falls_with_noise() -> None:
    information = _proposed("drive").ready.limits.information
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 1, information.count))
    made = information.outputs(q, qd, qdd)
    once, twice = (information.nats(made, seconds)[0] for seconds in (10.0, 20.0))
    loud = replace(information, noise=np.sqrt(2) * information.noise).nats(made, 20.0)[0]
    assert twice > once > 0
    assert loud == pytest.approx(once, rel=1e-9)


# --- the motion ---


@pytest.mark.parametrize("name", ["vishard4", "ur10", pytest.param("panda", marks=pytest.mark.slow)])
def test_no_possible_arm_leaves_its_limits(name: str) -> None:
    """1,000 arms drawn anew, in the torque that the generated C computes along the whole motion, at its own rate."""
    found = _proposed(name)
    information, path = found.ready.limits.information, found.first.path
    old = information.arms
    arms = PossibleArms.of(old.model, old.arm, old.values, found.to_move.assumed, 1000, seed=12345)
    q, qd, qdd = (part[:, ::20] for part in derivatives(path))
    peaks = _peaks(arms, q, qd, qdd)
    assert (peaks.max(axis=0) <= found.ready.limits.torque / 0.9).all()
    for i, envelope in enumerate(found.ready.limits.envelopes):
        assert np.abs(q[i] - envelope.middle).max() <= envelope.reach
        assert np.abs(qd[i]).max() <= envelope.speed
        assert np.abs(qdd[i]).max() <= envelope.acceleration
    assert path[:, 0] == pytest.approx(found.first.start)
    assert path[:, -1] == pytest.approx(found.first.start)
    assert np.abs(derivatives(path)[1][:, [0, -1]]).max() < 1e-6


def _peaks(arms: PossibleArms, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """(K, n) largest torques of every possible arm."""
    likeliest = arms.model.lump_values
    effects = []
    for term in arms.values:
        one = torque_along(arms.model, q, qd, qdd, 50.0, {term: arms.values[term]})
        effects.append(one - np.einsum("npN,p->nN", arms.model.regressor(q, qd, qdd), likeliest))
    rigid = np.einsum("npN,kp->knN", arms.model.regressor(q, qd, qdd), arms.draws)
    return np.abs(rigid + np.einsum("kt,tnN->knN", arms.factors, np.array(effects))).max(axis=2)


@pytest.mark.parametrize("seconds", [30.0, 60.0])
def test_there_is_time_for_some_constant_speeds(seconds: float) -> None:
    found = _proposed("drive", seconds=seconds).first
    parts = dict(found.parts)
    assert parts["a ladder of constant speeds with reversals"] <= seconds / 2 + 1.0
    assert found.seconds < 1.3 * seconds


def test_an_arm_that_speeds_up_sooner_is_told_more() -> None:
    slow, fast = _proposed("drive"), _proposed("drive", speeding_up=0.1)
    (there,), (here,) = slow.document.joints, fast.document.joints
    assert here.acceleration_limit == pytest.approx(3 * there.acceleration_limit)
    assert there.acceleration_limit < here.acceleration <= here.acceleration_limit
    assert fast.first.nats > slow.first.nats


def test_it_tells_more_than_random_motions_within_the_same_limits() -> None:
    """Against 100 random Fourier motions, each as large as the limits allow."""
    found = _proposed("vishard4")
    limits, rng = found.ready.limits, np.random.default_rng(1)
    series = FourierMotion(limits.envelopes, tuple(range(4)), 10.0, harmonics_of(10.0, 2.0))
    count = limits.information.count
    search = ExcitationSearch(
        limits.information,
        series,
        NoRoom(),
        np.arange(count) * 10.0 / count,
        30.0,
        torque=limits.torque,
        tip_speed=limits.tip_speed,
    )
    best = -np.inf
    for _ in range(100):
        x = series.random(rng)
        low, high = 0.0, 4.0
        for _ in range(12):
            middle = (low + high) / 2
            low, high = (middle, high) if search.beyond(middle * x) <= 1.0 else (low, middle)
        best = max(best, search.value(low * x))
    assert found.first.nats > best + 5.0


def test_the_prediction_is_kept_by_the_recording(tendon: Run) -> None:
    """What `inspect` says of a recording with other noise: the same parameters are told well."""
    motion, check, run, told = Path("motion.csv"), Path("check.csv"), Path("run.csv.gz"), Path("told.json")
    out = ("--out", motion, "--held-out", check, "--seconds", "40", "--json", told)
    assert tendon("experiment", "drive", *out)[0] == 0
    assert tendon("simulate", "drive", "--motion", motion, "--out", run, "--seed", "5")[0] == 0
    status, said, _ = tendon("inspect", run, "drive", "--promised", told)
    assert status == 0
    assert "told well as promised: 5 of 5 parameters" in said
    status, seen, _ = tendon("inspect", run, "drive", "--promised", told, "--json", "-")
    assert status == 0
    predicted, got = json.loads(told.read_text()), json.loads(seen)
    assert {p["name"]: p["told"] for p in predicted["parameters"]} == {p["name"]: p["told"] for p in got["parameters"]}
    widths = [p["width"] / p["promised_width"] for p in got["promises"]]
    assert all(0.5 < width < 2.0 for width in widths)
    status, _, err = tendon("inspect", run, "drive", "--promised", motion)
    assert status == output.BAD_INPUT
    assert "expected what tendon experiment MODEL --json FILE writes" in err
    assert motion.read_text().startswith("# NOT CHECKED: ")
    first, second = read_motion(motion, 1), read_motion(check, 1)
    assert first.shape[1] > 1.5 * second.shape[1]
    assert not np.array_equal(first[:, : second.shape[1]], second)


def test_slower_and_narrower_on_request(tendon: Run) -> None:
    asked = ("--speed", "0.2", "--range", "q2=-0.2:0.3", "--joints", "2,3", "--tip-speed", "0.3")
    written = ("--budget", "60", "--seconds", "40", "--json", "told.json")
    status, out, _ = tendon("experiment", "vishard4", *asked, *written)
    assert status == output.NO
    found = json.loads(Path("told.json").read_text())
    joints = found["joints"]
    assert [j["speed"] > 0 for j in joints] == [False, True, True, False]
    assert all(j["speed"] <= j["speed_limit"] + 1e-9 for j in joints)
    assert joints[0]["speed_limit"] == pytest.approx(0.2 * 0.9 * 2.0)
    assert -0.2 <= joints[1]["position"][0] < joints[1]["position"][1] <= 0.3
    assert found["tip_speed"] <= 0.3
    assert "NOT CHECKED" in out


def test_the_arm_keeps_clear_of_the_floor_and_of_itself(tendon: Run) -> None:
    """Of the written motion every 10 ms; it uses the room that there is."""
    motion = Path("motion.csv")
    options = ("--budget", "60", "--seconds", "40", "--start", "0,-1.57,1.57,-1.57,-1.57,0")
    assert tendon("experiment", "ur10", "--floor", "0", *options, "--out", motion)[0] == output.NO
    clear = Clearance.of(Source.shipped("ur10").arm(), Scene.of(floor=0.0))
    least = clear.least(read_motion(motion, 6)[:, ::10])
    assert least.min() >= 0
    assert (np.ptp(read_motion(motion, 6), axis=1) > 0.3).all()


def test_an_arm_that_cannot_hold_itself_gets_an_answer(tendon: Run) -> None:
    """Its weight takes more than the largest torque wherever it is: no motion is written."""
    weak = TWO_LINKS.replace("LONG", "0.1").replace('effort="60"', 'effort="0.01"')
    Path("two.urdf").write_text(weak.replace('xyz="0 0 0.2"', 'xyz="0.2 0 0"'))
    assert tendon("import", "two.urdf", "--out", "two.toml")[0] == 0
    asked = ("--seconds", "30", "--budget", "60", "--out", "motion.csv")
    status, _, err = tendon("experiment", "two.toml", *asked)
    assert status == output.BAD_INPUT
    assert "no safe motion about the middle of the ranges was found: even a small one has" in err
    assert not Path("motion.csv").exists()


@pytest.mark.parametrize(("budget", "status"), [([], 0), (["--budget", "20"], output.NO)])
def test_work_is_counted_and_not_the_clock(
    budget: list[str], status: int, tendon: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same bytes by a clock that runs 30 times as fast and with any number of processes; the end of a small budget
    is reached and said."""
    clocks = {name: getattr(time, name) for name in ("monotonic", "perf_counter", "time")}
    found = []
    for pace, processes in ((1, 1), (30, 2), (30, 8)):
        for name, clock in clocks.items():
            monkeypatch.setattr(time, name, lambda clock=clock, pace=pace: pace * clock())
        with on_cores(processes):
            asked = ("--seconds", "20", *budget, "--out", "motion.csv", "--json", "told.json")
            ended, out, _ = tendon("experiment", "drive", *asked)
        assert ended == status
        assert ("The search was cut after" in out) == bool(budget)
        found.append([Path(name).read_bytes() for name in ("motion.csv", "told.json")])
    assert found == 3 * found[:1]
    search = json.loads(found[0][1])["search"]
    assert search["ended"] == ("budget" if budget else "complete")
    assert 0 < search["iterations"] <= search["budget"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--start", "0,1"], "--start: found 2 numbers, expected 1"),
        (["--start", "far"], "--start far: expected numbers separated by commas"),
        (["--start", "nan"], "--start nan: expected finite numbers"),
        (["--scene", "nowhere.toml"], "nowhere.toml"),
        (["--noise", "0"], "give a noise above 0"),
        (["--between", "stribeck@1", "--held-out", "check.csv"], "are for motions without --between"),
    ],
)
def test_what_is_no_motion_is_one_line(options: list[str], message: str, tendon: Run) -> None:
    status, _, err = tendon("experiment", "drive", *options)
    assert status == output.BAD_INPUT
    assert message in err


# --- the next motion ---


@pytest.mark.slow
def test_the_next_motion_tells_what_the_first_recording_left_open(tendon: Run) -> None:
    """Of a recording in which two joints rest, the next motion tells them: with it, all is told well that the first
    motion of all joints tells."""
    quick = ("experiment", "vishard4", "--seconds", "40")
    assert tendon(*quick, "--joints", "1,2", "--out", "motion.csv")[0] == 0
    assert tendon("simulate", "vishard4", "--motion", "motion.csv", "--out", "run.csv.gz")[0] == 0
    assert tendon(*quick, "--given", "run.csv.gz", "--out", "next.csv", "--json", "told.json")[0] == 0
    found = json.loads(Path("told.json").read_text())
    before = {p["name"]: p["told"] for p in found["before"]}
    after = {p["name"]: p["told"] for p in found["parameters"]}
    for joint in (3, 4):
        friction = [name for name in before if name.startswith(f"viscous@{joint}")]
        assert friction
        assert {before[name] for name in friction} == {"no"}
        assert {after[name] for name in friction} == {"well"}
    assert found["rivals"] == []


def test_what_is_known_is_not_sought_again() -> None:
    """With the information of a recording of the same motion, another one brings less than the first, and no recording
    takes information away."""
    information = _proposed("drive").ready.limits.information
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 1, information.count))
    made = information.outputs(q, qd, qdd)
    known = information.told(q, qd, qdd, 10.0)
    seconds = information.count / 10.0
    first, _, _ = information.nats(made, seconds)
    second, _, _ = replace(information, known=known).nats(made, seconds)
    both, _, _ = information.nats(made, 2 * seconds)
    assert 0 < second < first
    assert first + second == pytest.approx(both, rel=1e-9)


def test_rivals_that_a_recording_leaves_open_are_told_apart(tendon: Run) -> None:
    """A weak spring and a weak pull of gravity are one over a small range; over a larger one they are not."""
    t = np.arange(0.0, 40.0, 0.001)
    q = 0.12 * np.sin(2 * np.pi * 0.3 * t) + 0.05 * np.sin(2 * np.pi * 1.1 * t) + 0.02 * np.sin(2 * np.pi * 2.3 * t)
    np.savetxt("motion.csv", np.column_stack([t, q]), fmt="%.9f", delimiter=",", header="t,q1", comments="")
    hidden = ("--hide", "linear_spring@1:stiffness=1.5,rest=0")
    assert tendon("simulate", "drive", *hidden, "--motion", "motion.csv", "--out", "run.csv.gz")[0] == 0
    assert tendon("experiment", "drive", "--given", "run.csv.gz", "--seconds", "60", "--json", "told.json")[0] == 0
    found = json.loads(Path("told.json").read_text())
    rivals = {r["effect"] for r in found["rivals"]}
    assert {"linear_spring"} < rivals
    assert any(part["name"].startswith("what tells ") for part in found["parts"])


TWO_LINKS = """
<robot name="two">
  <link name="base"><collision><origin xyz="0 0 0"/><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <link name="upper"><inertial><mass value="2"/><origin xyz="0 0 0.2"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.2"/><geometry><box size="0.05 0.05 0.2"/></geometry></collision></link>
  <link name="lower"><inertial><mass value="1"/><origin xyz="0 0 0.2"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.15"/><geometry><box size="0.05 0.05 LONG"/></geometry></collision></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.1"/><limit lower="-1" upper="1" effort="60" velocity="2"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.4"/><limit lower="-2.6" upper="2.6" effort="30" velocity="2"/></joint>
</robot>
"""


@pytest.mark.parametrize(("long", "status"), [("0.1", output.NO), ("2.0", output.BAD_INPUT)])
def test_the_finished_motion_is_checked_with_the_collision_shapes(long: str, status: int, tendon: Run) -> None:
    """A bar of a metre on the lower link, which no capsule holds, would sweep through the floor."""
    pytest.importorskip("coal", reason="collision shapes are judged by coal")
    Path("two.urdf").write_text(TWO_LINKS.replace("LONG", long))
    assert tendon("import", "two.urdf", "--out", "two.toml")[0] == 0
    asked = ("--shapes", "two.urdf", "--floor", "0", "--seconds", "30", "--budget", "60", "--out", "motion.csv")
    ended, _, err = tendon("experiment", "two.toml", *asked)
    assert ended == status
    assert Path("motion.csv").exists() == (status == output.NO)
    assert ("by their collision shapes" in err) == (status == output.BAD_INPUT)
