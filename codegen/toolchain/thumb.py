"""Where a function in Thumb-2 code branches to: as much of the instruction set as that takes."""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field

_RETURN = 14  # the link register


@dataclass
class Flow:
    """What a function's instructions may do to the program counter.

    jumps       targets of branches, those within the function among them
    calls       targets of branches that come back
    registers   through which it calls or jumps, that of the return apart
    constants   by register: what is loaded into it as a constant, or from a register with a constant
    """

    jumps: set[int] = field(default_factory=set)
    calls: set[int] = field(default_factory=set)
    registers: set[int] = field(default_factory=set)
    constants: dict[int, set[int]] = field(default_factory=lambda: defaultdict(set))


def flow(code: bytes, start: int, is_code: Callable[[int], bool]) -> Flow:
    """Of a function's bytes, its literals among them.

    start     address of the first byte
    is_code   whether an instruction stands at an address, by the mapping symbols
    """
    found, at = Flow(), 0
    halves: dict[int, int] = {}
    while at + 2 <= len(code):
        here = start + at
        (first,) = struct.unpack_from("<H", code, at)
        at += 2
        if not is_code(here):
            continue
        if first >> 11 not in (0b11101, 0b11110, 0b11111):
            _narrow(found, first, here, code, start)
        elif at + 2 <= len(code):
            (second,) = struct.unpack_from("<H", code, at)
            at += 2
            _wide(found, first, second, here, code, start, halves)
    return found


def _narrow(found: Flow, word: int, here: int, code: bytes, start: int) -> None:
    if word & 0xFF87 == 0x4780 or (word & 0xFF87 == 0x4700 and word >> 3 & 15 != _RETURN):  # BLX, BX
        found.registers.add(word >> 3 & 15)
    elif word >> 11 == 0b11100:  # B
        found.jumps.add(here + 4 + _signed(word & 0x7FF, 11) * 2)
    elif word >> 12 == 0b1101 and word >> 8 & 15 < 14:  # B<c>
        found.jumps.add(here + 4 + _signed(word & 0xFF, 8) * 2)
    elif word >> 8 == 0x46:  # MOV Rd, Rm
        found.constants[word >> 4 & 8 | word & 7] |= found.constants[word >> 3 & 15]
    elif word >> 11 == 0b01001:  # LDR Rt, [pc, #]
        _literal(found, word >> 8 & 7, (here + 4 & ~3) + (word & 0xFF) * 4, code, start)


def _wide(found: Flow, first: int, second: int, here: int, code: bytes, start: int, halves: dict[int, int]) -> None:
    sign, j1, j2 = first >> 10 & 1, second >> 13 & 1, second >> 11 & 1
    immediate = (first & 15) << 12 | sign << 11 | (second >> 12 & 7) << 8 | second & 0xFF
    register = second >> 8 & 15
    if first >> 11 == 0b11110 and second & 0x9000 == 0x9000:  # B.W, BL
        top = (sign << 2 | (1 - (j1 ^ sign)) << 1 | (1 - (j2 ^ sign))) << 21
        target = here + 4 + _signed(top | (first & 0x3FF) << 11 | second & 0x7FF, 24) * 2
        (found.calls if second & 0x4000 else found.jumps).add(target)
    elif first >> 11 == 0b11110 and second & 0xD000 == 0x8000 and first >> 6 & 15 < 14:  # B<c>.W
        offset = sign << 19 | j2 << 18 | j1 << 17 | (first & 0x3F) << 11 | second & 0x7FF
        found.jumps.add(here + 4 + _signed(offset, 20) * 2)
    elif first & 0xFBF0 == 0xF240 and not second & 0x8000:  # MOVW
        halves[register] = immediate
    elif first & 0xFBF0 == 0xF2C0 and not second & 0x8000 and register in halves:  # MOVT
        found.constants[register].add(immediate << 16 | halves[register])
    elif first & 0xFF7F == 0xF85F:  # LDR.W Rt, [pc, #]
        offset = (second & 0xFFF) if first & 0x80 else -(second & 0xFFF)
        _literal(found, second >> 12, (here + 4 & ~3) + offset, code, start)


def _literal(found: Flow, register: int, address: int, code: bytes, start: int) -> None:
    if 0 <= address - start <= len(code) - 4:
        found.constants[register] |= set(struct.unpack_from("<I", code, address - start))


def _signed(value: int, bits: int) -> int:
    return value - (1 << bits) if value >> (bits - 1) else value
