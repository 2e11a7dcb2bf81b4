"""What every format of recordings shares: fields and clocks, samples with their place in the file, refusal and checks.

The checks are those that need no model: enough samples, finite values, the unit of the time, gaps, motion.
"""

from __future__ import annotations

import itertools
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import NoReturn, Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.recordings.settings import (
    GAP,
    LARGEST,
    MIN_SAMPLES,
    MIN_SEGMENT,
    MOST_SAMPLES,
    ROUNDING,
    SLOWEST_STEP,
    SMALLEST,
)
from symbolic.model_file.checks import quote


class RecordingError(ValueError):
    """A recording that cannot be used; the message is one line with the file and, where it applies, the place."""


def printable(text: object) -> str:
    """Text for a message: one line, without characters that control a terminal."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in os.fsdecode(str(text)))


@dataclass(frozen=True)
class Refusal:
    """Refuses a file. shown: the file's name in messages."""

    shown: str

    def __call__(self, message: str, place: str = "") -> NoReturn:
        """Raises RecordingError. place: where in the file, such as "line 812"."""
        at = f" {printable(place)}" if place else ""
        raise RecordingError(f"{self.shown}{at}: {printable(message)}")

    @contextmanager
    def on(self, errors: tuple[type[Exception], ...], what: str, cure: str) -> Iterator[None]:
        """Turns these errors of a reading library into a refusal: `what` is wrong, and `cure` repairs it."""
        try:
            yield
        except RecordingError:
            raise
        except errors as error:
            reason = str(error).partition("\n")[0][:200] or type(error).__name__
            self(f"{what} ({reason}); {cure}")


def require(package: str, extra: str, what: str, refuse: Refusal) -> None:
    """Refuses a file whose format, `what`, needs a package that is not installed, and says how to install it."""
    if find_spec(package) is None:
        refuse(
            f"{what} needs {package}, the extra `{extra}` (pip install -e '.[{extra}]'); "
            f"run: {sys.executable} -m pip install {package}"
        )


Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class RecordedField:
    """A column of a file, before it is read.

    name     as in the file, with `[unit]` where the file states a unit
    clock    fields that are sampled together share a clock: a topic, a group, a struct; "" if the file has only one
    place    precedes a sample's number in messages: "line", "/joint_states message", "rec.q column"
    signal   "t", "run", "q", "qd", "tau", "q_desired" … where the format defines it; None: it does not
    joint    the joint's name, where the format names joints
    """

    name: str
    clock: str = ""
    place: str = "line"
    signal: str | None = None
    joint: str | None = None


@dataclass(frozen=True)
class MixedStream:
    """What is wrong with samples of one clock as a whole, and cannot be put right without a choice.

    said    what, and what to do      sample   the first of them
    rows    (N,) samples that are left out where gaps are allowed; None: it is not known which are wrong
    """

    said: str
    sample: int
    rows: NDArray[np.bool_] | None


@dataclass(frozen=True)
class Samples:
    """Signals of one clock.

    signals   name -> (N,)
    numbers   (N,) of the samples in the file, counted as its own tools count
    places    of each signal; see RecordedField.place
    fault     None: nothing is known to be wrong
    notes     what was repaired, a line each     turned   positions whose turns were counted
    """

    signals: dict[str, Array]
    numbers: Numbers
    places: Mapping[str, str]
    fault: MixedStream | None = None
    notes: tuple[str, ...] = ()
    turned: frozenset[str] = frozenset()

    def at(self, name: str, sample: int) -> str:
        """The place of a signal's sample in the file."""
        return f"{self.places[name]} {self.numbers[sample]}"

    def kept(self, samples: NDArray[np.bool_]) -> Samples:
        """Only the samples where this mask (N,) is true."""
        signals = {name: values[samples] for name, values in self.signals.items()}
        return replace(self, signals=signals, numbers=self.numbers[samples], fault=None)


