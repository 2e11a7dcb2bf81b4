"""Messages of a topic as rows: in the order of time, each once, and of one sender.

Two nodes that publish the same joints on one topic are told by their frame_id, by which arrays they fill, by a torque
that is exactly 0 in theirs alone, or by positions that go away and come back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from runtime.recordings.contents import Array, Fault, Numbers
from runtime.recordings.settings import (
    CLOCK_SHIFT_MOST,
    GAP,
    LATE_STEP,
    LEAST_OF_SENDER,
    LEAST_SWITCHES,
    MIN_SAMPLES,
    MOST_SENDERS,
    SENDERS_APART,
    SENDERS_TRAVEL,
    SPLINE_DEGREE,
)
from symbolic.model_file.checks import quote

Mask = NDArray[np.bool_]
ARRAYS = ("position", "velocity", "effort")


@dataclass(frozen=True)
class JointStream:
    """Messages of a topic for one set of joints.

    clock            its name as a clock                frames   the texts of frame_id in it
    stamps, logged   (N,) ns; of the header, and when the log got it
    numbers          (N,) counted from 1 on the topic, as it was logged
    frame            (N,) number of its frame_id; −1 where these are too many to be names of senders
    filled           (N,) which of ARRAYS it has, a bit each
    values           position, velocity and effort, (joints, N) each; NaN in messages without
    notes, fault     how it was put right, and what cannot be
    """

    clock: str
    topic: str
    joints: tuple[str, ...]
    stamps: Numbers
    logged: Numbers
    numbers: Numbers
    frame: Numbers
    filled: Numbers
    values: Mapping[str, Array]
    frames: Sequence[str] = ()
    notes: tuple[str, ...] = ()
    fault: Fault | None = None

    def taken(self, rows: NDArray[np.intp] | Mask) -> JointStream:
        """These messages, in this order."""
        return replace(
            self,
            stamps=self.stamps[rows],
            logged=self.logged[rows],
            numbers=self.numbers[rows],
            frame=self.frame[rows],
            filled=self.filled[rows],
            values={name: x[:, rows] for name, x in self.values.items()},
        )

    def noted(self, note: str) -> JointStream:
        """With a note."""
        return replace(self, notes=(*self.notes, f"{self.topic}: {note}"))


def of_topic(parts: Sequence[JointStream]) -> list[JointStream]:
    """The parts of a topic joined for each set of joints, and for each set of arrays where no two fill the same."""
    arrays: dict[tuple[str, ...], set[int]] = {}
    for part in parts:
        arrays.setdefault(tuple(sorted(part.joints)), set()).add(int(part.filled[0]))
    kinds: dict[str, list[JointStream]] = {}
    for part in parts:
        joints = tuple(sorted(part.joints))
        name = f"{', '.join(joints[:2])}, …" if len(arrays) > 1 else ""
        if len(arrays[joints]) > 1 and sum(arrays[joints]) == reduce(int.__or__, arrays[joints]):
            name = f"{name}{', '.join(part.values)}"
        kinds.setdefault(f"{part.topic} ({name})" if name else part.topic, []).append(part)
    return [_joined(clock, own) for clock, own in kinds.items()]


def _joined(clock: str, parts: Sequence[JointStream]) -> JointStream:
    """The parts as one, in the order of the log, with joints in the order of the first."""
    joints, values = parts[0].joints, {}
    for name in (name for name in ARRAYS if any(name in part.values for part in parts)):
        blocks = []
        for part in parts:
            block = part.values.get(name)
            if block is None:
                block = np.full((len(joints), len(part.stamps)), np.nan)
            elif part.joints != joints:
                block = block[[part.joints.index(joint) for joint in joints]]
            blocks.append(block)
        values[name] = np.concatenate(blocks, axis=1)
    whole = replace(
        parts[0],
        clock=clock,
        stamps=np.concatenate([part.stamps for part in parts]),
        logged=np.concatenate([part.logged for part in parts]),
        numbers=np.concatenate([part.numbers for part in parts]),
        frame=np.concatenate([part.frame for part in parts]),
        filled=np.concatenate([part.filled for part in parts]),
        values=values,
    )
    order = np.argsort(whole.numbers, kind="stable")
    return whole if np.array_equal(order, np.arange(len(order))) else whole.taken(order)


def in_log_order(parts: Sequence[JointStream]) -> list[JointStream]:
    """The parts of a topic, numbered as the log got the messages: files may hold them in another order."""
    logged = np.empty(sum(len(part.logged) for part in parts), dtype=np.int64)
    for part in parts:
        logged[part.numbers - 1] = part.logged
    if (np.diff(logged) >= 0).all():
        return list(parts)
    place = np.empty(len(logged), dtype=np.int64)
    place[np.argsort(logged, kind="stable")] = 1 + np.arange(len(logged))
    note = f"{parts[0].topic}: the file's messages are put in the order of their log time"
    return [replace(part, numbers=place[part.numbers - 1], notes=(note,)) for part in parts]


def settled(stream: JointStream) -> JointStream:
    """The messages in the order of their stamps, each once; with what is wrong with them."""
    stream = _without_repeats(_in_time(_stamped(stream)))
    return replace(stream, fault=_of_several_senders(stream))


def in_rows(streams: Sequence[JointStream]) -> list[JointStream]:
    """The streams of a topic; those with one joint each as one, at their common instants or at those of the first."""
    if len(streams) < 2 or any(len(s.joints) > 1 or s.fault or len(s.stamps) < MIN_SAMPLES for s in streams):
        return list(streams)
    if any(s.values.keys() != streams[0].values.keys() for s in streams):
        return list(streams)
    stamps = reduce(np.intersect1d, (stream.stamps for stream in streams))
    how = "those of one stamp are put together"
    rows = [s.taken(np.searchsorted(s.stamps, stamps)) for s in streams]
    if len(stamps) < MIN_SAMPLES:
        how = f"the others are resampled at the times of {streams[0].joints[0]}"
        begin, end = max(s.stamps[0] for s in streams), min(s.stamps[-1] for s in streams)
        first = streams[0].taken((streams[0].stamps >= begin) & (streams[0].stamps <= end))
        rows = [first, *(_resampled(s, first) for s in streams[1:])]
    values = {name: np.concatenate([row.values[name] for row in rows]) for name in rows[0].values}
    notes = tuple(dict.fromkeys(text for row in streams for text in row.notes))
    joints = tuple(joint for row in rows for joint in row.joints)
    whole = replace(rows[0], clock=rows[0].topic, joints=joints, values=values, notes=notes)
    return [whole.noted(f"one joint a message: {how}")]


def _resampled(stream: JointStream, first: JointStream) -> JointStream:
    """At the instants of another; NaN in gaps."""
    from scipy.interpolate import make_interp_spline  # slow to import

    there, once = np.unique(stream.stamps, return_index=True)
    steps, after = np.diff(there), np.clip(np.searchsorted(there, first.stamps), 1, len(there) - 1)
    lost = steps[after - 1] > GAP * np.median(steps)
    values = {}
    for name, x in stream.values.items():
        spline = make_interp_spline((there - there[0]) * 1e-9, x[:, once], k=SPLINE_DEGREE, axis=1)
        values[name] = np.where(lost, np.nan, spline((first.stamps - there[0]) * 1e-9))
    return replace(first, joints=stream.joints, values=values)


def _stamped(stream: JointStream) -> JointStream:
    """Without stamps of 0, but for one from which the others count; by the log's time where no stamp was set."""
    unset = stream.stamps == 0
    if not unset.any():
        return stream
    if unset.all():
        return replace(stream, stamps=stream.logged).noted("no message has a stamp: the log's times are used")
    told = np.sort(stream.stamps[~unset])
    last = int(np.flatnonzero(unset)[-1])
    if len(told) > 1 and told[0] <= GAP * np.median(np.diff(told)):
        unset[last] = False  # a clock that began at 0
        stream = stream.noted(
            f"the stamp of 0 of message {stream.numbers[last]} is a step before the next, and is used"
        )
    if not unset.any():
        return stream
    return stream.taken(~unset).noted(f"{_messages(unset)} with a stamp of 0, at an unknown time, left out")


