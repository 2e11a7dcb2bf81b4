"""The messages between a host and an arm's controller: fields, units, ranges, meanings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from codegen.c.controller import COORDINATES, MAX_DEGREE, MIN_DEGREE
from codegen.c.monitor import SIGNALS, VERDICTS
from codegen.c.records import Record

MAX_PHASES, MAX_ROWS, ROWS_A_MESSAGE = 16, 256, 8
"""Capacity of a board: phases, and control points of all phases; and control points in a message."""
ROOMY = ("TENDON_MAX_PHASES=4096U", "TENDON_MAX_ROWS=32768U")
"""Macros of a board with the memory of a computer: motions of a quarter of an hour, 2 MB for sixteen joints."""
MOST_DAMPING = 40_000
"""Control periods: ten seconds at 4 kHz, in which any motion has come to rest."""
LONGEST = 1000.0
"""s of a phase: up to there a float resolves time (0.06 ms) finely enough for any control period."""
SIZES = {"u8": 1, "u16": 2, "u32": 4, "i32": 4, "float": 4}
WHOLE = {"u8": (0, 2**8 - 1), "u16": (0, 2**16 - 1), "u32": (0, 2**32 - 1), "i32": (-(2**31), 2**31 - 1)}
RATES, STEPS = (1.0, 1e5), (1e-12, 1e3)
"""Hz; rad or m per encoder count: of any arm."""
LEAST_FILTER = 1e-3
"""Least gain of the low-pass on the rates: a time constant of 1000 periods. A slower one would hide the speed."""
LEAST_TORQUE = 1e-6
"""N m or N: a lower limit would leave no damping after a stop."""
LARGEST = (2.0 - 2.0**-23) * 2.0**127
"""The largest float, which stands for "no limit"."""

Direction = Literal["command", "report"]


@dataclass(frozen=True)
class Item:
    """A field of a message. count: of an array, None for a scalar; low, high: the accepted range, ends included.

    capacity   the upper end in C where a board may be built with more
    """

    name: str
    type: str
    unit: str
    meaning: str
    count: int | None = None
    low: float | None = None
    high: float | None = None
    capacity: str = ""

    @property
    def size(self) -> int:
        """Bytes."""
        return SIZES[self.type] * (self.count or 1)

    @property
    def range(self) -> tuple[float, float]:
        """The accepted range, ends included; every finite number for a float without limits."""
        low, high = WHOLE.get(self.type, (-LARGEST, LARGEST))
        return (low if self.low is None else self.low, high if self.high is None else self.high)


@dataclass(frozen=True)
class Message:
    """A message.

    direction   command (host to board) or report (board to host)
    states      in which a command is accepted; () for all
    record      the controller's struct that a command fills completely, or None
    """

    name: str
    number: int
    direction: Direction
    meaning: str
    fields: tuple[Item, ...] = ()
    states: tuple[str, ...] = ()
    record: str | None = None

    @property
    def size(self) -> int:
        """Bytes of the payload."""
        return sum(item.size for item in self.fields)

    def to_json(self) -> dict[str, object]:
        """The message in protocol.json."""
        head = {"name": self.name, "number": self.number, "direction": self.direction, "size": self.size}
        fields = []
        for f in self.fields:
            low, high = f.range
            own = {"name": f.name, "type": f.type, "count": f.count, "unit": f.unit, "meaning": f.meaning}
            fields.append({**own, "low": low, "high": high})
        return {**head, "states": list(self.states), "fields": fields}

    def place(self, name: str) -> int:
        """Index of a field's first value among all values of the message, from 0."""
        before = [item.name for item in self.fields].index(name)
        return sum(item.count or 1 for item in self.fields[:before])


def _numbered(table: Mapping[str, int]) -> str:
    return ", ".join(f"{number} {word}" for word, number in table.items())


Row = tuple[Any, ...]
"""Name, type, unit, meaning, and, where they are restricted, the least and the largest accepted value, and the latter
in C where a board may be built with more. A type ends with [n] for an array with a value a joint; a unit "rad|m" is rad
for revolute joints and m for prismatic ones."""

