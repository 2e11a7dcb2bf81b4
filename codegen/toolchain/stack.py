"""Images of Cortex-M processors: their symbols and sizes, and the worst-case stack.

The compiler states the frame of every function; the calls are read from the machine code.
"""

from __future__ import annotations

import bisect
import io
import struct
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from elftools.elf.constants import SH_FLAGS
from elftools.elf.elffile import ELFFile
from elftools.elf.sections import Section, SymbolTableSection


@dataclass(frozen=True)
class Symbol:
    """address: with the lowest bit set for a function in Thumb code; section: index, 0 if undefined or absolute."""

    name: str
    address: int
    size: int
    function: bool
    section: int


@dataclass(frozen=True)
class Sizes:
    """Bytes. text: code, constants, vector table; data: initialised, in flash and in RAM; bss: zeroed."""

    text: int
    data: int
    bss: int


class Elf:
    """The sections, symbols and segments of an image. Raises ELFError if the file is no ELF file."""

    def __init__(self, content: bytes) -> None:
        self._file = ELFFile(io.BytesIO(content))
        self.entry: int = self._file["e_entry"]
        self.sections: list[Section] = list(self._file.iter_sections())

    @classmethod
    def read(cls, path: Path) -> Elf:
        """The image in a file."""
        return cls(path.read_bytes())

    @cached_property
    def symbols(self) -> list[Symbol]:
        """In the file's order, the mapping symbols ($t, $d) among them."""
        return [
            Symbol(
                symbol.name,
                symbol["st_value"],
                symbol["st_size"],
                symbol["st_info"]["type"] == "STT_FUNC",
                symbol["st_shndx"] if isinstance(symbol["st_shndx"], int) else 0,
            )
            for table in self.sections
            if isinstance(table, SymbolTableSection)
            for symbol in table.iter_symbols()
        ]

    @property
    def sizes(self) -> Sizes:
        """Bytes of code and constants, of initialised data, and of zeroed data."""
        taken = [s for s in self.sections if s["sh_flags"] & SH_FLAGS.SHF_ALLOC]
        bss = sum(s["sh_size"] for s in taken if s["sh_type"] == "SHT_NOBITS")
        writable = [s for s in taken if s["sh_flags"] & SH_FLAGS.SHF_WRITE]
        data = sum(s["sh_size"] for s in writable if s["sh_type"] != "SHT_NOBITS")
        return Sizes(sum(s["sh_size"] for s in taken) - bss - data, data, bss)

    def binary(self) -> tuple[int, bytes]:
        """The content of the flash: the address of its first byte, and the bytes, gaps filled with 0xFF.

        It is made of sections, as a segment may begin with the ELF header. Raises ValueError if nothing is loaded.
        """
        parts = [
            (section["sh_addr"] - segment["p_vaddr"] + segment["p_paddr"], section.data())
            for section in self.sections
            for segment in self._file.iter_segments("PT_LOAD")
            if section["sh_flags"] & SH_FLAGS.SHF_ALLOC
            and section["sh_type"] != "SHT_NOBITS"
            and section["sh_size"]
            and segment["p_vaddr"] <= section["sh_addr"] < segment["p_vaddr"] + segment["p_filesz"]
        ]
        if not parts:
            raise ValueError("nothing is loaded")
        start = min(address for address, _ in parts)
        image = bytearray(b"\xff" * (max(address + len(part) for address, part in parts) - start))
        for address, part in parts:
            image[address - start : address - start + len(part)] = part
        return start, bytes(image)


_RETURN = 14  # the link register


@dataclass
class _Flow:
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


def _flow(code: bytes, start: int, is_code: Callable[[int], bool]) -> _Flow:
    """Of a function's bytes, its literals among them.

    start     address of the first byte
    is_code   whether an instruction stands at an address, by the mapping symbols
    """
    found, at = _Flow(), 0
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


def _narrow(found: _Flow, word: int, here: int, code: bytes, start: int) -> None:
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


def _wide(found: _Flow, first: int, second: int, here: int, code: bytes, start: int, halves: dict[int, int]) -> None:
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


def _literal(found: _Flow, register: int, address: int, code: bytes, start: int) -> None:
    if 0 <= address - start <= len(code) - 4:
        found.constants[register] |= set(struct.unpack_from("<I", code, address - start))


def _signed(value: int, bits: int) -> int:
    return value - (1 << bits) if value >> (bits - 1) else value


EXCEPTION_FRAME = 108
"""Bytes that an exception pushes at most: 8 registers, 18 words of the floating-point unit, alignment."""


@dataclass(frozen=True)
class Stack:
    """The worst stack in bytes, and the calls that lead there.

    chain       function and its frame, from the reset handler inwards
    handlers    the worst that an exception adds: its own frame, its handler and what that calls
    unknown     why there is no bound: recursion, calls through pointers, frames the compiler does not state
    """

    main: int
    handlers: int
    chain: tuple[tuple[str, int], ...]
    unknown: tuple[str, ...]

    @property
    def worst(self) -> int:
        """Bytes that main and the deepest chain of interrupt handlers take together."""
        return self.main + self.handlers


