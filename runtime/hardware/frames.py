"""Frames on the link to a board: COBS, CRC-32, and the messages of protocol.json packed and unpacked.

A frame before COBS, little endian: version u8, type u8, sequence u16, length u16, payload, CRC-32 u32 of all before
it; after COBS, a delimiter 0. What a link does to the bytes is counted, never raised.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

DELIMITER = b"\0"
IN_EVERY_VERSION = ("hello", "identity")
"""Messages that are the same whatever the version: they say which one it is."""
_HEADER, _CRC = struct.Struct("<BBHH"), struct.Struct("<I")
_LETTERS = {"u8": "B", "u16": "H", "u32": "I", "i32": "i", "float": "f"}


class FrameError(ValueError):
    """A message that the protocol does not have, or values that do not fill it."""


@dataclass(frozen=True, slots=True)
class ReceivedMessage:
    """One message as it was received; a value is a number or, of an array, a tuple."""

    name: str
    sequence: int
    values: dict[str, Any]


class _Layout:
    """A message's bytes."""

    def __init__(self, item: Mapping[str, Any]) -> None:
        self.name: str = item["name"]
        self.number: int = item["number"]
        self.counts: dict[str, int | None] = {field["name"]: field["count"] for field in item["fields"]}
        letters = (f"{field['count'] or 1}{_LETTERS[field['type']]}" for field in item["fields"])
        self.struct = struct.Struct("<" + "".join(letters))
        self._slices: list[tuple[str, int | slice]] = []
        at = 0
        for name, count in self.counts.items():
            self._slices.append((name, at if count is None else slice(at, at + count)))
            at += count or 1

    def pack(self, values: Mapping[str, Any]) -> bytes:
        """FrameError names what is missing, unknown or of another length."""
        if values.keys() != self.counts.keys():
            wrong = sorted(values.keys() ^ self.counts.keys())
            raise FrameError(f"{self.name} has the fields {', '.join(self.counts) or 'none'}; look at {wrong[0]}")
        flat: list[Any] = []
        for name, count in self.counts.items():
            if count is None:
                flat.append(values[name])
                continue
            if len(values[name]) != count:
                raise FrameError(f"{self.name}: {name} has {count} values, not {len(values[name])}")
            flat += values[name]
        try:
            return self.struct.pack(*flat)
        except (struct.error, OverflowError) as error:
            raise FrameError(f"{self.name}: {error}") from error

    def unpack(self, payload: bytes) -> dict[str, Any]:
        flat = self.struct.unpack(payload)
        return {name: flat[part] for name, part in self._slices}


class Codec:
    """The messages of one arm, by protocol.json."""

    def __init__(self, document: Mapping[str, Any]) -> None:
        self.document = document
        self.version: int = document["version"]
        self.fingerprint: int = document["fingerprint"]
        layouts = [_Layout(item) for item in document["messages"]]
        self._by_name = {layout.name: layout for layout in layouts}
        self._by_number = {layout.number: layout for layout in layouts}
        self.longest = max(layout.struct.size for layout in layouts) + _HEADER.size + _CRC.size

    @classmethod
    def from_json(cls, path: Path) -> Codec:
        """From a file."""
        return cls(json.loads(Path(path).read_text(encoding="utf-8")))

    def names(self, table: str) -> dict[int, str]:
        """Number to name of "states", "reasons" or "results"."""
        return {item["number"]: item["name"] for item in self.document[table]}

    def fields(self, name: str) -> dict[str, int | None]:
        """Of a message, in order; how many values an array has, None for a scalar."""
        return dict(self._by_name[name].counts)

    def number(self, name: str) -> int:
        return self._by_name[name].number

    def payload(self, name: str, values: Mapping[str, Any] | None = None) -> bytes:
        """Packed values, without a frame: what the checksum of a trajectory is made of."""
        if name not in self._by_name:
            raise FrameError(f'no message "{name}"; there are: {", ".join(self._by_name)}')
        return self._by_name[name].pack(values or {})

    def encode(self, name: str, values: Mapping[str, Any] | None = None, sequence: int = 0) -> bytes:
        """A whole frame with its delimiter. Values that are no number or out of range are the board's to refuse."""
        payload = self.payload(name, values)
        plain = _HEADER.pack(self.version, self._by_name[name].number, sequence & 0xFFFF, len(payload)) + payload
        return cobs_encode(plain + _CRC.pack(zlib.crc32(plain))) + DELIMITER

    def decode(self, frame: bytes) -> ReceivedMessage | str:
        """A frame without its delimiter: the message, or the kind of error that it has."""
        plain = cobs_decode(frame)
        if plain is None or not _HEADER.size + _CRC.size <= len(plain) <= self.longest:
            return "bad_frame"
        body = plain[: -_CRC.size]
        if zlib.crc32(body) != _CRC.unpack_from(plain, len(body))[0]:
            return "bad_crc"
        version, number, sequence, length = _HEADER.unpack_from(plain)
        layout = self._by_number.get(number)
        if length != len(body) - _HEADER.size:
            return "bad_header"
        if version != self.version and (layout is None or layout.name not in IN_EVERY_VERSION):
            return "bad_header"
        if layout is None or layout.struct.size != length:
            return "unknown"
        return ReceivedMessage(layout.name, sequence, layout.unpack(body[_HEADER.size :]))


class Decoder:
    """Messages out of a stream of bytes, in pieces of any length.

    errors   how many frames were refused, by kind: bad_frame, bad_crc, bad_header, unknown
    lost     frames that are missing by their sequence numbers
    """

    def __init__(self, codec: Codec) -> None:
        self.codec = codec
        self.errors: Counter[str] = Counter()
        self.lost = 0
        self._pending = b""
        self._skipping = False
        self._expected: int | None = None

    def feed(self, data: bytes) -> list[ReceivedMessage]:
        """What `data` completes."""
        *whole, rest = (self._pending + data).split(DELIMITER) if DELIMITER in data else (self._pending + data,)
        found: list[ReceivedMessage] = []
        for frame in whole:
            if self._skipping:
                self._skipping = False
            elif frame:
                message = self.codec.decode(frame)
                if isinstance(message, str):
                    self.errors[message] += 1
                else:
                    self._count(message.sequence)
                    found.append(message)
        # A frame without an end takes no memory without end.
        if len(rest) > 2 * self.codec.longest:
            self.errors["bad_frame"] += not self._skipping
            self._skipping, rest = True, b""
        self._pending = rest
        return found

    def _count(self, sequence: int) -> None:
        if self._expected is not None:
            ahead = (sequence - self._expected) & 0xFFFF
            # Half of the circle: an older one that comes again or late is no gap.
            self.lost += ahead if ahead < 0x8000 else 0
            if ahead >= 0x8000:
                return
        self._expected = (sequence + 1) & 0xFFFF


def cobs_encode(plain: bytes) -> bytes:
    """Consistent overhead byte stuffing (Cheshire & Baker 1999), without the delimiter: no byte is 0."""
    out = bytearray()
    for part in plain.split(DELIMITER):
        while len(part) >= 254:
            out += b"\xff" + part[:254]
            part = part[254:]
        out += bytes([len(part) + 1]) + part
    return bytes(out)


def cobs_decode(frame: bytes) -> bytes | None:
    """What was encoded, for a frame without its delimiter; None if it is no such encoding."""
    out, at, end = bytearray(), 0, len(frame)
    while at < end:
        code = frame[at]
        if code == 0 or at + code > end:
            return None
        out += frame[at + 1 : at + code]
        at += code
        if code != 0xFF and at < end:
            out.append(0)
    return bytes(out)