def _in_time(stream: JointStream) -> JointStream:
    """In the order of stamps where single messages came late; a clock that was set back is left to further checks."""
    late = np.maximum.accumulate(stream.stamps) - stream.stamps
    if not 0 < late.max(initial=0) <= CLOCK_SHIFT_MOST * 1e9:
        return stream
    order = np.argsort(stream.stamps, kind="stable")
    steps = np.diff(stream.stamps[order])
    if steps[steps > 0].min() < LATE_STEP * np.median(steps):
        return stream
    return stream.taken(order).noted(f"{_messages(late > 0)} that came late put in the order of their stamps")


def _without_repeats(stream: JointStream) -> JointStream:
    again = np.concatenate([[False], np.diff(stream.stamps) == 0])
    for x in stream.values.values():
        one, other = x[:, 1:], x[:, :-1]
        again[1:] &= ((one == other) | (np.isnan(one) & np.isnan(other))).all(axis=0)
    if not again.any():
        return stream
    return stream.taken(~again).noted(f"{_messages(again)} that repeat the one before, with its stamp, left out")


def _messages(which: Mask) -> str:
    count = np.count_nonzero(which)
    return f"{count} message{'s' if count > 1 else ''}"


# --- two senders ---


def _of_several_senders(stream: JointStream) -> Fault | None:
    """What tells that several nodes sent these messages; those of one are kept where only its have a torque, or all
    arrays that any has."""
    count = len(stream.stamps)
    if count < MIN_SAMPLES:
        return None
    filled: dict[str, Mask] = {name: stream.filled >> k & 1 == 1 for k, name in enumerate(ARRAYS)}
    marks: list[NDArray[Any]] = []
    said = []
    frames, which, sizes = np.unique(stream.frame, return_inverse=True, return_counts=True)
    named = frames[0] >= 0 and len(frames) <= MOST_SENDERS and _alternates(stream.frame)
    if named:
        marks.append(stream.frame)
        each = (f"{quote(stream.frames[k])} in {size}" for k, size in zip(frames, sizes, strict=True))
        said.append(f"frame_id is {' and '.join(each)} of {count} messages")
    for name, full in filled.items():
        if _alternates(full):
            marks.append(full)
            said.append(f"{name} is empty in {_which(stream, ~full)}")
    silent = np.zeros(count, dtype=bool)
    if filled["effort"].all():
        silent = (stream.values["effort"] == 0).all(axis=0)
        idle = np.bincount(which, weights=silent) == sizes
        if not (named and 0 < np.count_nonzero(idle) < len(idle)) and not _is_silence(stream.values["effort"], silent):
            silent[:] = False
    if silent.any():
        marks.append(silent)
        said.append(f"torque is exactly 0 in {_which(stream, silent)}")
    foreign = None if marks else _foreign(stream.values.get("position"))
    if foreign is not None:
        marks.append(foreign)
        said.append(f"the positions of {_which(stream, foreign)} are away from those before and after")
    if not marks:
        return None
    _, first, sender = np.unique(np.stack(marks), axis=1, return_index=True, return_inverse=True)
    sender = sender.reshape(-1)
    worth = [(not silent[k], sum(bool(full[k]) for full in filled.values())) for k in first]
    best = max(worth)
    rows = sender != worth.index(best) if worth.count(best) == 1 else None
    cure = "record one of them alone, or give it a topic of its own"
    if rows is not None:
        cure += f", or pass --allow-gaps to keep those of the one with {'the torque' if silent.any() else 'all arrays'}"
    place = int(np.argmax(sender != sender[0]))
    several = "two" if len(first) == 2 else len(first)
    return Fault(f"{several} senders publish these joints: {'; '.join(said)}; {cure}", place, rows)


