"""The link between a host and an arm's controller: states, reasons, results and ceilings, and the messages of an arm.

The board's C and PROTOCOL.md (codegen.firmware.protocol_text) and the host's protocol.json are generated from it.
"""

from __future__ import annotations

import json
import re
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from math import ceil, exp, pi
from pathlib import Path
from typing import Literal

from codegen.c.c_code import float32
from codegen.c.controller import COORDINATES, MAX_DEGREE, STATUS, Controller
from codegen.c.monitor import SIGNALS, VERDICTS
from codegen.c.records import Record
from codegen.firmware.messages import (
    LARGEST,
    LEAST_FILTER,
    MAX_PHASES,
    MAX_ROWS,
    RATES,
    ROWS_A_MESSAGE,
    STEPS,
    Message,
    commands,
    reports,
)
from symbolic.model_file.arm import Control, DescribedJoint

VERSION = 1
"""Version of the frame and of the messages' meaning."""
TELEMETRY_RECORDS, ACKS = 8, 8
"""Capacity of the board's queues; powers of two."""
OUTRUN = 1.25
"""Times a joint's rate at a stop, or its limit if that is higher: a higher rate ends the damping."""
NOT_READY = 0xFFFFFFFF
"""Fault code of drives that are not ready."""
BAUD, BITS, LINE_SHARE = 1_000_000, 10, 0.9
"""A serial line: default speed, bits per byte, and the share that telemetry may use."""
HEADER = (("version", "u8"), ("type", "u8"), ("sequence", "u16"), ("length", "u16"))
MOST_JOINTS = 16
SOONEST = 5
"""Periods within which every joint is inspected."""
IN_TURN = ("speed", "position", "encoder_frozen")
"""Reasons that are checked for some joints each period, in turn."""


@dataclass(frozen=True)
class MachineState:
    name: str
    number: int
    meaning: str


@dataclass(frozen=True)
class Reason:
    """Why a board has stopped. criterion: the condition that is checked; torque: what the board does at once."""

    name: str
    number: int
    text: str
    criterion: str
    torque: Literal["", "damping", "zero"] = ""
    joint: bool = False


@dataclass(frozen=True)
class Result:
    """The result in an acknowledgement. detail: the meaning of its number."""

    name: str
    number: int
    text: str
    detail: str = ""


STATES = (
    MachineState("idle", 0, "drives off; settings and trajectories are taken"),
    MachineState("armed", 1, "drives on, no torque; waits for run"),
    MachineState("running", 2, "drives on, the controller follows the trajectory"),
    MachineState("stopped", 3, "active damping for a while, then drives off; waits for reset"),
)

REASONS = (
    Reason("none", 0, "nothing has stopped the arm", "since start or reset"),
    Reason("done", 1, "the run is over", "so many periods as `run` asked for have been driven", torque="damping"),
    Reason("host", 2, "stopped by the host", "`stop` was received", torque="damping"),
    Reason("link_lost", 3, "no valid frame from the host", "for more than safety.silence periods", torque="damping"),
    Reason("corrupted", 4, "too many corrupted frames", "more than safety.errors since `arm`", torque="damping"),
    Reason(
        "sequence", 5, "too many commands out of sequence", "more than safety.errors refused since `arm`",
        torque="damping",
    ),
    Reason(
        "not_finite", 6, "the controller met a number that is not finite", "a torque that is infinite or no number",
        torque="zero", joint=True,
    ),
    Reason("tracking", 7, "tracking error", "|q_d - q| over safety.tracking", torque="damping", joint=True),
    Reason("speed", 8, "speed", "|qd|, filtered, over safety.speed (in turn)", torque="damping", joint=True),
    Reason(
        "position", 9, "position", "q below safety.low or above safety.high, in whole counts (in turn)",
        torque="damping", joint=True,
    ),
    Reason(
        "torque_limit", 10, "the torque has been at its limit for too long",
        "some torque limited in more than safety.saturated periods in a row", torque="damping", joint=True,
    ),
    Reason(
        "encoder_frozen", 11, "the encoder does not count",
        "q_d more than safety.frozen from where it was at the last change of the count (in turn)",
        torque="zero", joint=True,
    ),
    Reason(
        "encoder_jump", 12, "the encoder jumps", "more than safety.jump counts between two periods",
        torque="zero", joint=True,
    ),
    Reason(
        "watchdog", 13, "a control period was missed, or came too soon",
        "less than safety.early or more than safety.late microseconds between two steps", torque="damping",
    ),
    Reason(
        "start_position", 14, "the arm does not stand where the trajectory starts",
        "|q_d - q| over safety.start in a run's first period", torque="damping", joint=True,
    ),
    Reason(
        "drive", 15, "a drive reports a fault", "the board's fault code is not 0; `state` carries it", torque="zero"
    ),
)  # fmt: skip

