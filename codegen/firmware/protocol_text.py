"""The protocol as C (structs, packing and accepted ranges of the messages) and as PROTOCOL.md."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from math import ceil

from codegen.c.c_code import Routine, comment, declaration
from codegen.c.controller import STATUS, Controller
from codegen.firmware.messages import (
    LARGEST,
    MAX_PHASES,
    MAX_ROWS,
    PRODUCTS_A_MESSAGE,
    ROWS_A_MESSAGE,
    SIZES,
    WHOLE,
    Item,
    Message,
)
from codegen.firmware.protocol import (
    ACKS,
    BAUD,
    BITS,
    FACT,
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
    records_of,
)

WATCHED_ARMED = ("drive", "watchdog", "encoder_jump", "speed", "link_lost", "corrupted", "sequence")
_HEADER_MEANING = {
    "version": "of the protocol",
    "type": "number of the message",
    "sequence": "see below",
    "length": "bytes of the payload",
}


def page_holes(protocol: Protocol) -> dict[str, object]:
    """The holes of PROTOCOL.md."""
    plain, wire = example(protocol)
    return {
        "name": protocol.arm,
        "n": len(protocol.types),
        "prismatic": "prismatic" in protocol.types,
        "version": VERSION,
        "fingerprint": f"0x{protocol.fingerprint:08x}",
        "header_table": _table(
            ("field", "type", ""),
            [
                *((name, kind, _HEADER_MEANING[name]) for name, kind in HEADER),
                ("payload", "", "`length` bytes"),
                ("checksum", "u32", "CRC-32 of IEEE 802.3 of all bytes before it"),
            ],
        ),
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


def _ceiling_holes(protocol: Protocol) -> dict[str, object]:
    """The holes about the board's ceilings."""
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


def line_holes(protocol: Protocol) -> dict[str, object]:
    """Holes about telemetry on a serial line: bytes per record, records per second, periods per record."""
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
    """Command number 5, `run` for 2000 periods with every record: the plain and the encoded frame."""
    run = protocol.message("run")
    payload = struct.pack("<II", 2000, 1)
    plain = struct.pack("<BBHH", VERSION, run.number, 5, len(payload)) + payload
    plain += struct.pack("<I", zlib.crc32(plain))
    # All blocks are short: a zero is where the next one begins.
    wire = b"".join(bytes([len(part) + 1]) + part for part in plain.split(b"\0"))
    return plain, wire + b"\0"


_OR_MORE = ", or as many as the board was built for"


def said_range(item: Item) -> str:
    """The accepted range in words; empty if it is the whole range of the type."""
    low, high = item.range
    if item.type == "float":
        if (low, high) == (-LARGEST, LARGEST):
            return ""
        return f"{low:g} or more" if high == LARGEST else f"{low:g} to {high:g}"
    least, most = WHOLE[item.type]
    if (low, high) == (least, most):
        return ""
    return f"{low:.0f} or more" if high == most else f"{low:.0f} to {high:.0f}{_OR_MORE if item.capacity else ''}"


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


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    return "\n".join([line(head), "|" + "---|" * len(head), *map(line, rows)])


def _wire_bytes(message: Message) -> int:
    plain = sum(SIZES[kind] for _, kind in HEADER) + message.size + 4
    return plain + plain // 254 + 2


C_TYPES = {"u8": "uint8_t", "u16": "uint16_t", "u32": "uint32_t", "i32": "int32_t", "float": "float"}
_KINDS = {"float": "TENDON_KIND_REAL", "i32": "TENDON_KIND_SIGNED", "u32": "TENDON_KIND_COUNT"}
_SIGN = 0x80000000
_NAMED = {
    "drive": ("rate", "velocity_gain", "position_per_count", "kp", "kd", "torque_limit"),
    "safety": ("tracking", "speed", "low", "high", "silence", "late"),
    "trajectory": ("elbow",),
    "phase": ("first_row",),
}
"""Fields whose places the machine reports when it refuses or lowers a value by more than a single range."""
_BYTE = 255
"""Most values of a rule, because the count is a byte."""


