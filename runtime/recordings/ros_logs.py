"""Logs of ROS 2: MCAP files and SQLite bags. Of MCAP, chunks are read whole and messages found by their indices.

Source: the MCAP file format specification, version 0 (mcap.dev/spec).
"""

from __future__ import annotations

import mmap
import sqlite3
import struct
import zlib
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.recordings.contents import Refusal, require
from runtime.recordings.joint_state import TYPE, JointStateContents, JointStates, MessageBatch
from runtime.recordings.settings import LONGEST_RECORD, MAX_BYTES

MCAP = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX = 0x03, 0x04, 0x05, 0x06, 0x07
_METADATA, _DATA_END = 0x0C, 0x0F
_RECORD = struct.Struct("<BQ")
"""Head of a record: kind and length."""
_CURE = "repair it with: mcap recover FILE"
_MESSAGE_HEAD = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("logged", "<u8"), ("published", "<u8")])


@dataclass
class _Log:
    """What is known of a file: schema number -> name, channel -> (topic, schema, encoding), decompressed bytes, and
    what its metadata say that torques are."""

    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, tuple[str, int, str]] = field(default_factory=dict)
    unpacked: int = 0
    torque: str = ""

    def declare(self, kind: int, content: memoryview) -> None:
        """Adds a schema, a channel, or an entry torque of the metadata. Raises struct.error, ValueError."""
        if kind == _METADATA:
            self.torque = _entries(content).get("torque", self.torque)
            return
        (number,) = struct.unpack_from("<H", content)
        if kind == _SCHEMA:
            self.schemas[number], _ = _text(content, 2)
        elif kind == _CHANNEL:
            (schema,) = struct.unpack_from("<H", content, 2)
            topic, place = _text(content, 4)
            encoding, _ = _text(content, place)
            self.channels[number] = (topic, schema, encoding)

    def types(self) -> dict[str, str]:
        """Topic -> type, and its encoding where that is not ROS 2's."""
        known = [(topic, self.schemas.get(schema, "no schema"), form) for topic, schema, form in self.channels.values()]
        return {topic: kind if form == "cdr" else f"{kind} in {form}" for topic, kind, form in known}

    def is_wanted(self, channel: int) -> bool:
        _, schema, encoding = self.channels.get(channel, ("", 0, ""))
        return self.schemas.get(schema) in TYPE and encoding == "cdr"


def open_mcap(path: Path, refuse: Refusal) -> JointStateContents:
    """The joint states of an MCAP file. Raises RecordingError."""
    log = _Log()
    with refuse.on((struct.error, ValueError), "the MCAP file is damaged", _CURE), open(path, "rb") as file:
        # Not closed here: arrays refer to it.
        data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        states = JointStates(_mcap_batches(data, log, refuse), refuse)
    return replace(states.contents("MCAP", log.types()), torque=log.torque)


def _mcap_batches(data: memoryview, log: _Log, refuse: Refusal) -> Iterator[MessageBatch]:
    """The joint states, a chunk at a time; chunks without an index are read record by record."""
    loose: list[tuple[int, int, int]] = []
    chunk: memoryview | None = None
    indexed = False
    for kind, content, start in _records(data, len(MCAP), refuse):
        if kind == _INDEX and chunk is not None:
            if struct.unpack_from("<H", content)[0] not in log.channels:
                _declared_in(chunk, log, refuse, whole=True)
            yield from _indexed(chunk, content, log)
            indexed = True
            continue
        if chunk is not None and not indexed:
            yield from _listed(chunk, _declared_in(chunk, log, refuse, whole=True), log)
        chunk = None
        if kind == _CHUNK:
            chunk, indexed = _unpacked(content, log, refuse), False
            _declared_in(chunk, log, refuse, whole=False)
        elif kind in (_SCHEMA, _CHANNEL, _METADATA):
            log.declare(kind, content)
        elif kind == _MESSAGE:
            loose.append((struct.unpack_from("<H", content)[0], start, len(content)))
        elif kind == _DATA_END:
            break
    else:
        refuse(f"the MCAP file is cut off before its end; {_CURE}")
    yield from _listed(data, loose, log)