RESULTS = (
    Result(
        "done", 0, "done",
        "of `drive` and `safety`: 0, or the number of the first value, from 1, that a ceiling has lowered",
    ),
    Result("sequence", 1, "refused: out of sequence", "the sequence number that was expected"),
    Result("state", 2, "refused: not in this state", "the state"),
    Result("not_finite", 3, "refused: a value is infinite or no number", "which value of the message, from 0"),
    Result(
        "out_of_range", 4, "refused: a value is outside its range",
        "which value of the message, from 0; after `arm`: which phase, from 0, is shorter than a period",
    ),
    Result("order", 5, "refused: not the part that is next", "the phase or row that is expected"),
    Result("incomplete", 6, "refused: something has not been uploaded", "bits: MISSING"),
    Result("checksum", 7, "refused: the trajectory is not what was sent"),
    Result("unknown", 8, "refused: no such command, or not of this size"),
    Result("not_ready", 9, "refused: the drives are not ready yet"),
)  # fmt: skip

MISSING = {"parameters": 1, "effects": 2, "drive": 4, "safety": 8, "trajectory": 16}
"""What may be missing at `arm`, as bits; `trajectory`: a committed one."""


OVERSPEED = 2.0
"""Times a joint's speed limit, which plans keep: tracking needs some room above it."""
BEYOND = {"revolute": 0.1, "prismatic": 0.02}
"""rad, m beyond a joint's range of position, which plans keep: twice what tracking needs."""
GAIN_ROOM = 10.0
"""Times the model file's gains: up to there they can be tuned without new firmware."""
FACT = 0.05
"""Relative difference that is accepted between the host's rate and encoder steps and the model file's."""
FILTER = 0.5
"""Times the model file's gain of the low-pass on the rates: a smaller gain would hide speed from the guard."""
HIGHEST = 1e38
"""Largest ceiling, below the float that stands for no limit."""
LATE_PERIODS = 2.0
"""Control periods between two steps that are always accepted, even where they exceed TENDON_MOST_LATE."""
_MICROSECONDS = 1e6
_BOARD_HEADER = Path(__file__).resolve().parent / "tree" / "src" / "tendon_board.h"
_KINDS = {"revolute": ("TORQUE", "SPEED", "ERROR", "ANGLE"), "prismatic": ("FORCE", "LINEAR_SPEED", "SLIP", "TRAVEL")}
_DEFINED = re.compile(r"^#define (TENDON_MOST_\w+) ([0-9.e+]+)[fU]? ", re.MULTILINE)


@dataclass(frozen=True)
class Ceiling:
    """A number and its spelling in C: a name of tendon_board.h, or digits."""

    value: float
    text: str

    @property
    def of_board(self) -> bool:
        """Whether it comes from tendon_board.h because the model file has no such limit."""
        return self.text.startswith("TENDON_MOST_")

    def __neg__(self) -> Ceiling:
        return Ceiling(-self.value, self.text[1:] if self.text.startswith("-") else f"-{self.text}")


