"""Recorded torques drive the model: exact equalities, limits by hand, and recordings of equations written apart."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import servos
from one_joint import INERTIA, model_text

from runtime.identification.identify import identify
from runtime.model.loader import Model
from runtime.recordings.recording import Recording
from runtime.recordings.recording import write as write_recording
from runtime.replay.replay import Replay
from runtime.simulation import simulate
from runtime.simulation.demo import record_files
from runtime.simulation.options import SimulationSettings
from runtime.workspace.source import Source

Run = Callable[..., tuple[int, str, str]]

FRICTION = """\
[joint.controller]
kp = 40.0
kd = 5.0
[joint.effects.viscous]
coefficient = 1.0
"""


@pytest.fixture(scope="module")
def smooth(cache: Path) -> Model:  # noqa: ARG001
    """A joint with viscous friction alone, and a controller's gains."""
    return Source(Path("drive1.toml"), model_text(FRICTION)).compiled.model()


@pytest.fixture(scope="module")
def recorded(smooth: Model) -> Recording:
    """Of that joint, without noise."""
    return simulate.simulate(smooth, settings=SimulationSettings(seconds=12.0, noise=0.0))[0]


def test_a_model_that_is_right_moves_as_recorded(smooth: Model, recorded: Recording) -> None:
    (joint,) = Replay.of_file(smooth, [recorded]).joints
    assert joint.controller == "gains"
    assert [round(e.seconds, 6) for e in joint.open_loop] == [0.1, 0.3, 1.0]
    assert joint.closed_loop is not None
    assert all(e.share is not None and e.share < 2e-3 for e in (*joint.open_loop, joint.closed_loop))


def test_a_constant_torque_moves_the_joint_as_computed_by_hand(smooth: Model, recorded: Recording) -> None:
    """In open loop q = T/c (t − J/c (1 − exp(−c t/J))), in closed loop T/kp in the end."""
    extra, c, tau = 0.2, 1.0, INERTIA / 1.0
    (joint,) = Replay.of_file(smooth, [replace(recorded, tau=recorded.tau + extra)]).joints
    for error in joint.open_loop:
        t = np.linspace(0.0, error.seconds, 1 + round(error.seconds * 1000))[1:]
        by_hand = extra / c * (t - tau * -np.expm1(-t / tau))
        assert error.rms == pytest.approx(np.sqrt(np.mean(by_hand**2)), rel=0.01)
        assert error.promised == pytest.approx(error.rms, rel=0.01)
    assert joint.closed_loop is not None
    assert joint.closed_loop.rms == pytest.approx(extra / 40.0, rel=0.02)
    assert joint.agrees


def test_the_hidden_effect_of_a_bench_written_apart_is_in_the_motion(drive: Model, tmp_path: Path) -> None:
    """Stick-slip equations of the demo: with the effect, the model's motion comes nearer on what was not fitted."""
    source = Source.shipped("drive")
    fitted, held = source.recordings(record_files(tmp_path))
    with_effect = source.with_text(source.edits.add("stribeck", 1).text).compiled.model()
    before, after = (Replay.of_fit(identify(m, [fitted]), [held]).joints[0] for m in (drive, with_effect))
    assert before.closed_loop is not None
    assert after.closed_loop is not None
    assert after.closed_loop.rms is not None
    assert before.closed_loop.rms is not None
    assert after.closed_loop.rms < 0.2 * before.closed_loop.rms
    pairs = zip(before.open_loop, after.open_loop, strict=True)
    assert all(b.rms is not None and a.rms is not None and a.rms < 0.6 * b.rms for b, a in pairs)


@pytest.mark.parametrize(("log", "law"), [(servos.servo, servos.SERVO), (servos.bridge, servos.BRIDGE)])
def test_a_command_drives_the_model_by_the_law_of_its_drive(
    log: Callable[[None, int], servos.ServoLog], law: str, tmp_path: Path
) -> None:
    """Without a torque signal: a servo written apart follows its command; so does the model, given its friction."""
    text = servos.model(law, Source.shipped("drive").text)
    source = Source(tmp_path / "drive.toml", text)
    paths = [log(None, seed).write(tmp_path / f"{seed}.csv") for seed in (1, 2)]
    fitted, held = source.recordings(paths)
    (joint,) = Replay.of_fit(identify(source.compiled.model(), [fitted]), [held]).joints
    assert joint.controller == "law"
    assert joint.closed_loop is not None
    assert joint.closed_loop.share is not None
    assert joint.closed_loop.share < 0.01


