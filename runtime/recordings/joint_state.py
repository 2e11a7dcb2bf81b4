"""Messages of ROS 2, `sensor_msgs/msg/JointState` in CDR, decoded many at once.

Messages of one node differ only in stamp and numbers. The first message gives the layout; all messages with this layout
are read as columns of one matrix of bytes, the others with a layout of their own.

Source: OMG, DDS Interoperability Wire Protocol 2.5, 10.2 (CDR); ROS 2 common_interfaces, JointState.msg.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from runtime.recordings.contents import Array, RecordedField, Refusal, Samples
from runtime.recordings.settings import LARGEST_MATRIX, MAX_BYTES, MOST_LAYOUTS, MOST_SENDERS
from runtime.recordings.streams import ARRAYS, HEAD, JointStream, streams_of

TYPE = frozenset(("sensor_msgs/msg/JointState", "sensor_msgs/JointState"))
_SIGNALS = dict(zip(ARRAYS, ("q", "qd", "tau"), strict=True))
_ENCAPSULATION = 4
"""Bytes that state the encoding before a message; alignment counts from after them."""
_STAMP = 8
_NUMBER = 8


@dataclass(frozen=True)
class MessageBatch:
    """Messages of one topic: message k is buffer[starts[k] : starts[k] + lengths[k]], logged at times[k] ns."""

    topic: str
    buffer: NDArray[np.uint8]
    starts: NDArray[np.int64]
    lengths: NDArray[np.int64]
    times: NDArray[np.int64]


@dataclass(frozen=True)
class Layout:
    """The places of a message's parts.

    order    byte order, as in struct
    joints   names in the message's order
    at       place of the first number of position, velocity and effort; None without numbers
    frame    places of the bytes of frame_id
    fixed    places of the bytes that are equal in all messages of this layout
    """

    order: str
    joints: tuple[str, ...]
    at: tuple[int | None, ...]
    frame: slice
    fixed: NDArray[np.intp]

    @classmethod
    def of(cls, message: bytes) -> Layout:
        """The layout of one message. Raises ValueError, struct.error."""
        if message[:1] != b"\0" or message[1] not in (0, 1):
            raise ValueError(f"its encoding is {message[:2].hex()}; expected plain CDR (0000 or 0001)")
        order = "<" if message[1] else ">"
        place = _ENCAPSULATION + _STAMP
        texts = []
        size, place = _count(message, place, order)
        fixed = [np.arange(2), np.arange(place - 4, place)]
        frame = slice(place, place + size)
        place += size
        first = place
        count, place = _count(message, place, order)
        if count > LARGEST_MATRIX:
            raise ValueError(f"it has {count} joints; expected at most {LARGEST_MATRIX}")
        for _ in range(count):
            text, place = _text(message, place, order)
            texts.append(text)
        if len(set(texts)) < len(texts):
            raise ValueError("two of its joints have the same name")
        fixed.append(np.arange(first, place))
        at = []
        for name in _SIGNALS:
            before = place
            size, place = _count(message, place, order)
            fixed.append(np.arange(before, place))
            if size not in (0, count):
                raise ValueError(f"it has {count} joints and {size} numbers of {name}")
            place += -(place - _ENCAPSULATION) % _NUMBER if size else 0
            at.append(place if size else None)
            place += _NUMBER * size
        if place > len(message):
            raise ValueError("it is cut off")
        return cls(order, tuple(texts), tuple(at), frame, np.concatenate(fixed))


def _count(message: bytes, place: int, order: str) -> tuple[int, int]:
    place += -(place - _ENCAPSULATION) % 4
    return struct.unpack_from(f"{order}I", message, place)[0], place + 4


def _text(message: bytes, place: int, order: str) -> tuple[str, int]:
    size, place = _count(message, place, order)
    if size > len(message) - place:
        raise ValueError(f"a text of {size} bytes in a message of {len(message)}")
    return message[place : place + size].rstrip(b"\0").decode("utf-8"), place + size


class JointStates:
    """The JointState messages of a log, decoded batch by batch. Raises RecordingError."""

    def __init__(self, batches: Iterable[MessageBatch], refuse: Refusal) -> None:
        self.refuse = refuse
        self._parts: dict[tuple[str, frozenset[str]], list[JointStream]] = {}
        self._counted: dict[str, int] = {}
        self._layouts: dict[str, list[Layout]] = {}
        self._frames: dict[bytes, int] = {}
        self._bytes = 0
        for batch in batches:
            self._add(batch)

    def _add(self, batch: MessageBatch) -> None:
        first = self._counted.get(batch.topic, 0) + 1
        self._counted[batch.topic] = first + len(batch.starts) - 1
        numbers = first + np.arange(len(batch.starts))
        for length in np.unique(batch.lengths):
            alike = batch.lengths == length
            self._of_one_length(
                batch, int(length), batch.starts[alike], times=batch.times[alike], numbers=numbers[alike]
            )

    def _of_one_length(
        self,
        batch: MessageBatch,
        length: int,
        starts: NDArray[np.int64],
        times: NDArray[np.int64],
        numbers: NDArray[np.int64],
    ) -> None:
        rows = np.lib.stride_tricks.sliding_window_view(batch.buffer, length)[starts] if length else None
        for _ in range(MOST_LAYOUTS):
            if rows is None or length < _ENCAPSULATION + _STAMP:
                self.refuse(f"has {length} bytes; expected a JointState", f"{batch.topic} message {numbers[0]}")
            layout = self._layout(rows[0].tobytes(), batch.topic, int(numbers[0]))
            same = np.all(rows[:, layout.fixed] == rows[0, layout.fixed], axis=1)
            whole = bool(same.all())
            self._keep(batch.topic, layout, rows if whole else rows[same], times=times[same], numbers=numbers[same])
            if whole:
                return
            rows, times, numbers = rows[~same], times[~same], numbers[~same]
        self._too_many(batch.topic)

    def _layout(self, message: bytes, topic: str, number: int) -> Layout:
        known = self._layouts.setdefault(topic, [])
        try:
            found = Layout.of(message)
        except (ValueError, struct.error, IndexError) as error:
            self.refuse(f"is not a complete JointState: {error}", f"{topic} message {number}")
        if not any(found.joints == layout.joints for layout in known):
            known.append(found)
        if len(known) > MOST_LAYOUTS:
            self._too_many(topic)
        return found

    def _too_many(self, topic: str) -> NoReturn:
        self.refuse(
            f"has messages with more than {MOST_LAYOUTS} different lists of joints; expected one list for each node",
            topic,
        )

    def _keep(
        self, topic: str, layout: Layout, rows: NDArray[np.uint8], times: NDArray[np.int64], numbers: NDArray[np.int64]
    ) -> None:
        stamp = np.ascontiguousarray(rows[:, _ENCAPSULATION : _ENCAPSULATION + _STAMP])
        seconds = stamp.view(f"{layout.order}i4")[:, 0].astype(np.int64)
        nanoseconds = stamp.view(f"{layout.order}u4")[:, 1].astype(np.int64)
        stamps = seconds * 1_000_000_000 + nanoseconds
        values = {}
        for name, place in zip(_SIGNALS, layout.at, strict=True):
            if place is not None:
                block = np.ascontiguousarray(rows[:, place : place + _NUMBER * len(layout.joints)])
                values[name] = np.ascontiguousarray(block.view(f"{layout.order}f8").T, dtype=np.float64)
        self._bytes += sum(x.nbytes for x in values.values()) + 5 * stamps.nbytes
        if self._bytes > MAX_BYTES:
            self.refuse(f"has more than {MAX_BYTES // 10**9} GB of joint states; split it into several recordings")
        head = np.zeros(len(stamps), HEAD)
        head["stamp"], head["logged"], head["number"] = stamps, times, numbers
        head["frame"] = self._frame(rows[:, layout.frame])
        head["filled"] = sum(1 << k for k, name in enumerate(ARRAYS) if name in values)
        part = JointStream(topic, topic, layout.joints, head, values)
        self._parts.setdefault((topic, frozenset(layout.joints)), []).append(part)

    def _frame(self, texts: NDArray[np.uint8]) -> NDArray[np.int64]:
        """(N,) numbers of texts (N, M); −1 where there are too many for one to be a sender's."""
        found, which = [texts[0].tobytes()], np.zeros(len(texts), dtype=np.intp)
        if not (texts == texts[0]).all():
            whole = np.ascontiguousarray(texts).view(f"S{texts.shape[1]}")[:, 0]
            each, which = np.unique(whole, return_inverse=True)
            found = each.tolist()
        if len(found) > MOST_SENDERS:
            return np.full(len(texts), -1)
        return np.array([self._frames.setdefault(t.rstrip(b"\0"), len(self._frames)) for t in found])[which]

    def contents(self, format: str, others: Mapping[str, str]) -> JointStateContents:
        """The collected messages. others: all topics and their types, for the message if there are no joint states."""
        if not self._parts:
            listed = ", ".join(f"{topic} ({kind})" for topic, kind in list(others.items())[:8])
            self.refuse(f"has no messages of sensor_msgs/msg/JointState in CDR; its topics are {listed or 'none'}")
        frames = [text.decode("utf-8", "replace") for text in self._frames]
        streams = []
        for topic in dict.fromkeys(topic for topic, _ in self._parts):
            own = [part for (t, _), parts in self._parts.items() if t == topic for part in parts]
            streams += streams_of([replace(part, frames=frames) for part in own])
        notes = tuple(dict.fromkeys(note for stream in streams for note in stream.notes))
        return JointStateContents(format, tuple(streams), notes=notes)


