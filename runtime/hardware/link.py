"""The line to a board: bytes there and back, and its own clock."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from typing import Any, Protocol
from urllib.parse import parse_qs, urlsplit


class LinkError(RuntimeError):
    """The line cannot be opened; the message says what to do."""


class LinkLost(RuntimeError):
    """The line that was there is gone; the message says how."""


class BoardLink(Protocol):
    """Both directions of a line. All may raise LinkLost.

    A link has a time of its own, so that a simulated board is waited for in its time and not in that of a busy
    machine: every deadline is kept by `now`.

    baud    bits per second of a serial line; None where there is no such bound
    late    s between two control steps at most where this end keeps the time; None: as a board's timer does
    fault   words for what has failed where this end of the link drives the arm itself; None: nothing, or the board does
    """

    baud: int | None
    late: float | None
    fault: str | None

    def write(self, data: bytes) -> None:
        """Send these bytes; waits no longer than the line takes."""

    def read(self, timeout: float) -> bytes:
        """What has come, at once if something has; b"" if nothing comes within `timeout` s of this link's time."""

    def now(self) -> float:
        """s, from any beginning; grows in `read`."""

    def figures(self) -> Mapping[str, Any]:
        """What became of it, for --json."""

    def close(self) -> None:
        """Give the line back; may be called twice."""


BAUD = 1_000_000
SERIAL_SCHEME = "serial"
_BAUD_DIGITS = re.compile(r"[1-9][0-9]{0,8}", re.ASCII)
_SERIAL_EXAMPLE = "serial:///dev/ttyACM0 or serial:///dev/ttyUSB0?baud=1000000"


class SerialLink:
    """A serial port, held exclusively. dtr: whether that line is set, which resets some boards. Raises LinkError."""

    def __init__(self, device: str, baud: int = BAUD, dtr: bool = True) -> None:
        try:
            import serial
        except ImportError as error:
            raise LinkError("a serial port needs pyserial: pip install pyserial") from error
        self.device = device
        self.baud: int | None = baud
        self.late: float | None = None
        self.fault: str | None = None
        self._errors = (serial.SerialException, OSError)
        try:
            self._port: Any = serial.Serial(None, baud, timeout=0, write_timeout=1.0, exclusive=True)
            # Some boards reset by the one line, others by both.
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
            raise LinkLost(f"{self.device} takes no more bytes: {_one_line(error)}") from error

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

    def figures(self) -> Mapping[str, Any]:
        return {}

    def close(self) -> None:
        self._port.close()


def serial_address(url: str) -> tuple[str, int, bool]:
    """Device, baud and DTR of `serial:///dev/ttyACM0?baud=1000000&dtr=0`. Raises LinkError."""
    try:
        parts = urlsplit(url)
        query = parse_qs(parts.query, keep_blank_values=True)
    except ValueError as error:  # brackets that are not closed, too many fields
        raise LinkError(f"--on {url}: {error}; expected {_SERIAL_EXAMPLE}") from None
    device = parts.netloc + parts.path
    words = query.pop("baud", [str(BAUD)])[-1]
    dtr = query.pop("dtr", ["1"])[-1]
    if not device or query or not _BAUD_DIGITS.fullmatch(words) or dtr not in ("0", "1"):
        raise LinkError(f"--on {url}: expected {_SERIAL_EXAMPLE}")
    return device, int(words), dtr == "1"


def _open_failure(device: str, baud: int, error: Exception) -> str:
    number = getattr(error, "errno", None)
    words = str(error).lower()
    if number == 2 or "no such file" in words:
        return f"{device}: there is no such port; is the board plugged in? (ls /dev/ttyACM* /dev/ttyUSB*)"
    if number == 13 or "permission denied" in words:
        return f"{device}: no permission; join the group that owns it: sudo usermod -aG dialout $USER, then log in anew"
    if number in (11, 16) or "exclusively lock" in words or "busy" in words:
        return f"{device}: another program holds this port; close it first (fuser {device} names it)"
    if isinstance(error, ValueError):
        return f"{device}: cannot run at {baud} baud: {_one_line(error)}"
    return f"{device}: cannot be opened: {_one_line(error)}"


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
