"""Motions for other programs, read back by readers that are not ours."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from tests.runtime.conftest import Run

SECONDS, STARTS = 2.0, (0.1, -0.2)


def position(i: int, t: np.ndarray) -> np.ndarray:
    return STARTS[i] + 0.3 * (i + 1) * (1 - np.cos(2 * np.pi * t / SECONDS)) ** 2


def arm(joints: int) -> str:
    """Joints that turn about axes of their own, the first two with names."""
    text = 'name = "arm"\ngravity = [0.0, 0.0, -9.81]\n[controller]\nrate = 500.0\nvelocity_cutoff = 50.0\n'
    text += "friction_scale = 0.9\nfriction_slope = 150.0\n"
    for i in range(joints):
        name = f'name = "{("base", "elbow")[i]}"\n' if i < 2 else ""
        text += (
            f'[[joint]]\n{name}type = "revolute"\nrotor_inertia = 0.1\ngear_ratio = 100\n'
            f"origin = {{ xyz = [0.0, 0.0, 0.2], rpy = [0.0, 0.0, 0.0] }}\naxis = [0.0, {i % 2}.0, {1 - i % 2}.0]\n"
            "[joint.limits]\nposition = [-2.0, 3.0]\nspeed = 5.0\n"
            "[joint.link]\nmass = 1.0\ncom = [0.0, 0.0, 0.1]\ninertia = [0.01, 0.0, 0.0, 0.01, 0.0, 0.01]\n"
        )
    return text


@pytest.fixture
def export(tendon: Run) -> Run:
    """`tendon export` of a motion of two joints."""
    write(2)
    return partial(tendon, "export", "arm.toml", "motion.csv")


def write(joints: int, notes: str = "# NOT CHECKED: the cat\n# a comment\n") -> None:
    Path("arm.toml").write_text(arm(joints))
    t = np.arange(0.0, SECONDS + 1e-9, 0.001)
    q = np.array([position(i % 2, t) for i in range(joints)])
    head = "t [s]," + ",".join(f"q{i} [rad]" for i in range(1, joints + 1))
    rows = [",".join([f"{a:.3f}", *(f"{b:.10f}" for b in row)]) for a, row in zip(t, q.T, strict=True)]
    Path("motion.csv").write_text(notes + "\n".join([head, *rows]) + "\n")


def check_points(names: list[str], points: list[tuple[float, list[float], list[float], list[float]]]) -> None:
    """At half the pace."""
    assert names == ["base", "elbow"]
    t, q, qd, qdd = (np.array(column) for column in zip(*points, strict=True))
    np.testing.assert_allclose(t, np.arange(len(t)) * 0.01, atol=1e-9)
    assert t[-1] == pytest.approx(2 * SECONDS)
    for i in range(2):
        np.testing.assert_allclose(q[:, i], position(i, t / 2), atol=1e-6)
        np.testing.assert_allclose(qd[:, i], np.gradient(position(i, t / 2), t), atol=2e-3)
        np.testing.assert_allclose(qdd[2:-2, i], np.gradient(qd[:, i], t)[2:-2], atol=2e-2)
    # ROS 2's controllers refuse a motion that does not end at rest.
    assert not qd[[0, -1]].any()
    # What is rounding beside a column's largest number is 0.
    assert all((np.abs(x[x != 0]) > 1e-10 * np.abs(x).max()).all() for part in (q, qd, qdd) for x in part.T)


def test_ros_reads_the_yaml(export: Run) -> None:
    status, out, _ = export("--to", "joint_trajectory", "--out", "m.yaml", "--speed", 0.5)
    assert status == 0
    assert out.startswith("NOT CHECKED:\n  the cat\n")
    text = Path("m.yaml").read_text()
    assert text.startswith("# NOT CHECKED: the cat\n# a comment\n# played at 0.5 of its pace\n")
    read = yaml.safe_load(text)
    assert set(read) == {"header", "joint_names", "points"}
    check_points(
        read["joint_names"],
        [
            (
                p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"],
                p["positions"],
                p["velocities"],
                p["accelerations"],
            )
            for p in read["points"]
        ],
    )


def test_ros_reads_the_mcap(export: Run) -> None:
    assert export("--to", "joint_trajectory", "--out", "m.mcap", "--speed", 0.5)[0] == 0
    with Path("m.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        (schema, channel, _, message), *others = list(reader.iter_decoded_messages())
    assert not others
    assert (schema.name, channel.message_encoding) == ("trajectory_msgs/msg/JointTrajectory", "cdr")
    assert channel.metadata["notes"].startswith("NOT CHECKED: the cat")
    check_points(
        list(message.joint_names),
        [
            (
                p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec,
                list(p.positions),
                list(p.velocities),
                list(p.accelerations),
            )
            for p in message.points
        ],
    )


def test_csv_is_at_the_controllers_rate(export: Run) -> None:
    assert export("--to", "csv", "--out", "m.csv")[0] == 0
    table = pd.read_csv("m.csv", comment="#")
    assert list(table) == ["t [s]", "q1 [rad]", "q2 [rad]", "qd1 [rad/s]", "qd2 [rad/s]"]
    assert table["t [s]"][1] == 0.002
    assert len(table) == 1001
    np.testing.assert_allclose(table["q2 [rad]"], position(1, np.array(table["t [s]"])), atol=1e-9)


@pytest.mark.parametrize("unit", ["deg", "rad", "normalised"])
def test_lerobots_columns(export: Run, unit: str) -> None:
    status, out, _ = export("--to", "lerobot", "--out", "m.parquet", "--unit", unit, "--json", "-")
    assert (status, json.loads(out)["unit"]) == (0, unit)
    table = pq.read_table("m.parquet")
    t = np.array(table["timestamp"])
    assert table.column_names == ["action", "timestamp", "frame_index", "episode_index", "index", "task_index"]
    info = json.loads(table.schema.metadata[b"info"])
    assert (info["fps"], info["features"]["action"]["units"]) == (30.0, unit)
    assert info["features"]["action"]["names"] == ["base.pos", "elbow.pos"]
    np.testing.assert_allclose(t, np.array(table["frame_index"]) / 30, atol=1e-6)
    action = np.array(table["action"].to_pylist())
    truth = position(1, np.minimum(t, SECONDS))
    wanted = {"deg": np.degrees(truth), "rad": truth, "normalised": 200 * (truth + 2.0) / 5.0 - 100}[unit]
    np.testing.assert_allclose(action[:, 1], wanted, atol=1e-3)


def test_urscript_starts_only_at_the_start_and_stops_at_the_end(export: Run) -> None:
    status, _, err = export("--to", "urscript", "--out", "m.script")
    assert (status, err) == (2, "arm: URScript is for arms of six revolute joints\n")
    # What is written into a script stays on its line of comment.
    write(6, notes="# NOT CHECKED: \u202eend\x1b[2J\n")
    assert export("--to", "urscript", "--out", "m.script", "--lookahead", 0.05, "--gain", 500)[0] == 0
    lines = Path("m.script").read_text().splitlines()
    program = [line.strip() for line in lines if not line.startswith("#")]
    assert lines[0].isprintable()
    assert lines[0].endswith("\\u202eend\\x1b[2J")
    assert (program[0], program[-3:]) == ("def tendon_motion():", ["stopj(2)", "end", "tendon_motion()"])
    moves = [line for line in program if line.startswith("servoj(")]
    assert len(moves) == 251
    assert all(line.endswith("], 0, 0, t=0.008, lookahead_time=0.05, gain=500)") for line in moves)
    # Nothing moves before the pose has been looked at.
    assert program.index("halt") < program.index(moves[0])
    assert program[1] == "start = [0.10000000, -0.20000000, 0.10000000, -0.20000000, 0.10000000, -0.20000000]"
    at = np.array([json.loads(line[len("servoj(") : line.index("]") + 1]) for line in moves])
    np.testing.assert_allclose(at[:, 1], position(1, np.arange(251) * 0.008), atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--to", "urdf", "--out", "m.urdf"), "--to urdf: expected no MOTION; urdf, mjcf, bam are formats of arms"),
        (("--to", "lerobot", "--out", "m.csv"), "--out m.csv: expected a name that ends in .parquet"),
        (("--to", "lerobot", "--out", "m.parquet", "--unit", "turns"), "expected deg, rad, normalised"),
        (("--to", "csv", "--out", "motion.csv"), "motion.csv"),
    ],
)
def test_what_cannot_be_written(export: Run, arguments: tuple[str, ...], words: str) -> None:
    before = sorted((path.name, path.read_text()) for path in Path().iterdir())
    status, _, err = export(*arguments)
    assert status == 2
    assert words in err
    assert sorted((path.name, path.read_text()) for path in Path().iterdir()) == before


def test_a_motion_that_no_arm_may_make_is_not_written(export: Run) -> None:
    text = Path("motion.csv").read_text().splitlines()
    text[1000] = text[1000].replace(",", ",9", 1)
    Path("motion.csv").write_text("\n".join(text) + "\n")
    status, _, err = export("--to", "csv", "--out", "m.csv")
    assert status == 2
    assert "motion.csv line 1001: q1 " in err
    assert not Path("m.csv").exists()
