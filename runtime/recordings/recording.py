"""Recordings: a CSV with a header, read into arrays in SI, or refused with one line that says why."""

from __future__ import annotations

import csv
import gzip
import io
import itertools
import math
import os
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from runtime import files
from runtime.recordings import plausible
from runtime.recordings.columns import IN_PLANE, IN_SPACE, Column, columns
from symbolic.model_file.checks import quote

Array = NDArray[np.float64]

MIN_SAMPLES = 200
MIN_SEGMENT = 50
GAP = 3.0
"""A step over this many times the median is a gap."""
ROUNDING = 1e-6
"""Of times and of their differences, by printing and arithmetic."""
LARGEST = 1e12
MAX_BYTES = 2_000_000_000
_ABSENT = frozenset(("", "nan", "na", "n/a", "null", "none"))


class RecordingError(ValueError):
    """A recording that cannot be used; the message is one line with the file and, where it applies, the line."""


@dataclass(frozen=True, repr=False)
class Recording:
    """Samples of n joints in SI; positions are rad or m, torques N m or N, by the joint's type.

    t             (N,) s, each run as recorded
    run           (N,) whole numbers; time may restart where it changes
    q, tau        (n, N) motor encoder / gear ratio, motor torque * gear ratio
    qd, q_desired, q_link, tau_link, tau_rigid
                  (n, N), or None where the file has none of them; a joint without one has a row of NaN
    tau_rigid     what the user's own model predicts of tau without friction: rotors and contact included
    temperature   °C, (N,) or None for each joint
    force         (2, N) N along base x and y that acts on the arm at the end-effector, or None; of an arm in space
                  (6, N) N and N m, along base x, y and z and about them, at the tip
    segments      gap-free pieces of at least MIN_SEGMENT samples, each within one run
    types         "revolute" or "prismatic" for each joint
    """

    path: Path
    t: Array
    run: NDArray[np.int64]
    q: Array
    tau: Array
    types: tuple[str, ...]
    segments: tuple[slice, ...]
    temperature: tuple[Array | None, ...]
    qd: Array | None = None
    q_desired: Array | None = None
    q_link: Array | None = None
    tau_link: Array | None = None
    tau_rigid: Array | None = None
    force: Array | None = None

    @property
    def dt(self) -> float:
        """Median step, s."""
        return _median_step(self.t, self.run)

    def save(self, path: Path | str) -> None:
        """As `write`."""
        write(path, self)

    def __repr__(self) -> str:
        n, samples = self.q.shape
        extra = [name for name in ("qd", "q_link", "tau_link", "tau_rigid", "force") if getattr(self, name) is not None]
        extra += ["temperature"] * any(c is not None for c in self.temperature)
        what = f"{n} joint{'s' if n > 1 else ''}, {samples} samples, {samples * self.dt:.4g} s at {1 / self.dt:.4g} Hz"
        return f"{self.path}: {what}" + (f", with {', '.join(extra)}" if extra else "")


def read(
    path: Path | str,
    model: Mapping[str, Any] | int,
    mapping: Mapping[str, str] | None = None,
    allow_gaps: bool = False,
) -> Recording:
    """The recording at `path`, CSV, plain or gzip.

    model       metadata of the arm (joints' types and torque constants, whether it is one in space), or a number of
                revolute joints of an arm of which no more is known
    mapping     signal name -> header cell, for other headers than ours
    allow_gaps  split at gaps and drop rows with a NaN, instead of refusing them
    Raises RecordingError.
    """
    joints, space = (
        ([{"type": "revolute"}] * model, True) if isinstance(model, int) else (model["joints"], model["space"])
    )
    return _Reader(_shown(path), joints, space, mapping or {}, allow_gaps).read(Path(path))


def count_joints(path: Path | str, mapping: Mapping[str, str] | None = None) -> int:
    """How many joints a recording's header, or the mapping, names: q1, q2, … Raises RecordingError."""
    reader = _Reader(_shown(path), [], True, mapping or {}, False)
    header = reader.decode(reader.load(Path(path))).lstrip("\n").partition("\n")[0]
    named = {cell.split("[")[0].strip().lower() for cell in re.split("[,;\t]", header)} | set(mapping or {})
    numbers = itertools.takewhile(lambda k: f"q{k}" in named, itertools.count(1))
    return max(1, sum(1 for _ in numbers))


