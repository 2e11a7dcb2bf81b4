"""The link to a board: bytes in both directions with the link's own clock, and the frames in them.

A frame before COBS, little endian: version u8, type u8, sequence u16, length u16, payload, CRC-32 u32 of all before
it; after COBS, a delimiter 0. Damaged frames are counted and never raise. The messages are those of protocol.json.
"""

from __future__ import annotations

import json
import re
import struct
import time
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import parse_qsl, unquote, urlsplit

from runtime.documents.plans import DrivesEntry

Values = Mapping[str, Any]
"""Values of a message's fields, as protocol.json lays them out: an integer or a float, or a sequence of them."""


class LinkError(RuntimeError):
    """The link cannot be opened or used; the message says what to do."""


class LinkLost(RuntimeError):
    """The link broke; the message says how."""


class BoardLink(Protocol):
    """A link in both directions, with its own clock. All methods may raise LinkLost.

    Deadlines are measured by `now`, so that a simulated board has as much time on a busy computer as on an idle one.

    baud    bits per second of a serial line; None: not limited
    late    longest time in s between two control steps if this computer runs them; None: the board's timer does
    fault   what failed, if this computer drives the arm itself; None: nothing, or the board drives it
    """

    baud: int | None = None
    late: float | None = None
    fault: str | None = None

    def write(self, data: bytes) -> None:
        """Sends bytes."""

    def read(self, timeout: float) -> bytes:
        """The received bytes; waits at most `timeout` s of this link's clock, then returns b""."""

    def now(self) -> float:
        """Time in s of this link's clock, which advances in `read`."""

    def figures(self) -> DrivesEntry | None:
        """Statistics of the drives, if this computer drives the arm itself."""
        return None

    def close(self) -> None:
        """Closes the link; may be called twice."""


BAUD = 1_000_000
SERIAL_SCHEME = "serial"
_BAUD_DIGITS = re.compile(r"[1-9][0-9]{0,8}", re.ASCII)
_SERIAL_EXAMPLE = "serial:///dev/ttyACM0 or serial:///dev/ttyUSB0?baud=1000000"


class SerialLink(BoardLink):
    """A serial port, opened exclusively. dtr: state of DTR and RTS, which reset some boards. Raises LinkError."""

    def __init__(self, device: str, baud: int = BAUD, dtr: bool = True) -> None:
        try:
            import serial
        except ImportError as error:
            raise LinkError("a serial port needs pyserial: pip install pyserial") from error
        self.device = device
        self.baud = baud
        self._errors = (serial.SerialException, OSError)
        try:
            self._port: Any = serial.Serial(None, baud, timeout=0, write_timeout=1.0, exclusive=True)
            # Some boards are reset by one of these lines, others by both.
            self._port.dtr = self._port.rts = dtr
            self._port.port = device
            self._port.open()
        except (*self._errors, ValueError) as error:
            raise LinkError(_open_failure(device, baud, error)) from error
        self._port.reset_input_buffer()

    @classmethod
    def of(cls, url: str) -> SerialLink:
        """`serial:///dev/ttyACM0?baud=1000000`. Raises LinkError."""
        return cls(*serial_address(url))

    def write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except self._errors as error:
            raise LinkLost(f"{self.device} accepts no more bytes: {_one_line(error)}") from error

    def read(self, timeout: float) -> bytes:
        try:
            if data := self._port.read(self._port.in_waiting):
                return bytes(data)
            self._port.timeout = timeout
            first = self._port.read(1)
            return bytes(first + self._port.read(self._port.in_waiting)) if first else b""
        except self._errors as error:
            raise LinkLost(f"{self.device} is gone: {_one_line(error)}") from error

    def now(self) -> float:
        return time.monotonic()

    def close(self) -> None:
        self._port.close()


def parse_address(url: str, scheme: str, defaults: Mapping[str, str], example: str) -> tuple[str, dict[str, str]]:
    """What follows the scheme, and the query's values beside the defaults of its keys. Raises LinkError."""
    try:
        parts = urlsplit(url)
        given = dict(parse_qsl(parts.query, keep_blank_values=True))
    except ValueError as error:  # brackets that are not closed, too many fields
        raise LinkError(f"--on {url}: {error}; expected {example}") from None
    place = unquote(parts.netloc + parts.path)
    if parts.scheme != scheme or not place:
        raise LinkError(f"--on {url}: expected {example}")
    if unknown := sorted(given.keys() - defaults.keys()):
        raise LinkError(f'--on {url}: unknown key "{unknown[0]}"; expected {" and ".join(defaults)}: {example}')
    return place, {**defaults, **given}


def serial_address(url: str) -> tuple[str, int, bool]:
    """Device, baud and DTR of `serial:///dev/ttyACM0?baud=1000000&dtr=0`. Raises LinkError."""
    device, keys = parse_address(url, SERIAL_SCHEME, {"baud": str(BAUD), "dtr": "1"}, _SERIAL_EXAMPLE)
    if not _BAUD_DIGITS.fullmatch(keys["baud"]) or keys["dtr"] not in ("0", "1"):
        raise LinkError(f"--on {url}: expected {_SERIAL_EXAMPLE}")
    return device, int(keys["baud"]), keys["dtr"] == "1"


