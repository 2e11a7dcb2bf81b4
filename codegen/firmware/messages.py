"""The messages between a host and an arm's controller: fields, units, ranges, meanings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from codegen.c.controller import COORDINATES, MAX_DEGREE, MIN_DEGREE, Record

MAX_PHASES, MAX_ROWS, ROWS_A_MESSAGE = 16, 256, 8
"""What a board holds of a trajectory: phases, control points of all phases; and control points in a message."""
MOST_DAMPING = 40_000
"""Control periods: ten seconds at 4 kHz. By then whatever was to be damped has come to rest."""
LONGEST = 1000.0
"""s of a phase: up to there, time as a float is fine enough (0.06 ms) for any control period."""
SIZES = {"u8": 1, "u16": 2, "u32": 4, "i32": 4, "float": 4}
WHOLE = {"u8": (0, 2**8 - 1), "u16": (0, 2**16 - 1), "u32": (0, 2**32 - 1), "i32": (-(2**31), 2**31 - 1)}
RATES, STEPS = (1.0, 1e5), (1e-12, 1e3)
"""Hz; rad or m per encoder count: of any arm."""
LEAST_FILTER = 1e-3
"""Of the low-pass on the rates: a time constant of a thousand periods. A slower one would hide speed from the guard."""
LEAST_TORQUE = 1e-6
"""N m or N: less is no limit of a torque but none at all, and with it no damping after a stop."""
LARGEST = (2.0 - 2.0**-23) * 2.0**127
"""The largest float: stands for "no limit"."""

Direction = Literal["command", "report"]


@dataclass(frozen=True)
class Item:
    """A field of a message. count: of an array, None for a scalar; low, high: what is accepted, ends included."""

    name: str
    type: str
    unit: str
    meaning: str
    count: int | None = None
    low: float | None = None
    high: float | None = None

    @property
    def size(self) -> int:
        """Bytes."""
        return SIZES[self.type] * (self.count or 1)

    @property
    def range(self) -> tuple[float, float]:
        """What is accepted, ends included; for a float without limits, every finite one."""
        low, high = WHOLE.get(self.type, (-LARGEST, LARGEST))
        return (low if self.low is None else self.low, high if self.high is None else self.high)


@dataclass(frozen=True)
class Message:
    """direction: command (host to board) or report; states: in which a command is accepted, () stands for all.

    record   the controller's struct that a command fills with all of its fields, or None
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

    def place(self, name: str) -> int:
        """Which value of the message a field begins with, from 0."""
        before = [item.name for item in self.fields].index(name)
        return sum(item.count or 1 for item in self.fields[:before])


IDENTITY = (
    Item("version", "u8", "", "of the protocol"),
    Item("joints", "u8", "", "of the arm"),
    Item("state", "u8", "", "as in `state`"),
    Item("reason", "u8", "", "as in `state`"),
    Item("fingerprint", "u32", "", "of all messages' layouts: a board with another one needs its firmware rebuilt"),
    Item("max_phases", "u16", "", "that a trajectory may have"),
    Item("max_rows", "u16", "", "control points of all phases together"),
    Item("build", "u32", "", "CRC-32 of the generated sources: a board with another one has other equations or rules"),
)
"""The same in every version, as `hello` is, so that a host can always ask."""


@dataclass(frozen=True)
class _Units:
    """Of arrays with a value a joint."""

    position: str
    rate: str
    force: str
    stiffness: str
    damping: str

    @classmethod
    def of(cls, types: Sequence[str]) -> _Units:
        kinds = set(types)
        pairs = (("rad", "m"), ("rad/s", "m/s"), ("N m", "N"), ("N m/rad", "N/m"), ("N m s/rad", "N s/m"))
        if kinds == {"revolute"}:
            return cls(*(first for first, _ in pairs))
        if kinds == {"prismatic"}:
            return cls(*(second for _, second in pairs))
        return cls(*(f"{first} or {second}" for first, second in pairs))


def _floats(record: Record) -> tuple[Item, ...]:
    """The fields of a struct of floats, one after another."""
    return tuple(Item(field.name, "float", field.unit, field.meaning) for field in record.fields)


