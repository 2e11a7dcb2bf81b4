"""Recordings in other formats, written by the programs that own them."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as PlainWriter
from mcap_ros2.writer import Writer

from runtime.arrays import Array
from symbolic.model_file.arm import DescribedJoint


def joint(kind: Literal["revolute", "prismatic"] = "revolute", **given: Any) -> DescribedJoint:
    """A joint as far as a reader of recordings needs it."""
    return DescribedJoint(kind, None, 1.0, **given)


JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
EPOCH = 1_700_000_000_000_000_000
"""ns; the first stamp of a log."""


def motion(samples: int = 600, joints: int = 2, rate: float = 1000.0, start: float = 0.0) -> dict[str, Array]:
    """t (N,), and q, qd, tau (joints, N) of a sway."""
    t = start + np.arange(samples) / rate
    phase = np.arange(joints)[:, None]
    q, qd = np.sin(20 * t + phase), 20 * np.cos(20 * t + phase)
    return {"t": t, "q": q, "qd": qd, "tau": 0.3 * qd + 2 * np.sign(qd)}


def message(names: Sequence[str], ns: int, k: int, signals: Mapping[str, Array], frame: str = "base") -> dict[str, Any]:
    """A JointState of sample k."""
    ros = {"q": "position", "qd": "velocity", "tau": "effort"}
    numbers = {word: signals[name][:, k].tolist() if name in signals else [] for name, word in ros.items()}
    stamp = {"sec": ns // 10**9, "nanosec": ns % 10**9}
    return {"header": {"stamp": stamp, "frame_id": frame}, "name": list(names), **numbers}


def write_mcap(
    path: Path,
    streams: Sequence[tuple[str, Sequence[str], Mapping[str, Array]]],
    compression: CompressionType = CompressionType.ZSTD,
    **options: Any,
) -> Path:
    """Joint states: of each stream its topic, the names of the joints, and t with some of q, qd, tau."""
    with open(path, "wb") as file:
        writer = Writer(file, compression=compression, **options)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        todo = [
            (EPOCH + round(float(t) * 1e9), stream, k)
            for stream, (_, _, signals) in enumerate(streams)
            for k, t in enumerate(signals["t"])
        ]
        for ns, stream, k in sorted(todo):
            topic, names, signals = streams[stream]
            writer.write_message(topic, schema, message(names, ns, k, signals), log_time=ns + 1000, publish_time=ns)
        writer.finish()
    return path


def write_bare_mcap(path: Path, names: Sequence[str], signals: Mapping[str, Array], **options: Any) -> Path:
    """A log as other writers lay it out: without chunks, or without indices."""
    with open(path, "wb") as file:
        writer = PlainWriter(file, **options)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", JOINT_STATE.encode())
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for k, t in enumerate(signals["t"]):
            ns = EPOCH + round(float(t) * 1e9)
            writer.add_message(channel, ns, cdr(names, ns, k, signals), ns)
        writer.finish()
    return path


def cdr(names: Sequence[str], ns: int, k: int, signals: Mapping[str, Array], frame: str = "base") -> bytes:
    """A JointState as bytes, by the official encoder."""
    from mcap_ros2._dynamic import serialize_dynamic

    encode = serialize_dynamic("sensor_msgs/msg/JointState", JOINT_STATE)["sensor_msgs/msg/JointState"]
    return bytes(encode(message(names, ns, k, signals, frame)))


def write_sqlite(path: Path, topic: str, names: Sequence[str], signals: Mapping[str, Array]) -> Path:
    """A bag as rosbag2's SQLite plug-in lays it out."""
    bag = sqlite3.connect(path)
    bag.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    bag.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    bag.execute("INSERT INTO topics VALUES (1, ?, 'sensor_msgs/msg/JointState', 'cdr')", (topic,))
    bag.execute("INSERT INTO topics VALUES (2, '/rosout', 'rcl_interfaces/msg/Log', 'cdr')")
    stamps = [EPOCH + round(float(t) * 1e9) for t in signals["t"]]
    rows = [(1, ns, cdr(names, ns, k, signals)) for k, ns in enumerate(stamps)]
    bag.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    bag.commit()
    bag.close()
    return path
