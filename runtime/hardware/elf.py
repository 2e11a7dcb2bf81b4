"""What an emulator needs of an image: 32-bit little-endian ELF, as linkers for a Cortex-M write it."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

_LOAD, _SYMBOLS = 1, 2


class ImageError(ValueError):
    """A file that is no image; the message says what was found."""


@dataclass(frozen=True)
class Image:
    """entry: address; segments: (load address, bytes); symbols: by name (address, size)."""

    entry: int
    segments: tuple[tuple[int, bytes], ...]
    symbols: Mapping[str, tuple[int, int]]


def read(path: Path) -> Image:
    """The image in a file. Raises ImageError."""
    data = path.read_bytes()
    if data[:6] != b"\x7fELF\x01\x01":
        raise ImageError(f"{path}: no 32-bit little-endian ELF image; tendon firmware makes one")
    entry, programs, sections = struct.unpack_from("<III", data, 24)
    program_size, program_count, section_size, section_count = struct.unpack_from("<4H", data, 42)
    headers = [struct.unpack_from("<10I", data, sections + k * section_size) for k in range(section_count)]
    loads = [struct.unpack_from("<5I", data, programs + k * program_size) for k in range(program_count)]
    segments = tuple((place, data[at : at + size]) for kind, at, _, place, size in loads if kind == _LOAD and size)
    symbols: dict[str, tuple[int, int]] = {}
    for header in headers:
        if header[1] == _SYMBOLS:
            symbols |= _symbols(data, header, headers[header[6]])
    return Image(entry, segments, symbols)


def _symbols(data: bytes, table: tuple[int, ...], strings: tuple[int, ...]) -> dict[str, tuple[int, int]]:
    found = {}
    for at in range(table[4], table[4] + table[5], 16):
        name_at, address, size = struct.unpack_from("<III", data, at)
        begin = strings[4] + name_at
        name = data[begin : data.index(b"\0", begin)].decode()
        if name and not name.startswith("$"):
            found[name] = (address, size)
    return found