def frames_of_usage(directory: Path) -> dict[str, int]:
    """What gcc's -fstack-usage wrote: the largest frame of a name's functions; frames without bound are left out."""
    frames: dict[str, int] = {}
    for path in sorted(directory.rglob("*.su")):
        for line in path.read_text().splitlines():
            place, size, kind = line.split("\t")
            name = place.split(":")[-1]
            if kind != "dynamic":
                frames[name] = max(int(size), frames.get(name, 0))
    return frames


def frames_of_sections(elf: Elf) -> dict[str, int]:
    """The same from clang's -fstack-size-section, whose table the image carries."""
    names = {s.address & ~1: s.name for s in elf.symbols if s.function and s.section}
    frames: dict[str, int] = {}
    for section in elf.sections:
        if section.name != ".stack_sizes":
            continue
        content, at = section.data(), 0
        while at < len(content):
            (address,) = struct.unpack_from("<I", content, at)
            at, size, shift = at + 4, 0, 0
            while True:
                byte = content[at]
                at, size, shift = at + 1, size | (byte & 127) << shift, shift + 7
                if not byte & 128:
                    break
            name = names[address & ~1]
            frames[name] = max(size, frames.get(name, 0))
    return frames


def worst(elf: Elf, frames: Mapping[str, int]) -> Stack:
    """The deepest chain of calls from the image's entry, and what the deepest exception would add to it."""
    graph = _Calls(elf)
    search = _Search(graph.calls, frames, [])
    entry = graph.name_at(elf.entry)
    chain = search.deepest(entry, ())
    reached = search.reached
    called = {callee for callees in graph.calls.values() for callee in callees}
    handlers = [search.deepest(name, ()) for name in sorted(graph.calls.keys() - reached - called)]
    above = max((EXCEPTION_FRAME + sum(frame for _, frame in calls) for calls in handlers), default=0)
    unknown = [f"{name} calls through a pointer" for name in sorted(graph.indirect)] + search.unknown
    return Stack(sum(frame for _, frame in chain), above, chain, tuple(dict.fromkeys(unknown)))


class _Search:
    """Depth first; `reached` are the functions seen so far."""

    def __init__(self, calls: Mapping[str, set[str]], frames: Mapping[str, int], unknown: list[str]) -> None:
        self._calls, self._frames, self.unknown = calls, frames, unknown
        self._known: dict[str, tuple[tuple[str, int], ...]] = {}

    @property
    def reached(self) -> set[str]:
        return set(self._known)

    def deepest(self, name: str, above: tuple[str, ...]) -> tuple[tuple[str, int], ...]:
        if name in above:
            self.unknown.append(f"{name} calls itself")
            return ()
        if name not in self._known:
            # gcc calls a copy of f that it specialised f.constprop.0 in the image and f.constprop in its report.
            spellings = (name, name.rpartition(".")[0], name.partition(".")[0])
            frame = next((self._frames[spelling] for spelling in spellings if spelling in self._frames), None)
            if frame is None:
                self.unknown.append(f"the compiler does not state the frame of {name}")
            chains = [self.deepest(callee, (*above, name)) for callee in sorted(self._calls.get(name, ()))]
            inner = max(chains, key=lambda chain: sum(size for _, size in chain), default=())
            self._known[name] = ((name, frame or 0), *inner)
        return self._known[name]


class _Calls:
    """calls: who branches to whom, tail calls included; indirect: who calls through a pointer."""

    def __init__(self, elf: Elf) -> None:
        text = {i for i, section in enumerate(elf.sections) if section["sh_flags"] & SH_FLAGS.SHF_EXECINSTR}
        functions = [s for s in elf.symbols if s.function and s.section in text and s.size]
        # Two names at one address are one function.
        self._functions = list(
            {s.address & ~1: s for s in sorted(functions, key=lambda s: (s.address, s.name))}.values()
        )
        self._starts = [s.address & ~1 for s in self._functions]
        self._marks = sorted((s.address, s.name[1]) for s in elf.symbols if s.name[:2] in ("$t", "$d"))
        self.calls: dict[str, set[str]] = {s.name: set() for s in self._functions}
        self.indirect: set[str] = set()
        for function in self._functions:
            section = elf.sections[function.section]
            self._scan(function, section.data(), section["sh_addr"])

    def name_at(self, address: int) -> str:
        """The function that holds an address."""
        found = self._functions[bisect.bisect_right(self._starts, address & ~1) - 1]
        if not (found.address & ~1) <= (address & ~1) < (found.address & ~1) + found.size:
            raise ValueError(f"no function at {address:#x}")
        return found.name

    def _is_code(self, address: int) -> bool:
        at = bisect.bisect_right(self._marks, (address, "z")) - 1
        return at < 0 or self._marks[at][1] == "t"

    def _scan(self, function: Symbol, content: bytes, base: int) -> None:
        start = function.address & ~1
        flow = _flow(content[start - base : start - base + function.size], start, self._is_code)
        within = range(start, start + function.size)
        targets = flow.calls | {target for target in flow.jumps if target not in within}
        for register in flow.registers:
            # Compilers put a function's address into a register where they call it often.
            known = {value & ~1 for value in flow.constants[register]} & set(self._starts)
            targets |= known
            if not known:
                self.indirect.add(function.name)
        self.calls[function.name] |= {self.name_at(target) for target in targets}
