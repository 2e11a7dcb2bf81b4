"""Joint states of several senders, out of order, twice, without a stamp, one joint a message: from MCAP and bags."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer

from runtime.arrays import Array
from runtime.recordings.columns import RecordedArm
from runtime.recordings.recording import RecordingError, read
from tests.runtime.recordings.formats import EPOCH, JOINT_STATE, cdr, joint, motion

NAMES = ("shoulder", "elbow")
ARM = RecordedArm(tuple(joint(name=name) for name in NAMES), space=True)
M = motion(700, rate=250.0)
SILENT = {**M, "tau": 0 * M["tau"]}


class Sent(NamedTuple):
    """A message: sample k of some signals; ns after EPOCH at which it was logged, and its stamp."""

    k: int
    signals: dict[str, Array] = M
    frame: str = "a"
    names: Sequence[str] = NAMES
    late: int = 0
    stamp: int | None = None

    @property
    def logged(self) -> int:
        return EPOCH + round(float(M["t"][self.k]) * 1e9) + self.late

    @property
    def data(self) -> bytes:
        stamp = self.logged if self.stamp is None else self.stamp
        return cdr(self.names, stamp, self.k, self.signals, self.frame)


def as_mcap(path: Path, messages: Sequence[Sent], compression: CompressionType = CompressionType.ZSTD) -> Path:
    with open(path, "wb") as file:
        writer = Writer(file, compression=compression, chunk_size=8000)._writer
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", JOINT_STATE.encode())
        channel = writer.register_channel("/js", "cdr", schema)
        for m in messages:
            writer.add_message(channel, m.logged, m.data, m.logged)
        writer.finish()
    return path


def as_bag(path: Path, messages: Sequence[Sent]) -> Path:
    path.unlink(missing_ok=True)
    bag = sqlite3.connect(path)
    bag.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    bag.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    bag.execute("INSERT INTO topics VALUES (1, '/js', 'sensor_msgs/msg/JointState', 'cdr')")
    rows = [(m.logged, m.data) for m in messages]
    bag.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", rows)
    bag.commit()
    bag.close()
    return path


@pytest.fixture(params=[as_mcap, as_bag])
def log(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[Sequence[Sent]], Path]:
    return lambda messages: request.param(tmp_path / "a.log", sorted(messages, key=lambda m: m.logged))


EVERY = [Sent(k) for k in range(700)]


def refused(path: Path, **options: bool) -> str:
    with pytest.raises(RecordingError) as caught:
        read(path, ARM, **options)
    return str(caught.value)


def check_kept(path: Path) -> None:
    """With gaps allowed, the messages of the one sender are left, and no gap."""
    r = read(path, ARM, allow_gaps=True)
    assert np.array_equal(r.tau, M["tau"])
    assert r.segments == (slice(0, 700),)


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(1, 12), st.sampled_from(["a", "", "elsewhere"]), st.integers(0, 3_900_000), st.booleans())
def test_a_second_sender_without_torque(log, every: int, frame: str, late: int, regular: bool) -> None:
    chosen = np.random.default_rng(every).random(700) < 1 / every
    ks = range(0, 700, every) if regular else np.flatnonzero(chosen)
    path = log([*EVERY, *(Sent(int(k), SILENT, frame, late=late + 1) for k in ks)])
    said = refused(path)
    assert "/js message " in said
    assert ": two senders publish these joints: " in said
    assert f"torque is exactly 0 in {f'every {every + 1}th' if regular and every > 2 else ''}" in said
    assert f"{len(ks)} of {700 + len(ks)} messages" in said
    assert (f'frame_id is "a" in 700 and "{frame}" in {len(ks)} of ' in said) == (frame != "a")
    check_kept(path)


@pytest.mark.parametrize("lacks", ["tau", "qd"])
def test_a_second_sender_that_leaves_an_array_empty(log, lacks: str) -> None:
    fewer = {name: x for name, x in M.items() if name != lacks}
    path = log([*EVERY, *(Sent(k, fewer, late=900) for k in range(0, 700, 3))])
    assert f"{'effort' if lacks == 'tau' else 'velocity'} is empty in every 4th message, 234 of 934" in refused(path)
    check_kept(path)


def test_three_senders(log) -> None:
    others = [Sent(k, SILENT, frame, late=900 * ord(frame)) for frame in "bc" for k in range(0, 700, 2)]
    path = log([*EVERY, *others])
    assert ': 3 senders publish these joints: frame_id is "a" in 700' in refused(path)
    check_kept(path)


@pytest.mark.parametrize("every", [1, 2, 5])
def test_positions_of_two_sources(log, every: int) -> None:
    """Nothing says which is right, so that leaving rows out is no answer."""
    apart = {**M, "q": M["q"] + 1.0}
    path = log([*EVERY, *(Sent(k, apart, late=2_000_000) for k in range(0, 700, every))])
    assert "two senders publish these joints: the positions of every" in refused(path)
    assert "--allow-gaps" not in refused(path, allow_gaps=True)


def test_what_is_no_second_sender(log) -> None:
    """Other joints, another text in every message, a coarse torque around 0; nor a torque that ends, which is no
    torque."""
    off = {**M, "tau": M["tau"] * (M["t"] < 2)}
    coarse = {**M, "tau": 3.0 * np.round(M["tau"] / 6)}
    arm = [Sent(k, SILENT, names=("left", "right"), late=500) for k in range(700)]
    counted = [Sent(k, frame=f"{k:06d}") for k in range(700)]
    assert "tau1 is 0 beside" in refused(log([Sent(k, off) for k in range(700)]))
    for messages in ([*EVERY, *arm], counted, [Sent(k, coarse) for k in range(700)]):
        log_file = log(messages)
        assert read(log_file, ARM).q.shape == (2, 700)
        log_file.unlink()


def test_messages_twice(log) -> None:
    r = read(log([*EVERY, *(Sent(k, frame="b") for k in range(0, 700, 2))]), ARM)
    assert np.array_equal(r.q, M["q"])
    assert r.notes == ("/js: left out 350 messages that repeat the one before, with its stamp",)


@pytest.mark.parametrize(("unset", "start", "left"), [(1, 0, 700), (3, 0, 698), (3, EPOCH, 697), (700, EPOCH, 700)])
def test_stamps_of_zero(log, unset: int, start: int, left: int) -> None:
    """A simulated clock begins at 0; where no stamp was set, the log's times count."""
    messages = [Sent(k, stamp=start + 4_000_000 * k if k >= unset else 0) for k in range(700)]
    r = read(log(messages), ARM)
    assert np.array_equal(r.q, M["q"][:, 700 - left :])
    assert r.dt == pytest.approx(0.004)
    assert r.segments == (slice(0, left),)
    assert r.notes


