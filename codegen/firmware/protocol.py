"""The link between a host and an arm's controller: messages, states, reasons and results, in one table.

From it come the C that packs and unpacks (codegen.firmware.protocol_text), protocol.json for the host, and PROTOCOL.md.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass
from typing import Any, Literal

from codegen.c.controller import COORDINATES, MAX_DEGREE, STATUS, Controller, Record
from codegen.firmware.ceilings import Ceilings
from codegen.firmware.messages import LARGEST, MAX_PHASES, MAX_ROWS, ROWS_A_MESSAGE, Message, commands, reports

VERSION = 1
"""Of the frame and of the meaning of messages."""
TELEMETRY_RECORDS, ACKS = 8, 8
"""What a board holds until the link takes it; powers of two."""
OUTRUN = 1.25
"""Of a joint's rate at a stop, or its limit if that is more: a damping in which it gets faster than this ends."""
NOT_READY = 0xFFFFFFFF
"""What a board gives for its fault as long as its drives are not ready."""
BAUD, BITS, LINE_SHARE = 1_000_000, 10, 0.9
"""Of a serial line: its usual speed; bits of a byte on it; the part that telemetry may fill, for answers need some."""
HEADER = (("version", "u8"), ("type", "u8"), ("sequence", "u16"), ("length", "u16"))
MOST_JOINTS = 16
SOONEST = 5
"""Periods within which every joint has been looked at closely."""
IN_TURN = ("speed", "position", "encoder_frozen")
"""Reasons whose criteria are looked at for a part of the joints each period, in turn."""


@dataclass(frozen=True)
class MachineState:
    name: str
    number: int
    meaning: str


@dataclass(frozen=True)
class Reason:
    """Why a board is in its state. torque: what it does at once; criterion: what has to be observed, by which step."""

    name: str
    number: int
    text: str
    criterion: str
    torque: Literal["", "damping", "zero"] = ""
    joint: bool = False


@dataclass(frozen=True)
class Result:
    """What an acknowledgement says. detail: what its number means."""

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
    Reason("done", 1, "the run is over", "so many periods as `run` asked for have been driven", "damping"),
    Reason("host", 2, "stopped by the host", "`stop` was received", "damping"),
    Reason("link_lost", 3, "no valid frame from the host", "for more than safety.silence periods", "damping"),
    Reason("corrupted", 4, "too many corrupted frames", "more than safety.errors since `arm`", "damping"),
    Reason(
        "sequence", 5, "too many commands out of sequence", "more than safety.errors refused since `arm`", "damping"
    ),
    Reason(
        "not_finite", 6, "the controller met a number that is not finite", "a torque that is infinite or no number",
        "zero", True,
    ),
    Reason("tracking", 7, "tracking error", "|q_d - q| over safety.tracking", "damping", True),
    Reason("speed", 8, "speed", "|qd|, filtered, over safety.speed (in turn)", "damping", True),
    Reason(
        "position", 9, "position", "q below safety.low or above safety.high, in whole counts (in turn)", "damping", True
    ),
    Reason(
        "torque_limit", 10, "the torque has been at its limit for too long",
        "some torque limited in more than safety.saturated periods in a row", "damping", True,
    ),
    Reason(
        "encoder_frozen", 11, "the encoder does not count",
        "q_d more than safety.frozen from where it was at the last change of the count (in turn)",
        "zero", True,
    ),
    Reason(
        "encoder_jump", 12, "the encoder jumps", "more than safety.jump counts between two periods", "zero", True
    ),
    Reason(
        "watchdog", 13, "a control period was missed, or came too soon",
        "less than safety.early or more than safety.late microseconds between two steps", "damping",
    ),
    Reason(
        "start_position", 14, "the arm does not stand where the trajectory starts",
        "|q_d - q| over safety.start in a run's first period", "damping", True,
    ),
    Reason("drive", 15, "a drive reports a fault", "the board's fault code is not 0; `state` carries it", "zero"),
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
"""What `arm` may find wanting; `trajectory`: one that is committed."""


@dataclass(frozen=True)
class Protocol:
    """The messages of one arm.

    types      of its joints, as in the model file
    ceilings   what its board keeps to whatever is sent
    """

    arm: str
    types: tuple[str, ...]
    messages: tuple[Message, ...]
    ceilings: Ceilings

    @classmethod
    def of(cls, controller: Controller) -> Protocol:
        """What the link to this controller carries. ValueError for an arm with more joints than a message names."""
        model = controller.model
        types = tuple(joint.type for joint in model.arm.joints)
        if len(types) > MOST_JOINTS:
            raise ValueError(f"{model.arm.name} has {len(types)} joints; a controller takes {MOST_JOINTS}")
        sent = commands(types, records_of(controller), controller.has_contact_coordinates)
        ceilings = Ceilings.of(model.arm.joints, model.arm.controller)
        return cls(model.arm.name, types, (*sent, *reports(types)), ceilings)

    def message(self, name: str) -> Message:
        """The message of this name. Raises StopIteration without one."""
        return next(message for message in self.messages if message.name == name)

    @property
    def looks(self) -> int:
        """Joints that are looked at closely each period."""
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
        """CRC-32 of everything that both ends must agree on, without the words."""
        layout = [
            self.arm,
            [[m.name, m.number, [[f.name, f.type, f.count] for f in m.fields]] for m in self.messages],
            *([[item.name, item.number] for item in table] for table in (STATES, REASONS, RESULTS)),
            [MISSING, STATUS, COORDINATES, HEADER],
        ]
        return zlib.crc32(json.dumps(layout, separators=(",", ":")).encode())

    def document(self, build: int) -> dict[str, Any]:
        """protocol.json: all that a host needs to speak with a board. build: CRC-32 of its sources."""
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
            "messages": [_message_json(message) for message in self.messages],
            "states": [vars(state) for state in STATES],
            "reasons": [vars(reason) for reason in REASONS],
            "results": [vars(result) for result in RESULTS],
            "missing": MISSING,
            "status": {flag: bit for flag, (bit, _) in STATUS.items()},
            "coordinates": COORDINATES,
        }


def records_of(controller: Controller) -> dict[str, Record]:
    """The controller's structs by their names without the arm's and the precision."""
    arm = controller.model.arm.name
    return {record.name.removeprefix(f"{arm}_").removesuffix("_f32"): record for record in controller.records}


def _message_json(message: Message) -> dict[str, Any]:
    return {
        "name": message.name,
        "number": message.number,
        "direction": message.direction,
        "size": message.size,
        "states": list(message.states),
        "fields": [
            {
                "name": f.name,
                "type": f.type,
                "count": f.count,
                "unit": f.unit,
                "meaning": f.meaning,
                "low": f.range[0],
                "high": f.range[1],
            }
            for f in message.fields
        ],
    }