def test_states_of_effects_begin_as_the_recorded_motion_left_them() -> None:
    """A spring with hysteresis, whose torque depends on where the joint came from."""
    text = model_text(f"{FRICTION}[joint.effects.spring_hysteresis]\ntorque = 0.8\nwidth = 0.05\n")
    model = Source(Path("held.toml"), text).compiled.model()
    recording, _ = simulate.simulate(model, settings=SimulationSettings(seconds=12.0, noise=0.0))
    (joint,) = Replay.of_file(model, [recording]).joints
    assert all(e.share is not None and e.share < 5e-3 for e in joint.open_loop)


def test_what_a_user_types(tendon: Run, tmp_path: Path) -> None:
    record_files(tmp_path)
    status, _, said = tendon("replay", "drive", "held_out.csv.gz")
    assert status == 2
    assert "tendon identify MODEL RECORDING --write" in said
    status, out, _ = tendon(
        "replay", "drive", "held_out.csv.gz", "--fit", "fitted.csv.gz", "--report", "page", "--json", "said.json"
    )
    assert status == 0
    assert "closed loop" in out
    document = json.loads((tmp_path / "said.json").read_text())
    (step,) = document["steps"]
    assert document["fitted"]
    assert step["added"] is None
    assert step["joints"][0]["closed_loop"]["rms"] > 0.001
    assert "as recorded, dashed" in (tmp_path / "page" / "report.html").read_text()


def test_your_own_rigid_torque_cannot_be_moved(recorded: Recording, tmp_path: Path, tendon: Run) -> None:
    write_recording(tmp_path / "own.csv", replace(recorded, tau_rigid=recorded.tau))
    (tmp_path / "drive1.toml").write_text(model_text(FRICTION))
    status, _, said = tendon("replay", "drive1.toml", "own.csv")
    assert status == 2
    assert "needs the arm's masses and frames" in said


def test_mujoco_moves_the_exported_arm_as_the_equations_do(tendon: Run, tmp_path: Path) -> None:
    """A joint with viscous friction, which MuJoCo plays exactly; its torque is a tenth too large."""
    pytest.importorskip("mujoco")
    (tmp_path / "drive1.toml").write_text(model_text(FRICTION))
    model = Source(Path("drive1.toml"), model_text(FRICTION)).compiled.model()
    recording, _ = simulate.simulate(model, settings=SimulationSettings(seconds=6.0, noise=0.0))
    write_recording(tmp_path / "run.csv", replace(recording, tau=1.1 * recording.tau))
    status, out, _ = tendon("replay", "drive1.toml", "run.csv", "--in", "mujoco", "--json", "said.json")
    assert status == 0
    assert "as given, in MuJoCo" in out
    own, other = (step["joints"][0]["open_loop"] for step in json.loads((tmp_path / "said.json").read_text())["steps"])
    for ours, theirs in zip(own, other, strict=True):
        assert ours["share"] > 0.02
        assert theirs["apart"] < 1e-3 * ours["rms"] / ours["share"]
    status, _, said = tendon("replay", "drive1.toml", "run.csv", "--fit", "run.csv", "--in", "mujoco")
    assert status == 2
    assert "identify --write" in said


def test_recordings_of_two_rates_are_not_played_together(recorded: Recording, tmp_path: Path, tendon: Run) -> None:
    (tmp_path / "drive1.toml").write_text(model_text(FRICTION))
    slower = simulate.simulate(
        Source(Path("drive1.toml"), model_text(FRICTION)).compiled.model(),
        settings=SimulationSettings(seconds=12.0, noise=0.0, seed=5),
    )[0]
    write_recording(tmp_path / "fast.csv", recorded)
    write_recording(tmp_path / "slow.csv", slower)
    rows = (tmp_path / "slow.csv").read_text().splitlines()
    (tmp_path / "slow.csv").write_text("\n".join([rows[0], *rows[1::4]]) + "\n")
    status, _, said = tendon("replay", "drive1.toml", "fast.csv", "slow.csv")
    assert status == 2
    assert "expected one rate: replay them one after the other" in said