def _listed(data: memoryview, messages: list[tuple[int, int, int]], log: _Log) -> Iterator[MessageBatch]:
    for channel in dict.fromkeys(c for c, _, _ in messages):
        places = np.array([(start, size) for c, start, size in messages if c == channel])
        yield from _of_channel(np.frombuffer(data, np.uint8), channel, places[:, 0], lengths=places[:, 1], log=log)


def _records(data: memoryview, place: int, refuse: Refusal) -> Iterator[tuple[int, memoryview, int]]:
    """Kind and content of each record from a place on, and the place of its content."""
    while place < len(data):
        start = place + _RECORD.size
        if start > len(data):
            refuse(f"the MCAP file is cut off before its end; {_CURE}")
        kind, length = _RECORD.unpack_from(data, place)
        if length > len(data) - start:
            left = len(data) - start
            refuse(
                f"the MCAP file is cut off: a record at byte {place} has {length} bytes, and {left} are left; {_CURE}"
            )
        yield kind, data[start : start + length], start
        place = start + length


def _text(content: memoryview, place: int) -> tuple[str, int]:
    (size,) = struct.unpack_from("<I", content, place)
    end = place + 4 + size
    if end > len(content):
        raise ValueError(f"a text of {size} bytes where {len(content) - place - 4} are left")
    return bytes(content[place + 4 : end]).decode("utf-8"), end


def _entries(content: memoryview) -> dict[str, str]:
    """The entries of a metadata record. Raises struct.error, ValueError."""
    _, place = _text(content, 0)
    (size,) = struct.unpack_from("<I", content, place)
    place += 4
    end, found = place + size, dict[str, str]()
    while place < end:
        key, place = _text(content, place)
        found[key], place = _text(content, place)
    return found


def _unpacked(content: memoryview, log: _Log, refuse: Refusal) -> memoryview:
    """The records of a chunk, decompressed; at most as many bytes as it states, within the limits."""
    _, _, size, checksum = struct.unpack_from("<QQQI", content)
    packing, place = _text(content, 28)
    (packed,) = struct.unpack_from("<Q", content, place)
    records = content[place + 8 : place + 8 + packed]
    log.unpacked += size
    if size > LONGEST_RECORD or log.unpacked > 8 * MAX_BYTES or len(records) < packed:
        refuse(f"the MCAP file has a chunk that states {size} bytes, more than the limit or the file; {_CURE}")
    damage = "the MCAP file has a damaged chunk"
    if packing == "":
        unpacked = records
    elif packing == "lz4":
        require("lz4", "mcap", "an MCAP file compressed with lz4", refuse)
        from lz4.frame import LZ4FrameDecompressor

        with refuse.on((RuntimeError,), damage, _CURE):
            unpacked = memoryview(LZ4FrameDecompressor().decompress(records, max_length=size))
    elif packing == "zstd":
        require("zstandard", "mcap", "an MCAP file compressed with zstd", refuse)
        from zstandard import ZstdDecompressor, ZstdError

        reader = ZstdDecompressor(max_window_size=LONGEST_RECORD).stream_reader(records)
        with refuse.on((ZstdError, MemoryError), damage, _CURE), reader:
            unpacked = memoryview(reader.read(size))
    else:
        refuse(f"the MCAP file is compressed with {packing}; expected lz4, zstd or none")
    if len(unpacked) != size or (checksum and zlib.crc32(unpacked) != checksum):
        refuse(f"{damage}; {_CURE}")
    return unpacked


def _declared_in(chunk: memoryview, log: _Log, refuse: Refusal, whole: bool) -> list[tuple[int, int, int]]:
    """Declares the schemas and channels of a chunk, up to its first message or in all of it.

    Returns channel, place and length of the messages; see `_listed`.
    """
    found: list[tuple[int, int, int]] = []
    for kind, content, start in _records(chunk, 0, refuse):
        if kind in (_SCHEMA, _CHANNEL):
            log.declare(kind, content)
        elif kind == _MESSAGE:
            if not whole:
                break
            found.append((struct.unpack_from("<H", content)[0], start, len(content)))
    return found


