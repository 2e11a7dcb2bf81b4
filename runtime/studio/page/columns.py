"""Which column of a recording is which signal, in which unit and with which sign: chosen from lists, and previewed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain
from math import inf

from msgspec.structs import replace

from runtime.inspection.guesses import alike
from runtime.recordings.columns import UNITS, MappedColumn, normal_unit
from runtime.recordings.names import bare
from runtime.recordings.recording import TORQUE
from runtime.studio.documents import ColumnOverview, RecordingOverview
from runtime.studio.inputs import GivenReading, GivenRecording
from runtime.studio.page.view import PageView, button, folded, put
from runtime.wording import number
from symbolic.model_file.arm import TORQUES

NONE = ""
"""No column."""
_NAMES = {"t": "time", "q": "position", "qd": "velocity", "tau": "torque or current", "temperature": "temperature"}
_HEADS = ("signal", "column", "unit", "sign", "first rows", "range", "picture")
_WIDTH, _HEIGHT = 120, 28
"""px of a small picture."""

Choice = Mapping[str, str]
"""Signal -> column as entries of `--map` name it; TORQUE -> what the torques are."""


def columns(view: PageView, given: GivenRecording, shown: RecordingOverview) -> None:
    """The columns of a recording: folded where it is read without a problem and nothing is being chosen."""
    choosing = _Choosing(view, given, shown, _chosen(view, given, shown))
    unread, mapped = not shown.cells, bool(given.reading.maps)
    with folded("Columns, units and signs", open_=given.given.file in view.choices or unread or mapped):
        if unread and not mapped:
            put("p", "Choose the column of each signal. The choices below are guesses from names and values.")
        choosing.table()
        with put("div", classes="acts"):
            choosing.further()
            choosing.torques()
        choosing.constants()
        choosing.act()


def _chosen(view: PageView, given: GivenRecording, shown: RecordingOverview) -> Choice:
    asked = dict(entry.split("=", 1) for entry in given.reading.maps if "=" in entry)
    stated = {TORQUE: asked[TORQUE]} if TORQUE in asked else {}
    asked = {signal: column for signal, column in asked.items() if signal in shown.units}
    return view.choices.get(given.given.file, (shown.cells or {**shown.guesses, **asked}) | stated)


@dataclass(frozen=True)
class _Choosing:
    """The columns of one recording, as they are chosen in one tab."""

    view: PageView
    given: GivenRecording
    shown: RecordingOverview
    chosen: Choice

    @property
    def file(self) -> str:
        return self.given.given.file

    @cached_property
    def known(self) -> dict[str, ColumnOverview]:
        """The columns of the file by name."""
        return {bare(column.name): column for column in self.view.studio.columns(self.given.given)}

    @cached_property
    def ratios(self) -> dict[int, float]:
        """The gear ratios of joints whose current is recorded and whose torque constant is not known."""
        found = ((k, ratio, self._of(f"tau{k}")) for k, ratio in self.shown.ratios.items())
        return {k: ratio for k, ratio, column in found if UNITS.get(self._unit(column), ("",))[0] == "current"}

    # The table

    def table(self) -> None:
        """A row a signal."""
        with put("div", classes="scroll"), put("table", classes="stack columns-of"):
            with put("thead"), put("tr"):
                for head in _HEADS:
                    put("th", head, scope="col")
            with put("tbody"):
                for signal in self.shown.units:
                    if signal in self.shown.needed or signal in self.chosen:
                        with put("tr", data_signal=signal):
                            self._row(signal)

    def _row(self, signal: str) -> None:
        cell = self._of(signal)
        column = self.known.get(cell.name)
        with put("th", scope="row"):
            put("span", said(signal))
            if cell.name and not self.shown.cells and str(cell) == self.shown.guesses.get(signal):
                put("span", "guessed", "of guessed")
        names = {NONE: "none yet" if signal in self.shown.needed else "none"} | {name: name for name in self.known}
        with put("td", data_is="column"):
            self._list(signal, "column", names, cell.name if column else NONE, chosen=partial(self._name, signal))
        with put("td", data_is="unit"):
            if column is not None and self.shown.units[signal]:
                options = self._units(signal, column, cell)
                self._list(signal, "unit", options, cell.unit, chosen=partial(self._measure, signal))
        with put("td", data_is="sign"):
            if column is not None and _signed(signal):
                signs, sign = {"+": "+", "-": "\N{MINUS SIGN}"}, "-" if cell.turned else "+"
                self._list(signal, "sign", signs, sign, chosen=partial(self._turn, signal))
        _preview(column, cell, self.shown.units[signal], self._unit(cell))

    def _list(
        self, signal: str, what: str, options: dict[str, str], value: str, *, chosen: Callable[[str], None]
    ) -> None:
        self.view.choice(f"{self.file} {signal} {what}", "", options=options, value=value, chosen=chosen)

    def _units(self, signal: str, column: ColumnOverview, cell: MappedColumn) -> dict[str, str]:
        units, stated = self.shown.units[signal], MappedColumn.of(column.name).unit
        default = f"{stated}, as the file says" if stated else f"{units[0]}, not stated"
        return {NONE: default} | {unit: unit for unit in (*units, cell.unit) if unit}

    # A choice is made

    def _name(self, signal: str, name: str) -> None:
        """Another column, with the unit that is guessed for it; joints without one take those that are called alike."""
        cell, guess = self._of(signal), MappedColumn.of(self.shown.guesses.get(signal, NONE))
        new = guess if guess.name == name else MappedColumn(name, "", cell.turned)
        others = {}
        for k, other in enumerate(alike(name, list(self.known)) if name else (), 1):
            beside = f"{_stem(signal)}{k}"
            if beside in self.shown.units and beside not in self.chosen:
                others[beside] = str(MappedColumn(other, new.unit, new.turned))
        self._set({**others, signal: str(new)})

    def _measure(self, signal: str, unit: str) -> None:
        before = self._of(signal).unit
        same = [s for s in self.chosen if _stem(s) == _stem(signal) and self._of(s).unit == before and s != TORQUE]
        cells = {s: self._of(s) for s in same if not unit or unit in self.shown.units[s]}
        self._set({s: str(MappedColumn(cell.name, unit, cell.turned)) for s, cell in cells.items()})

    def _turn(self, signal: str, sign: str) -> None:
        cell = self._of(signal)
        self._set({signal: str(MappedColumn(cell.name, cell.unit, sign == "-"))})

    def _set(self, changes: Choice) -> None:
        chosen = {signal: text for signal, text in {**self.chosen, **changes}.items() if text}
        self.view.set(choices={**self.view.choices, self.file: chosen})

    def _forget(self) -> None:
        self.view.set(choices={name: other for name, other in self.view.choices.items() if name != self.file})

    # Below the table

    def further(self) -> None:
        """Signals that a recording may have beside those that it must have."""
        absent = {s: said(s) for s in self.shown.units if s not in self.shown.needed and s not in self.chosen}
        free = next(iter(self.known), NONE)

        def add(signal: str) -> None:
            if signal:
                self._set({signal: self.shown.guesses.get(signal, free)})

        if absent and free:
            options = {NONE: "choose"} | absent
            self.view.choice(f"{self.file} further", "further signal", options=options, value=NONE, chosen=add)

    def torques(self) -> None:
        """What the torques are."""
        self.view.choice(
            f"{self.file} torques",
            "the torques are those of the",
            options={NONE: "motor, if nothing else is stated", **{name: name for name in TORQUES}},
            value=self.chosen.get(TORQUE, NONE),
            chosen=lambda name: self._set({TORQUE: name}),
        )

    def constants(self) -> None:
        """The torque constants that turn currents into torques."""
        if self.ratios:
            put("p", "A current becomes a torque with the torque constant of the motor, which the model lacks.", "of")
        for k, ratio in self.ratios.items():
            label = f"motor of joint {k}, N m/A, times the gear ratio {number(ratio)}"
            value = self.view.constants.get(k, "")
            self.view.entry(f"constant {k}", label, value=value, typed=partial(self._type, k))

    def _type(self, joint: int, text: str) -> None:
        self.view.set(constants={**self.view.constants, joint: text})

    def act(self) -> None:
        """Take the choice, or leave it."""
        absent = [said(signal) for signal in self.shown.needed if signal not in self.chosen]
        stated = {k: _positive(self.view.constants.get(k, "")) for k in self.ratios}
        absent += [f"torque constant {k}" for k, value in stated.items() if value is None]
        constants = {k: self.ratios[k] * value for k, value in stated.items() if value is not None}
        how = self.given.reading
        entries = tuple(f"{signal}={column}" for signal, column in self.chosen.items())
        changed = self.file in self.view.choices or not self.shown.cells
        ready = changed and not (absent or self.view.busy or entries == how.maps)
        with put("div", classes="acts"):
            use = partial(self._use, replace(how, maps=entries), constants)
            button("Use these columns", use, "first" if ready else "", disabled=not ready, data_do="columns")
            if self.file in self.view.choices:
                button("Leave them as they were", self._forget, data_do="columns-back")
            if how.maps:
                plain = partial(self._use, replace(how, maps=()), {})
                button("Read it as the file says", plain, disabled=self.view.busy, data_do="columns-remove")
        if absent:
            put("p", f"Still to be chosen: {', '.join(absent)}.", "of")

    def _use(self, reading: GivenReading, constants: Mapping[int, float]) -> None:
        def take() -> None:
            if constants:
                self.view.studio.state_torque_constants(constants)
            self.view.studio.read_as(self.file, reading)

        self._forget()
        self.view.give(take)

    # Cells

    def _of(self, signal: str) -> MappedColumn:
        """What is chosen for a signal; without a name if nothing is."""
        return MappedColumn.of(self.chosen.get(signal, NONE))

    def _unit(self, cell: MappedColumn) -> str:
        column = self.known.get(cell.name)
        return normal_unit(cell.unit or ("" if column is None else MappedColumn.of(column.name).unit))


def _preview(column: ColumnOverview | None, cell: MappedColumn, units: Sequence[str], unit: str) -> None:
    """First values and range as they will be read, in SI, and the course of the signal."""
    if column is None or column.least is None or column.largest is None:
        put("td", "" if column is None else "no numbers", data_is="first rows")
        for head in ("range", "picture"):
            put("td", data_is=head)
        return
    dimension, factor, offset = UNITS.get(unit, ("", 1.0, 0.0))
    factor = -factor if cell.turned else factor
    # A current is multiplied by the torque constant later; it stays in ampere here.
    si = "A" if dimension == "current" else units[0] if units else ""
    first = ", ".join(number(factor * value + offset, 4) for value in column.first)
    put("td", f"{first} …", "n", data_is="first rows")
    low, high = sorted((factor * column.least + offset, factor * column.largest + offset))
    put("td", f"{number(low, 3)} … {number(high, 3)} {si}", "n", data_is="range")
    with put("td", data_is="picture"):
        _picture(column, turned=cell.turned)


def _picture(column: ColumnOverview, turned: bool) -> None:
    """The course of a column over the file."""
    least, largest = column.least or 0.0, column.largest or 0.0
    scale = (_HEIGHT - 2) / ((largest - least) or 1.0)

    def height(value: float) -> float:
        up = (value - least) * scale
        return 1 + (up if turned else _HEIGHT - 2 - up)

    step = _WIDTH / max(len(column.outline), 1)
    ends = ((k * step, low, high) for k, (low, high) in enumerate(column.outline))
    points = chain.from_iterable(((x, height(low)), (x + step / 2, height(high))) for x, low, high in ends)
    path = "M" + " L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    box = f"0 0 {_WIDTH} {_HEIGHT}"
    with put("svg", role="img", aria_label="its course", viewBox=box, width=_WIDTH, height=_HEIGHT):
        put("path", d=path, classes="course")


def said(signal: str) -> str:
    """A signal in words: q2 is the position of joint 2."""
    stem = _stem(signal)
    return f"{_NAMES[stem]}{', joint ' * (stem != signal)}{signal[len(stem) :]}" if stem in _NAMES else signal


def _stem(signal: str) -> str:
    return signal.rstrip("0123456789")


def _signed(signal: str) -> bool:
    """Whether a signal may have the other sign: positions, rates, torques and commands."""
    return signal.startswith(("q", "tau", "duty", "voltage", "current"))


def _positive(text: str) -> float | None:
    """A number above 0; None for any other text."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if 0 < value < inf else None
