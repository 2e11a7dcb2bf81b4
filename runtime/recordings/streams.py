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

from runtime.arrays import Mask
from runtime.recordings.contents import Array, MixedStream, Numbers
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

ARRAYS = ("position", "velocity", "effort")


HEAD = np.dtype([(name, np.int64) for name in ("stamp", "logged", "number", "frame", "filled")])
"""Of a message: ns in its header and in the log; its number from 1 on, on its topic; the number of its frame_id, −1
where these are too many to be names of senders; which of ARRAYS it has, a bit each."""


@dataclass(frozen=True)
class JointStream:
    """Messages of a topic for one set of joints.

    clock          its name as a clock                  head     (N,) of HEAD
    frames         the texts of frame_id in the log     values   of ARRAYS, (joints, N) each; NaN in messages without
    notes, fault   how it was put right, and what cannot be
    """

    clock: str
    topic: str
    joints: tuple[str, ...]
    head: NDArray[np.void]
    values: Mapping[str, Array]
    frames: Sequence[str] = ()
    notes: tuple[str, ...] = ()
    fault: MixedStream | None = None

    def taken(self, rows: NDArray[np.intp] | Mask, note: str = "") -> JointStream:
        """These messages, in this order."""
        notes = (*self.notes, f"{self.topic}: {note}") if note else self.notes
        return replace(
            self, head=self.head[rows], values={name: x[:, rows] for name, x in self.values.items()}, notes=notes
        )


def streams_of(parts: Sequence[JointStream]) -> list[JointStream]:
    """The messages of a topic, given in parts: a stream for each set of joints, and for each set of arrays where no two
    fill the same; one for all joints where each message has one."""
    parts = _in_log_order(parts)
    arrays: dict[tuple[str, ...], set[int]] = {}
    for part in parts:
        arrays.setdefault(tuple(sorted(part.joints)), set()).add(int(part.head["filled"][0]))
    kinds: dict[str, list[JointStream]] = {}
    for part in parts:
        joints = tuple(sorted(part.joints))
        name = f"{', '.join(joints[:2])}, …" if len(arrays) > 1 else ""
        if len(arrays[joints]) > 1 and sum(arrays[joints]) == reduce(int.__or__, arrays[joints]):
            name += ", ".join(part.values)
        kinds.setdefault(f"{part.topic} ({name})" if name else part.topic, []).append(part)
    settled = [_without_repeats(_in_time(_stamped(_joined(clock, own)))) for clock, own in kinds.items()]
    return _in_rows([replace(stream, fault=_of_several_senders(stream)) for stream in settled])


def _in_log_order(parts: Sequence[JointStream]) -> list[JointStream]:
    """The parts numbered as the log got the messages: files may hold them in another order."""
    head = np.concatenate([part.head for part in parts])
    head = head[np.argsort(head["number"])]
    if (np.diff(head["logged"]) >= 0).all():
        return list(parts)
    place, note = np.empty(len(head), dtype=np.int64), "its messages are put in the order of their log time"
    place[np.argsort(head["logged"], kind="stable")] = 1 + np.arange(len(head))
    for part in parts:
        part.head["number"] = place[part.head["number"] - 1]
    return [replace(part, notes=(f"{part.topic}: {note}",)) for part in parts]


def _joined(clock: str, parts: Sequence[JointStream]) -> JointStream:
    """The parts as one, in the order of the log, with joints in the order of the first."""
    joints, values = parts[0].joints, {}
    for name in (name for name in ARRAYS if any(name in part.values for part in parts)):
        blocks = []
        for part in parts:
            block = part.values.get(name)
            if block is None:
                block = np.full((len(joints), len(part.head)), np.nan)
            elif part.joints != joints:
                block = block[[part.joints.index(joint) for joint in joints]]
            blocks.append(block)
        values[name] = np.concatenate(blocks, axis=1)
    whole = replace(parts[0], clock=clock, head=np.concatenate([part.head for part in parts]), values=values)
    order = np.argsort(whole.head["number"], kind="stable")
    return whole if np.array_equal(order, np.arange(len(order))) else whole.taken(order)


