"""C of the protocol, as finished strings: structs of the messages, their packing and unpacking, the accepted ranges."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from codegen.c.c_code import Routine, comment, declaration
from codegen.firmware.messages import LARGEST, MAX_PHASES, MAX_ROWS, ROWS_A_MESSAGE, SIZES, Item, Message
from codegen.firmware.protocol import HEADER, MISSING, REASONS, RESULTS, STATES, VERSION, Protocol
from codegen.firmware.protocol_page import said_range

C_TYPES = {"u8": "uint8_t", "u16": "uint16_t", "u32": "uint32_t", "i32": "int32_t", "float": "float"}
_KINDS = {"float": "REAL", "i32": "SIGNED", "u32": "COUNT"}
_SIGN = 0x80000000
_BYTE = 255
"""Most values of a rule, whose count is a byte."""


def holes(protocol: Protocol, build: int) -> dict[str, Any]:
    """What the pages of protocol.h and protocol.c need. build: CRC-32 of the sources."""
    name, commands = protocol.arm, protocol.commands
    filled = [message for message in protocol.messages if message.fields]
    rules, table = _tables(commands)
    return {
        "name": name,
        "NAME": name.upper(),
        "guard": f"TENDON_{name.upper()}_PROTOCOL_H",
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
        "types": [_typedef(name, message) for message in filled if message.record is None],
        "routines": [
            _unpack(name, message) if message.direction == "command" else _pack(name, message) for message in filled
        ],
        "rules": rules,
        "commands": table,
        "first_command": commands[0].number,
        "last_command": commands[-1].number,
    }


def crc_table() -> list[str]:
    """Remainders of all half bytes."""
    return [f"0x{_remainder(k):08x}U" for k in range(16)]


def _remainder(half: int) -> int:
    for _ in range(4):
        half = (half >> 1) ^ (0xEDB88320 if half & 1 else 0)
    return half


def struct_name(arm: str, message: Message) -> str:
    """The C type that holds a message's fields."""
    return f"{arm}_{message.record}_f32" if message.record else f"{arm}_{message.name}_message"


def _numbers(protocol: Protocol) -> list[dict[str, Any]]:
    groups = (
        ("Types of commands, host to board.", "COMMAND", [(m.name, m.number) for m in protocol.commands]),
        ("Types of reports, board to host.", "REPORT", [(m.name, m.number) for m in protocol.reports]),
        ("States.", "STATE", [(s.name, s.number) for s in STATES]),
        ("Reasons for the state.", "REASON", [(r.name, r.number) for r in REASONS]),
        ("Results of a command.", "RESULT", [(r.name, r.number) for r in RESULTS]),
        ("What has not been uploaded, as bits.", "MISSING", list(MISSING.items())),
        ("Bytes of the reports' payloads.", "SIZE", [(m.name, m.size) for m in protocol.reports]),
    )
    return [
        {"comment": comment(text), "lines": [f"{group}_{name.upper()} {number}U" for name, number in pairs]}
        for text, group, pairs in groups
    ]


def _typedef(arm: str, message: Message) -> str:
    lines = [f"    {_member(item)} {comment(_meaning(item))}" for item in message.fields]
    return "\n".join([comment(message.meaning), "typedef struct {", *lines, f"}} {struct_name(arm, message)};"])


def _member(item: Item) -> str:
    return f"{C_TYPES[item.type]} {item.name}{'' if item.count is None else f'[{item.count}]'};"


def _meaning(item: Item) -> str:
    return f"{item.unit}: {item.meaning}" if item.unit else item.meaning


def _unpack(arm: str, message: Message) -> Routine:
    arguments = ["const uint8_t *payload", f"{struct_name(arm, message)} *message"]
    lines = _fields(message, lambda item, value, place: f"{value} = tendon_get_{item.type}(&payload[{place}]);")
    return Routine("", declaration(f"void {arm}_unpack_{message.name}", arguments), "\n".join(lines))


def _pack(arm: str, message: Message) -> Routine:
    arguments = [f"const {struct_name(arm, message)} *message", "uint8_t *payload"]
    lines = _fields(message, lambda item, value, place: f"tendon_put_{item.type}(&payload[{place}], {value});")
    return Routine("", declaration(f"void {arm}_pack_{message.name}", arguments), "\n".join(lines))


def _fields(message: Message, statement: Callable[[Item, str, str], str]) -> list[str]:
    """A statement a field, in a loop for an array; it takes the field, its name in C, and its place in the payload."""
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
    """Rows of the rules and of the commands, in order of the commands' numbers, which have no gap."""
    rules: list[str] = []
    table: list[str] = []
    numbers = {state.name: state.number for state in STATES}
    for message in commands:
        first = len(rules)
        for place, count, item in _groups(message):
            low, high = item.range
            kind = _KINDS[item.type]
            said = f"{message.name} from {item.name} on: {said_range(item) or 'any finite number'}"
            keys = f"0x{ordered(item.type, low):08x}U, 0x{ordered(item.type, high):08x}U"
            for part in range(0, count, _BYTE):
                rules.append(f"{{{place + part}U, {min(_BYTE, count - part)}U, {kind}, {keys}}}, {comment(said)}")
        states = sum(1 << numbers[name] for name in message.states or numbers)
        row = f"{{{message.size}U, 0x{states:x}U, {first}U, {len(rules) - first}U}}"
        table.append(f"{row}, {comment(message.name)}")
    return rules, table


def _groups(message: Message) -> Iterator[tuple[int, int, Item]]:
    """First value, number of values and first field of neighbours with the same range; none where all is accepted."""
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
    """A number's 32 bits as an unsigned key: keys compare as the numbers do. Zero as a low end takes -0 with it."""
    if kind == "float":
        bits: int = struct.unpack("<I", struct.pack("<f", min(max(value, -LARGEST), LARGEST)))[0]
        if bits == 0:
            bits = _SIGN
        return bits ^ 0xFFFFFFFF if bits & _SIGN else bits | _SIGN
    whole = int(value)
    return (whole ^ _SIGN if whole >= 0 else whole + _SIGN) if kind == "i32" else whole