def code_holes(controller: Controller, protocol: Protocol, build: int) -> dict[str, object]:
    """The holes of tendon_messages.h and tendon_messages.c. build: CRC-32 of the sources."""
    commands = protocol.commands
    filled = [message for message in protocol.messages if message.fields]
    rules, table = _tables(commands)
    return {
        "version": VERSION,
        "fingerprint": f"0x{protocol.fingerprint:08x}",
        "build": f"0x{build:08x}",
        "max_phases": MAX_PHASES,
        "max_rows": MAX_ROWS,
        "rows_a_message": ROWS_A_MESSAGE,
        "header": sum(SIZES[kind] for _, kind in HEADER),
        "longest_command": max(message.size for message in commands),
        "longest_report": max(message.size for message in protocol.reports),
        "numbers": _numbers(protocol),
        "types": [_typedef(message) for message in filled if message.record is None],
        "routines": [_conversion(message) for message in filled],
        "parts": _parts(controller),
        "rules": rules,
        "commands": table,
        "first_command": commands[0].number,
    }


def struct_name(message: Message) -> str:
    """The C type of a message."""
    return f"tendon_{message.record}" if message.record else f"tendon_{message.name}_message"


def _numbers(protocol: Protocol) -> list[dict[str, object]]:
    sizes = [SIZES[kind] for _, kind in HEADER]
    header = [(name, sum(sizes[:k])) for k, (name, _) in enumerate(HEADER)]
    reports = [(m.name, m.number) for m in protocol.reports]
    if "statistics" not in dict(reports):
        reports.append(("statistics", 0))
    groups = (
        ("Types of commands, host to board.", "COMMAND", [(m.name, m.number) for m in protocol.commands]),
        ("Types of reports, board to host; 0: never sent.", "REPORT", reports),
        ("States.", "STATE", [(s.name, s.number) for s in STATES]),
        ("Reasons for the state.", "REASON", [(r.name, r.number) for r in REASONS]),
        ("Results of a command.", "RESULT", [(r.name, r.number) for r in RESULTS]),
        ("What has not been uploaded, as bits.", "MISSING", [*MISSING.items(), ("everything", sum(MISSING.values()))]),
        ("Bytes of the reports' payloads.", "SIZE", [(m.name, m.size) for m in protocol.reports]),
        ("Bytes from a frame's begin to the fields of its header.", "PLACE_HEADER", header),
        *(
            (
                f"Which values of `{message.name}` these are, from 0.",
                f"PLACE_{message.name.upper()}",
                [(field, message.place(field)) for field in _NAMED[message.name]],
            )
            for message in map(protocol.message, _NAMED)
        ),
    )
    return [
        {"comment": comment(text), "lines": [f"{group}_{name.upper()} {number}U" for name, number in pairs]}
        for text, group, pairs in groups
    ]


def _parts(controller: Controller) -> list[Routine]:
    """Functions that copy springs and contact from a trajectory's message into the controller's structs, and what the
    monitor says into the message of telemetry."""
    records = records_of(controller)
    springs = [f"        springs[j].{f.name} = message->spring_{f.name}[j];" for f in records["spring"].fields]
    contact = [f"    contact->{f.name} = message->{f.name};" for f in records["contact"].fields]
    loop = ["    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {", *springs, "    }"]
    heads = (("springs", "tendon_spring springs[TENDON_JOINTS]"), ("contact", "tendon_contact *contact"))
    message = "const tendon_trajectory_message *message"
    taken = [
        Routine("", declaration(f"void tendon_take_{name}", [message, to]), "\n".join(body))
        for (name, to), body in zip(heads, (loop, contact), strict=True)
    ]
    return [*taken, _watched(controller), _block(controller)]


def _block(controller: Controller) -> Routine:
    """The function that packs the next part of a block of statistics, which is then sent, and returns its size."""
    body = ["    (void)statistics;", "    (void)payload;", "    return 0U;"]
    pointer = "const tendon_statistics *statistics"
    if controller.statistics is not None:
        pointer = "tendon_statistics *statistics"
        many = f"{PRODUCTS_A_MESSAGE}U"
        body = [
            "    tendon_statistics_message message;",
            "    message.number = statistics->number;",
            "    message.place = statistics->place;",
            "    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {",
            "        message.rows[j] = statistics->sums.products.rows[j];",
            "    }",
            f"    for (uint32_t k = 0U; k < {many}; ++k) {{",
            "        const uint32_t i = statistics->place + k;",
            *(
                f"        message.{side}[k] = (i < TENDON_PRODUCTS) ? statistics->sums.products.{side}[i] : 0.0f;"
                for side in ("high", "low")
            ),
            "    }",
            "    tendon_pack_statistics(&message, payload);",
            f"    tendon_statistics_sent(statistics, {many});",
            "    return TENDON_SIZE_STATISTICS;",
        ]
    head = declaration("uint32_t tendon_take_block", [pointer, "uint8_t *payload"])
    return Routine("", head, "\n".join(body))


