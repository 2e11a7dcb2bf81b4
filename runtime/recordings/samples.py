"""Samples looked at before they are believed: values held, turns of an encoder, reads that failed, torques that read 0.

Each signal is compared with itself. A value that repeats while the signal moves on is held, if it is renewed at even
distances. A jump by a turn after which the motion goes on as before is a turn. A few samples are failed reads if they
are away from a parabola through their neighbours by many times what the neighbours, and the signal everywhere else,
deviate from it; a number that comes back again and again is compared with the other samples around it. What the signal
itself does at other places (noise, steps of an encoder, stick-slip, impacts, reversals) is the measure, and no model.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Mask
from runtime.recordings.clocks import dry, features
from runtime.recordings.contents import Array, Refusal, Samples
from runtime.recordings.settings import (
    AT_AN_END,
    AWAY,
    CLOCK_SHIFT_SAMPLES,
    CLOCK_SHIFT_SMOOTHING,
    COMMON_VALUE,
    COUNTED_STEPS,
    EVEN_RENEWALS,
    FEWEST_RENEWALS,
    GAP,
    IN_PHASE,
    LEAST_STEPS,
    LONGEST_EXCURSION,
    MANY_READS,
    ORDINARY,
    REPEATED_AWAY,
    SAME_RATE,
    SCALE_SAMPLES,
    SIDE,
    SILENT,
    SPLINE_DEGREE,
    TURN_OFF,
)
from runtime.wording import number
from symbolic.model_file.arm import DescribedJoint

Rows = NDArray[np.intp]

_JOINT = re.compile(r"(q|qd|tau|duty|voltage|current)(\d+)(_desired|_link)?", re.ASCII)
"""Signals of a joint that are looked at; a voltage of the supply and a temperature decide nothing by themselves."""


@dataclass(frozen=True)
class Look:
    """How samples are looked at.

    joints      what slides has no turns; a motor's encoder wraps after a turn of the motor
    allow_gaps  leave failed reads out instead of refusing them
    """

    joints: Sequence[DescribedJoint]
    allow_gaps: bool
    refuse: Refusal

    def __call__(self, table: Samples) -> Samples:
        """Samples of one clock, repaired where nothing is lost by it, with notes. Raises RecordingError."""
        names = [name for name in table.signals if _JOINT.fullmatch(name)]
        renewed = self._renewed(self._unwrapped(table, names), names)
        return self._read(renewed, [name for name in names if name in renewed.signals])

    def _unwrapped(self, table: Samples, names: Collection[str]) -> Samples:
        """Positions without the jumps of their turns, in the turn that is nearest to zero or to the joint's own."""
        signals, notes, turned = dict(table.signals), list(table.notes), set(table.turned)
        for name in names:
            match = _JOINT.fullmatch(name)
            joint = self.joints[int(match[2]) - 1] if match is not None and match[1] == "q" else None
            if joint is None or joint.type != "revolute":
                continue
            turns = _turns(signals[name], _pieces(table), joint.gear_ratio)
            if turns is None:
                continue
            counts, turn = turns
            x, rows = signals[name] - turn * counts, np.flatnonzero(np.diff(counts)) + 1
            signals[name] = x - turn * np.round(np.median(x) / turn)
            turned.add(name)
            place = table.at(name, int(rows[0]))
            notes.append(f"{name} jumps by a turn of {number(turn)} rad {len(rows)} times, first at {place}: unwrapped")
        for name in names if turned else ():
            own = re.sub(r"_\w+$", "", name)
            if name != own and own in signals and {name, own} & turned:
                apart = np.median(signals[name] - signals[own])
                signals[name] = signals[name] - 2 * pi * np.round(apart / (2 * pi))
        return replace(table, signals=signals, notes=tuple(notes), turned=frozenset(turned))

    def _renewed(self, table: Samples, names: Collection[str]) -> Samples:
        """Rows in which values are renewed: of a command that a drive held, too, each then acts half a row later."""
        found = {name: _held(table.signals[name], name[0] == "q") for name in names if not name.endswith("_desired")}
        held = {name: own for name, own in found.items() if own is not None and own.times > 0}
        if not held:
            return table
        times = max(own.times for own in held.values())
        first = max(held.values(), key=lambda own: len(own.rows))
        free = []
        for name in [name for name, own in found.items() if own is None or own.oftener(times)]:
            rows = _changes(table.signals[name])
            if np.mean(np.isin(rows, first.rows)) > 1 - COMMON_VALUE:
                held[name] = _Held(rows, first.times, rows[:0])
            else:
                free.append(name)
        if free and all(name.startswith("qd") for name in held):
            signals = {name: x for name, x in table.signals.items() if name not in held}
            note = f"{_list(held)} repeat their values while {_list(free)} do not: not read"
            return replace(table, signals=signals, notes=(*table.notes, note))
        slowest = {name: own for name, own in held.items() if own.times > SAME_RATE * times}
        others = [*free, *(name for name in held if name not in slowest)]
        hz = 1 / (times * float(np.median(np.diff(table.signals["t"]))))
        thinned, moved = _thinned(table, slowest, times)
        kept = _rows(len(thinned.numbers), len(table.numbers))
        note = f"{_list(slowest) if others else 'all signals'}: each value comes {number(times, 3)} times; "
        note += f"read are the {kept} in which values renew, every {number(1e3 / hz, 3)} ms"
        note += f"; {_list(moved)}, renewed in others, interpolated there" if moved else ""
        return replace(thinned, notes=(*table.notes, note))

    def _read(self, table: Samples, names: Collection[str]) -> Samples:
        """Samples without reads that failed. Raises RecordingError, unless rows may be left out."""
        pieces, positions = _pieces(table), [name for name in names if re.fullmatch(r"q\d+", name)]
        found = {name: _failed(table.signals[name], pieces, "q") for name in positions}
        pushes = np.array([_pushes(table.signals["t"], table.signals[name], found[name]) for name in positions])
        for name in (name for name in names if name not in found):
            own = table.signals.get("q" + "".join(filter(str.isdigit, name)))
            kind = re.sub(r"\d+", "", name)
            beside = [table.signals[other] for other in names if other != name and re.sub(r"\d+", "", other) == kind]
            found[name] = _failed(table.signals[name], pieces, kind, own, pushes, beside)
            if name[:3] == "tau":
                found[name] |= _silent(table, name)
        failed = {name: found[name] for name in names if found[name].any()}
        if not failed:
            return table
        empty: Mask = np.all([table.signals[name] == 0 for name in names], axis=0)
        if any((empty & bad).any() for bad in failed.values()):
            failed = {name: bad | empty for name, bad in failed.items()}
        rows: Mask = np.any(list(failed.values()), axis=0)
        name = min(failed, key=lambda name: int(np.argmax(failed[name])))
        k, x = int(np.argmax(failed[name])), table.signals[name]
        good = x[~failed[name]]
        i = int(np.count_nonzero(~failed[name][:k]))
        sides = [number(float(v)) for v in good[max(i - 1, 0) : i + 1]]
        said = f"{name} is {number(float(x[k]))} beside {' and '.join(sides)}: no motion is so quick, the read failed"
        counts = [f"{other} in {np.count_nonzero(bad)}" for other, bad in failed.items()]
        counted = f"{said}, in {_rows(int(rows.sum()), len(x))}" + f" ({', '.join(counts)})" * (len(counts) > 1)
        if not self.allow_gaps:
            self.refuse(f"{counted}; drop them, or pass --allow-gaps to leave them out", table.at(name, k))
        left = f"left out: {table.at(name, k)}: {counted}"
        return replace(table.kept(~rows), notes=(*table.notes, left))