class _Reader:
    """One call of `read`: carries what the messages need."""

    def __init__(
        self, shown: str, joints: Sequence[Mapping[str, Any]], space: bool, mapping: Mapping[str, str], allow_gaps: bool
    ) -> None:
        self.shown, self.joints, self.space = shown, joints, space
        self.mapping, self.allow_gaps = mapping, allow_gaps

    def fail(self, message: str, line: int | None = None) -> NoReturn:
        at = f" line {line}" if line else ""
        raise RecordingError(f"{self.shown}{at}: {_shown(message)}")

    def read(self, path: Path) -> Recording:
        text = self.decode(self.load(path))
        start = 1 + len(text) - len(text.lstrip("\n"))  # blank lines before the header
        header_line, _, body = text.lstrip("\n").partition("\n")
        if not header_line.strip():
            self.fail("is empty; expected a header such as t [s],q1 [rad],tau1 [N m] and one line a sample")
        delimiter = max(",;\t", key=header_line.count)
        header = next(csv.reader([header_line], delimiter=delimiter))
        used = columns(header, self.joints, self.space, self.mapping, lambda message: self.fail(message, start))
        if not body.strip():
            self.fail("has a header but no samples")
        table, lines = self.numbers(body, len(header), used, delimiter, start + 1)
        signals = {c.name: table[:, k] * c.factor + c.offset for k, c in enumerate(used.values())}
        signals, lines = self.finite(signals, lines)
        return self.recording(path, signals, lines)

    def load(self, path: Path) -> bytes:
        """The file's bytes, decompressed. Reads by content, not by the ending of the name."""
        try:
            with open(path, "rb") as file:
                data = file.read(MAX_BYTES + 1)
            if data[:2] == b"\x1f\x8b":
                with gzip.open(io.BytesIO(data)) as unpacked:
                    data = unpacked.read(MAX_BYTES + 1)
        except FileNotFoundError:
            self.fail("no such file; expected a recording in CSV, plain or gzip")
        except IsADirectoryError:
            self.fail("is a directory; expected a recording in CSV, plain or gzip")
        except EOFError:
            self.fail("the gzip file is cut off; copy it again")
        except (zlib.error, gzip.BadGzipFile) as error:
            self.fail(f"the gzip file is damaged ({error}); copy it again")
        except (OSError, ValueError) as error:
            self.fail(f"cannot be read: {getattr(error, 'strerror', None) or error}")
        if len(data) > MAX_BYTES:
            self.fail(f"is larger than {MAX_BYTES // 10**9} GB; split it into several recordings")
        return data

    def decode(self, data: bytes) -> str:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            line = data.count(b"\n", 0, error.start) + 1
            self.fail(f"byte 0x{data[error.start]:02x} is not UTF-8; save the recording as UTF-8", line)
        return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text

    def numbers(
        self, body: str, width: int, used: Mapping[str, Column], delimiter: str, first_line: int
    ) -> tuple[Array, NDArray[np.int64]]:
        """The used columns (N, k) and the line of each row."""
        body = body.rstrip("\n")
        cells = [c.index for c in used.values()]
        if '"' not in body and _is_regular(body, width, delimiter):
            try:
                table = np.loadtxt(io.StringIO(body), delimiter=delimiter, comments=None, usecols=cells, ndmin=2)
                return table, first_line + np.arange(len(table))
            except ValueError:
                pass  # the careful way below finds the cell
        rows, lines = [], []
        for line, text in enumerate(body.split("\n"), first_line):
            if not text.strip():
                continue
            try:
                row = next(csv.reader([text], delimiter=delimiter))
            except csv.Error as error:
                self.fail(f"is no CSV: {error}", line)
            if len(row) != width:
                self.fail(f"has {len(row)} cells; expected {width} as in the header", line)
            rows.append([self.number(row[c.index], c.name, line) for c in used.values()])
            lines.append(line)
        return np.array(rows, dtype=float).reshape(-1, len(cells)), np.array(lines)

    def number(self, cell: str, name: str, line: int) -> float:
        cell = cell.strip()
        if cell.lower() in _ABSENT:
            return math.nan
        try:
            if "_" in cell or not cell.isascii():
                raise ValueError
            return float(cell)
        except ValueError:
            hint = " with a decimal point" if "," in cell else ""
            self.fail(f"{name} is {quote(cell)}; expected a number{hint}", line)

    def finite(self, signals: dict[str, Array], lines: NDArray[np.int64]) -> tuple[dict[str, Array], NDArray[np.int64]]:
        """The signals without NaN, infinite or absurd values; rows with NaN are dropped if gaps are allowed."""
        drop = np.zeros(len(lines), dtype=bool)
        for name, values in list(signals.items()):
            absent = np.isnan(values)
            large = np.abs(values, where=~absent, out=np.zeros_like(values)) > LARGEST
            if large.any():
                k = int(np.argmax(large))
                what = "infinite" if np.isinf(values[k]) else f"{values[k]:.3g}, too large for a reading"
                self.fail(f"{name} is {what}; repair or drop the row", int(lines[k]))
            if absent.any() and not self.allow_gaps:
                self.fail(f"{name} is NaN; drop the row or pass --allow-gaps", int(lines[np.argmax(absent)]))
            if absent.any() and name.startswith("temperature"):
                if absent.all():
                    del signals[name]
                else:  # temperatures are slow, and often logged more slowly than the rest
                    rows = np.arange(len(values))
                    signals[name] = np.interp(rows, rows[~absent], values[~absent]).astype(np.float64)
                continue
            drop |= absent
        if drop.any():
            return {name: values[~drop] for name, values in signals.items()}, lines[~drop]
        return signals, lines

    def recording(self, path: Path, signals: dict[str, Array], lines: NDArray[np.int64]) -> Recording:
        t = signals["t"]
        if len(t) < MIN_SAMPLES:
            left = " are left" if self.allow_gaps else ""
            self.fail(f"only {len(t)} samples{left}; expected at least {MIN_SAMPLES}")
        run = self.runs(signals, lines)
        segments = self.segments(t, run, lines)
        n = len(self.joints)

        def rows(pattern: str, count: int = n) -> Array | None:
            names = [pattern.format(i) for i in range(1, count + 1)]
            if not any(name in signals for name in names):
                return None
            return np.ascontiguousarray([signals.get(name, np.full(len(t), np.nan)) for name in names])

        q, tau = rows("q{}"), rows("tau{}")
        assert q is not None
        assert tau is not None
        self.moving(q, tau)
        rigid = rows("tau{}_rigid")
        for i in range(n):
            if rigid is not None and f"tau{i + 1}_rigid" not in signals:
                self.fail(f"has no column tau{i + 1}_rigid; give the rigid-body torque of every joint, or of none")
        acting, force = IN_SPACE if self.space else IN_PLANE, None
        if any(name in signals for name in acting):
            force = np.array([signals.get(name, np.full(len(t), np.nan)) for name in acting])
        return Recording(
            path=path,
            t=t,
            run=run,
            q=q,
            tau=tau,
            qd=rows("qd{}"),
            q_desired=rows("q{}_desired"),
            q_link=rows("q{}_link"),
            tau_link=rows("tau{}_link"),
            tau_rigid=rigid,
            temperature=tuple(signals.get(f"temperature{i}") for i in range(1, n + 1)),
            force=force,
            segments=segments,
            types=tuple(joint["type"] for joint in self.joints),
        )

    def runs(self, signals: dict[str, Array], lines: NDArray[np.int64]) -> NDArray[np.int64]:
        run = signals.get("run")
        if run is None:
            return np.zeros(len(lines), dtype=np.int64)
        broken = run != np.round(run)
        if broken.any():
            k = int(np.argmax(broken))
            self.fail(f"run is {run[k]:g}; expected a whole number", int(lines[k]))
        return run.astype(np.int64)

    def segments(self, t: Array, run: NDArray[np.int64], lines: NDArray[np.int64]) -> tuple[slice, ...]:
        """Gap-free pieces, each within one run."""
        steps, same = np.diff(t), np.diff(run) == 0
        back = same & (steps <= 0)
        if back.any() and not self.allow_gaps:
            k = int(np.argmax(back)) + 1
            how = "stands still" if t[k] == t[k - 1] else "runs backwards"
            self.fail(
                f"time {how}, {t[k]:.9g} s after {t[k - 1]:.9g} s; "
                "number the runs in a column run, or pass --allow-gaps",
                int(lines[k]),
            )
        step = _median_step(t, run)
        if not step > 0:
            self.fail("time never advances by as much as it goes back; expected seconds in t")
        if wrong := plausible.slow_clock(step):
            self.fail(wrong)
        gap = same & (steps > GAP * step * (1 + ROUNDING))
        if gap.any() and not self.allow_gaps:
            k = int(np.argmax(gap)) + 1
            self.fail(
                f"a gap of {steps[k - 1]:.4g} s in t, over {GAP:g} times the median step of {step:.4g} s; "
                "pass --allow-gaps to split there",
                int(lines[k]),
            )
        edges = [0, *(np.flatnonzero(~same | back | gap) + 1).tolist(), len(t)]
        pieces = tuple(slice(a, b) for a, b in itertools.pairwise(edges) if b - a >= MIN_SEGMENT)
        if not pieces:
            self.fail(f"no piece without a gap has {MIN_SEGMENT} samples; expected a longer recording")
        return pieces

    def moving(self, q: Array, tau: Array) -> None:
        """Joints may be held or passive while others move, but something must move, and by a torque."""
        still = np.ptp(q, axis=1) == 0
        if still.all():
            which = "q1 is" if len(q) == 1 else f"q1 to q{len(q)} are"
            self.fail(f"{which} constant; nothing moves, so nothing can be learned from this recording")
        if not (~still & ~plausible.unpowered(tau)).any():
            i = int(np.flatnonzero(~still)[0])
            self.fail(f"tau{i + 1} is constant ({tau[i, 0]:g}) while q{i + 1} moves; is the right column recorded?")


