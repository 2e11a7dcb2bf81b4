"""Signals of one joint or recording for a canvas: numbers, panels, and answers to a browser.

A browser asks once for the spec and the table, for columns when a view leaves the loaded range, and for the samples of
a selection. Arrays are sent as little-endian numbers without a header; the spec states their shape. Colours are names
of report/plots/style.py: ink for measurements, before and after for models.
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

from runtime import files
from runtime.arrays import Array

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
    """A curve of arrays (K,) that breaks at values that are not finite."""
    points = [
        (float(a), float(b)) if np.isfinite(a) and np.isfinite(b) else (None, None) for a, b in zip(x, y, strict=True)
    ]
    return DrawnCurve(name, colour, [a for a, _ in points], y=[b for _, b in points], dashed=dashed)


def around(values: Sequence[Array], least: float = 0.0) -> tuple[float, float]:
    """A vertical scale for lines (M,): all finite values and ±`least`, with a margin."""
    finite = [v[np.isfinite(v)] for v in values]
    low = min([*(float(v.min()) for v in finite if len(v)), -least], default=-1.0)
    high = max([*(float(v.max()) for v in finite if len(v)), least], default=1.0)
    margin = 0.05 * (high - low) or abs(high) or 1.0
    return low - margin, high + margin


_FINEST = 64
"""Samples of the shortest blocks that are stored; shorter ones are reduced for every view."""
_COARSER = 8
"""Blocks that make one block of the next level."""


@dataclass(frozen=True)
class _Level:
    """Smallest and largest values of blocks of `size` samples, (L, B) each."""

    size: int
    least: Array
    most: Array

    def coarser(self) -> _Level:
        return _Level(self.size * _COARSER, *_reduced(self.least, self.most, _COARSER))


@dataclass(frozen=True)
class Pyramid:
    """Signals over time as blocks of several sizes, so that every view takes the same time.

    t       (M,) s, never falling
    names   of the lines
    levels  the samples, then blocks of increasing size
    """

    t: Array
    names: tuple[str, ...]
    levels: tuple[_Level, ...]

    @classmethod
    def of(cls, t: Array, lines: Mapping[str, Array]) -> Pyramid:
        """From times (M,) and lines (M,), which break at NaN."""
        values = np.array([lines[name] for name in lines], dtype=float).reshape(len(lines), len(t))
        levels = [_Level(1, values, values)]
        if len(t) > _FINEST:
            levels.append(_Level(_FINEST, *_reduced(values, values, _FINEST)))
        while levels[-1].least.shape[1] > _FINEST:
            levels.append(levels[-1].coarser())
        return cls(t, tuple(lines), tuple(levels))

    def columns(self, begin: float, end: float, columns: int) -> Array:
        """Blocks (1 + 2 L, B) from `begin` to `end`, s, and one on either side.

        Rows: the time of the block's first sample, then the smallest and the largest value of each line.
        columns   of pixels, at least 1; B is at most 2 `columns` + 2
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
        enough = [level for level in self.levels if level.size * columns <= samples]
        return enough[-1] if enough else self.levels[0]


def _reduced(least: Array, most: Array, together: int) -> tuple[Array, Array]:
    """Blocks that join `together` neighbours each; the last one may have fewer."""
    if together == 1 or not least.shape[1]:
        return least, most
    starts = np.arange(0, least.shape[1], together)
    whole = least.shape[1] // together
    if least.shape[1] == whole * together:
        shape = (len(least), whole, together)
        return np.fmin.reduce(least.reshape(shape), axis=2), np.fmax.reduce(most.reshape(shape), axis=2)
    return np.fmin.reduceat(least, starts, axis=1), np.fmax.reduceat(most, starts, axis=1)


MOST_ROWS = 20_000
"""Largest number of samples in a table: enough dots for a cloud, and for three digits of an rms."""
MOST_COLUMNS = 8_192
"""Largest number of columns in an answer: a view on an 8K screen with a margin."""

EMBEDDED_COLUMNS, EMBEDDED_ROWS = 1_000, 3_000
"""Columns and samples that a report embeds for a joint: some 100 kB, so that it can be sent by mail."""


def _moments(line: Array) -> tuple[float, float] | None:
    """Mean and rms of a line (M,); None if it has no value."""
    values = line[np.isfinite(line)]
    return (float(values.mean()), float(np.sqrt(np.mean(values**2)))) if len(values) else None


class AskedWrongly(ValueError):
    """A malformed request of a browser."""


@dataclass(frozen=True)
class SignalSet:
    """Signals of one joint or recording (M samples), and the panels in which they are shown.

    t       (M,) s, never falling
    lines   (M,) each, drawn over time or as clouds
    axes    (M,) each, horizontal axes of the clouds
    floor   noise floor of the residuals, in `unit`; 0: unknown
    unit    of the torque     units   of lines that are not torques, by name
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
        """Blocks of the lines that are drawn over time."""
        drawn = {line.line for panel in self.panels if panel.kind == "time" for line in panel.lines}
        return Pyramid.of(self.t, {name: self.lines[name] for name in self.lines if name in drawn})

    @cached_property
    def signals(self) -> dict[str, Array]:
        """All signals (M,) by name: time, axes, then lines."""
        return {"time": self.t, **{k: v for k, v in self.axes.items() if k != "time"}, **self.lines}

    @property
    def step(self) -> float:
        """Median step, s."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else 1.0

    def spec(self) -> dict[str, object]:
        """Description for signals.js, which it reads before the numbers."""
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
            "whole": {name: _moments(line) for name, line in self.lines.items()},
            "panels": msgspec.to_builtins(self.panels),
        }

    # --- numbers ---

    def columns(self, begin: float, end: float, columns: int) -> Array:
        """As `Pyramid.columns`, with the lines in the order of the spec."""
        return self.pyramid.columns(begin, end, columns)

    def rows(self, ranges: Mapping[str, tuple[float, float]], most: int = MOST_ROWS) -> tuple[int, Array]:
        """Number of samples within all ranges, ends included, and at most `most` of them (S, K), in order of time.

        Of more samples a random choice is returned, the same each time. Raises AskedWrongly for an unknown signal.
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

    # --- requests of a browser ---

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
        """For a report: the spec, columns and samples as 16-bit integers. The signals must be finite."""
        begin, end = (float(self.t[0]), float(self.t[-1])) if len(self.t) else (0.0, 1.0)
        columns = self.columns(begin, np.nextafter(end, np.inf), EMBEDDED_COLUMNS)
        rows = self.rows({}, EMBEDDED_ROWS)[1]
        return {"spec": self.spec(), "columns": [_packed(r) for r in columns], "rows": [_packed(r) for r in rows]}

    # --- a file ---

    def save(self, path: Path) -> None:
        """Write a .npz file. Raises OSError."""
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
        """Read what `save` wrote. Raises OSError, ValueError or KeyError for another file."""
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