IDENTITY: tuple[Row, ...] = (
    ("version", "u8", "", "of the protocol"),
    ("joints", "u8", "", "of the arm"),
    ("state", "u8", "", "as in `state`"),
    ("reason", "u8", "", "as in `state`"),
    ("fingerprint", "u32", "", "of all messages' layouts: a board with another one needs new firmware"),
    ("max_phases", "u16", "", "that a trajectory may have"),
    ("max_rows", "u16", "", "control points of all phases together"),
    ("build", "u32", "", "CRC-32 of the generated sources: a board with another one has other equations or rules"),
)
"""The same in every version, as `hello` is, so that a host can always ask."""
_DRIVE: tuple[Row, ...] = (
    ("rate", "float", "Hz", "of the control step", *RATES),
    ("velocity_gain", "float", "1", "of the low-pass on the rates: 1 - exp(-2 pi cut-off/rate)", LEAST_FILTER, 1.0),
    ("position_per_count", "float[n]", "rad|m", "of one encoder count", *STEPS),
    ("zero", "i32[n]", "counts", "where the position is 0"),
    ("kp", "float[n]", "N m/rad|N/m", "torque per error of position", 0.0, 1e9),
    ("kd", "float[n]", "N m s/rad|N s/m", "torque per error of rate, and of the damping after a stop", 0.0, 1e9),
    ("torque_limit", "float[n]", "N m|N", "largest torque in either direction, also of the damping", LEAST_TORQUE),
)
_SAFETY: tuple[Row, ...] = (
    ("tracking", "float[n]", "rad|m", "largest error of position", 0.0),
    ("speed", "float[n]", "rad/s|m/s", "largest rate, as measured and filtered", 0.0),
    ("low", "float[n]", "rad|m", "lower end of the range of position"),
    ("high", "float[n]", "rad|m", "upper end of the range of position, not below `low`"),
    ("start", "float[n]", "rad|m", "largest distance from the trajectory's start at which a run may begin", 0.0),
    ("jump", "i32[n]", "counts", "largest change between two periods", 1),
    ("frozen", "float[n]", "rad|m", "largest desired motion without a change of the count", 0.0),
    ("saturated", "u32", "periods", "in a row with a limited torque that are tolerated", None, 2**31 - 1),
    ("silence", "u32", "periods", "without a valid frame that are tolerated", 1, 2**31 - 1),
    ("errors", "u32", "", "corrupted frames, and commands out of sequence, that are tolerated since `arm`"),
    ("early", "u32", "us", "shortest time between two steps"),
    ("late", "u32", "us", "longest time between two steps, not below `early`", 1),
    ("damping", "u32", "periods", "of active damping after a stop", None, MOST_DAMPING),
)
_TRAJECTORY: tuple[Row, ...] = (
    ("count", "u32", "", "of the phases", 1, MAX_PHASES, "TENDON_MAX_PHASES"),
    ("periodic", "u32", "", "1: the first phase follows the last one; 0: the arm rests at the end", None, 1),
    ("elbow", "i32", "", "sign of sin q_2 in contact coordinates: 1 or -1", -1, 1),
    ("rows", "u32", "", "control points of all phases", MIN_DEGREE + 1, MAX_ROWS, "TENDON_MAX_ROWS"),
)
_PHASE: tuple[Row, ...] = (
    ("index", "u32", "", "from 0", None, MAX_PHASES - 1, "TENDON_MAX_PHASES - 1U"),
    ("degree", "u32", "", "of the polynomials", MIN_DEGREE, MAX_DEGREE),
    ("duration", "float", "s", "not less than a control period", 1e-6, LONGEST),
    ("touches", "u32", "", "1: the plate may be touched; 0: contact forces are not computed", None, 1),
    (
        "first_row", "u32", "", "its first control point; it has degree + 1", None, MAX_ROWS - 1 - MIN_DEGREE,
        f"TENDON_MAX_ROWS - {1 + MIN_DEGREE}U",
    ),
)  # fmt: skip
_RUN: tuple[Row, ...] = (
    ("periods", "u32", "periods", "to drive; 0: until something stops the arm"),
    ("every", "u32", "periods", "from one telemetry record to the next", 1),
)
_ACK: tuple[Row, ...] = (
    ("type", "u8", "", "of the command"),
    ("result", "u8", "", "see the results"),
    ("sequence", "u16", "", "of the command"),
    ("detail", "u16", "", "see the results"),
)
_STATE: tuple[Row, ...] = (
    ("state", "u8", "", "see the states"),
    ("reason", "u8", "", "see the reasons"),
    ("joint", "u8", "", "from 1; 0: no joint in particular"),
    ("enabled", "u8", "", "1: the drives are on"),
    ("period", "u32", "periods", "in which the arm was stopped, counted as in telemetry"),
    ("code", "u32", "", "the board's fault code, with the reason drive; else 0"),
)
_TELEMETRY: tuple[Row, ...] = (
    ("period", "u32", "periods", "since the first one of the run, which is 0; continues after the run"),
    ("time_us", "u32", "us", "of the board's clock, at the step; wraps"),
    ("counts", "i32[n]", "counts", "of the encoders, at the step"),
    ("torque", "float[n]", "N m|N", "output of the step, held until the next one"),
    ("q_desired", "float[n]", "rad|m", "by the trajectory; after a run, the last one"),
    ("phase", "u8", "", "of the trajectory, from 0; wraps"),
    ("status", "u8", "", "bits of the controller's status"),
    ("state", "u8", "", "after the step"),
    ("reason", "u8", "", "after the step"),
)
_WATCHED: tuple[Row, ...] = (
    ("verdict", "u8[n]", "", f"whether the model holds as the record is sent: {_numbered(VERDICTS)}"),
    ("signal", "u8[n]", "", f"which the residual follows: {_numbered(SIGNALS)}"),
    ("drifting", "u16[n]", "steps", "the sum that tells drift; controller.json has where it is an alarm"),
)
"""Behind the telemetry of an arm whose model is watched."""
PRODUCTS_A_MESSAGE = 16
_STATISTICS: tuple[Row, ...] = (
    ("number", "u32", "", "of the block, of which this is a part; all parts of one are of the same rows"),
    ("place", "u32", "", "of the first product; those beyond the last are 0"),
    ("rows", "u32[n]", "", "that the block has added, a joint"),
)
_COUNTERS: tuple[Row, ...] = (
    ("bad_frame", "u32", "", "frames that are not valid COBS, too short or too long"),
    ("bad_crc", "u32", "", "frames with a wrong checksum"),
    ("bad_header", "u32", "", "frames of another version, or whose length differs from the stated one"),
    ("unknown", "u32", "", "frames of an unknown type, or whose size does not fit their type"),
    ("out_of_order", "u32", "", "commands out of sequence"),
    ("duplicates", "u32", "", "repeated commands"),
    ("refused", "u32", "", "commands refused because of a value or of the state"),
    ("telemetry_lost", "u32", "", "records for which there was no room"),
    ("acks_lost", "u32", "", "acknowledgements for which there was no room"),
)


