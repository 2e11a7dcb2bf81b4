"""Signals of one joint or recording for a canvas: its numbers, its panels, and answers to a browser.

A browser asks for the spec and the table once, for columns whenever a view has moved beyond what it has, and for the
samples of a selection. Arrays travel as little-endian numbers without a header; the spec says their shape. Colours are
names of report/plots/style.py: ink is what was measured, before and after are models.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from runtime import files

Array = NDArray[np.float64]
Colour = Literal["ink", "faint", "before", "after"]


class DrawnLine(msgspec.Struct, frozen=True):
    """A line of a signal set by its name there, with its label and colour; a curve over time or a cloud."""

    line: str
    name: str
    colour: Colour


class DrawnCurve(msgspec.Struct, frozen=True):
    """A curve with points of its own: x and y (K,), None where it breaks."""

    name: str
    colour: Colour
    x: list[float | None]
    y: list[float | None]
    dashed: bool = False


class SignalPanel(msgspec.Struct, frozen=True):
    """A panel of a signal set; panels zoom one by one and share a selection.

    kind      "time": lines over time; "over": clouds over another signal; "curves": curves alone
    x         name of the signal on the horizontal axis
    labels    of the axes, with units
    low, high vertical scale
    band      ± noise floor, or for "curves" from 0 to it; 0: none
    stretch   the horizontal axis is linear within this distance from 0 and logarithmic beyond it; 0: linear
    log       the vertical axis is logarithmic
    marks     positions on the horizontal axis to mark
    note      a sentence below the panel
    """

    kind: Literal["time", "over", "curves"]
    title: str
    x: str
    labels: tuple[str, str]
    low: float
    high: float
    lines: tuple[DrawnLine, ...] = ()
    curves: tuple[DrawnCurve, ...] = ()
    band: float = 0.0
    stretch: float = 0.0
    log: bool = False
    marks: tuple[float, ...] = ()
    note: str = ""


def curve(name: str, colour: Colour, x: Array, y: Array, dashed: bool = False) -> DrawnCurve:
    """A curve of arrays; what is not finite is where it breaks."""
    points = [
        (float(a), float(b)) if np.isfinite(a) and np.isfinite(b) else (None, None) for a, b in zip(x, y, strict=True)
    ]
    return DrawnCurve(name, colour, [a for a, _ in points], y=[b for _, b in points], dashed=dashed)


def around(values: Sequence[Array], least: float = 0.0) -> tuple[float, float]:
    """A vertical scale for lines (M,): all that is finite, with a margin, and `least` about zero if that is given."""
    finite = [v[np.isfinite(v)] for v in values]
    low = min([*(float(v.min()) for v in finite if len(v)), -least], default=-1.0)
    high = max([*(float(v.max()) for v in finite if len(v)), least], default=1.0)
    margin = 0.05 * (high - low) or abs(high) or 1.0
    return low - margin, high + margin


_FINEST = 64
"""Samples of the shortest blocks that are kept: what is shorter is reduced anew at every view."""
_COARSER = 8
"""Blocks that the next level takes for one."""


@dataclass(frozen=True)
class _Level:
    """Of blocks of `size` samples the smallest and the largest values, (L, B) each."""

    size: int
    least: Array
    most: Array

    def coarser(self) -> _Level:
        return _Level(self.size * _COARSER, *_reduced(self.least, self.most, _COARSER))


@dataclass(frozen=True)
class Pyramid:
    """Signals over one time, reduced beforehand so that every view of them costs the same.

    t       (M,) s, never falling
    names   of the lines
    levels  the samples themselves, then ever longer blocks
    """

    t: Array
    names: tuple[str, ...]
    levels: tuple[_Level, ...]

    @classmethod
    def of(cls, t: Array, lines: Mapping[str, Array]) -> Pyramid:
        """Over times (M,), of lines (M,); a line's NaN is a place where it is not drawn."""
        values = np.array([lines[name] for name in lines], dtype=float).reshape(len(lines), len(t))
        levels = [_Level(1, values, values)]
        if len(t) > _FINEST:
            levels.append(_Level(_FINEST, *_reduced(values, values, _FINEST)))
        while levels[-1].least.shape[1] > _FINEST:
            levels.append(levels[-1].coarser())
        return cls(t, tuple(lines), tuple(levels))

    def columns(self, begin: float, end: float, columns: int) -> Array:
        """(1 + 2 L, B) of the samples from `begin` to `end`, s, and one block on either side of them: the time of each
        block's first sample, then the smallest and the largest value of each line.

        columns   of the drawing, at least 1; B is at most 2 `columns` + 2
        """
        first, last = np.searchsorted(self.t, [begin, end], side="left")
        level = self._level(int(last - first), columns)
        blocks = level.least.shape[1]
        start = max(0, first // level.size - 1)
        stop = min(blocks, -(-last // level.size) + 1)
        together = max(1, -(-int(stop - start) // (2 * columns)))
        least, most = _reduced(level.least[:, start:stop], level.most[:, start:stop], together)
        times = self.t[start * level.size : stop * level.size : level.size * together]
        out = np.empty((1 + 2 * len(self.names), len(times)))
        out[0], out[1::2], out[2::2] = times, least, most
        return out

    def _level(self, samples: int, columns: int) -> _Level:
        """The one of the longest blocks that has at least a block a column."""
        enough = [level for level in self.levels if level.size * columns <= samples]
        return enough[-1] if enough else self.levels[0]


def _reduced(least: Array, most: Array, together: int) -> tuple[Array, Array]:
    """Every `together` neighbours as one, the last of those that are left."""
    if together == 1 or not least.shape[1]:
        return least, most
    starts = np.arange(0, least.shape[1], together)
    whole = least.shape[1] // together
    if least.shape[1] == whole * together:
        shape = (len(least), whole, together)
        return np.fmin.reduce(least.reshape(shape), axis=2), np.fmax.reduce(most.reshape(shape), axis=2)
    return np.fmin.reduceat(least, starts, axis=1), np.fmax.reduceat(most, starts, axis=1)


MOST_ROWS = 20_000
"""Samples of a table: as many dots as a cloud needs, drawn in a part of a frame, and enough for three digits of an
rms."""
MOST_COLUMNS = 8_192
"""Of one answer: a view of 8K with a margin."""

EMBEDDED_COLUMNS, EMBEDDED_ROWS = 1_000, 3_000
"""Of a page that stands alone, a joint: some 100 kB, so that a report of an arm can still be sent to others."""


class AskedWrongly(ValueError):
    """A browser's question that has no answer; the message says why."""


@dataclass(frozen=True)
class SignalSet:
    """Signals of one joint or recording (M samples), and the panels in which they are shown.

    title   what it is
    t       (M,) s, never falling
    lines   (M,) each, drawn over time or as clouds
    axes    (M,) each, that clouds are drawn over
    floor   noise floor of the residuals, in `unit`; 0: there is none
    unit    of the torque     units   of lines that are none
    """

    title: str
    t: Array
    lines: Mapping[str, Array]
    axes: Mapping[str, Array]
    panels: tuple[SignalPanel, ...]
    floor: float
    unit: str
    units: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def pyramid(self) -> Pyramid:
        """Of the lines that are drawn over time."""
        drawn = {line.line for panel in self.panels if panel.kind == "time" for line in panel.lines}
        return Pyramid.of(self.t, {name: self.lines[name] for name in self.lines if name in drawn})

    @cached_property
    def signals(self) -> dict[str, Array]:
        """All that a sample has, by name: its time, then what clouds are drawn over, then the lines."""
        return {"time": self.t, **{k: v for k, v in self.axes.items() if k != "time"}, **self.lines}

    @property
    def step(self) -> float:
        """Median step, s."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else 1.0

    def spec(self) -> dict[str, object]:
        """What signals.js needs to know before it asks for numbers."""
        return {
            "title": self.title,
            "samples": len(self.t),
            "begin": float(self.t[0]) if len(self.t) else 0.0,
            "end": float(self.t[-1]) if len(self.t) else 1.0,
            "step": self.step,
            "lines": list(self.pyramid.names),
            "signals": list(self.signals),
            "floor": self.floor,
            "unit": self.unit,
            "units": dict(self.units),
            "panels": msgspec.to_builtins(self.panels),
        }

    # --- numbers ---

    def columns(self, begin: float, end: float, columns: int) -> Array:
        """(1 + 2 L, B): as `Pyramid.columns`, of the lines in the order of the spec."""
        return self.pyramid.columns(begin, end, columns)

    def rows(self, ranges: Mapping[str, tuple[float, float]], most: int = MOST_ROWS) -> tuple[int, Array]:
        """How many samples lie in all ranges, ends included, and at most so many of them (S, K), in their order.

        Of more the same ones are picked each time, at random. Raises AskedWrongly for a signal that is not there.
        """
        inside = np.ones(len(self.t), dtype=bool)
        for name, (low, high) in ranges.items():
            if name not in self.signals:
                raise AskedWrongly(f"no signal {name!r}")
            inside &= (self.signals[name] >= low) & (self.signals[name] <= high)
        found = np.flatnonzero(inside)
        picked = found
        if len(found) > most:
            picked = np.sort(np.random.default_rng(0).choice(found, most, replace=False))
        return len(found), np.array([signal[picked] for signal in self.signals.values()])

    # --- a browser's questions ---

    def answer(self, what: str, query: Mapping[str, str]) -> tuple[bytes, str]:
        """Body and media type of an answer. Raises AskedWrongly.

        spec     JSON
        columns  ?begin=&end=&columns= : float64, as `columns`
        rows     ?NAME=low,high&... : float64, the number of samples and then (S, K), as `rows`; all without a range
        """
        if what == "spec":
            return json.dumps(self.spec(), allow_nan=False).encode(), "application/json"
        if what == "columns":
            columns = int(min(max(_finite(query.get("columns", "")), 1), MOST_COLUMNS))
            found = self.columns(_finite(query.get("begin", "")), _finite(query.get("end", "")), columns)
            return found.astype("<f8").tobytes(), "application/octet-stream"
        if what == "rows":
            count, rows = self.rows({name: _range(text) for name, text in query.items()})
            return np.array(count, "<f8").tobytes() + rows.astype("<f8").tobytes(), "application/octet-stream"
        raise AskedWrongly(f"no {what!r}; expected spec, columns or rows")

    def embedded(self) -> dict[str, object]:
        """For a page that stands alone: the spec, a drawing's worth of columns, and a cloud's worth of samples, in
        whole numbers of 16 bits: the signals must be finite."""
        begin, end = (float(self.t[0]), float(self.t[-1])) if len(self.t) else (0.0, 1.0)
        columns = self.columns(begin, np.nextafter(end, np.inf), EMBEDDED_COLUMNS)
        rows = self.rows({}, EMBEDDED_ROWS)[1]
        return {"spec": self.spec(), "columns": [_packed(r) for r in columns], "rows": [_packed(r) for r in rows]}

    # --- a file ---

    def save(self, path: Path) -> None:
        """As .npz. Raises OSError."""
        kept = {"title": self.title, "panels": self.panels, "floor": self.floor, "unit": self.unit}
        document = {**kept, "units": self.units, "lines": list(self.lines), "axes": list(self.axes)}
        arrays = {f"line{k}": v for k, v in enumerate(self.lines.values())}
        arrays |= {f"axis{k}": v for k, v in enumerate(self.axes.values())}
        buffer = io.BytesIO()
        text = msgspec.json.encode(document)
        np.savez(buffer, allow_pickle=False, document=np.frombuffer(text, dtype=np.uint8), t=self.t, **arrays)
        files.replace(path, buffer.getvalue())

    @classmethod
    def load(cls, path: Path) -> SignalSet:
        """As `save` wrote it. Raises OSError, ValueError or KeyError where it did not."""
        with np.load(path, allow_pickle=False) as kept:
            document = json.loads(kept["document"].tobytes())
            lines, axes, panels = (document.pop(name) for name in ("lines", "axes", "panels"))
            return cls(
                t=kept["t"],
                lines={name: kept[f"line{k}"] for k, name in enumerate(lines)},
                axes={name: kept[f"axis{k}"] for k, name in enumerate(axes)},
                panels=msgspec.convert(panels, tuple[SignalPanel, ...]),
                **document,
            )


def _packed(values: Array) -> dict[str, object]:
    """Numbers between their ends, in steps of 1/65535, as text."""
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
    steps = np.rint((values - low) * (65535 / ((high - low) or 1.0))).astype("<u2")
    return {"low": low, "high": high, "data": f"base64,{base64.b64encode(steps.tobytes()).decode()}"}


def _finite(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise AskedWrongly(f"{text!r} is no finite number")
    return value


def _range(text: str) -> tuple[float, float]:
    low, comma, high = text.partition(",")
    if not comma:
        raise AskedWrongly(f"{text!r} is no range; expected low,high")
    return _finite(low), _finite(high)