def _is_regular(body: str, width: int, delimiter: str) -> bool:
    """Whether every line has `width` cells; np.loadtxt looks at the used columns only."""
    text = np.frombuffer(body.encode("utf-8"), np.uint8)
    ends = np.append(np.flatnonzero(text == ord("\n")), len(text))
    marks = np.flatnonzero(text == ord(delimiter))
    return bool(np.all(np.diff(np.searchsorted(marks, ends), prepend=0) == width - 1))


def _median_step(t: Array, run: NDArray[np.int64]) -> float:
    steps = np.diff(t)[np.diff(run) == 0]
    return float(np.median(steps)) if len(steps) else math.nan


def _shown(path: object) -> str:
    """Text for a message: one line, nothing that a terminal would act on."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in os.fsdecode(str(path)))


def write(path: Path | str, recording: Recording) -> None:
    """Write a recording that `read` gives back to 12 digits; gzip if the name ends in .gz.

    The same recording gives the same bytes. Raises OSError.
    """
    position = ["m" if kind == "prismatic" else "rad" for kind in recording.types]
    force = ["N" if kind == "prismatic" else "N m" for kind in recording.types]
    cells: list[tuple[str, Array]] = []
    if len(np.unique(recording.run)) > 1:
        cells.append(("run", recording.run.astype(float)))
    cells.append(("t [s]", recording.t))
    groups = (
        ("q{}", recording.q, position),
        ("qd{}", recording.qd, [f"{u}/s" for u in position]),
        ("tau{}", recording.tau, force),
        ("q{}_desired", recording.q_desired, position),
        ("q{}_link", recording.q_link, position),
        ("tau{}_link", recording.tau_link, force),
        ("tau{}_rigid", recording.tau_rigid, force),
    )
    for name, values, units in groups:
        for i, unit in enumerate(units):
            if values is not None and not np.isnan(values[i]).all():
                cells.append((f"{name.format(i + 1)} [{unit}]", values[i]))
    for i, celsius in enumerate(recording.temperature, 1):
        if celsius is not None:
            cells.append((f"temperature{i} [degC]", celsius))
    if recording.force is not None:
        acting = zip(IN_SPACE.items(), recording.force, strict=False)
        unit_of = {"force": "N", "torque": "N m"}
        cells += [(f"{name} [{unit_of[kind]}]", f) for (name, kind), f in acting if not np.isnan(f).all()]
    row = ",".join(["%.12g"] * len(cells))
    lines = [",".join(name for name, _ in cells)]
    lines += [row % values for values in zip(*(column.tolist() for _, column in cells), strict=True)]
    data = ("\n".join(lines) + "\n").encode()
    files.replace(path, gzip.compress(data, mtime=0) if str(path).endswith(".gz") else data)