@pytest.mark.parametrize("compression", CompressionType)
def test_a_file_in_another_order_than_its_log(tmp_path: Path, compression: CompressionType) -> None:
    shuffled = [EVERY[k] for k in (*range(300, 700), *range(300))]
    r = read(as_mcap(tmp_path / "a.mcap", shuffled, compression), ARM)
    assert np.array_equal(r.tau, M["tau"])
    assert r.notes == ("/js: its messages are put in the order of their log time",)


def test_messages_that_came_late(log) -> None:
    late = [Sent(k, late=9_000_000 * (k in (100, 400)), stamp=m.logged) for k, m in enumerate(EVERY)]
    r = read(log(late), ARM)
    assert np.array_equal(r.q, M["q"])
    assert "2 messages that came late" in r.notes[0]
    back = [Sent(k, stamp=m.logged - (10**9 if k > 400 else 0)) for k, m in enumerate(EVERY)]
    assert "time runs backwards" in refused(as_bag(log(EVERY).with_name("b.log"), back))


@pytest.mark.parametrize("apart", [0, 300_000])
def test_one_joint_a_message(log, apart: int) -> None:
    def single(j: int) -> list[Sent]:
        own = {name: x if name == "t" else x[j : j + 1] for name, x in M.items()}
        return [Sent(k, own, names=NAMES[j : j + 1], late=j * apart) for k in range(700)]

    r = read(log([*single(0), *single(1)]), ARM)
    inside = slice(1 if apart else 0, None)
    assert np.array_equal(r.q[0], M["q"][0, inside])
    assert r.q[1][5:] == pytest.approx(np.sin(20 * (M["t"][inside][5:] - apart * 1e-9) + 1), abs=1e-5)
    assert "one joint a message" in r.notes[0]
