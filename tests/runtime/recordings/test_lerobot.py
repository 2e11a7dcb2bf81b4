"""Data sets of LeRobot, written with pyarrow as its documentation describes them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.recordings.columns import RecordedArm
from runtime.recordings.recording import Recording, RecordingError, read
from symbolic.model_file.arm import Drive
from tests.runtime.recordings.formats import joint

FRAMES, FPS = 240, 30
MOTORS = ("shoulder_pan", "shoulder_lift", "gripper")


def angles(offset: float = 0.0, frames: int = FRAMES) -> np.ndarray:
    """(frames, 3) degrees, beyond what normalised positions reach; the gripper in percent."""
    t = np.arange(frames)[:, None] / FPS
    return np.hstack([115 * np.sin(2 * t + offset), 40 * np.cos(3 * t + offset), 50 + 50 * np.sin(t)])


def table(episodes: Sequence[int], lengths: Sequence[int] | None = None, **features: np.ndarray) -> pa.Table:
    """Rows of some episodes, features one after the other; frame_index and timestamp restart with each."""
    lengths = lengths or [FRAMES] * len(episodes)
    frame = np.concatenate([np.arange(n) for n in lengths])
    columns: dict[str, Any] = {
        name: pa.array([row.astype(np.float32).tolist() for row in values]) for name, values in features.items()
    }
    columns |= {
        "timestamp": pa.array((frame / FPS).astype(np.float32)),
        "frame_index": frame,
        "episode_index": np.repeat(episodes, lengths),
        "index": np.arange(len(frame)),
        "task_index": np.zeros(len(frame), int),
    }
    return pa.table(columns)


def written(root: Path, name: str, rows: pa.Table, features: Mapping[str, Any] | None = None) -> Path:
    """A file of a data set, and its description."""
    path = root / "data" / "chunk-000" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(rows, path)
    if features is not None:
        (root / "meta").mkdir(exist_ok=True)
        about = {"codebase_version": "v2.1", "fps": FPS, "features": features}
        (root / "meta" / "info.json").write_text(json.dumps(about), encoding="utf-8")
    return path


def described(*names: str, endings: str = ".pos", **more: Any) -> dict[str, Any]:
    motors = [motor + endings for motor in MOTORS]
    return {name: {"dtype": "float32", "shape": [3], "names": motors} | more for name in names}


def state_and_action(**more: np.ndarray) -> dict[str, np.ndarray]:
    return {"observation.state": angles(), "action": angles(0.1), "observation.effort": angles() / 100} | more


def arm(*names: str) -> RecordedArm:
    return RecordedArm([joint(name=name) for name in names], space=True)


def said(path: Path, *given: Any) -> str:
    with pytest.raises(RecordingError) as error:
        read(path, *given)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_an_episode_in_degrees_and_its_commands(tmp_path: Path) -> None:
    features = described("observation.state", "action", "observation.effort")
    path = written(tmp_path, "episode_000003.parquet", table([3], **state_and_action()), features)
    r = read(path, None)
    assert np.allclose(r.q, np.radians(angles().T[:2]), atol=1e-6)
    assert r.q_desired is not None
    assert np.allclose(r.q_desired, np.radians(angles(0.1).T[:2]), atol=1e-6)
    assert np.allclose(r.tau, angles().T[:2] / 100, atol=1e-6)
    assert set(r.run) == {3}
    assert r.dt == pytest.approx(1 / FPS, rel=1e-4)
    assert "observation.state is read in degrees" in r.notes[0]
    assert r.notes[1].startswith("gripper left out: observation.state.gripper.pos, action.gripper.pos, observation.eff")
    assert "joints in the order of the file: 1 shoulder_pan, 2 shoulder_lift" in r.notes


def test_without_torque_the_drive_makes_it_from_the_action(tmp_path: Path) -> None:
    silent = {name: x for name, x in state_and_action().items() if name != "observation.effort"}
    features = described("observation.state", "action")
    path = written(tmp_path, "episode_000000.parquet", table([0], **silent), features)
    servo = joint(name="shoulder_pan", drive=Drive(law="position_servo", gains={"kp": 3.0, "kd": 0.0}))
    r = read(path, RecordedArm((servo,), space=False), {"q1": "observation.state[0] [deg]"})
    assert np.allclose(r.tau[0], 3.0 * np.radians(angles(0.1) - angles()).T[0], atol=1e-5)
    assert 'add [joint.drive] with law = "position_servo" to joint 1' in said(path, arm("shoulder_pan"))


def test_joints_by_the_names_of_the_model(tmp_path: Path) -> None:
    features = described("observation.state", "action", "observation.effort", endings="")
    path = written(tmp_path, "episode_000000.parquet", table([0], **state_and_action()), features)
    r = read(path, arm("shoulder_lift", "shoulder_pan"))
    assert np.allclose(r.q, np.radians(angles().T[1::-1]), atol=1e-6)
    assert np.allclose(r.tau, angles().T[1::-1] / 100, atol=1e-6)


def test_episodes_are_runs_in_one_file_and_in_many(tmp_path: Path) -> None:
    both = {name: np.vstack([x, x]) for name, x in state_and_action().items()}
    features = described("observation.state", "action")
    one = read(written(tmp_path / "v3", "file-000.parquet", table([0, 1], **both), features), None)
    for k in (0, 1):
        written(tmp_path / "v2", f"episode_{k:06d}.parquet", table([k], **state_and_action()), features)
    many = read(tmp_path / "v2", None)
    for r in (one, many):
        assert [len(np.unique(r.run)), len(r.segments), r.q.shape[1]] == [2, 2, 2 * FRAMES]
    assert np.array_equal(one.q, many.q)
    assert np.array_equal(one.t, many.t)


def test_short_episodes_of_a_folder_are_left_out(tmp_path: Path) -> None:
    features = described("observation.state", "action")
    written(tmp_path, "episode_000000.parquet", table([0], **state_and_action()), features)
    few = {name: x[:10] for name, x in state_and_action().items()}
    written(tmp_path, "episode_000001.parquet", table([1], [10], **few))
    r = read(tmp_path, None)
    assert r.q.shape == (2, FRAMES)
    assert "episodes left out, with fewer than 50 frames: 1" in r.notes


def test_positions_that_may_be_normalised_are_refused_with_what_to_give(tmp_path: Path) -> None:
    small = {name: x / 2 for name, x in state_and_action().items()}
    features = described("observation.state", "action", "observation.effort")
    path = written(tmp_path, "episode_000000.parquet", table([0], **small), features)
    expected = 'q1 has the unknown unit "deg or normalised"; the file does not say which of the two; if degrees, pass '
    expected += '--map q="observation.state [deg]" --map q_desired="action [deg]"'
    assert expected in said(path, None)
    mapping = {"q": "observation.state [deg]", "q_desired": "action [deg]"}
    r = read(path, None, mapping)
    assert np.allclose(r.q[:2], np.radians(angles().T[:2] / 2), atol=1e-6)


def test_a_stated_unit_counts(tmp_path: Path) -> None:
    small = {name: x / 2 for name, x in state_and_action().items()}
    features = described("observation.state", "action", units=["deg", "deg", "%"]) | described("observation.effort")
    r = read(written(tmp_path, "episode_000000.parquet", table([0], **small), features), None)
    assert np.allclose(r.q, np.radians(angles().T[:2] / 2), atol=1e-6)
    assert not any("in degrees" in note for note in r.notes)


def test_radians_without_a_description(tmp_path: Path) -> None:
    radians = {name: x / 100 for name, x in state_and_action().items()}
    r = read(written(tmp_path, "episode_000000.parquet", table([0], **radians)), None)
    assert r.q.shape == (3, FRAMES)  # nothing says that the third is a gripper
    assert np.allclose(r.q, angles().T / 100, atol=1e-6)


def test_which_joint_is_which_by_map(tmp_path: Path) -> None:
    """The other signals follow the joint that is named."""
    features = described("observation.state", "action", "observation.effort")
    path = written(tmp_path, "episode_000000.parquet", table([0], **state_and_action()), features)
    assert "has 2 joints" in said(path, arm("elbow"))
    r = read(path, arm("elbow"), {"q1": "observation.state[1] [deg]"})
    assert np.allclose(r.q[0], np.radians(angles().T[1]), atol=1e-6)
    assert np.allclose(r.tau[0], angles().T[1] / 100, atol=1e-6)
    assert r.q_desired is not None
    assert np.allclose(r.q_desired[0], np.radians(angles(0.1).T[1]), atol=1e-6)


def test_signals_within_one_feature(tmp_path: Path) -> None:
    """Arms that list position, rate and torque of each motor in observation.state."""
    t = np.arange(FRAMES) / FPS
    state = np.column_stack([np.sin(t), np.cos(t), 3 * np.sin(5 * t)])
    names = ["a.pos", "a.vel", "a.torque"]
    features = {"observation.state": {"dtype": "float32", "shape": [3], "names": names}}
    r = read(written(tmp_path, "file-000.parquet", table([0], **{"observation.state": state}), features), None)
    assert np.allclose(np.vstack([r.q, r.tau]), state.T[[0, 2]], atol=1e-6)
    assert r.qd is not None
    assert np.allclose(r.qd[0], state.T[1], atol=1e-6)


def test_steps_of_a_tool_are_no_commands_of_joints(tmp_path: Path) -> None:
    features = described("observation.state", "observation.effort")
    features["action"] = {"dtype": "float32", "shape": [3], "names": ["delta_x", "delta_y", "gripper"]}
    r = read(written(tmp_path, "episode_000000.parquet", table([0], **state_and_action()), features), None)
    assert r.q_desired is None
    assert "action is left out: its names are not those of the joints in observation.state" in r.notes


def test_one_joint_in_a_column_of_numbers(tmp_path: Path) -> None:
    rows = table([0], **{"observation.effort": angles()[:, :1]})
    rows = rows.append_column("observation.state", pa.array(angles()[:, 0] / 100))
    r = read(written(tmp_path, "episode_000000.parquet", rows), None)
    assert np.allclose(r.q[0], angles()[:, 0] / 100)


def test_an_empty_row_at_the_beginning(tmp_path: Path) -> None:
    rows = table([0], **state_and_action())
    empty = pa.array([None, *rows.column("observation.state").to_pylist()[1:]])
    rows = rows.set_column(rows.column_names.index("observation.state"), "observation.state", empty)
    assert "no column t" in said(written(tmp_path, "episode_000000.parquet", rows), None)


@settings(deadline=None, max_examples=20)
@given(st.floats(120, 4000), st.floats(-3, 3))
def test_degrees_of_any_size_become_radians(
    tmp_path_factory: pytest.TempPathFactory, size: float, phase: float
) -> None:
    t = np.arange(FRAMES)[:, None] / FPS
    state = size * np.sin(4 * t + phase)
    rows = table([0], **{"observation.state": state, "action": state, "observation.effort": np.cos(4 * t)})
    r: Recording = read(written(tmp_path_factory.mktemp("any"), "episode_000000.parquet", rows), None)
    assert np.allclose(r.q, np.radians(state.T), rtol=1e-5, atol=1e-5 * size)


@pytest.mark.parametrize(
    ("about", "expected"),
    [
        ({"features": []}, "joints in the order"),
        ({"features": {"observation.state": []}}, "joints in the order"),
        ({"features": {"observation.state": {"names": {"a": "b"}, "units": 3}}}, "joints in the order"),
        ([1], "joints in the order"),
    ],
)
def test_a_description_that_is_none(tmp_path: Path, about: Any, expected: str) -> None:
    path = written(tmp_path, "episode_000000.parquet", table([0], **state_and_action()))
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps(about), encoding="utf-8")
    assert any(note.startswith(expected) for note in read(path, None).notes)


def test_folders_that_are_no_data_set(tmp_path: Path) -> None:
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text("{", encoding="utf-8")
    assert "without Parquet files in its folder data" in said(tmp_path, None)
    written(tmp_path, "episode_000000.parquet", pa.table({"a": np.arange(100.0)}))
    assert "its files lack one of episode_index, frame_index, observation.state" in said(tmp_path, None)
    written(tmp_path, "episode_000001.parquet", pa.table({"b": np.arange(100.0)}))
    assert "its files have different features" in said(tmp_path, None)
    (tmp_path / "data" / "chunk-000" / "episode_000002.parquet").write_bytes(b"PAR1 cut off")
    assert "the Parquet file is damaged or cut off" in said(tmp_path, None)
