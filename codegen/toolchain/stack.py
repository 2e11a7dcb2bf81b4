"""Symbols, sizes and worst-case stack of a Cortex-M image.

The compiler states the frame of every function; the calls follow from the image's relocations.
"""

from __future__ import annotations

import bisect
import io
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from elftools.elf.constants import SH_FLAGS
from elftools.elf.elffile import ELFFile
from elftools.elf.enums import ENUM_RELOC_TYPE_ARM
from elftools.elf.relocation import RelocationSection
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
        """All symbols in the file's order, including the mapping symbols ($t, $d)."""
        return [
            Symbol(
                symbol.name,
                symbol["st_value"],
                symbol["st_size"],
                function=symbol["st_info"]["type"] == "STT_FUNC",
                section=symbol["st_shndx"] if isinstance(symbol["st_shndx"], int) else 0,
            )
            for table in self.sections
            if isinstance(table, SymbolTableSection)
            for symbol in table.iter_symbols()
        ]

    @property
    def sizes(self) -> Sizes:
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


_LINK_REGISTER = 14
_ADDRESSES = {ENUM_RELOC_TYPE_ARM["R_ARM_ABS32"], ENUM_RELOC_TYPE_ARM["R_ARM_MOVW_ABS_NC"]}
"""Relocations of an address, in contrast to those of a branch."""
EXCEPTION_FRAME = 108
"""Bytes that an exception pushes at most: 8 registers, 18 words of the floating-point unit, alignment."""


@dataclass(frozen=True)
class Stack:
    """Worst-case stack.

    main       bytes of the deepest chain of calls from the image's entry
    handlers   most bytes that an exception adds: the processor's frame, the handler and what it calls
    chain      functions with their frames, from the entry inwards
    unknown    why there is no bound: recursion, calls through pointers, frames that the compiler does not state
    """

    main: int
    handlers: int
    chain: tuple[tuple[str, int], ...]
    unknown: tuple[str, ...]

    @property
    def worst(self) -> int:
        """Bytes of main and handlers together."""
        return self.main + self.handlers


def frames_of_usage(directory: Path) -> dict[str, int]:
    """Largest frame by function name, as gcc's -fstack-usage wrote it; dynamic frames are left out."""
    frames: dict[str, int] = {}
    for path in sorted(directory.rglob("*.su")):
        for line in path.read_text().splitlines():
            place, size, kind = line.split("\t")
            name = place.split(":")[-1]
            if kind != "dynamic":
                frames[name] = max(int(size), frames.get(name, 0))
    return frames


def frames_of_sections(elf: Elf) -> dict[str, int]:
    """The same from the section that clang's -fstack-size-section adds to the image."""
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
    """The worst-case stack of an image, for the frames that the compiler states.

    frames   bytes by function; gcc reports a specialised copy f.constprop.0 as f.constprop
    """
    graph = _Calls(elf)
    unknown = [f"{name} calls through a pointer" for name in sorted(graph.indirect)]
    known: dict[str, tuple[tuple[str, int], ...]] = {}

    def deepest(name: str, above: tuple[str, ...]) -> tuple[tuple[str, int], ...]:
        if name in above:
            unknown.append(f"{name} calls itself")
            return ()
        if name not in known:
            spellings = (name, name.rpartition(".")[0], name.partition(".")[0])
            frame = next((frames[spelling] for spelling in spellings if spelling in frames), None)
            if frame is None:
                unknown.append(f"the compiler does not state the frame of {name}")
            chains = [deepest(callee, (*above, name)) for callee in sorted(graph.calls[name])]
            inner = max(chains, key=lambda chain: sum(size for _, size in chain), default=())
            known[name] = ((name, frame or 0), *inner)
        return known[name]

    chain = deepest(graph.name_at(elf.entry), ())
    called = {callee for callees in graph.calls.values() for callee in callees}
    handlers = [deepest(name, ()) for name in sorted(graph.calls.keys() - known.keys() - called)]
    above = max((EXCEPTION_FRAME + sum(frame for _, frame in calls) for calls in handlers), default=0)
    return Stack(sum(frame for _, frame in chain), above, chain, tuple(dict.fromkeys(unknown)))


class _Calls:
    """The call graph, from the relocations that the linker keeps (--emit-relocs).

    calls      function -> functions that it branches to or whose address it takes, tail calls included
    indirect   functions that branch through a register although they take no function's address
    """

    def __init__(self, elf: Elf) -> None:
        self.calls: dict[str, set[str]] = {}
        self.indirect: set[str] = set()
        text = {i for i, section in enumerate(elf.sections) if section["sh_flags"] & SH_FLAGS.SHF_EXECINSTR}
        functions = [s for s in elf.symbols if s.function and s.section in text and s.size]
        # Two names at one address are one function.
        self._functions = {s.address & ~1: s for s in sorted(functions, key=lambda s: (s.address, s.name))}
        self._starts = list(self._functions)
        self._marks = sorted((s.address, s.name[1]) for s in elf.symbols if s.name[:2] in ("$t", "$d"))
        relocations = [
            (relocation["r_offset"], relocation["r_info_type"], elf.symbols[relocation["r_info_sym"]].address & ~1)
            for table in elf.sections
            if isinstance(table, RelocationSection) and table["sh_info"] in text
            for relocation in table.iter_relocations()
        ]
        for start, function in self._functions.items():
            end = start + function.size
            own = [(kind, to) for at, kind, to in relocations if start <= at < end and to in self._functions]
            self.calls[function.name] = {self._functions[to].name for _, to in own}
            section = elf.sections[function.section]
            code = section.data()[start - section["sh_addr"] : end - section["sh_addr"]]
            if self._branches_to_register(code, start) and not any(kind in _ADDRESSES for kind, _ in own):
                self.indirect.add(function.name)

    def name_at(self, address: int) -> str:
        """The function that contains an address. Raises ValueError if there is none."""
        start = self._starts[bisect.bisect_right(self._starts, address & ~1) - 1]
        if not start <= address & ~1 < start + self._functions[start].size:
            raise ValueError(f"no function at {address:#x}")
        return self._functions[start].name

    def _branches_to_register(self, code: bytes, start: int) -> bool:
        """Whether the Thumb code holds BLX or BX through a register other than the link register."""
        at = 0
        while at + 2 <= len(code):
            (word,) = struct.unpack_from("<H", code, at)
            mark = bisect.bisect_right(self._marks, (start + at, "z")) - 1
            is_code = mark < 0 or self._marks[mark][1] == "t"
            if is_code and (word & 0xFF87 == 0x4780 or (word & 0xFF87 == 0x4700 and word >> 3 & 15 != _LINK_REGISTER)):
                return True
            at += 4 if is_code and word >> 11 in (0b11101, 0b11110, 0b11111) else 2
        return False