def _stamped(stream: JointStream) -> JointStream:
    """Without stamps of 0, but for one from which the others count; by the log's time where no stamp was set."""
    head, unset = stream.head, stream.head["stamp"] == 0
    if unset.all():
        head["stamp"] = head["logged"]
        return stream.taken(unset, "no message has a stamp: the log's times are used")
    told = np.sort(head["stamp"][~unset])
    if unset.any() and len(told) > 1 and told[0] <= GAP * np.median(np.diff(told)):
        last = int(np.flatnonzero(unset)[-1])
        unset[last] = False
        note = f"the stamp of message {head['number'][last]} is 0, a step before the next, and is used"
        stream = stream.taken(np.arange(len(head)), note)
    return stream.taken(~unset, f"left out {_messages(unset)} with a stamp of 0") if unset.any() else stream


def _in_time(stream: JointStream) -> JointStream:
    """In the order of stamps where single messages came late; a clock that was set back is left to further checks."""
    stamps = stream.head["stamp"]
    late = np.maximum.accumulate(stamps) - stamps
    order = np.argsort(stamps, kind="stable")
    steps = np.diff(stamps[order])
    if not 0 < late.max() <= CLOCK_SHIFT_MOST * 1e9 or steps[steps > 0].min() < LATE_STEP * np.median(steps):
        return stream
    return stream.taken(order, f"{_messages(late > 0)} that came late put in the order of the stamps")


def _without_repeats(stream: JointStream) -> JointStream:
    again = np.concatenate([[False], np.diff(stream.head["stamp"]) == 0])
    for x in stream.values.values():
        again[1:] &= ((x[:, 1:] == x[:, :-1]) | (np.isnan(x[:, 1:]) & np.isnan(x[:, :-1]))).all(axis=0)
    note = f"left out {_messages(again)} that repeat the one before, with its stamp"
    return stream.taken(~again, note) if again.any() else stream


def _messages(which: Mask) -> str:
    count = np.count_nonzero(which)
    return f"{count} message{'s' if count > 1 else ''}"


def _in_rows(streams: Sequence[JointStream]) -> list[JointStream]:
    """Streams with one joint each as one, at their common instants, or else at those of the first."""
    first = streams[0]
    alone = all(len(s.joints) == 1 and not s.fault and s.values.keys() == first.values.keys() for s in streams)
    if len(streams) < 2 or not alone or min(len(s.head) for s in streams) < MIN_SAMPLES:
        return list(streams)
    stamps, how = reduce(np.intersect1d, (s.head["stamp"] for s in streams)), "those of one stamp are put together"
    if len(stamps) < MIN_SAMPLES:
        ends = max(s.head["stamp"].min() for s in streams), min(s.head["stamp"].max() for s in streams)
        stamps = first.head["stamp"][(first.head["stamp"] >= ends[0]) & (first.head["stamp"] <= ends[1])]
        how = f"resampled at the times of {first.joints[0]}"
    values = {name: np.concatenate([_at(s, stamps, name) for s in streams]) for name in first.values}
    notes = tuple(dict.fromkeys(text for s in streams for text in s.notes))
    whole = replace(first, clock=first.topic, joints=tuple(s.joints[0] for s in streams), notes=notes)
    whole = whole.taken(np.isin(first.head["stamp"], stamps), f"one joint a message: {how}")
    return [replace(whole, values=values)]


def _at(stream: JointStream, stamps: Numbers, name: str) -> Array:
    """(joints, M) values at these stamps; NaN in gaps."""
    from scipy.interpolate import make_interp_spline  # slow to import

    there, once = np.unique(stream.head["stamp"], return_index=True)
    after = np.clip(np.searchsorted(there, stamps), 1, len(there) - 1)
    if np.array_equal(there[np.searchsorted(there, stamps)], stamps):
        return stream.values[name][:, once[np.searchsorted(there, stamps)]]
    lost = np.diff(there)[after - 1] > GAP * np.median(np.diff(there))
    spline = make_interp_spline((there - there[0]) * 1e-9, stream.values[name][:, once], k=SPLINE_DEGREE, axis=1)
    found: Array = np.where(lost, np.nan, spline((stamps - there[0]) * 1e-9))
    return found