@dataclass(frozen=True)
class JointCeilings:
    """Ceilings of a joint, in the order of the C structure.

    low, high           ends of the range of position
    finest, coarsest    ends of the range of the encoder's step
    """

    torque_limit: Ceiling
    speed: Ceiling
    tracking: Ceiling
    low: Ceiling
    high: Ceiling
    kp: Ceiling
    kd: Ceiling
    finest: Ceiling
    coarsest: Ceiling

    @classmethod
    def of(cls, joint: DescribedJoint) -> JointCeilings:
        """The ceilings of a joint of the model file."""
        torque, speed, tracking, position = (_of_board(name) for name in _KINDS[joint.type])
        limits, beyond = joint.limits, BEYOND[joint.type]
        low, high = -position, position
        if limits.position is not None:
            low, high = _real(limits.position[0] - beyond), _real(limits.position[1] + beyond)
        finest, coarsest = STEPS
        if joint.encoder_counts:
            step = 2.0 * pi / (joint.encoder_counts * joint.gear_ratio)
            finest, coarsest = (1.0 - FACT) * step, (1.0 + FACT) * step
        gains = joint.gains
        return cls(
            torque_limit=torque if limits.torque is None else _real(limits.torque),
            speed=speed if limits.speed is None else _real(OVERSPEED * limits.speed),
            tracking=tracking,
            low=low,
            high=high,
            kp=_real(GAIN_ROOM * gains.kp) if gains and gains.kp else _of_board("KP"),
            kd=_real(GAIN_ROOM * gains.kd) if gains and gains.kd else _of_board("KD"),
            finest=_real(finest),
            coarsest=_real(coarsest),
        )


@dataclass(frozen=True)
class Ceilings:
    """Limits that the board enforces whatever a host sends, from the model file and, where it has none, tendon_board.h.

    rates     Hz, the accepted range          filter   least gain of the low-pass on the rates
    silence   periods without a valid frame   late     us between two steps
    """

    joints: tuple[JointCeilings, ...]
    rates: tuple[Ceiling, Ceiling]
    filter: Ceiling
    silence: Ceiling
    late: Ceiling

    @classmethod
    def of(cls, joints: Sequence[DescribedJoint], control: Control | None) -> Ceilings:
        """The ceilings for the joints and the [controller] of a model file."""
        rates, gain, late = RATES, LEAST_FILTER, _of_board("LATE")
        rate = _of_board("RATE").value
        if control is not None:
            rate = control.rate
            rates = ((1.0 - FACT) * rate, (1.0 + FACT) * rate)
            gain = FILTER * (1.0 - exp(-2.0 * pi * control.velocity_cutoff / rate))
            periods = ceil(LATE_PERIODS / rate * _MICROSECONDS)
            late = _whole(periods) if periods > late.value else late
        return cls(
            joints=tuple(JointCeilings.of(joint) for joint in joints),
            rates=(_real(rates[0]), _real(rates[1])),
            filter=_real(gain),
            silence=_whole(ceil(_of_board("SILENCE").value / _MICROSECONDS * rate)),
            late=late,
        )

    def document(self) -> dict[str, object]:
        """The ceilings in protocol.json, by the names of the fields of `drive` and `safety` that they limit."""
        page: dict[str, object] = {
            field.name: [getattr(joint, field.name).value for joint in self.joints]
            for field in fields(JointCeilings)
            if field.name not in ("finest", "coarsest")
        }
        return page | {
            "silence": int(self.silence.value),
            "late": int(self.late.value),
            "rate": [end.value for end in self.rates],
            "velocity_gain": self.filter.value,
            "position_per_count": [[joint.finest.value, joint.coarsest.value] for joint in self.joints],
        }

    def rows(self) -> list[str]:
        """The C structure of each joint."""
        return [
            "{" + ", ".join(getattr(joint, field.name).text for field in fields(JointCeilings)) + "}"
            for joint in self.joints
        ]


def _real(value: float) -> Ceiling:
    nearest: float = struct.unpack("<f", struct.pack("<f", min(max(value, -HIGHEST), HIGHEST)))[0]
    return Ceiling(nearest, float32(Fraction(nearest)))


def _whole(value: int) -> Ceiling:
    return Ceiling(value, f"{value}U")