def _open_failure(device: str, baud: int, error: Exception) -> str:
    number = getattr(error, "errno", None)
    words = str(error).lower()
    if number == 2 or "no such file" in words:
        return f"{device}: there is no such port; is the board plugged in? (ls /dev/ttyACM* /dev/ttyUSB*)"
    if number == 13 or "permission denied" in words:
        return (
            f"{device}: no permission; join the group that owns it: sudo usermod -aG dialout $USER, then log in again"
        )
    if number in (11, 16) or "exclusively lock" in words or "busy" in words:
        return f"{device}: another program uses this port; close it first (fuser {device} shows which)"
    if isinstance(error, ValueError):
        return f"{device}: cannot run at {baud} baud: {_one_line(error)}"
    return f"{device}: cannot be opened: {_one_line(error)}"


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


DELIMITER = b"\0"
IN_EVERY_VERSION = ("hello", "identity")
"""Messages with the same layout in every version; they state the version."""
_HEADER, _CRC = struct.Struct("<BBHH"), struct.Struct("<I")
_LETTERS = {"u8": "B", "u16": "H", "u32": "I", "i32": "i", "float": "f"}


class FrameError(ValueError):
    """An unknown message, or values that do not fit its fields."""


@dataclass(frozen=True, slots=True)
class ReceivedMessage:
    """A received message; arrays are tuples."""

    name: str
    sequence: int
    values: Values


class _Layout:
    """The layout of a message's payload."""

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

    def pack(self, values: Values) -> bytes:
        """The payload. Raises FrameError for missing or unknown fields and wrong lengths."""
        if values.keys() != self.counts.keys():
            wrong = sorted(values.keys() ^ self.counts.keys())
            raise FrameError(
                f"{self.name} has the fields {', '.join(self.counts) or 'none'}; {wrong[0]} is missing or unknown"
            )
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

    def unpack(self, payload: bytes) -> Values:
        flat = self.struct.unpack(payload)
        return {name: flat[part] for name, part in self._slices}


class Codec:
    """Packs and unpacks the messages of one arm, defined by protocol.json."""

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
        """The codec of a protocol.json."""
        return cls(json.loads(Path(path).read_text(encoding="utf-8")))

    def names(self, table: str) -> dict[int, str]:
        """Number -> name of "states", "reasons" or "results"."""
        return {item["number"]: item["name"] for item in self.document[table]}

    def fields(self, name: str) -> dict[str, int | None]:
        """Fields of a message in order: the length of an array, None for a scalar."""
        return dict(self._by_name[name].counts)

    def number(self, name: str) -> int:
        return self._by_name[name].number

    def payload(self, name: str, values: Values | None = None) -> bytes:
        """The payload alone, of which the checksum of a trajectory is computed."""
        if name not in self._by_name:
            raise FrameError(f'no message "{name}"; there are: {", ".join(self._by_name)}')
        return self._by_name[name].pack(values or {})

    def encode(self, name: str, values: Values | None = None, sequence: int = 0) -> bytes:
        """A frame with its delimiter. The board refuses values that are not finite or out of range."""
        payload = self.payload(name, values)
        plain = _HEADER.pack(self.version, self._by_name[name].number, sequence & 0xFFFF, len(payload)) + payload
        return cobs_encode(plain + _CRC.pack(zlib.crc32(plain))) + DELIMITER

    def decode(self, frame: bytes) -> ReceivedMessage | str:
        """The message in a frame without its delimiter, or the kind of its error."""
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
    """Finds messages in a stream of bytes that arrives in pieces of any length.

    errors   number of damaged frames by kind: bad_frame, bad_crc, bad_header, unknown
    """

    def __init__(self, codec: Codec) -> None:
        self.codec = codec
        self.errors: Counter[str] = Counter()
        self._pending = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[ReceivedMessage]:
        """The messages that `data` completes."""
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
                    found.append(message)
        # An endless frame must not fill the memory.
        if len(rest) > 2 * self.codec.longest:
            self.errors["bad_frame"] += not self._skipping
            self._skipping, rest = True, b""
        self._pending = rest
        return found


def cobs_encode(plain: bytes) -> bytes:
    """Consistent overhead byte stuffing (Cheshire & Baker 1999), without the delimiter; no byte is 0."""
    out = bytearray()
    for part in plain.split(DELIMITER):
        while len(part) >= 254:
            out += b"\xff" + part[:254]
            part = part[254:]
        out += bytes([len(part) + 1]) + part
    return bytes(out)


def cobs_decode(frame: bytes) -> bytes | None:
    """The decoded bytes of a frame without its delimiter; None if it is not COBS."""
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