def _watched(controller: Controller) -> Routine:
    said = ("verdict", "uint8_t"), ("signal", "uint8_t"), ("drifting", "uint16_t")
    body = ["    (void)state;", "    (void)message;"]
    if controller.monitor is not None:
        each = [f"        message->{name}[j] = ({kind})state->monitor.joints[j].{name};" for name, kind in said]
        body = ["    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {", *each, "    }"]
    arguments = ["const tendon_controller_state *state", "tendon_telemetry_message *message"]
    return Routine("", declaration("void tendon_take_watched", arguments), "\n".join(body))


def _typedef(message: Message) -> str:
    """The struct of a message in C."""
    lines = []
    for item in message.fields:
        array = "" if item.count is None else f"[{item.count}]"
        meaning = f"{item.unit}: {item.meaning}" if item.unit else item.meaning
        lines.append(f"    {C_TYPES[item.type]} {item.name}{array}; {comment(meaning)}")
    return "\n".join([comment(message.meaning), "typedef struct {", *lines, f"}} {struct_name(message)};"])


def _conversion(message: Message) -> Routine:
    """The function that unpacks a command or packs a report."""
    if message.direction == "command":
        name, arguments = "unpack", ["const uint8_t *payload", f"{struct_name(message)} *message"]
    else:
        name, arguments = "pack", [f"const {struct_name(message)} *message", "uint8_t *payload"]

    def statement(item: Item, value: str, place: str) -> str:
        if name == "unpack":
            return f"{value} = tendon_get_{item.type}(&payload[{place}]);"
        return f"tendon_put_{item.type}(&payload[{place}], {value});"

    body = "\n".join(_fields(message, statement))
    return Routine("", declaration(f"void tendon_{name}_{message.name}", arguments), body)


def _fields(message: Message, statement: Callable[[Item, str, str], str]) -> list[str]:
    """One statement per field, in a loop for an array. statement: of a field, its name in C and its place."""
    lines, at = [], 0
    for item in message.fields:
        value = f"message->{item.name}"
        if item.count is None:
            lines.append(f"    {statement(item, value, f'{at}U')}")
        else:
            step = f"{SIZES[item.type]}U * k"
            lines.append(f"    for (uint32_t k = 0U; k < {item.count}U; ++k) {{")
            lines.append(f"        {statement(item, f'{value}[k]', f'{at}U + ({step})' if at else step)}")
            lines.append("    }")
        at += item.size
    return lines


def _tables(commands: Sequence[Message]) -> tuple[list[str], list[str]]:
    """Rows of the tables of rules and commands, in order of the commands' consecutive numbers."""
    rules: list[str] = []
    table: list[str] = []
    numbers = {state.name: state.number for state in STATES}
    for message in commands:
        first = len(rules)
        for place, count, item in _groups(message):
            low, high = item.range
            kind = _KINDS[item.type]
            said = f"{message.name} from {item.name} on: {said_range(item) or 'any finite number'}"
            most = item.capacity or f"0x{ordered(item.type, high):08x}U"
            keys = f"0x{ordered(item.type, low):08x}U, {most}"
            for part in range(0, count, _BYTE):
                rules.append(f"{{{place + part}U, {min(_BYTE, count - part)}U, {kind}, {keys}}}, {comment(said)}")
        states = sum(1 << numbers[name] for name in message.states or numbers)
        row = f"{{{message.size}U, 0x{states:x}U, {first}U, {len(rules) - first}U}}"
        table.append(f"{row}, {comment(message.name)}")
    return rules, table


def _groups(message: Message) -> Iterator[tuple[int, int, Item]]:
    """First value, number of values and first field of adjacent fields with the same restricted range."""
    place, begin, held = 0, 0, None
    for item in message.fields:
        if held is None or (item.type, item.range) != (held.type, held.range):
            if held is not None and _restricted(held):
                yield begin, place - begin, held
            begin, held = place, item
        place += item.count or 1
    if held is not None and _restricted(held):
        yield begin, place - begin, held


def _restricted(item: Item) -> bool:
    return item.type == "float" or item.range != Item("", item.type, "", "").range


def ordered(kind: str, value: float) -> int:
    """A number's bits as an unsigned key that compares as the number does. As a lower end, 0 includes -0."""
    if kind == "float":
        bits: int = struct.unpack("<I", struct.pack("<f", min(max(value, -LARGEST), LARGEST)))[0]
        if bits == 0:
            bits = _SIGN
        return bits ^ 0xFFFFFFFF if bits & _SIGN else bits | _SIGN
    whole = int(value)
    return (whole ^ _SIGN if whole >= 0 else whole + _SIGN) if kind == "i32" else whole