def commands(types: Sequence[str], records: Mapping[str, Record], contact_coordinates: bool) -> tuple[Message, ...]:
    """Host to board. records: of the controller, by name without the arm's."""
    n, units = len(types), _Units.of(types)
    idle = ("idle",)
    return (
        Message(
            "hello", 1, "command",
            "Who are you? Answered by `identity`; numbers the commands anew, but in `armed` and `running`.",
        ),
        Message(
            "parameters", 2, "command", "The arm's lumped parameters.", _floats(records["parameters"]), idle,
            "parameters",
        ),
        Message(
            "effects", 3, "command", "Parameters of the effects that are compensated.", _floats(records["effects"]),
            idle, "effects",
        ),
        Message("drive", 4, "command", "Encoders, gains and torque limits.", _drive(n, units), idle),
        Message("safety", 5, "command", "When the board stops the arm by itself.", _safety(n, units), idle),
        Message(
            "trajectory", 6, "command", "Begins a new trajectory; its phases and points follow, then `commit`.",
            _trajectory(n, records), idle,
        ),
        Message(
            "phase", 7, "command", "The next phase of the trajectory, equation (9).", _phase(contact_coordinates), idle
        ),
        Message("points", 8, "command", "The next control points of the trajectory.", _points(n, units), idle),
        Message(
            "commit", 9, "command", "The trajectory is whole.",
            (Item("checksum", "u32", "", "CRC-32 of the payloads of trajectory, phase and points as they were sent"),),
            idle,
        ),
        Message("arm", 10, "command", "Drives on, without torque. Needs every setting and a trajectory.", (), idle),
        Message(
            "run", 11, "command", "Follow the trajectory from its start, from the next period on.",
            (
                Item("periods", "u32", "periods", "to drive; 0: until something stops the arm"),
                Item("every", "u32", "periods", "from one telemetry record to the next", low=1),
            ),
            ("armed",),
        ),
        Message("alive", 12, "command", "The host is there: sent when there is nothing else to say."),
        Message(
            "stop", 13, "command",
            "Stop the arm, whatever its sequence number, in every state; a second one ends the damping.",
        ),
        Message(
            "reset", 14, "command", "To idle, once the drives are off; what was uploaded is kept.", (), ("stopped",)
        ),
        Message("query", 15, "command", "Answered by `state`, `counters` and, after the next step, `telemetry`."),
    )  # fmt: skip


def _drive(n: int, units: _Units) -> tuple[Item, ...]:
    return (
        Item("rate", "float", "Hz", "of the control step", None, *RATES),
        Item(
            "velocity_gain",
            "float",
            "1",
            "of the low-pass on the rates: 1 - exp(-2 pi cut-off/rate)",
            None,
            LEAST_FILTER,
            1.0,
        ),
        Item("position_per_count", "float", units.position, "of one encoder count", n, *STEPS),
        Item("zero", "i32", "counts", "where the position is 0", n),
        Item("kp", "float", units.stiffness, "torque per error of position", n, 0.0, 1e9),
        Item("kd", "float", units.damping, "torque per error of rate, and of the damping after a stop", n, 0.0, 1e9),
        Item(
            "torque_limit",
            "float",
            units.force,
            "largest torque in either direction, of the damping too; none is 0, which would leave no damping",
            n,
            LEAST_TORQUE,
        ),
    )


def _safety(n: int, units: _Units) -> tuple[Item, ...]:
    return (
        Item("tracking", "float", units.position, "largest error of position", n, 0.0),
        Item("speed", "float", units.rate, "largest rate, as measured and filtered", n, 0.0),
        Item("low", "float", units.position, "end of the range of position", n),
        Item("high", "float", units.position, "end of the range of position, not below `low`", n),
        Item("start", "float", units.position, "how far from the trajectory's start a run may begin", n, 0.0),
        Item("jump", "i32", "counts", "most between two periods", n, 1),
        Item("frozen", "float", units.position, "desired travel without one encoder count", n, 0.0),
        Item("saturated", "u32", "periods", "in a row with a limited torque that are tolerated", high=2**31 - 1),
        Item("silence", "u32", "periods", "without a valid frame that are tolerated", low=1, high=2**31 - 1),
        Item("errors", "u32", "", "corrupted frames, and commands out of sequence, that are tolerated from `arm` on"),
        Item("early", "u32", "us", "least between two steps"),
        Item("late", "u32", "us", "most between two steps, not below `early`", low=1),
        Item("damping", "u32", "periods", "of active damping after a stop", high=MOST_DAMPING),
    )