# --- two senders ---


def _of_several_senders(stream: JointStream) -> MixedStream | None:
    """What tells that several nodes sent these messages; those of one are kept where only its have a torque, or all
    arrays that any has."""
    head, count, said = stream.head, len(stream.head), list[str]()
    if count < MIN_SAMPLES:
        return None
    filled: list[Mask] = [head["filled"] >> k & 1 == 1 for k in range(len(ARRAYS))]
    marks: list[NDArray[Any]] = [full for full in filled if _alternates(full)]
    said += [f"{name} is empty in {_which(head, ~x)}" for name, x in zip(ARRAYS, filled, strict=True) if _alternates(x)]
    frames, which, sizes = np.unique(head["frame"], return_inverse=True, return_counts=True)
    named = frames[0] >= 0 and len(frames) <= MOST_SENDERS and _alternates(head["frame"])
    if named:
        marks.append(head["frame"])
        each = (f"{quote(stream.frames[k])} in {size}" for k, size in zip(frames, sizes, strict=True))
        said.append(f"frame_id is {' and '.join(each)} of {count} messages")
    effort = stream.values.get("effort", np.zeros((1, count)))
    silent = (effort == 0).all(axis=0)
    idle = np.bincount(which, weights=silent) == sizes
    if silent.all() or not ((named and idle.any()) or _is_silence(effort, silent)):
        silent[:] = False
    if silent.any():
        marks.append(silent)
        said.append(f"torque is exactly 0 in {_which(head, silent)}")
    if not marks and (foreign := _foreign(stream.values.get("position"))) is not None:
        marks.append(foreign)
        said.append(f"the positions of {_which(head, foreign)} are away from those before and after")
    if not marks:
        return None
    _, first, sender = np.unique(np.stack(marks), axis=1, return_index=True, return_inverse=True)
    worth = [(not silent[k], sum(bool(full[k]) for full in filled)) for k in first]
    rows = sender.reshape(-1) != worth.index(max(worth)) if worth.count(max(worth)) == 1 else None
    cure = "record one of them alone, or give it a topic of its own"
    if rows is not None:
        cure += f", or pass --allow-gaps to keep those of the one with {'the torque' if silent.any() else 'all arrays'}"
    several = "two" if len(first) == 2 else len(first)
    place = int(np.sort(first)[1])
    return MixedStream(f"{several} senders publish these joints: {'; '.join(said)}; {cure}", place, rows)


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
        step = np.diff(np.unique(np.append(size, 0.0))).min(initial=np.inf)
        if np.median(size[beside[~silent]]) > max(np.median(size) / 2, SENDERS_APART * step):
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
        # Two of three steps may lead away or back; a quarter of those of noise are below half of their median.
        least = SENDERS_APART * 2 * np.quantile(moved, 1 / 4)
        if np.mean(steps > least) < LEAST_OF_SENDER:
            continue
        between = np.abs(np.concatenate([[0.0], x[2:] - x[:-2], [0.0]]))
        foreign: Mask = np.abs(x - median_filter(x, 5)) > np.maximum(least, SENDERS_APART * between)
        if _takes_turns(foreign):
            return foreign
    return None


def _which(head: NDArray[np.void], rows: Mask) -> str:
    """How many messages, which, and how regularly."""
    numbers = head["number"][rows]
    steps, said = np.diff(numbers), f"{len(numbers)} of {len(rows)} messages ({', '.join(map(str, numbers[:3]))}, …)"
    every = int(np.median(steps))
    if every == 1 or np.mean(steps == every) < 1 / 2:
        return said
    return f"every {({2: '2nd', 3: '3rd'}).get(every, f'{every}th')} message, {said}"