def _of_board(name: str) -> Ceiling:
    """A number of tendon_board.h. Raises KeyError."""
    name = f"TENDON_MOST_{name}"
    return Ceiling(float(dict(_DEFINED.findall(_BOARD_HEADER.read_text(encoding="utf-8")))[name]), name)


@dataclass(frozen=True)
class Protocol:
    """The messages of one arm. types: of its joints; ceilings: the board's limits, whatever is sent; watched: its model
    has a monitor; statistics: the layout of what the board adds up, or None."""

    arm: str
    types: tuple[str, ...]
    messages: tuple[Message, ...]
    ceilings: Ceilings
    watched: bool = False
    statistics: dict[str, object] | None = None

    @classmethod
    def of(cls, controller: Controller) -> Protocol:
        """The protocol of a controller. ValueError for an arm with too many joints."""
        model = controller.model
        types = tuple(joint.type for joint in model.arm.joints)
        if len(types) > MOST_JOINTS:
            raise ValueError(f"{model.arm.name} has {len(types)} joints; a controller takes {MOST_JOINTS}")
        sent = commands(types, records_of(controller), controller.has_contact_coordinates)
        ceilings = Ceilings.of(model.arm.joints, model.arm.controller)
        watched = controller.monitor is not None
        statistics = None if controller.statistics is None else controller.statistics.document()
        every = (*sent, *reports(types, watched, summed=statistics is not None))
        return cls(model.arm.name, types, every, ceilings, watched, statistics)

    def message(self, name: str) -> Message:
        """The message with this name. Raises StopIteration if there is none."""
        return next(message for message in self.messages if message.name == name)

    @property
    def looks(self) -> int:
        """Joints that are inspected each period."""
        return -(-len(self.types) // SOONEST)

    @property
    def commands(self) -> tuple[Message, ...]:
        """Messages to the board."""
        return tuple(message for message in self.messages if message.direction == "command")

    @property
    def reports(self) -> tuple[Message, ...]:
        """Messages from the board."""
        return tuple(message for message in self.messages if message.direction == "report")

    @property
    def fingerprint(self) -> int:
        """CRC-32 of everything on which both ends must agree, without descriptions."""
        layout = [
            self.arm,
            [[m.name, m.number, [[f.name, f.type, f.count] for f in m.fields]] for m in self.messages],
            *([[item.name, item.number] for item in table] for table in (STATES, REASONS, RESULTS)),
            [MISSING, STATUS, COORDINATES, HEADER],
        ]
        return zlib.crc32(json.dumps(layout, separators=(",", ":")).encode())

    def document(self, build: int) -> dict[str, object]:
        """protocol.json for the host. build: CRC-32 of the board's sources."""
        return {
            "name": self.arm,
            "version": VERSION,
            "fingerprint": self.fingerprint,
            "build": build,
            "joints": len(self.types),
            "max_phases": MAX_PHASES,
            "max_rows": MAX_ROWS,
            "rows_a_message": ROWS_A_MESSAGE,
            "max_degree": MAX_DEGREE,
            "no_limit": LARGEST,
            "ceilings": self.ceilings.document(),
            "not_ready": NOT_READY,
            "line": {"bits": BITS, "share": LINE_SHARE},
            "header": [{"name": name, "type": kind} for name, kind in HEADER],
            "messages": [message.to_json() for message in self.messages],
            "states": [vars(state) for state in STATES],
            "reasons": [vars(reason) for reason in REASONS],
            "results": [vars(result) for result in RESULTS],
            "missing": MISSING,
            "status": {flag: bit for flag, (bit, _) in STATUS.items()},
            "coordinates": COORDINATES,
            **({"verdicts": VERDICTS, "signals": SIGNALS} if self.watched else {}),
            **({} if self.statistics is None else {"statistics": self.statistics}),
        }


def records_of(controller: Controller) -> dict[str, Record]:
    """The controller's structs by name, without the arm's name and the precision."""
    arm = controller.model.arm.name
    return {record.name.removeprefix(f"{arm}_").removesuffix("_f32"): record for record in controller.records}
