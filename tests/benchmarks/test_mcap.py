"""A million JointState messages from MCAP, beside the official reader: the same numbers, in a part of its time."""

from __future__ import annotations

import struct
import time
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory

from runtime.arrays import Array
from runtime.recordings.recording import read
from tests.benchmarks import harness
from tests.runtime.recordings.formats import EPOCH, JOINT_STATE, cdr, motion

MESSAGES = harness.sized(1_000_000, 20_000)
OFFICIAL = 20_000
"""messages that the official reader decodes; its time a message does not depend on their number."""
JOINTS = 6
MOST_SECONDS = 2.0
"""of processor time, for a million messages."""


def written(path: Path, signals: dict[str, Array]) -> Path:
    """Messages as the official encoder lays them out: one of them, with the numbers of each put into their places."""
    names = [f"joint_{k}" for k in range(JOINTS)]
    marks = {"q": 1.25, "qd": 2.25, "tau": 3.25}
    one = cdr(names, EPOCH, 0, {name: np.full((JOINTS, 1), mark) for name, mark in marks.items()})
    places = {name: one.index(struct.pack("<d", mark)) for name, mark in marks.items()}
    rows = {name: np.ascontiguousarray(signals[name].T) for name in marks}
    body = bytearray(one)
    with open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", JOINT_STATE.encode())
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for k, t in enumerate(signals["t"]):
            ns = EPOCH + round(float(t) * 1e9)
            struct.pack_into("<iI", body, 4, ns // 10**9, ns % 10**9)
            for name, place in places.items():
                body[place : place + 8 * JOINTS] = rows[name][k].tobytes()
            writer.add_message(channel, ns, bytes(body), ns)
        writer.finish()
    return path


def test_a_million_messages(tmp_path: Path) -> None:
    signals = motion(MESSAGES, JOINTS)
    path = written(tmp_path / "run.mcap", signals)
    costs = []
    for _ in range(3):
        began = time.process_time()
        recording = read(path, None)
        costs.append(time.process_time() - began)
    assert all(np.array_equal(getattr(recording, name), signals[name]) for name in ("q", "qd", "tau"))
    began = time.process_time()
    with open(path, "rb") as file:
        messages = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        official = [message for (*_, message), _ in zip(messages, range(OFFICIAL), strict=False)]
    slow = (time.process_time() - began) * MESSAGES / len(official)
    for name, word in (("q", "position"), ("qd", "velocity"), ("tau", "effort")):
        numbers = np.array([getattr(message, word) for message in official]).T
        assert np.array_equal(getattr(recording, name)[:, : len(official)], numbers)
    harness.show(
        f"{MESSAGES} JointState messages of {JOINTS} joints, zstd",
        ("", "s of processor time", "us a message"),
        [(who, f"{s:.3g}", f"{1e6 * s / MESSAGES:.3g}") for who, s in (("Tendon", min(costs)), ("official", slow))],
        (f"the official reader's from {len(official)} messages",),
    )
    if not harness.SHORT:
        assert min(costs) < MOST_SECONDS