def _indexed(chunk: memoryview, content: memoryview, log: _Log) -> Iterator[MessageBatch]:
    """The messages of one channel in a chunk, by its index."""
    channel, size = struct.unpack_from("<HI", content)
    if not log.is_wanted(channel):
        return
    entries = np.frombuffer(content[6 : 6 + size], "<u8").reshape(-1, 2)
    starts = entries[:, 1].astype(np.int64)
    buffer = np.frombuffer(chunk, np.uint8)
    if len(starts) and (starts.min() < 0 or int(starts.max()) + _RECORD.size + _MESSAGE_HEAD.itemsize > len(buffer)):
        raise ValueError("an index points outside its chunk")
    lengths = _gathered(buffer, starts + 1, 8).view("<u8")[:, 0].astype(np.int64)
    yield from _of_channel(buffer, channel, starts + _RECORD.size, lengths=lengths, log=log)


def _of_channel(
    buffer: NDArray[np.uint8], channel: int, starts: NDArray[np.int64], lengths: NDArray[np.int64], log: _Log
) -> Iterator[MessageBatch]:
    """Messages of a channel at these places, in the order in which they were logged."""
    if not log.is_wanted(channel) or not len(starts):
        return
    if lengths.min() < _MESSAGE_HEAD.itemsize or int((starts + lengths).max()) > len(buffer) or lengths.max() < 0:
        raise ValueError("a message is longer than its chunk")
    heads = _gathered(buffer, starts, _MESSAGE_HEAD.itemsize).view(_MESSAGE_HEAD)[:, 0]
    if np.any(heads["channel"] != channel):
        raise ValueError("an index names messages of another channel")
    topic = log.channels[channel][0]
    times = heads["logged"].astype(np.int64)
    yield MessageBatch(
        topic, buffer, starts + _MESSAGE_HEAD.itemsize, lengths=lengths - _MESSAGE_HEAD.itemsize, times=times
    )


def _gathered(buffer: NDArray[np.uint8], starts: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
    """(N, size) bytes from each of these places."""
    return np.lib.stride_tricks.sliding_window_view(buffer, size)[starts]


SQLITE = b"SQLite format 3\0"
_AT_ONCE = 10_000
"""Messages read from the database at a time."""


def open_sqlite_bag(path: Path, refuse: Refusal) -> JointStateContents:
    """The joint states of a bag. Raises RecordingError."""
    damage = (sqlite3.Error, ValueError, TypeError, OverflowError, MemoryError)
    with (
        refuse.on(damage, "the SQLite file is damaged or is not a ROS 2 bag", "copy it again"),
        closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as bag,
    ):
        bag.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_RECORD)
        if bag.execute(_TABLES).fetchone() != (2,):
            refuse("is a SQLite file without the tables topics and messages; expected a ROS 2 bag")
        topics = {int(n): (str(name), str(kind), str(form)) for n, name, kind, form in bag.execute(_TOPICS)}
        states = JointStates(_bag_batches(bag, topics, refuse), refuse)
    return states.contents("ROS 2 bag", {name: kind for name, kind, _ in topics.values()})


_TABLES = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name IN ('topics', 'messages')"
"""Tables only: a view may be an endless query."""
_TOPICS = "SELECT id, name, type, serialization_format FROM topics"
_MESSAGES = "SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY timestamp"


def _bag_batches(
    bag: sqlite3.Connection, topics: dict[int, tuple[str, str, str]], refuse: Refusal
) -> Iterator[MessageBatch]:
    for number, (topic, kind, form) in topics.items():
        if kind not in TYPE or form != "cdr":
            continue
        rows = bag.execute(_MESSAGES, (number,))
        while some := rows.fetchmany(_AT_ONCE):
            if not all(isinstance(data, bytes) and isinstance(time, int) for time, data in some):
                refuse("has messages that are not bytes with a time; expected a ROS 2 bag")
            lengths = np.array([len(data) for _, data in some])
            buffer = np.frombuffer(b"".join(data for _, data in some), np.uint8)
            times = np.array([time for time, _ in some], dtype=np.int64)
            yield MessageBatch(topic, buffer, np.cumsum(lengths) - lengths, lengths=lengths, times=times)