class Contents(Protocol):
    """An opened file, whatever its format.

    format   the format's name in messages
    header   where the names of the fields stand, such as "line 1"; "" in formats without a header
    fields   in the file's order
    times    clock -> index of the field with its time; clocks without a time are left out
    torque   what the file itself says that its torques are, unchecked; "" if nothing
    notes    what users should know about the file, a line each
    """

    @property
    def format(self) -> str: ...

    @property
    def header(self) -> str: ...

    @property
    def fields(self) -> Sequence[RecordedField]: ...

    @property
    def times(self) -> Mapping[str, int]: ...

    @property
    def torque(self) -> str: ...

    @property
    def notes(self) -> Sequence[str]: ...

    def load(self, wanted: Mapping[str, int]) -> Samples:
        """Fields of one clock, in the file's units. wanted: signal -> index of the field. Raises RecordingError."""
        ...


def some(names: Sequence[str], most: int = 8) -> str:
    """The first names of a list, quoted, for a message."""
    quoted = [quote(name.strip()) for name in names[:most]]
    return ", ".join(quoted) + (f" and {len(names) - most} more" if len(names) > most else "")


def map_option(cells: Mapping[str, str], signal: str, source: str = "", unit: str = "", turned: bool = False) -> str:
    """The option that reads a signal from its field, or from that of another signal.

    cells   signal -> field      unit   in which it is read      turned   with the opposite sign
    """
    cell = cells.get(source or signal, source or signal)
    cell = f"{cell.split(' [')[0]} [{unit}]" if unit else cell
    if turned:
        cell = cell.removeprefix("-") if cell.startswith("-") else f"-{cell}"
    return f'--map {signal}="{cell}"'


_FINER = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of time in s, the longest first."""


def unpowered(tau: Array) -> NDArray[np.bool_]:
    """(n,) joints whose torque (n, N) is constant: passive joints, or joints without a recorded torque."""
    constant: NDArray[np.bool_] = np.ptp(tau, axis=1) < SMALLEST
    return constant


def check_finite(table: Samples, allow_gaps: bool, refuse: Refusal) -> Samples:
    """Refuses infinite and absurdly large values, and NaN unless gaps are allowed: then these samples are dropped."""
    drop = np.zeros(len(table.numbers), dtype=bool)
    for name, values in list(table.signals.items()):
        absent = np.isnan(values)
        # A time may count ns since 1970; whether its unit is right follows from its steps.
        largest = np.inf if name == "t" else LARGEST
        large = np.abs(values, where=~absent, out=np.zeros_like(values)) > largest
        large |= np.isinf(values)
        if large.any():
            k = int(np.argmax(large))
            what = (
                "infinite"
                if np.isinf(values[k])
                else f"{values[k]:.3g}, more than any sensor reads (at most {LARGEST:g} in SI)"
            )
            refuse(f"{name} is {what}; repair or drop the row", table.at(name, k))
        if absent.any() and not allow_gaps:
            refuse(f"{name} is NaN; drop the row or pass --allow-gaps", table.at(name, int(np.argmax(absent))))
        if absent.any() and name.startswith("temperature"):
            if absent.all():
                del table.signals[name]
            else:  # temperatures change slowly and are often logged at a lower rate
                rows = np.arange(len(values))
                table.signals[name] = np.interp(rows, rows[~absent], values[~absent]).astype(np.float64)
            continue
        drop |= absent
    return table.kept(~drop) if drop.any() else table


def check_whole(table: Samples, allow_gaps: bool, refuse: Refusal) -> Samples:
    """Refuses samples with a fault, unless gaps are allowed and it is known which are wrong: then these are dropped."""
    if table.fault is None:
        return table
    if table.fault.rows is None or not allow_gaps:
        refuse(table.fault.said, table.at(next(iter(table.places)), table.fault.sample))
    return table.kept(~table.fault.rows)


def check_count(samples: int, refuse: Refusal) -> None:
    """Refuses a recording that would fill the memory; called while it is read."""
    if samples > MOST_SAMPLES:
        refuse(f"has more than {MOST_SAMPLES} samples; split it into several recordings or reduce its rate")


def check_length(t: Array, allow_gaps: bool, refuse: Refusal) -> None:
    """Refuses a recording with too few or too many samples."""
    check_count(len(t), refuse)
    if len(t) < MIN_SAMPLES:
        left = (" is left" if len(t) == 1 else " are left") if allow_gaps else ""
        refuse(f"only {len(t)} sample{'s' if len(t) != 1 else ''}{left}; expected at least {MIN_SAMPLES}")


def run_numbers(table: Samples, refuse: Refusal) -> Numbers:
    """(N,) number of each sample's run; zeros if the file has no column run."""
    run = table.signals.get("run")
    if run is None:
        return np.zeros(len(table.numbers), dtype=np.int64)
    broken = run != np.round(run)
    if broken.any():
        k = int(np.argmax(broken))
        refuse(f"run is {run[k]:g}; expected a whole number", table.at("run", k))
    return run.astype(np.int64)


