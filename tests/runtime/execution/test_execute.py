"""Execution on the simulated arm: plans are followed, what is hidden shows and is named, limits stop the arm."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from bench_arm import BENCH, SPRING, THERE_AND_BACK, motion, trajectory

from runtime.execution.execute import Execution, execute
from runtime.execution.options import ExecutionSettings
from runtime.model.loader import Model
from runtime.planning.trajectory import Trajectory
from runtime.recordings import recording
from runtime.simulation.simulate import parse_hidden
from runtime.workspace.source import Source
from tests.runtime.conftest import Refused, Run

Executed = Callable[..., Execution]


@pytest.fixture(scope="module")
def executed(bench: Source, arm: Model) -> Executed:
    def run(plan: Trajectory, hide: Sequence[str] = (), change: Sequence[str] = (), **others: object) -> Execution:
        hidden = [parse_hidden(text, arm) for text in hide]
        changed = [parse_hidden(text, arm) for text in change]
        settings = ExecutionSettings(**others)  # type: ignore[arg-type]
        return execute(arm, bench.compiled.controller(), plan, settings, hidden=hidden, changed=changed)

    return run


# --- following a plan ---


def test_a_plan_is_followed_and_costs_what_it_was_planned_for(executed: Executed) -> None:
    found = executed(trajectory(THERE_AND_BACK, springs={1: SPRING})).document().to_json()
    assert found["status"] == "done"
    assert [len(trial["cycles"]) for trial in found["trials"]] == [3, 3, 3]
    # (7) compensates 92 % of a friction of 1 to 5 N m at 40 N m/rad.
    assert found["mean"]["tracking_max"][0] < 0.02
    assert found["mean"]["total"] == pytest.approx(found["plan"]["total"], rel=0.02)
    assert found["mean"]["q_min"][0] == pytest.approx(-1.2, abs=0.02)
    assert found["spread"]["total"] < 0.005 * found["mean"]["total"]


def test_without_compensation_it_lags_and_costs_more_than_a_plan_without_friction(executed: Executed) -> None:
    frictionless = executed(trajectory(THERE_AND_BACK, friction=False), trials=1).document().to_json()
    assert not frictionless["friction_compensation"]
    plan, mean = frictionless["plan"], frictionless["mean"]
    # Between the plan without friction and the same motion with all of it: the lag saves some of the friction's work.
    assert 1.05 * plan["total"] < mean["total"] < 1.1 * plan["modelled"]["total"]
    # At the turn it stays behind by more than what Coulomb friction alone opens against the position gain.
    assert -1.2 + 1.05 / 40 < mean["q_min"][0] < -1.1
    assert mean["tracking_max"][0] > 0.05
    compensated = (
        executed(trajectory(THERE_AND_BACK, friction=False), trials=1, friction_compensation=True).document().to_json()
    )
    assert compensated["mean"]["tracking_max"][0] < 0.2 * mean["tracking_max"][0]


def test_the_trajectorys_springs_take_the_place_of_the_files(executed: Executed) -> None:
    without = executed(trajectory(THERE_AND_BACK), trials=1).document().to_json()
    assert [e["effect"] for e in without["effects"]] == ["coulomb_asymmetric", "viscous"]
    with_spring = executed(trajectory(THERE_AND_BACK, springs={1: SPRING}), trials=1).document().to_json()
    assert with_spring["effects"][-1]["values"] == SPRING
    assert with_spring["mean"]["peak_torque"][0] != pytest.approx(without["mean"]["peak_torque"][0], rel=0.05)
    assert with_spring["mean"]["tracking_max"][0] < 0.02


def test_a_motion_that_is_not_periodic_is_made_once(executed: Executed) -> None:
    found = executed(trajectory(THERE_AND_BACK[:1], periodic=False), trials=2, cycles=5)
    assert [len(trial["cycles"]) for trial in found.document().to_json()["trials"]] == [1, 1]
    assert found.recording is not None
    assert found.recording.q[0, -1] == pytest.approx(-1.2, abs=0.03)


def test_what_is_hidden_raises_the_tracking_error(executed: Executed) -> None:
    plain = executed(trajectory(THERE_AND_BACK), trials=1).document().to_json()
    hidden = executed(trajectory(THERE_AND_BACK), ["linear_spring@1:stiffness=4,rest=0"], trials=1).document().to_json()
    changed = executed(trajectory(THERE_AND_BACK), (), ["viscous@1:coefficient=2.5"], trials=1).document().to_json()
    for other in (hidden, changed):
        assert other["mean"]["tracking_rms"][0] > 3 * plain["mean"]["tracking_rms"][0]
    assert [e["effect"] for e in hidden["effects"] if e["hidden"]] == ["linear_spring"]
    assert [e["effect"] for e in changed["effects"] if e["changed"]] == ["viscous"]


# --- figures and recording ---


def test_figures_are_those_of_the_recording(executed: Executed) -> None:
    found = executed(trajectory(THERE_AND_BACK), trials=2, cycles=2, noise=0.0)
    made = found.recording
    assert made is not None
    for k, trial in enumerate(found.document().to_json()["trials"], 1):
        for number, cycle in enumerate(trial["cycles"], 1):
            part = (made.run == k) & (made.t >= 1.4 * number - 1e-9) & (made.t < 1.4 * (number + 1) - 1e-9)
            q, tau = made.q[0, part], made.tau[0, part]
            error = q - made.q_desired[0, part]  # type: ignore[index]
            assert part.sum() == 1400
            assert cycle["cost"][0] == pytest.approx(np.sum(tau**2) * 1e-3, rel=1e-9)
            assert cycle["tracking_rms"][0] == pytest.approx(np.sqrt(np.mean(error**2)))
            assert (cycle["q_min"][0], cycle["q_max"][0]) == (q.min(), q.max())
            assert cycle["peak_torque"][0] == np.abs(tau).max()


def test_encoders_count_and_seeds_decide(executed: Executed) -> None:
    first, again, other = (
        executed(trajectory(THERE_AND_BACK), trials=1, cycles=1, seed=s).recording for s in (1, 1, 2)
    )
    assert first is not None
    assert again is not None
    assert other is not None
    counts = first.q[0] / (2 * np.pi / 200_000)
    assert np.abs(counts - np.round(counts)).max() < 0.01
    np.testing.assert_array_equal(first.tau, again.tau)
    assert np.abs(first.tau - other.tau).max() > 0.01
    assert np.abs(first.q - other.q).max() < 0.002


def test_noise_is_a_part_of_the_recorded_torque_and_of_nothing_else(executed: Executed) -> None:
    quiet, loud = (executed(trajectory(THERE_AND_BACK), trials=1, noise=x) for x in (0.0, 0.1))
    assert quiet.recording is not None
    assert loud.recording is not None
    np.testing.assert_array_equal(quiet.recording.q, loud.recording.q)
    difference = loud.recording.tau - quiet.recording.tau
    # 5600 samples: the standard deviation is known to 1 %.
    assert difference.std() == pytest.approx(0.1 * np.sqrt(np.mean(quiet.recording.tau**2)), rel=0.05)
    assert loud.document().to_json()["mean"]["total"] == quiet.document().to_json()["mean"]["total"]


# --- safe stops ---


@pytest.mark.parametrize(
    ("hide", "limit", "reason"),
    [
        (["offset@1:torque=22"], None, "tracking error 0.5"),
        (["offset@1:torque=-50"], 100.0, "speed 7.5"),
        (["offset@1:torque=-40", "viscous_asymmetric@1:positive=9,negative=9"], 100.0, "tracking error 1 rad is over"),
    ],
)
def test_limits_stop_the_arm(executed: Executed, hide: list[str], limit: float | None, reason: str) -> None:
    found = executed(trajectory(THERE_AND_BACK), hide, tracking_limit=limit)
    document = found.document().to_json()
    assert document["status"] == "stopped"
    assert len(document["trials"]) == 1
    assert document["trials"][0]["stop"]["joint"] == 1
    assert reason in document["reason"]
    # What was recorded until then is kept.
    assert found.recording is not None
    assert found.recording.t[-1] == pytest.approx(document["trials"][0]["stop"]["t"])


def test_a_motion_that_is_no_number_stops_the_arm(executed: Executed) -> None:
    wild = "end_stop@1:position=-0.01,stiffness=1e15,damping=0,side=-1"
    found = executed(trajectory(THERE_AND_BACK), [wild], tracking_limit=1e300).document().to_json()
    assert found["status"] == "stopped"


# --- the command line ---


@pytest.fixture
def here(here: Path) -> Path:
    (here / "bench.toml").write_text(BENCH)
    trajectory(THERE_AND_BACK, springs={1: SPRING}).write(here / "plan.json")
    return here


@pytest.fixture
def called(here: Path, tendon: Run) -> Run:  # noqa: ARG001 - where the files are
    """`tendon execute` of the bench and its plan."""
    return partial(tendon, "execute", "bench.toml", "plan.json")


def test_what_is_hidden_is_named_from_the_recording(here: Path, tendon: Run) -> None:
    stations = [0.0, 0.6, -0.5, 0.8, -0.9, 1.0, -1.0, 0.9]
    slow = trajectory(motion(stations, [4.0, 3.0, 2.0, 1.4, 1.0, 0.9, 0.8, 0.7]))
    slow.write(here / "slow.json")
    hide = "stribeck@1:torque=0.6,speed=0.15"
    arguments = ("bench.toml", "slow.json", "--on", "simulation", "--hide", hide, "--trials", 1, "--cycles", 2)
    written = ("--out", "run.csv.gz", "--model-out", "mounted.toml", "--json", "e.json")
    status, out, _ = tendon("execute", *arguments, *written)
    assert status == 0
    assert "hidden: stribeck at joint 1: torque 0.6, speed 0.15" in out
    assert "  tendon diagnose mounted.toml run.csv.gz" in out
    assert tendon("diagnose", "mounted.toml", "run.csv.gz", "--json", "d.json")[0] == 0
    diagnosis = json.loads((here / "d.json").read_text())
    assert diagnosis["verdict"] == "effect"
    assert [(f["effect"], f["joint"]) for f in diagnosis["findings"]] == [("stribeck", 1)]
    torque = diagnosis["findings"][0]["parameters"]["torque"]
    assert torque["value"] == pytest.approx(0.6, rel=0.15)


def test_the_model_is_written_as_it_was_mounted(here: Path, called: Run) -> None:
    arguments = ("--on", "simulation", "--trials", 1, "--cycles", 1, "--model-out", "mounted.toml")
    assert called(*arguments)[0] == 0
    assert (here / "mounted.toml").read_text() == BENCH.replace("5900.0", "3000.0").replace("-1.2\n", "-0.5\n").replace(
        "pretension = 0.0", "pretension = 10.0"
    )
    trajectory(THERE_AND_BACK).write(here / "plan.json")
    assert called(*arguments)[0] == 0
    assert "parallel_spring" not in (here / "mounted.toml").read_text()


def test_json_alone_and_the_recording_reads_back(here: Path, called: Run) -> None:
    arguments = ("--on", "simulation", "--trials", 2, "--cycles", 1, "--out", "run.csv")
    status, out, _ = called(*arguments, "--json", "-")
    document = json.loads(out)
    assert (status, document["status"], document["on"]) == (0, "done", "simulation")
    assert document["recording"] == "run.csv"
    back = recording.read(here / "run.csv", None)
    assert sorted(set(back.run.tolist())) == [1, 2]
    assert back.q_desired is not None


def test_joints_are_called_by_their_names(here: Path, called: Run) -> None:
    (here / "bench.toml").write_text(BENCH.replace("[[joint]]", '[[joint]]\nname = "wrist"'))
    arguments = ("--on", "simulation", "--trials", 1, "--cycles", 1, "--report", "page", "--json", "made.json")
    status, out, _ = called(*arguments)
    assert status == 0
    assert any(line.split()[:2] == ["1", "wrist"] for line in out.splitlines())
    assert json.loads((here / "made.json").read_text())["joints"][0]["name"] == "wrist"
    assert "1 wrist" in (here / "page" / "report.html").read_text()


def test_a_plan_beyond_the_limits_is_refused_and_nothing_is_written(here: Path, called: Run) -> None:
    trajectory(motion([0.0, -1.9], [0.6, 0.6])).write(here / "plan.json")
    status, out, _ = called("--on", "simulation", "--out", "run.csv", "--model-out", "mounted.toml")
    assert status == 1
    assert "the plan's position of joint 1 is -1.9 rad at t = 0.6 s, 0.1 rad beyond the limit of -1.8" in out
    assert "the plan's speed of joint 1 is 5.938 rad/s at t = 0.3 s, 0.938 rad/s beyond the limit of 5" in out
    assert sorted(p.name for p in here.iterdir()) == ["bench.toml", "plan.json"]


@pytest.mark.parametrize(("turn", "status"), [(-1.80054, 0), (-1.80144, 1)])
def test_what_a_plan_goes_beyond_a_limit_between_its_nodes_is_let_pass(
    here: Path, called: Run, turn: float, status: int
) -> None:
    trajectory(motion([0.0, turn], [0.9, 0.9])).write(here / "plan.json")
    made, out, _ = called("--on", "simulation", "--trials", 1, "--cycles", 1)
    assert made == status
    assert ("is -1.801 rad at t = 0.9 s, 0.00144 rad beyond the limit of -1.8" in out) == bool(status)


def test_a_safe_stop_exits_with_1_and_keeps_the_recording(here: Path, called: Run) -> None:
    arguments = ("--on", "simulation", "--tracking-limit", 0.001, "--out", "run.csv")
    status, out, _ = called(*arguments)
    assert status == 1
    assert "SAFE STOP: trial 1 at t = " in out
    rows = (here / "run.csv").read_text().splitlines()
    assert len(rows) > 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--on", "mars"], "--on mars: no such target; there is: simulation"),
        (["--on", "simulation", "--hide", "stribek@1"], 'there is no effect "stribek"'),
        (["--on", "simulation", "--hide", "viscous@1:coefficient=1"], "bench already has this effect; change its"),
        (["--on", "simulation", "--set", "stribeck@1:torque=1"], "bench does not have this effect; add it"),
        (["--on", "simulation", "--set", "viscous@1"], "--set viscous@1: no value; write --set viscous@1:KEY=VALUE"),
        (["--on", "simulation", "--set", "viscous@1:coefficient=-1"], "expected a value from 0 to inf"),
        (["--on", "simulation", "--hide", "torque_delay@1:time=-1e-3"], "forward simulation cannot record a torque"),
        (["--on", "simulation", "--out", "bench.toml"], "bench.toml: is read here; choose another name"),
        (["--on", "simulation", "--out", "no/run.csv"], "there is no directory no"),
    ],
)
def test_mistakes_are_one_line(here: Path, refused: Refused, arguments: list[str], message: str) -> None:
    before = {p.name: p.read_bytes() for p in here.iterdir()}
    assert message in refused("execute", "bench.toml", "plan.json", *arguments)
    assert {p.name: p.read_bytes() for p in here.iterdir()} == before


def test_a_model_without_a_controller_says_what_to_add(here: Path, called: Run) -> None:
    text = BENCH.replace("[joint.controller]\nkp = 40.0\nkd = 6.0\n", "")
    (here / "bench.toml").write_text(text)
    status, _, err = called("--on", "simulation")
    assert status == 2
    assert "lacks [joint.controller] at joint 1; tendon init --controller MODEL --write proposes them" in err
