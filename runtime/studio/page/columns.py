"""Which column of a recording is which signal, in which unit and with which sign: chosen from lists, and previewed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import chain
from math import inf

from msgspec.structs import replace

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
_WIDTH, _HEIGHT = 120, 28
"""px of a small picture."""

Choice = Mapping[str, str]
"""Signal -> column as entries of `--map` name it; TORQUE -> what the torques are."""


def columns(view: PageView, given: GivenRecording, shown: RecordingOverview) -> None:
    """The columns of a recording: folded where it is read without a problem and nothing is being chosen."""
    file, chosen = given.given.file, choice(view, given, shown)
    changed = file in view.choices
    with folded("Columns, units and signs", open_=changed or not shown.cells or bool(given.reading.maps)):
        if not shown.cells and not given.reading.maps:
            put("p", "Choose the column of each signal. The choices below are guesses from the names of the columns.")
        _table(view, given, shown, chosen)
        with put("div", classes="acts"):
            _further(view, given, shown, chosen)
            _torques(view, given, chosen)
        _constants(view, _unknown(view, given, shown, chosen))
        _act(view, given, shown, chosen)


def choice(view: PageView, given: GivenRecording, shown: RecordingOverview) -> Choice:
    """What is chosen in this tab; before that how the recording is read, and where it cannot be read what was asked
    for and what is guessed."""
    asked = dict(entry.split("=", 1) for entry in given.reading.maps if "=" in entry)
    stated = {TORQUE: asked[TORQUE]} if TORQUE in asked else {}
    asked = {signal: cell for signal, cell in asked.items() if signal in shown.units}
    return view.choices.get(given.given.file, (shown.cells or {**shown.guesses, **asked}) | stated)


def _table(view: PageView, given: GivenRecording, shown: RecordingOverview, chosen: Choice) -> None:
    known = {bare(column.name): column for column in view.studio.columns(given.given)}
    listed = [signal for signal in shown.units if _needed(signal) or signal in chosen]
    heads = ("signal", "column", "unit", "sign", "first rows", "range", "picture")
    with put("div", classes="scroll"), put("table", classes="stack columns-of"):
        with put("thead"), put("tr"):
            for head in heads:
                put("th", head, scope="col")
        with put("tbody"):
            for signal in listed:
                with put("tr", data_signal=signal):
                    _row(view, given, shown, chosen, signal=signal, known=known)


def _row(
    view: PageView,
    given: GivenRecording,
    shown: RecordingOverview,
    chosen: Choice,
    *,
    signal: str,
    known: Mapping[str, ColumnOverview],
) -> None:
    """A signal: its column, unit and sign, and what is in that column."""
    file, cell = given.given.file, MappedColumn.of(chosen.get(signal, NONE))
    column, units = known.get(cell.name), shown.units[signal]

    def take(other: MappedColumn) -> None:
        rest = {name: text for name, text in chosen.items() if name != signal}
        _set(view, file, rest | ({signal: str(other)} if other.name else {}))

    def named(name: str) -> None:
        """Another column, with the unit that is guessed for it."""
        guess = MappedColumn.of(shown.guesses.get(signal, NONE))
        take(guess if guess.name == name else MappedColumn(name, "", cell.turned))

    with put("th", scope="row"):
        put("span", said(signal))
        if cell.name and not shown.cells and str(cell) == shown.guesses.get(signal):
            put("span", "guessed", "of guessed")
    with put("td", data_is="column"):
        names = {NONE: "none yet" if _needed(signal) else "none"} | {name: name for name in known}
        view.choice(f"{file} {signal}", "", options=names, value=cell.name if column else NONE, chosen=named)
    stated = None if column is None else MappedColumn.of(column.name).unit
    with put("td", data_is="unit"):
        if units and column is not None:
            default = f"{stated}, as the file says" if stated else f"{units[0]}, not stated"
            usual = {unit: unit for unit in (*units, cell.unit) if unit}
            view.choice(
                f"{file} {signal} unit",
                "",
                options={NONE: default} | usual,
                value=cell.unit,
                chosen=lambda unit: take(MappedColumn(cell.name, unit, cell.turned)),
            )
    with put("td", data_is="sign"):
        if column is not None and signal[0] in "qt" and signal != "t" and not signal.startswith("temperature"):
            signs = {"+": "+", "-": "\N{MINUS SIGN}"}
            view.choice(
                f"{file} {signal} sign",
                "",
                options=signs,
                value="-" if cell.turned else "+",
                chosen=lambda sign: take(MappedColumn(cell.name, cell.unit, sign == "-")),
            )
    _preview(column, cell, units, stated or "")


def _preview(column: ColumnOverview | None, cell: MappedColumn, units: Sequence[str], stated: str) -> None:
    """First values and range as they will be read, in SI, and the course of the signal."""
    if column is None:
        for head in ("first rows", "range", "picture"):
            put("td", data_is=head)
        return
    if column.least is None or column.largest is None:
        put("td", "no numbers", "warning", data_is="first rows")
        return
    unit = normal_unit(cell.unit or stated)
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


def _further(view: PageView, given: GivenRecording, shown: RecordingOverview, chosen: Choice) -> None:
    """Signals that a recording may have beside those that it must have."""
    file = given.given.file
    absent = {signal: said(signal) for signal in shown.units if not _needed(signal) and signal not in chosen}
    free = next((column.name for column in view.studio.columns(given.given)), NONE)

    def add(signal: str) -> None:
        if signal:
            _set(view, file, {**chosen, signal: shown.guesses.get(signal, bare(free))})

    if absent and free:
        options = {NONE: "choose"} | absent
        view.choice(f"{file} further", "further signal", options=options, value=NONE, chosen=add)


def _torques(view: PageView, given: GivenRecording, chosen: Choice) -> None:
    """What the torques are."""
    file = given.given.file
    rest = {signal: cell for signal, cell in chosen.items() if signal != TORQUE}
    view.choice(
        f"{file} torques",
        "the torques are those of the",
        options={NONE: "motor, if nothing else is stated", **{name: name for name in TORQUES}},
        value=chosen.get(TORQUE, NONE),
        chosen=lambda name: _set(view, file, rest | ({TORQUE: name} if name else {})),
    )


def _unknown(view: PageView, given: GivenRecording, shown: RecordingOverview, chosen: Choice) -> dict[int, float]:
    """The gear ratios of joints whose current is recorded and whose torque constant is not known."""
    stated = {bare(column.name): MappedColumn.of(column.name).unit for column in view.studio.columns(given.given)}

    def is_current(cell: MappedColumn) -> bool:
        unit = cell.unit or stated.get(cell.name, "")
        return UNITS.get(normal_unit(unit), ("",))[0] == "current"

    found = ((k, ratio, chosen.get(f"tau{k}", NONE)) for k, ratio in shown.ratios.items())
    return {k: ratio for k, ratio, text in found if is_current(MappedColumn.of(text))}


def _constants(view: PageView, ratios: Mapping[int, float]) -> None:
    """The torque constants that turn currents into torques."""
    if ratios:
        put("p", "A current becomes a torque with the torque constant of the motor, which the model file lacks.", "of")
    for k, ratio in ratios.items():
        put_in = partial(_type, view, k)
        typed, times = view.constants.get(k, ""), f"times the gear ratio {number(ratio)}"
        view.entry(f"constant {k}", f"motor of joint {k}, N m/A, {times}", value=typed, typed=put_in)


def _type(view: PageView, joint: int, said: str) -> None:
    view.set(constants={**view.constants, joint: said})


def _positive(said: str) -> float | None:
    """A number above 0; None for any other text."""
    try:
        value = float(said)
    except ValueError:
        return None
    return value if 0 < value < inf else None


def _act(view: PageView, given: GivenRecording, shown: RecordingOverview, chosen: Choice) -> None:
    """Take the choice, or leave it."""
    file, studio = given.given.file, view.studio
    entries = tuple(f"{signal}={cell}" for signal, cell in chosen.items())
    absent = [said(signal) for signal in shown.units if _needed(signal) and signal not in chosen]
    ratios = _unknown(view, given, shown, chosen)
    stated = {k: _positive(view.constants.get(k, "")) for k in ratios}
    absent += [f"torque constant {k}" for k, value in stated.items() if value is None]
    constants = {k: ratios[k] * value for k, value in stated.items() if value is not None}
    taken = set(entries) == set(given.reading.maps)

    def use(reading: GivenReading) -> None:
        def take() -> None:
            if constants:
                studio.state_torque_constants(constants)
            studio.read_as(file, reading)

        _forget(view, file)
        view.give(take)

    with put("div", classes="acts"):
        wanted = replace(given.reading, maps=entries)
        ready = not (absent or taken or view.busy)
        button(
            "Use these columns", partial(use, wanted), "first" if ready else "", disabled=not ready, data_do="columns"
        )
        if file in view.choices:
            button("Leave them as they were", lambda: _forget(view, file), data_do="columns-back")
        if given.reading.maps:
            plain = replace(given.reading, maps=())
            button("Read it as the file says", partial(use, plain), disabled=view.busy, data_do="columns-remove")
    if absent:
        put("p", f"Still to be chosen: {', '.join(absent)}.", "of")


def _set(view: PageView, file: str, chosen: Choice) -> None:
    view.set(choices={**view.choices, file: chosen})


def _forget(view: PageView, file: str) -> None:
    view.set(choices={name: chosen for name, chosen in view.choices.items() if name != file})


def _needed(signal: str) -> bool:
    return signal == "t" or signal.removeprefix("q").isdigit() or signal.removeprefix("tau").isdigit()


def said(signal: str) -> str:
    """A signal in words: q2 is the position of joint 2."""
    stem = signal.rstrip("0123456789")
    return f"{_NAMES[stem]}{', joint ' * (stem != signal)}{signal[len(stem) :]}" if stem in _NAMES else signal
