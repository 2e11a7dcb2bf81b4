"""Motions and files from a notebook: inspected, designed, executed and generated as by the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from runtime.notebook.arm import load, recording
from runtime.notebook.designed import FirstMotionResult, experiment
from runtime.notebook.exchanged import export_motion
from runtime.notebook.generated import generate
from runtime.notebook.planned import PlanResult, execute, optimize
from runtime.notebook.verbs import inspect, simulate
from tests.runtime.conftest import Run


@pytest.fixture(scope="module")
def plan() -> PlanResult:
    return optimize("scenario1", friction=False, springs=False)


def test_an_inspection_is_that_of_the_command_line(tendon: Run, tmp_path: Path) -> None:
    arm, path = load("drive"), tmp_path / "run.csv"
    made = simulate(arm, seconds=10)
    made.save(path)
    document = json.loads(tendon("inspect", str(path), "drive", "--json", "-")[1])
    result = inspect(path, arm)
    assert document.pop("provenance")["verb"] == "inspect"
    assert result.to_dict() == document
    assert (result.problem, result.suspicions) == (None, [])
    assert {p.told for p in result.parameters} == {"well"}
    again = inspect(made, arm).to_dict()
    assert [p["name"] for p in again["parameters"]] == [p["name"] for p in document["parameters"]]
    assert repr(inspect(path)).splitlines()[1] == "Nothing looks wrong; with MODEL more can be checked."


def test_an_inspection_of_a_frame_says_what_is_wrong() -> None:
    made = simulate(load("drive"), seconds=10)
    frame = pd.DataFrame({"t": made.t, "q1": np.degrees(made.q[0]), "tau1": made.tau[0]})
    frame["qd1"] = np.gradient(made.q[0], made.t)
    suspicion = inspect(frame).suspicions[0]
    assert (suspicion.joint, suspicion.kind) == (1, "degrees")
    frame.loc[7, "tau1"] = np.nan
    broken = inspect(frame)
    assert broken.problem == "recording row 7: tau1 is NaN; drop the row or pass allow_gaps=True"
    assert broken.recording is not None
    right = recording(frame, columns={"q1": "q1 [deg]"}, allow_gaps=True)
    np.testing.assert_allclose(right.q[0], np.delete(made.q[0], 7))


def test_a_plan_is_executed_on_the_simulated_arm(plan: PlanResult, tmp_path: Path) -> None:
    done = execute(plan.arm, plan, trials=2, cycles=1, friction_compensation=True)
    assert (done.status, done.reason) == ("done", None)
    assert done.recording is not None
    assert list(np.unique(done.recording.run)) == [1, 2]
    planned = plan.plan.trajectory.at(plan.arm.model, done.recording.t[done.recording.run == 1] % 1.2).q
    off = np.abs(done.recording.q[:, done.recording.run == 1] - planned).max(axis=1)
    np.testing.assert_allclose(off, done.document.trials[0].cycles[0].tracking_max, rtol=1e-3)
    assert off.max() < 0.02
    plan.save(tmp_path / "plan.json")
    again = execute(plan.arm, tmp_path / "plan.json", trials=2, cycles=1, friction_compensation=True)
    assert again.to_dict() == done.to_dict()
    assert done.report(tmp_path).exists()


def test_a_safe_stop_says_why(plan: PlanResult) -> None:
    stopped = execute(plan.arm, plan, trials=1, cycles=1, hide="linear_spring@2:stiffness=3000,rest=1")
    assert stopped.status == "stopped"
    assert "STOPPED: trial 1 at t = " in repr(stopped)
    with pytest.raises(ValueError, match="too few limits for a real arm"):
        execute(plan.arm, plan, on="serial:///dev/ttyACM0", move=True)


def test_an_experiment_separates_what_it_is_asked_to(tmp_path: Path) -> None:
    arm = load("drive")
    result = experiment(arm, ["linear_spring@1", "gravity"], joints=1, ranges={1: (-0.9, 0.9)})
    assert result.separated
    assert -0.9 <= result.motion.min() < -0.5
    assert 0.5 < result.motion.max() <= 0.9
    with pytest.raises(ValueError, match="is no joint of drive"):
        experiment(arm, "gravity", joints=[1, "wrist"])
    with pytest.raises(ValueError, match="expected LOW below HIGH"):
        experiment(arm, "gravity", ranges={1: (0.9, -0.9)})
    assert "linear_spring@1, gravity" in repr(result)
    result.save(tmp_path / "motion.csv")
    from_file, from_array = (simulate(arm, motion=motion) for motion in (tmp_path / "motion.csv", result.motion))
    count = from_file.q.shape[1]  # reading may leave out the last sample
    assert count >= len(result.motion) - 1
    np.testing.assert_allclose(from_file.q, from_array.q[:, :count], atol=1e-6)


def test_generated_code_is_that_of_the_command_line(tendon: Run) -> None:
    arm = load("drive")
    arm.save("drive.toml")
    result = generate(load("drive.toml"))
    assert result.directory == Path("generated") / arm.name
    assert tendon("generate", "drive.toml", "--check")[0] == 0
    assert result.to_dict() == json.loads(tendon("generate", "drive.toml", "--json", "-")[1])
    assert result.operations["inverse_dynamics"]["arithmetic"] == 1
    with pytest.raises(ValueError, match=r"effects: the library of effects is written there"):
        generate(arm, "effects")


def test_the_first_and_the_next_motion_of_an_arm(tmp_path: Path) -> None:
    """What is not checked is in what is printed and in the file; a recording along it needs no further motion."""
    arm = load("drive")
    first = experiment(arm, seconds=30.0, speed=0.8, start=[0.1])
    assert isinstance(first, FirstMotionResult)
    assert "NOT CHECKED" in repr(first)
    assert {p.told for p in first.parameters} == {"well"}
    assert first.motion[0, 0] == pytest.approx(0.1)
    first.save(tmp_path / "motion.csv", tmp_path / "check.csv")
    assert (tmp_path / "motion.csv").read_text().startswith("# NOT CHECKED")
    written = export_motion(arm, tmp_path / "motion.csv", tmp_path / "m.yaml", "joint_trajectory", speed=0.5)
    assert "points at 100 Hz" in repr(written)
    assert (written.document.speed, written.document.unchecked[0][:6]) == (0.5, "People")
    run = simulate(arm, motion=tmp_path / "motion.csv")
    following = experiment(arm, given=run, seconds=30.0)
    assert isinstance(following, FirstMotionResult)
    assert following.document.rivals == []
    assert {p.told for p in following.document.before or []} == {"well"}