def _rows(count: int, of: int) -> str:
    return f"{count} of {of} rows"


def _list(names: Iterable[str]) -> str:
    """Names for a message, those of joints that follow each other as a range."""
    own = list(names)
    stems = {re.sub(r"\d+", "{}", name): name for name in reversed(own)}
    parts = []
    for stem, first in reversed(stems.items()):
        same = [name for name in own if re.sub(r"\d+", "{}", name) == stem]
        parts += [f"{first} to {same[-1]}"] if len(same) > 2 else same
    return ", ".join(parts)


def _pieces(table: Samples) -> NDArray[np.int64] | None:
    """(N,) number of the piece between restarts of time to which each sample belongs; None if there is one."""
    breaks = np.diff(table.signals["t"]) <= 0
    if "run" in table.signals:
        breaks |= np.diff(table.signals["run"]) != 0
    return np.concatenate([[0], np.cumsum(breaks)]) if breaks.any() else None


def _usual(x: Array, order: int, turn: float = np.inf) -> float:
    """What all but few of the differences of a signal (N,) that are not zero stay below, whole turns apart; 0 if it is
    constant."""
    every = max(len(x) // SCALE_SAMPLES, 1)
    if order == 1:
        steps = np.abs(x[1::every] - x[: len(x) - 1 : every])
    else:
        steps = np.abs(x[2::every] - 2 * x[1 : len(x) - 1 : every] + x[: len(x) - 2 : every])
    if np.isfinite(turn):
        steps = np.abs(steps - turn * np.round(steps / turn))
    steps = steps[steps > 1e-12 * float(np.ptp(x))] if len(steps) else steps
    return float(np.quantile(steps, ORDINARY)) if len(steps) else 0.0


def _turns(x: Array, pieces: NDArray[np.int64] | None, ratio: float) -> tuple[Array, float] | None:
    """(N,) by how many turns positions x (N,) are beside their own motion, and the turn.

    The turn is one of the joint; half of one, or one of the motor, where the joint moves on before and after, as it
    does not where it slips; or the range of the register, at whose ends all large jumps begin and end. None: no jumps.
    """
    steps, usual, near = np.diff(x), _usual(x, 2, 2 * pi), SIDE - 1
    k = np.flatnonzero(np.abs(np.diff(steps)) > AWAY * usual)
    k = np.unique(np.concatenate([k, k + 1]))
    k = k[(k >= near) & (k + near < len(steps))]
    if pieces is not None:
        k = k[pieces[k - near] == pieces[k + near + 1]]
    around = steps[k[:, None] + np.r_[-near:0, 1 : near + 1]]
    slope = np.median(around, axis=1)
    jumps = steps[k] - slope
    k, around, slope, jumps = (v[np.abs(jumps) > AWAY * usual] for v in (k, around, slope, jumps))
    if not len(k):
        return None
    size, off = np.abs(jumps), TURN_OFF * np.maximum(usual, np.median(np.abs(np.diff(around, axis=1)), axis=1))
    moves = (around * np.sign(slope)[:, None]).min(axis=1) > usual
    known = [(2 * pi, np.ones(len(k), dtype=bool)), (pi, moves), (2 * pi / ratio, moves)]
    for turn, able in [*known, *_register(x, k, size)]:
        whole = np.round(jumps / turn)
        fits = able & (np.abs(whole) == 1) & (np.abs(jumps - whole * turn) <= off)
        if fits.any():
            seen = float(np.median(size[fits]))
            least = float(np.quantile(np.abs(steps[steps != 0]), LEAST_STEPS))
            known_better = abs(seen - turn) <= TURN_OFF * max(usual / np.sqrt(np.count_nonzero(fits)), least)
            turn = turn if known_better else seen
            return _counted(steps, turn, k[fits], whole[fits], pieces), turn
    return None


def _counted(steps: Array, turn: float, k: Rows, whole: Array, pieces: NDArray[np.int64] | None) -> Array:
    """(N,) turns from the beginning of its piece on to each sample; known jumps of `whole` turns are after samples k
    (M,), and all others that are nearer to a turn than to none, where no step leaves a doubt."""
    size = np.abs(steps) / turn
    counts = np.round(steps / turn)
    if ((size > 0.25) & (size < 0.75)).any():
        counts[:] = 0.0
        counts[k] = whole
    total = np.concatenate([[0.0], np.cumsum(counts)])
    if pieces is None:
        return total
    return np.asarray(total - total[np.searchsorted(pieces, pieces)])


def _register(x: Array, k: Rows, size: Array) -> Iterator[tuple[float, Mask]]:
    """The range of a register, and which of the jumps of this size (M,) after samples k (M,) of x (N,) are its wraps.

    A wrap stays, and there are samples at both ends of the range; a failed read returns, and is there by itself.
    """
    reach, low, high = float(np.ptp(x)), np.minimum(x[k], x[k + 1]), np.maximum(x[k], x[k + 1])
    large, margin = size > reach / 2, AT_AN_END * float(np.ptp(x))
    ends = (low < x.min() + margin) & (high > x.max() - margin)
    stays = np.diff(k[large]) > LONGEST_EXCURSION
    filled = min(np.count_nonzero(x < x.min() + margin), np.count_nonzero(x > x.max() - margin))
    if np.count_nonzero(stays) and ends[large].all() and filled >= SIDE * np.count_nonzero(large):
        yield float(np.median(size[large])), large


@dataclass(frozen=True)
class _Held:
    """A held signal: the rows (M,) in which it changes, how many times each value comes, 0 if it hardly changes, and
    those (S,) in which it changes so much that renewals before them were lost, if they are late."""

    rows: Rows
    times: float
    jumps: Rows

    def oftener(self, times: float) -> bool:
        """Whether a signal of which nothing can be said changes oftener than one whose values come that many times."""
        often = np.diff(self.rows) < np.floor(times)
        return self.times == 0 and bool(np.count_nonzero(often) > (1 - IN_PHASE) * len(often))


def _held(x: Array, position: bool) -> _Held | None:
    """Whether a signal x (N,) is held: renewed now and then, and not with each sample. None: it is not.

    Only changes by more than the least ones count: an encoder repeats itself where the joint is slow. A bus renews at
    uneven distances, too, but so does what switches between a few values. Where most samples are renewals, the
    distances of the others are even.
    """
    changed = x[1:] != x[:-1]
    count = int(np.count_nonzero(changed))
    if count > (1 - COMMON_VALUE) * len(changed):
        return None
    rows = _changes(x)
    if count < FEWEST_RENEWALS:
        return _Held(rows, 0.0, rows[:0])
    steps = np.abs(x[rows] - x[rows - 1])
    quick = steps > COUNTED_STEPS * float(np.quantile(steps, LEAST_STEPS))
    apart = np.diff(rows)[quick[1:] & quick[:-1]]
    if (times := _apart(apart, np.inf if len(np.unique(x[rows])) > FEWEST_RENEWALS else EVEN_RENEWALS)) > 0:
        # A joint moves off from rest ever faster, and catches up at once with what was lost; its torque may jump.
        caught_up = position & np.append(steps[:-1] > steps[1:], True) | (np.diff(rows, prepend=0) <= GAP * times)
        return _Held(rows, times, rows[quick & caught_up])
    stalled = np.flatnonzero(~changed) + 1
    after = np.clip(np.searchsorted(rows, stalled), 1, count - 1)
    stalled = stalled[quick[after - 1] & quick[after]]
    if (every := _apart(np.diff(stalled), EVEN_RENEWALS)) > 0:
        return _Held(rows, every / (every - 1), rows[:0])
    return _Held(rows, 0.0, rows[:0]) if len(apart) < FEWEST_RENEWALS else None


def _changes(x: Array) -> Rows:
    """Rows (M,) in which a signal x (N,) is not what it was before."""
    return np.flatnonzero(x[1:] != x[:-1]) + 1


def _apart(apart: Rows, most: float) -> float:
    """The mean of distances (M,) that are more than one sample, the longest at most so many times the shortest, without
    those in which renewals were lost; or 0."""
    if len(apart) < FEWEST_RENEWALS:
        return 0.0
    low, high = np.quantile(apart, [1 - IN_PHASE, IN_PHASE])
    usual = apart[(apart >= low) & (apart <= min(high, EVEN_RENEWALS * float(np.median(apart))))]
    return float(np.mean(usual)) if low >= 2 and high <= most * low else 0.0


def _filled(rows: Rows, jumps: Rows, times: float, length: int) -> Rows:
    """Rows of renewals, with those in which the value stayed the same, for a signal that comes that many times: before
    a jump renewals were lost, and what was read in their place is none."""
    gaps = np.diff(rows)
    same = (gaps > times + 1.5) & ~np.isin(rows[1:], jumps)
    more = np.where(same, np.round(gaps / times) - 1, 0).astype(np.intp)
    nth = np.arange(more.sum()) - np.repeat(np.cumsum(more) - more, more) + 1
    between = np.repeat(rows[:-1], more) + nth * np.repeat(gaps / (more + 1), more)
    before, after = np.arange(rows[0], -0.5, -times), np.arange(rows[-1], length - 0.9, times)
    return np.unique(np.round(np.concatenate([before, rows, between, after])).astype(np.intp))


def _thinned(table: Samples, held: Mapping[str, _Held], times: float) -> tuple[Samples, list[str]]:
    """The rows in which held signals are renewed. Those that are renewed in other rows than most are interpolated
    there, as signals of another clock are."""
    from scipy.interpolate import make_interp_spline  # slow to import

    length, first = len(table.numbers), max(held, key=lambda name: len(held[name].rows))
    keep = np.zeros(length, dtype=bool)
    keep[held[first].rows] = True
    together = [name for name, own in held.items() if np.count_nonzero(keep[own.rows]) > len(own.rows) / 2]
    for name in together:
        keep[held[name].rows] = True
    jumps = np.concatenate([held[name].jumps for name in together])
    keep[rows := _filled(np.flatnonzero(keep), jumps, times, length)] = True
    thinned, moved = table.kept(keep), [name for name in held if name not in together]
    for name in moved:
        own = _filled(held[name].rows, held[name].jumps, times, length)
        thinned.signals[name] = make_interp_spline(own, table.signals[name][own], k=SPLINE_DEGREE)(rows)
    return thinned, moved


def _pushes(t: Array, q: Array, failed: Mask) -> Array:
    """(N,) changes of a rate, of positions q (N,) at times t (N,), over what they usually are; none of samples that
    failed."""
    if len(q) < 3:
        return np.zeros(len(q))
    beside, dt = np.convolve(failed, np.ones(3), "same") > 0, np.diff(t)
    rate = np.diff(q) / np.where(dt > 0, dt, np.inf)
    return np.pad(np.abs(np.diff(rate)), 1) * ~beside / (_usual(rate, 1) or 1.0)


def _failed(
    x: Array,
    pieces: NDArray[np.int64] | None,
    kind: str,
    own: Array | None = None,
    pushes: Array | None = None,
    others: Sequence[Array] = (),
) -> Mask:
    """(N,) samples of x (N,) that are away from all of their neighbours. own: the position (N,) of its joint, where x
    is none; pushes (n, N): of all positions; others (N,): the same of other joints.

    What is commanded may do what no joint can: only numbers that come again are looked for. A position may fail for any
    time and from the first sample on; a torque or a rate that is 0 for longer may be one.
    """
    bad, free, position = np.zeros(len(x), dtype=bool), not kind.endswith("_desired"), kind in ("q", "q_link")
    own = None if position else own
    if free:
        _mark_excursions(x, pieces, bad, position, own, pushes, others)
    before = np.count_nonzero(bad)
    for value, any_time in _suspected(x):
        bad |= _repeated(x, x == value, bad, any_time=any_time and position)
    if free and before < np.count_nonzero(bad) < len(x) / 2:
        _mark_excursions(x, pieces, bad, position, own, pushes, others)
    return bad


def _suspected(x: Array) -> Iterator[tuple[float, bool]]:
    yield from ((0.0, True), (-1.0, True))
    seen, counts = np.unique(x[:: max(len(x) // SCALE_SAMPLES, 1)], return_counts=True)
    if counts.max() > 1:
        yield float(seen[np.argmax(counts)]), False


def _repeated(x: Array, same: Mask, failed: Mask, any_time: bool) -> Mask:
    """(N,) which of the samples `same` of x (N,), all of one value, are away from the other samples around them: beyond
    both neighbours by many times the steps of the others there, and elsewhere. All are where many are."""
    bad = np.zeros(len(x), dtype=bool)
    count = int(np.count_nonzero(same))
    others = np.flatnonzero(~(same | failed)) if count else np.zeros(0, dtype=np.intp)
    if len(others) < 2 * SIDE:
        return bad
    value = float(x[int(np.argmax(same))])
    y = x[others]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    first, last = edges[::2], edges[1::2]
    after = np.searchsorted(others, first)
    around = np.clip(after[:, None] + np.arange(-3, 3), 0, len(y) - 1)
    ends = y[around[:, 2:4]]
    away = np.maximum(ends.min(axis=1) - value, value - ends.max(axis=1))
    steps = np.abs(np.diff(y[around], axis=1))[:, [0, 1, 3, 4]].max(axis=1)
    usual = _usual(y, 1)
    found = away > REPEATED_AWAY * np.maximum(steps, usual) if usual > 0 else np.zeros(len(away), dtype=bool)
    if not any_time:
        found &= (last - first <= LONGEST_EXCURSION) & (after >= 3) & (after + 2 < len(y))
    for a, b in zip(first[found], last[found], strict=True):
        bad[a:b] = True
    many = np.count_nonzero(bad | (same & failed)) >= max(MANY_READS, COMMON_VALUE * count)
    return same if many else bad


def _mark_excursions(
    x: Array,
    pieces: NDArray[np.int64] | None,
    bad: Mask,
    smooth: bool,
    own: Array | None,
    pushes: Array | None,
    others: Sequence[Array],
) -> None:
    """Marks excursions of the samples of x (N,) that are not marked. Where the joint at `own` (N,) rests or turns
    round, its rate and its friction do, too: only what is beyond all that the signal does elsewhere is marked there.
    Nothing is where a joint is thrown back, for which `pushes` (n, N) stand out, as its torque reaches the others, nor
    for one sample where it takes a new level and the same of another joint, too: then all were commanded anew."""
    good = np.flatnonzero(~bad)
    y, parts = x[good], None if pieces is None else pieces[good]
    for first, count in _excursions(y, parts, smooth):
        if own is not None and pushes is not None and len(first):
            steps = np.diff(own[good[first[:, None] + np.arange(-2, count + 2)]], axis=1)
            moves = np.abs(np.sign(steps).sum(axis=1)) == count + 3
            beyond = np.abs(y[first] - np.median(y)) > float(np.ptp(np.quantile(y, [1 - IN_PHASE, IN_PHASE])))
            pushed = pushes[:, good[first[:, None] + np.arange(1 - SIDE, count + SIDE - 1)]]
            aside = pushed[..., [0, 1, -2, -1]].max(axis=-1)
            thrown = pushed[..., 2:-2].max(axis=-1) > np.maximum(AWAY / 2 * aside, 1.0)
            at = good[first[:, None] + np.array([-2, -1, count, count + 1])]
            anew = np.any([_steps(other[at]) > AWAY / 2 * _usual(other, 1) for other in others], axis=0)
            anew &= (AWAY / 2 * _steps(x[at]) > np.abs(x[at] - y[first][:, None]).min(axis=1)) & (count == 1)
            first = first[(moves | beyond) & ~thrown.any(axis=0) & ~anew]
        bad[good[(first[:, None] + np.arange(count)).ravel()]] = True


def _steps(sides: Array) -> Array:
    """(K,) from the two samples before to the two after, (K, 4), beyond what these differ among each other."""
    level = np.abs(sides[:, 2:].sum(axis=1) - sides[:, :2].sum(axis=1)) / 2
    return level - np.abs(np.diff(sides, axis=1)[:, [0, 2]]).max(axis=1)


def _excursions(x: Array, pieces: NDArray[np.int64] | None, smooth: bool) -> Iterator[tuple[Rows, int]]:
    """First samples, and number of samples, of what is away from a parabola through SIDE neighbours on both sides, all
    in one direction, by AWAY times what these deviate from it or second differences usually are, and more the longer
    it lasts. What is not smooth, as a position is, may have a peak as steep as the way to it."""
    usual = _usual(x, 2)
    if usual == 0:
        return
    entry = np.flatnonzero(np.abs(x[2:] - 2 * x[1:-1] + x[:-2]) > AWAY / 2 * usual) + 2
    for count in range(1, LONGEST_EXCURSION + 1):
        k = entry[(entry >= SIDE) & (entry + count + SIDE <= len(x))]
        if pieces is not None:
            k = k[pieces[k - SIDE] == pieces[k + count + SIDE - 1]]
        at = np.arange(-SIDE, count + SIDE) - (count - 1) / 2
        powers = np.vander(at / at[-1], 3)
        beside = np.r_[:SIDE, SIDE + count : 2 * SIDE + count]
        through = powers @ np.linalg.pinv(powers[beside])
        seen = x[k[:, None] + np.arange(-SIDE, count + SIDE)]
        left = seen - seen[:, beside] @ through.T
        away, own = left[:, SIDE : SIDE + count], np.abs(left[:, beside]).max(axis=1)
        if not smooth:
            steps = np.abs(np.diff(seen[:, beside], axis=1))
            own = np.maximum(own, np.delete(steps, SIDE - 1, axis=1).max(axis=1))
        least = np.maximum(away.min(axis=1), (-away).min(axis=1))
        yield k[least > AWAY * (1 + (count - 1) / 4) * np.maximum(own, usual)], count


def _silent(table: Samples, name: str) -> Mask:
    """(N,) samples of stretches in which a torque is 0 and the motion says that it is not.

    What the positions around explain of the torque where it is not 0 (see clocks.py) is what it is there: a drive that
    is off leaves a motion that needs no torque.
    """
    x = table.signals[name]
    zero = x == 0
    silent = np.zeros(len(x), dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], zero, [False]]).astype(np.int8)))
    long = edges[1::2] - edges[::2] > LONGEST_EXCURSION
    positions = [v for other, v in table.signals.items() if re.fullmatch(r"q\d+", other) and np.ptp(v) > 0]
    own = table.signals.get(name.replace("tau", "q").removesuffix("_link"))
    if not long.any() or own is None or not positions:
        return silent
    k = int(np.argmax((edges[1::2] - edges[::2]) * long))
    near = slice(max(0, edges[2 * k] - CLOCK_SHIFT_SAMPLES // 2), edges[2 * k + 1] + CLOCK_SHIFT_SAMPLES // 2)
    known = ~zero[near]
    if np.count_nonzero(known) < 10 * SIDE:
        return silent
    width = max(CLOCK_SHIFT_SMOOTHING[1] / float(np.median(np.diff(table.signals["t"]))), 1.0)
    basis = np.vstack([features([p[near] for p in positions], width), dry(own[near], width)]).T
    asked = basis @ np.linalg.lstsq(basis[known], x[near][known], rcond=None)[0]
    left = np.sqrt(np.mean((x[near] - asked)[known] ** 2))
    if np.median(np.abs(asked[~known])) > SILENT * left:
        for first, last in zip(edges[::2][long], edges[1::2][long], strict=True):
            silent[first:last] = np.ptp(own[first:last]) > 0
    return silent
