"""PROTOCOL.md: the protocol's table for people who write a host or a board."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from math import ceil
from typing import Any

from codegen.c.controller_records import STATUS
from codegen.firmware.ceilings import FACT
from codegen.firmware.messages import LARGEST, ROWS_A_MESSAGE, SIZES, WHOLE, Item, Message
from codegen.firmware.protocol import (
    ACKS,
    BAUD,
    BITS,
    HEADER,
    IN_TURN,
    LINE_SHARE,
    MISSING,
    NOT_READY,
    OUTRUN,
    REASONS,
    RESULTS,
    STATES,
    TELEMETRY_RECORDS,
    VERSION,
    Protocol,
)

WATCHED_ARMED = ("drive", "watchdog", "encoder_jump", "speed", "link_lost", "corrupted", "sequence")
_HEADER_MEANING = {
    "version": "of the protocol",
    "type": "number of the message",
    "sequence": "see below",
    "length": "bytes of the payload",
}


def holes(protocol: Protocol) -> dict[str, Any]:
    """What the page needs, as finished strings."""
    plain, wire = example(protocol)
    return {
        "name": protocol.arm,
        "n": len(protocol.types),
        "prismatic": "prismatic" in protocol.types,
        "version": VERSION,
        "fingerprint": f"0x{protocol.fingerprint:08x}",
        "header_table": _header_table(),
        "example_plain": plain.hex(" "),
        "example_wire": wire.hex(" "),
        "state_table": _table(("number", "state", ""), [(str(s.number), s.name, s.meaning) for s in STATES]),
        "watched": _listed(WATCHED_ARMED),
        "reason_table": _table(
            ("number", "reason", "", "criterion", "torque"),
            [(str(r.number), r.name, r.text, r.criterion, r.torque) for r in REASONS],
        ),
        "in_turn": _listed(IN_TURN),
        "turn": "one joint" if protocol.looks == 1 else f"{protocol.looks} joints",
        "outrun": f"{OUTRUN:g}",
        "not_ready_number": NOT_READY,
        "no_limit": f"{LARGEST:.9g}",
        **_ceiling_holes(protocol),
        "rows_a_message": ROWS_A_MESSAGE,
        "commands": [_section(message) for message in protocol.commands],
        "reports": [_section(message) for message in protocol.reports],
        "result_table": _table(
            ("number", "result", "", "detail"), [(str(r.number), r.name, r.text, r.detail) for r in RESULTS]
        ),
        "missing": ", ".join(f"{bit} {name}" for name, bit in MISSING.items()),
        "status": ", ".join(f"{bit} {flag} ({text})" for flag, (bit, text) in STATUS.items()),
        **line_holes(protocol),
        "telemetry_records": TELEMETRY_RECORDS,
        "acks": ACKS,
        "command_bytes": max(_wire_bytes(message) for message in protocol.commands),
    }


def _ceiling_holes(protocol: Protocol) -> dict[str, Any]:
    """What is compiled into the board whatever a host sends."""
    ceilings = protocol.ceilings
    rows = [
        (
            str(number),
            *(f"{c.value:.6g}" for c in (joint.torque_limit, joint.speed, joint.tracking)),
            f"{joint.low.value:.6g} to {joint.high.value:.6g}",
            *(f"{c.value:.6g}" for c in (joint.kp, joint.kd)),
        )
        for number, joint in enumerate(ceilings.joints, 1)
    ]
    unlimited = [str(k) for k, joint in enumerate(ceilings.joints, 1) if joint.torque_limit.of_board]
    heads = ("joint", "torque_limit", "speed", "tracking", "low to high", "kp", "kd")
    return {
        "ceiling_table": _table(heads, rows),
        "unlimited": f"joint{'s' * (len(unlimited) > 1)} {', '.join(unlimited)}" if unlimited else "",
        "silence": int(ceilings.silence.value),
        "late": int(ceilings.late.value),
        "rates": " to ".join(f"{end.value:.6g}" for end in ceilings.rates),
        "fact": f"{100 * FACT:g}",
        "filter": f"{ceilings.filter.value:.4g}",
    }


def line_holes(protocol: Protocol) -> dict[str, Any]:
    """What a serial line carries of telemetry: bytes of a record, records a second, one in how many periods."""
    record = _wire_bytes(protocol.message("telemetry"))
    rate = LINE_SHARE * BAUD / BITS / record
    return {
        "telemetry_bytes": record,
        "telemetry_rate": int(rate),
        "line_share": f"{100 * LINE_SHARE:g}",
        "every_1k": ceil(1000 / rate),
        "every_4k": ceil(4000 / rate),
    }


def example(protocol: Protocol) -> tuple[bytes, bytes]:
    """`run` for 2000 periods with every record, command number 5: the plain frame, and the same on the wire."""
    run = protocol.message("run")
    payload = struct.pack("<II", 2000, 1)
    plain = struct.pack("<BBHH", VERSION, run.number, 5, len(payload)) + payload
    plain += struct.pack("<I", zlib.crc32(plain))
    # All blocks are short: a zero is where the next one begins.
    wire = b"".join(bytes([len(part) + 1]) + part for part in plain.split(b"\0"))
    return plain, wire + b"\0"


def said_range(item: Item) -> str:
    """What is accepted, in words; empty where it is all that the type holds."""
    low, high = item.range
    if item.type == "float":
        if (low, high) == (-LARGEST, LARGEST):
            return ""
        return f"{low:g} or more" if high == LARGEST else f"{low:g} to {high:g}"
    least, most = WHOLE[item.type]
    if (low, high) == (least, most):
        return ""
    return f"{low:.0f} or more" if high == most else f"{low:.0f} to {high:.0f}"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:-1]) + f" and {names[-1]}"


def _section(message: Message) -> dict[str, str]:
    rows = [
        (
            f.name,
            f.type if f.count is None else f"{f.type}[{f.count}]",
            f.unit,
            f.meaning + (f"; {limits}" if (limits := said_range(f)) else ""),
        )
        for f in message.fields
    ]
    title = f"{message.name}: {message.number}, {message.size} bytes"
    where = f" Only in {' or '.join(message.states)}." if message.states else ""
    table = _table(("field", "type", "unit", ""), rows) if rows else ""
    return {"title": title, "meaning": message.meaning + where, "table": table}


def _header_table() -> str:
    rows = [(name, kind, _HEADER_MEANING[name]) for name, kind in HEADER]
    rows += [("payload", "", "`length` bytes"), ("checksum", "u32", "CRC-32 of IEEE 802.3 of all bytes before it")]
    return _table(("field", "type", ""), rows)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    return "\n".join([line(head), "|" + "---|" * len(head), *map(line, rows)])


def _wire_bytes(message: Message) -> int:
    """At most, with stuffing and delimiter."""
    plain = sum(SIZES[kind] for _, kind in HEADER) + message.size + 4
    return plain + plain // 254 + 2