def _unit(text: str, types: Sequence[str]) -> str:
    units = [unit for unit, kind in zip(text.split("|"), ("revolute", "prismatic"), strict=False) if kind in types]
    return " or ".join(units) if "|" in text else text


def _items(rows: Sequence[Row], types: Sequence[str]) -> tuple[Item, ...]:
    """The fields that rows describe, for joints of these types."""
    found = []
    for name, kind, unit, meaning, *ends in rows:
        count = len(types) if kind.endswith("[n]") else None
        given: tuple[Any, ...] = tuple(ends)
        low, high, capacity = given + (None, None, "")[len(given) :]
        item = Item(
            name, kind.removesuffix("[n]"), _unit(unit, types), meaning,
            count=count, low=low, high=high, capacity=capacity,
        )  # fmt: skip
        found.append(item)
    return tuple(found)


def commands(types: Sequence[str], records: Mapping[str, Record], contact_coordinates: bool) -> tuple[Message, ...]:
    """The messages from host to board.

    types                 of the joints
    records               structs of the controller, by name without the arm's
    contact_coordinates   whether the arm has them
    """

    def floats(record: str) -> tuple[Item, ...]:
        return tuple(Item(f.name, "float", f.unit, f.meaning) for f in records[record].fields)

    note = "; parallel to the joints, 0 where there is none"
    springs = [
        replace(item, name=f"spring_{item.name}", meaning=f"{item.meaning}{note}", count=len(types))
        for item in floats("spring")
    ]
    trajectory = (*_items(_TRAJECTORY, types), *springs, *floats("contact"))
    kinds = COORDINATES if contact_coordinates else {"q": COORDINATES["q"]}
    said = f"of its points, equation (13): {', '.join(f'{number}: {name}' for name, number in kinds.items())}"
    index, *phase = _items(_PHASE, types)
    coordinates = Item("coordinates", "u32", "", said, high=max(kinds.values()))
    values = f"{ROWS_A_MESSAGE} control points of {len(types)} coordinates; any beyond the trajectory's rows are unused"
    points = (
        Item("first_row", "u32", "", "from 0", high=MAX_ROWS - 1, capacity="TENDON_MAX_ROWS - 1U"),
        Item("values", "float", _unit("rad|m", types), values, count=ROWS_A_MESSAGE * len(types)),
    )
    checksum = Item("checksum", "u32", "", "CRC-32 of the payloads of trajectory, phase and points as they were sent")
    rows: tuple[Row, ...] = (
        ("hello", "Asks for `identity`. Restarts the sequence numbers, except in `armed` and `running`.", (), ()),
        ("parameters", "The arm's lumped parameters.", floats("parameters"), ("idle",)),
        ("effects", "Parameters of the effects that are compensated.", floats("effects"), ("idle",)),
        ("drive", "Encoders, gains and torque limits.", _items(_DRIVE, types), ("idle",)),
        ("safety", "When the board stops the arm by itself.", _items(_SAFETY, types), ("idle",)),
        ("trajectory", "Begins a new trajectory; its phases and points follow, then `commit`.", trajectory, ("idle",)),
        ("phase", "The next phase of the trajectory, equation (9).", (index, coordinates, *phase), ("idle",)),
        ("points", "The next control points of the trajectory.", points, ("idle",)),
        ("commit", "The trajectory is complete.", (checksum,), ("idle",)),
        ("arm", "Drives on, without torque. Needs every setting and a trajectory.", (), ("idle",)),
        ("run", "Follow the trajectory from its start, from the next period on.", _items(_RUN, types), ("armed",)),
        ("alive", "The host is there: sent when there is nothing else to send.", (), ()),
        ("stop", "Stop the arm, whatever the sequence number, in every state; a second one ends the damping.", (), ()),
        ("reset", "To idle, once the drives are off; what was uploaded is kept.", (), ("stopped",)),
        ("query", "Answered by `state`, `counters` and, after the next step, `telemetry`.", (), ()),
    )
    structs = ("parameters", "effects")
    return tuple(
        Message(
            name, number, "command", meaning, fields=fields, states=states, record=name if name in structs else None
        )
        for number, (name, meaning, fields, states) in enumerate(rows, 1)
    )