def gap_free_segments(table: Samples, run: Numbers, cell: str, allow_gaps: bool, refuse: Refusal) -> tuple[slice, ...]:
    """Pieces without a gap, each within one run; refuses gaps unless they are allowed. cell: the field of t."""
    t = table.signals["t"]
    steps, same = np.diff(t), np.diff(run) == 0
    step = median_step(t, run)
    if not step > 0:
        stuck = int(np.count_nonzero(same & (steps <= 0)))
        refuse(
            f"t does not increase in {stuck} of {np.count_nonzero(same)} steps; expected seconds that increase with "
            "each sample; write t with more digits"
        )
    back = same & (steps <= 0)
    if back.any() and not allow_gaps:
        k = int(np.argmax(back)) + 1
        how = "stands still" if t[k] == t[k - 1] else "runs backwards"
        refuse(
            f"time {how}, {t[k]:.9g} s after {t[k - 1]:.9g} s; number the runs in a column run, or pass --allow-gaps",
            table.at("t", k),
        )
    if step > SLOWEST_STEP:
        unit = next((name for name, size in _FINER.items() if size * step <= SLOWEST_STEP), None)
        cure = f'if t is in {unit}, pass --map t="{cell} [{unit}]"' if unit else "write t in seconds"
        refuse(f"the median step of t is {step:.4g} s; expected at most {SLOWEST_STEP:g} s between samples; {cure}")
    gap = same & (steps > GAP * step * (1 + ROUNDING))
    if gap.any() and not allow_gaps:
        k = int(np.argmax(gap)) + 1
        refuse(
            f"a gap of {steps[k - 1]:.4g} s in t, over {GAP:g} times the median step of {step:.4g} s; "
            "pass --allow-gaps to split there",
            table.at("t", k),
        )
    edges = [0, *(np.flatnonzero(~same | back | gap) + 1).tolist(), len(t)]
    pieces = tuple(slice(a, b) for a, b in itertools.pairwise(edges) if b - a >= MIN_SEGMENT)
    if not pieces:
        refuse(f"no piece between gaps has {MIN_SEGMENT} samples; record without gaps, or for longer")
    return pieces


def median_step(t: Array, run: Numbers) -> float:
    """Median step of t in s, within the runs; NaN if no run has two samples."""
    steps = np.diff(t)[np.diff(run) == 0]
    return float(np.median(steps)) if len(steps) else math.nan


def check_command(joint: int, q: Array, desired: Array | None, refuse: Refusal) -> None:
    """Refuses the position (N,) of a moving joint (from 1) in the place of the one that its drive was told."""
    if desired is not None and np.ptp(q) >= SMALLEST and np.array_equal(q, desired):
        refuse(
            f"q{joint}_desired is q{joint} in every sample while it moves, so that its drive makes no torque; expected "
            "the position that the drive is told: log what is sent, not what is read back"
        )


def check_moving(q: Array, tau: Array, refuse: Refusal) -> None:
    """Refuses a recording in which no joint moves, or none with a changing torque; some joints may be held."""
    still: NDArray[np.bool_] = np.ptp(q, axis=1) < SMALLEST
    if still.all():
        which = "q1 is" if len(q) == 1 else f"q1 to q{len(q)} are"
        refuse(f"{which} constant; nothing moves, so nothing can be identified from this recording")
    if not (~still & ~unpowered(tau)).any():
        i = int(np.flatnonzero(~still)[0])
        refuse(f"tau{i + 1} is constant ({tau[i, 0]:g}) while q{i + 1} moves; is it the right column?")
