"""Reads what the firmware's report needs from a 32-bit little-endian ELF file; and makes a flat binary of it."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

_ALLOCATED, _WRITABLE, _EXECUTABLE = 2, 1, 4
_SYMBOLS, _UNINITIALISED, _LOADED = 2, 8, 1


@dataclass(frozen=True)
class Section:
    """kind, flags: as the ELF format numbers them; address, offset, size: bytes."""

    name: str
    kind: int
    flags: int
    address: int
    offset: int
    size: int
    link: int

    @property
    def executable(self) -> bool:
        """Whether it holds machine code."""
        return bool(self.flags & _EXECUTABLE)


@dataclass(frozen=True)
class Symbol:
    """address: with bit 0 set for a function in Thumb code; section: index, 0 where it is not defined."""

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
    """A file's sections, symbols and segments. ValueError if it is no 32-bit little-endian ELF file."""

    def __init__(self, content: bytes) -> None:
        if content[:6] != b"\x7fELF\x01\x01":
            raise ValueError("not a 32-bit little-endian ELF file")
        self._content = content
        self.entry, programs, table = struct.unpack_from("<3I", content, 24)
        program_size, program_count, size, count, names = struct.unpack_from("<5H", content, 42)
        headers = [struct.unpack_from("<10I", content, table + size * i) for i in range(count)]
        texts = headers[names][4]
        self.sections = [
            Section(self._text(texts + name), kind, flags, address, offset, length, link)
            for name, kind, flags, address, offset, length, link, *_ in headers
        ]
        self._segments = [struct.unpack_from("<8I", content, programs + program_size * i) for i in range(program_count)]

    @classmethod
    def read(cls, path: Path) -> Elf:
        """The image in a file."""
        return cls(path.read_bytes())

    def _text(self, offset: int) -> str:
        return self._content[offset : self._content.index(b"\0", offset)].decode()

    def content(self, section: Section) -> bytes:
        """Its bytes in the file."""
        return b"" if section.kind == _UNINITIALISED else self._content[section.offset : section.offset + section.size]

    @cached_property
    def symbols(self) -> list[Symbol]:
        """In the file's order; mapping symbols ($t, $d) among them."""
        found = []
        for table in self.sections:
            if table.kind != _SYMBOLS:
                continue
            names = self.sections[table.link].offset
            for offset in range(table.offset, table.offset + table.size, 16):
                name, address, size, info, _, section = struct.unpack_from("<IIIBBH", self._content, offset)
                found.append(Symbol(self._text(names + name), address, size, info & 15 == 2, section))
        return found

    @property
    def sizes(self) -> Sizes:
        """Bytes of code and constants, of data that starts with values, and of data that starts with zeros."""
        taken = [s for s in self.sections if s.flags & _ALLOCATED]
        bss = sum(s.size for s in taken if s.kind == _UNINITIALISED)
        data = sum(s.size for s in taken if s.kind != _UNINITIALISED and s.flags & _WRITABLE)
        return Sizes(sum(s.size for s in taken) - bss - data, data, bss)

    def binary(self) -> tuple[int, bytes]:
        """What goes into flash: the address of its first byte, and the bytes, gaps filled with 0xFF."""
        # By sections: a segment may begin with the ELF header, in front of what was asked for.
        parts = [
            (section.address - virtual + physical, self.content(section))
            for section in self.sections
            for kind, _, virtual, physical, length, *_ in self._segments
            if kind == _LOADED
            and section.flags & _ALLOCATED
            and section.kind != _UNINITIALISED
            and section.size
            and virtual <= section.address < virtual + length
        ]
        if not parts:
            raise ValueError("nothing is loaded")
        start = min(address for address, _ in parts)
        image = bytearray(b"\xff" * (max(address + len(part) for address, part in parts) - start))
        for address, part in parts:
            image[address - start : address - start + len(part)] = part
        return start, bytes(image)
