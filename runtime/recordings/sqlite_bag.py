"""Bags of ROS 2 in SQLite, as `ros2 bag record` wrote them before MCAP."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from runtime.recordings.errors import Refusal
from runtime.recordings.joint_state import TYPE, JointStateContents, MessageBatch, collected
from runtime.recordings.settings import LONGEST_RECORD

MAGIC = b"SQLite format 3\0"
_AT_ONCE = 10_000
"""messages that are held packed at a time."""


def opened(path: Path, refuse: Refusal) -> JointStateContents:
    """The joint states of a bag. Raises RecordingError."""
    damage = (sqlite3.Error, ValueError, TypeError, OverflowError, MemoryError)
    with (
        refuse.on(damage, "the SQLite file is damaged, or no bag of ROS 2", "copy it again"),
        closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as bag,
    ):
        bag.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_RECORD)
        topics = {int(n): (str(name), str(kind), str(form)) for n, name, kind, form in bag.execute(_TOPICS)}
        states = collected(_batches(bag, topics, refuse), refuse)
    return states.contents("ROS 2 bag", {name: kind for name, kind, _ in topics.values()})


_TOPICS = "SELECT id, name, type, serialization_format FROM topics"
_MESSAGES = "SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY timestamp"


def _batches(
    bag: sqlite3.Connection, topics: dict[int, tuple[str, str, str]], refuse: Refusal
) -> Iterator[MessageBatch]:
    for number, (topic, kind, form) in topics.items():
        if kind not in TYPE or form != "cdr":
            continue
        rows = bag.execute(_MESSAGES, (number,))
        while some := rows.fetchmany(_AT_ONCE):
            if not all(isinstance(data, bytes) and isinstance(time, int) for time, data in some):
                refuse("holds messages that are no bytes with a time; expected a bag of ROS 2")
            lengths = np.array([len(data) for _, data in some])
            buffer = np.frombuffer(b"".join(data for _, data in some), np.uint8)
            times = np.array([time for time, _ in some], dtype=np.int64)
            yield MessageBatch(topic, buffer, np.cumsum(lengths) - lengths, lengths, times)