def _alternates(label: NDArray[Any]) -> bool:
    return int(np.count_nonzero(label[1:] != label[:-1])) >= LEAST_SWITCHES


def _takes_turns(which: Mask) -> bool:
    """Whether a mask (N,) is of single messages among those of another sender, often enough."""
    fewer = which if 2 * np.count_nonzero(which) <= len(which) else ~which
    runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[False], fewer, [False]]))))[::2]
    return len(runs) > LEAST_SWITCHES / 2 and fewer.mean() >= LEAST_OF_SENDER and bool(np.median(runs) <= 2)


def _is_silence(effort: Array, silent: Mask) -> bool:
    """Whether messages (N,) with a torque of exactly 0 stand between others with as much as usual."""
    if not _takes_turns(silent):
        return False
    beside = ~silent & (np.roll(silent, 1) | np.roll(silent, -1))
    for size in np.abs(effort[:, ~silent]):
        # Of a torque that changes its sign, or of a coarse one, zeros are among its smallest values.
        usual, least = np.median(size), size[size > 0].min(initial=np.inf)
        if np.median(size[beside[~silent]]) > max(usual / 2, SENDERS_APART * least):
            return True
    return False


def _foreign(position: Array | None) -> Mask | None:
    """(N,) messages with positions away from those of another sender, who sends as many or more; None without any."""
    for x in () if position is None else position:
        steps = np.abs(np.diff(x))
        if not (moved := steps[steps > 0]).size:
            continue
        two = np.abs(x[2:] - x[:-2])
        own = np.median(two[two > 0]) if two.any() else 0.0
        if two.sum() < SENDERS_TRAVEL * steps.sum() and np.median(steps) > SENDERS_APART * own:
            return np.arange(len(x)) % 2 == 1
        least = SENDERS_APART * np.median(moved)
        if np.mean(steps > least) < LEAST_OF_SENDER:
            continue
        between = np.abs(np.concatenate([[0.0], x[2:] - x[:-2], [0.0]]))
        foreign: Mask = np.abs(x - median_filter(x, 5)) > np.maximum(least, SENDERS_APART * between)
        if _takes_turns(foreign):
            return foreign
    return None


def _which(stream: JointStream, rows: Mask) -> str:
    """How many messages, which, and how regularly."""
    numbers = stream.numbers[rows]
    steps, said = np.diff(numbers), f"{len(numbers)} of {len(rows)} messages ({', '.join(map(str, numbers[:3]))}, …)"
    every = int(np.median(steps))
    if every == 1 or np.mean(steps == every) < 1 / 2:
        return said
    return f"every {({2: '2nd', 3: '3rd'}).get(every, f'{every}th')} message, {said}"