def _trajectory(n: int, records: Mapping[str, Record]) -> tuple[Item, ...]:
    return (
        Item("count", "u32", "", "of the phases", low=1, high=MAX_PHASES),
        Item("periodic", "u32", "", "1: the first phase follows the last one; 0: the arm rests at the end", high=1),
        Item("elbow", "i32", "", "sign of sin q_2 in contact coordinates: 1 or -1", low=-1, high=1),
        Item("rows", "u32", "", "control points of all phases", low=MIN_DEGREE + 1, high=MAX_ROWS),
        *(
            Item(f"spring_{f.name}", "float", f.unit, f"{f.meaning}; parallel to the joints, 0 where there is none", n)
            for f in records["spring"].fields
        ),
        *_floats(records["contact"]),
    )


def _phase(contact_coordinates: bool) -> tuple[Item, ...]:
    kinds = COORDINATES if contact_coordinates else {"q": COORDINATES["q"]}
    said = ", ".join(f"{number}: {name}" for name, number in kinds.items())
    return (
        Item("index", "u32", "", "from 0", high=MAX_PHASES - 1),
        Item("coordinates", "u32", "", f"of its points, equation (13): {said}", high=max(kinds.values())),
        Item("degree", "u32", "", "of the polynomials", low=MIN_DEGREE, high=MAX_DEGREE),
        Item("duration", "float", "s", "not less than a control period", low=1e-6, high=LONGEST),
        Item("touches", "u32", "", "1: the plate may be touched; 0: it is not looked for", high=1),
        Item("first_row", "u32", "", "its first control point; it has degree + 1", high=MAX_ROWS - 1 - MIN_DEGREE),
    )


def _points(n: int, units: _Units) -> tuple[Item, ...]:
    return (
        Item("first_row", "u32", "", "from 0", high=MAX_ROWS - 1),
        Item(
            "values", "float", units.position,
            f"{ROWS_A_MESSAGE} control points of {n} coordinates; what is beyond the trajectory's rows is not used",
            ROWS_A_MESSAGE * n,
        ),
    )  # fmt: skip


def reports(types: Sequence[str]) -> tuple[Message, ...]:
    """Board to host."""
    n, units = len(types), _Units.of(types)
    return (
        Message(
            "ack", 0x81, "report", "Answer to every command.",
            (
                Item("type", "u8", "", "of the command"),
                Item("result", "u8", "", "see the results"),
                Item("sequence", "u16", "", "of the command"),
                Item("detail", "u16", "", "see the results"),
            ),
        ),
        Message("identity", 0x82, "report", "Answer to `hello`; the same in every version of the protocol.", IDENTITY),
        Message(
            "state", 0x83, "report", "Sent whenever something in it changes, and after `query`.",
            (
                Item("state", "u8", "", "see the states"),
                Item("reason", "u8", "", "see the reasons"),
                Item("joint", "u8", "", "from 1; 0: no joint in particular"),
                Item("enabled", "u8", "", "1: the drives are on"),
                Item("period", "u32", "periods", "in which the arm was stopped, as telemetry counts them"),
                Item("code", "u32", "", "the board's fault code, with the reason drive; else 0"),
            ),
        ),
        Message(
            "telemetry", 0x84, "report", "A control period: in a run and the damping after it, every so many.",
            (
                Item("period", "u32", "periods", "from 0 in the first one of a run; goes on after it"),
                Item("time_us", "u32", "us", "of the board's clock, at the step; wraps"),
                Item("counts", "i32", "counts", "of the encoders, as the step took them", n),
                Item("torque", "float", units.force, "that the step gave, held until the next one", n),
                Item("q_desired", "float", units.position, "by the trajectory; after a run, where it was left", n),
                Item("phase", "u8", "", "of the trajectory, from 0"),
                Item("status", "u8", "", "bits of the controller's status"),
                Item("state", "u8", "", "after the step"),
                Item("reason", "u8", "", "after the step"),
            ),
        ),
        Message(
            "counters", 0x85, "report", "Since the board's start. Sent after `query` and at every stop.",
            (
                Item("bad_frame", "u32", "", "frames that are no COBS, or too short or too long"),
                Item("bad_crc", "u32", "", "frames whose checksum is wrong"),
                Item("bad_header", "u32", "", "frames of another version, or of another length than they say"),
                Item("unknown", "u32", "", "frames of an unknown type, or of another size than their type's"),
                Item("out_of_order", "u32", "", "commands out of sequence"),
                Item("duplicates", "u32", "", "commands that came again"),
                Item("refused", "u32", "", "commands refused for what they say"),
                Item("telemetry_lost", "u32", "", "records that the link did not take in time"),
                Item("acks_lost", "u32", "", "acknowledgements that the link did not take in time"),
            ),
        ),
    )  # fmt: skip