def reports(types: Sequence[str], watched: bool, summed: bool) -> tuple[Message, ...]:
    """The messages from board to host, for joints of these types.

    watched   the arm's model has a monitor     summed   the board adds up statistics
    """
    sums = tuple(
        Item(name, "float", "SI units", f"{what}, in the layout of controller.json", count=PRODUCTS_A_MESSAGE)
        for name, what in (("high", "sums of products"), ("low", "what these have lost by rounding"))
    )
    made = tuple(
        Message(name, number, "report", meaning, fields=_items(fields, types))
        for number, (name, meaning, fields) in enumerate(_report_rows(watched), 0x81)
    )
    if not summed:
        return made
    meaning = "A part of a block of sufficient statistics. A block is sent once a minute and after `query`."
    fields = (*_items(_STATISTICS, types), *sums)
    return (*made, Message("statistics", made[-1].number + 1, "report", meaning, fields=fields))


def _report_rows(watched: bool) -> tuple[tuple[str, str, tuple[Row, ...]], ...]:
    return (
        ("ack", "Answer to every command.", _ACK),
        ("identity", "Answer to `hello`; the same in every version of the protocol.", IDENTITY),
        ("state", "Sent whenever something in it changes, and after `query`.", _STATE),
        (
            "telemetry",
            "A control period of a run or of the damping after it, one in `run.every`.",
            (*_TELEMETRY, *_WATCHED) if watched else _TELEMETRY,
        ),
        ("counters", "Since the board's start. Sent after `query` and at every stop.", _COUNTERS),
    )