@dataclass(frozen=True)
class JointStateContents:
    """Each topic is a clock; `/joint_states.position.elbow` is the position of the joint elbow.

    Times count from the first stamp of all topics, so that a float resolves nanoseconds.
    """

    format: str
    streams: tuple[JointStream, ...]
    header: str = ""
    torque: str = ""
    notes: Sequence[str] = ()

    @cached_property
    def _index(self) -> list[tuple[JointStream, str, int]]:
        """Stream, signal and joint of each field, the time first."""
        found = []
        for stream in self.streams:
            found.append((stream, "stamp", 0))
            found += [(stream, name, k) for name in stream.values for k in range(len(stream.joints))]
        return found

    @cached_property
    def fields(self) -> tuple[RecordedField, ...]:
        found = []
        for stream, name, k in self._index:
            place = f"{stream.topic} message"
            if name == "stamp":
                found.append(RecordedField(f"{stream.clock}.stamp", stream.clock, place, "t"))
                continue
            joint, shown = stream.joints[k], f"{stream.clock}.{name}.{stream.joints[k]}"
            found.append(RecordedField(shown, stream.clock, place, signal=_SIGNALS[name], joint=joint))
        return tuple(found)

    @cached_property
    def times(self) -> Mapping[str, int]:
        return {stream.clock: i for i, (stream, name, _) in enumerate(self._index) if name == "stamp"}

    @cached_property
    def _origin(self) -> int:
        return min(int(stream.head["stamp"].min()) for stream in self.streams)

    def load(self, wanted: Mapping[str, int]) -> Samples:
        signals: dict[str, Array] = {}
        for signal, index in wanted.items():
            stream, name, k = self._index[index]
            if name == "stamp":
                signals[signal] = np.asarray((stream.head["stamp"] - self._origin) * 1e-9, dtype=np.float64)
            else:
                signals[signal] = np.ascontiguousarray(stream.values[name][k])
        places = {signal: self.fields[i].place for signal, i in wanted.items()}
        return Samples(signals, stream.head["number"], places, stream.fault)
