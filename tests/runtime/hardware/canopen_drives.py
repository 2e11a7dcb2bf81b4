"""Simulated CiA 402 drives on a CAN bus, written from the standards (CiA 301, CiA 402) and not from our own side.

They are strict where real drives are: a mapping is written while its PDO is off and the node pre-operational,
entries are checked, a torque acts in operation enabled and in no other state, faults are reset by a rising edge.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import can

PRE_OPERATIONAL, OPERATIONAL, STOPPED = 127, 5, 4
NO_OBJECT, READ_ONLY, BAD_VALUE, BAD_LENGTH, NOT_NOW, NOT_MAPPABLE = (
    0x06020000,
    0x06010002,
    0x06090030,
    0x06070010,
    0x08000022,
    0x06040041,
)

DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOPPED, FAULTY = (
    "disabled",
    "ready",
    "switched on",
    "enabled",
    "quick stop",
    "fault",
)
_WORDS = {DISABLED: 0x0250, READY: 0x0231, SWITCHED_ON: 0x0233, ENABLED: 0x1637, QUICK_STOPPED: 0x0217, FAULTY: 0x0218}


@dataclass
class Entry:
    """form as in struct; write: may be written."""

    form: str
    value: int
    write: bool = False


@dataclass
class Drive:
    """node; counts per turn of the motor; rated torque in mN m; max torque in per mille.

    heard   what it was asked and told, in order: ("write", index, sub, value), ("word", controlword, torque)
    """

    node: int
    counts: int = 2000
    rated: int = 250
    most: int = 3000
    position: int = 0
    state: str = DISABLED
    network: int = PRE_OPERATIONAL
    silent: bool = False
    holds_fault: bool = False
    target: int = 0
    word: int = 0
    heard: list[tuple[Any, ...]] = field(default_factory=list)

    def __post_init__(self) -> None:
        cob = self.node
        self.entries = {
            (0x1000, 0): Entry("I", 0x00020192),
            (0x1001, 0): Entry("B", 0),
            (0x1016, 1): Entry("I", 0, True),
            (0x1017, 0): Entry("H", 0, True),
            (0x603F, 0): Entry("H", 0),
            (0x6007, 0): Entry("h", 1, True),
            (0x6040, 0): Entry("H", 0, True),
            (0x6041, 0): Entry("H", 0),
            (0x6060, 0): Entry("b", 1, True),
            (0x6061, 0): Entry("b", 1),
            (0x6064, 0): Entry("i", 0),
            (0x6071, 0): Entry("h", 0, True),
            (0x6072, 0): Entry("H", self.most, True),
            (0x6076, 0): Entry("I", self.rated),
            (0x608F, 1): Entry("I", self.counts),
            (0x608F, 2): Entry("I", 1),
            (0x60C2, 1): Entry("B", 1, True),
            (0x60C2, 2): Entry("b", -3, True),
            (0x6502, 0): Entry("I", 0x000003AD),
        }
        for k in range(4):
            self.entries |= {
                (0x1400 + k, 1): Entry("I", 0x80000000 | (0x200 + 0x100 * k + cob), True),
                (0x1400 + k, 2): Entry("B", 255, True),
                (0x1800 + k, 1): Entry("I", (0x180 + 0x100 * k + cob), True),
                (0x1800 + k, 2): Entry("B", 255, True),
            }
            for at in (0x1600 + k, 0x1A00 + k):
                self.entries[at, 0] = Entry("B", 0, True)
                self.entries |= {(at, sub): Entry("I", 0, True) for sub in range(1, 9)}

    # --- what it can do ---

    @property
    def torque(self) -> float:
        """N m at the motor that acts now."""
        if self.state != ENABLED or self.entries[0x6061, 0].value != 10:
            return 0.0
        most = self.entries[0x6072, 0].value
        return max(-most, min(most, self.target)) / 1000.0 * self.entries[0x6076, 0].value / 1000.0

    def fail(self, code: int, register: int = 1) -> bytes:
        """Into the state of a fault; the emergency message that it sends."""
        self.state = FAULTY
        self.entries[0x603F, 0].value = code
        self.entries[0x1001, 0].value = register
        return struct.pack("<HB5x", code, register)

    def obey(self, word: int) -> None:
        """The controlword's effect: transitions 2 to 16 of the standard."""
        edge = word & 0x80 and not self.word & 0x80
        self.word = word
        if self.state == FAULTY:
            if edge and not self.holds_fault:
                self.state = DISABLED
            return
        if not word & 0x02:  # disable voltage
            self.state = DISABLED
        elif not word & 0x04:  # quick stop
            self.state = QUICK_STOPPED if self.state in (ENABLED, QUICK_STOPPED) else DISABLED
        elif self.state == QUICK_STOPPED:
            return
        elif not word & 0x01:  # shutdown
            self.state = READY
        elif self.state == READY:  # switch on
            self.state = SWITCHED_ON
        elif self.state in (SWITCHED_ON, ENABLED):
            self.state = ENABLED if word & 0x08 else SWITCHED_ON

    # --- SDO server, expedited ---

    def sdo(self, request: bytes) -> bytes:
        command, index, sub = struct.unpack_from("<BHB", request)
        entry = self.entries.get((index, sub))
        if entry is None:
            return self._abort(index, sub, NO_OBJECT)
        if command >> 5 == 2:
            self.refresh()
            data = struct.pack(f"<{entry.form}", entry.value)
            return struct.pack("<BHB", 0x43 | (4 - len(data)) << 2, index, sub) + data.ljust(4, b"\0")
        if command >> 5 != 1 or not command & 2:
            return self._abort(index, sub, 0x05040001)
        size = 4 - (command >> 2 & 3)
        if size != struct.calcsize(f"<{entry.form}"):
            return self._abort(index, sub, BAD_LENGTH)
        (value,) = struct.unpack_from(f"<{entry.form}", request, 4)
        if problem := self.write(index, sub, value):
            return self._abort(index, sub, problem)
        return struct.pack("<BHB4x", 0x60, index, sub)

    def write(self, index: int, sub: int, value: int) -> int:
        """0, or why not."""
        entry = self.entries[index, sub]
        if not entry.write:
            return READ_ONLY
        if 0x1600 <= index < 0x1700 or 0x1A00 <= index < 0x1B00:
            parameters = self.entries[index - 0x200, 1]
            if self.network != PRE_OPERATIONAL or not parameters.value & 0x80000000:
                return NOT_NOW
            if sub and self.entries[index, 0].value:
                return NOT_NOW
            if sub and value and (value >> 16, value >> 8 & 0xFF) not in self.entries:
                return NOT_MAPPABLE
        if index == 0x6007 and value not in (0, 1, 2, 3):
            return BAD_VALUE
        if index == 0x6060 and value not in (1, 3, 8, 9, 10):
            return BAD_VALUE
        entry.value = value
        if index == 0x6060:
            self.entries[0x6061, 0].value = value
        if index == 0x6071:
            self.target = value
        self.heard.append(("write", index, sub, value))
        return 0

    def _abort(self, index: int, sub: int, code: int) -> bytes:
        return struct.pack("<BHBI", 0x80, index, sub, code)

    # --- PDOs ---

    def refresh(self) -> None:
        self.entries[0x6041, 0].value = _WORDS[self.state]
        self.entries[0x6064, 0].value = self.position

    def mapped(self, at: int) -> list[tuple[tuple[int, int], Entry]]:
        words = [self.entries[at, sub].value for sub in range(1, self.entries[at, 0].value + 1)]
        keys = [(word >> 16, word >> 8 & 0xFF) for word in words]
        for key, word in zip(keys, words, strict=True):
            assert 8 * struct.calcsize(f"<{self.entries[key].form}") == word & 0xFF, "mapped with another length"
        return [(key, self.entries[key]) for key in keys]

    def tpdo(self) -> can.Message | None:
        """The answer to a SYNC."""
        identifier, kind = self.entries[0x1800, 1].value, self.entries[0x1800, 2].value
        if self.silent or self.network != OPERATIONAL or identifier & 0x80000000 or not 1 <= kind <= 240:
            return None
        self.refresh()
        data = b"".join(struct.pack(f"<{entry.form}", entry.value) for _, entry in self.mapped(0x1A00))
        return frame(identifier, data)

    def rpdo(self, data: bytes) -> None:
        if self.network != OPERATIONAL or self.entries[0x1400, 1].value & 0x80000000 or self.silent:
            return
        for key, entry in self.mapped(0x1600):
            size = struct.calcsize(f"<{entry.form}")
            (value,), data = struct.unpack(f"<{entry.form}", data[:size]), data[size:]
            if key == (0x6040, 0):
                self.obey(value)
            elif key == (0x6071, 0):
                self.target = value
        self.heard.append(("word", self.word, self.target))

    def manage(self, command: int) -> bool:
        """NMT; whether it starts anew."""
        self.network = {1: OPERATIONAL, 2: STOPPED, 128: PRE_OPERATIONAL}.get(command, PRE_OPERATIONAL)
        return command in (129, 130)

    def lose_host(self) -> None:
        """What it was told (0x6007) to do once the heartbeat of its host is missing."""
        if self.entries[0x1016, 1].value & 0xFFFF:
            self.state = (self.state, FAULTY, DISABLED, QUICK_STOPPED)[self.entries[0x6007, 0].value]


def frame(identifier: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)


class Drives:
    """A thread that serves drives on a bus.

    advance   called at each SYNC but the first with the motors' torques (N m) since the one before; it moves the
              motors and returns their positions in counts
    """

    def __init__(
        self, channel: str, drives: Sequence[Drive], advance: Callable[[list[float]], Sequence[int]] | None = None
    ) -> None:
        self.drives, self.advance = list(drives), advance
        self.syncs = 0
        self.before: Callable[[int], None] | None = None
        self.heartbeats = 0
        self._bus = can.Bus(interface="virtual", channel=channel)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self.error: BaseException | None = None

    def __enter__(self) -> Self:
        self._thread.start()
        for drive in self.drives:
            self.send(0x700 + drive.node, b"\0")
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._bus.shutdown()
        if self.error is not None:
            raise self.error

    def send(self, identifier: int, data: bytes) -> None:
        self._bus.send(frame(identifier, data))

    def fail(self, drive: Drive, code: int, register: int = 1) -> None:
        self.send(0x80 + drive.node, drive.fail(code, register))

    def _serve(self) -> None:
        try:
            while not self._ended.is_set():
                message = self._bus.recv(0.02)
                if message is not None:
                    self._handle(message.arbitration_id, bytes(message.data))
        except BaseException as error:
            self.error = error

    def _handle(self, identifier: int, data: bytes) -> None:
        if identifier == 0x80:
            self._sync()
        elif identifier == 0x77F:
            self.heartbeats += 1
        for drive in self.drives:
            if identifier == 0 and data[1] in (0, drive.node):
                if drive.manage(data[0]):
                    self.send(0x700 + drive.node, b"\0")
            elif identifier == 0x600 + drive.node and not drive.silent:
                if data[0] != 0x80:
                    self.send(0x580 + drive.node, drive.sdo(data))
            elif identifier == drive.entries[0x1400, 1].value & 0x7FF and 0x200 <= identifier < 0x280:
                drive.rpdo(data)

    def _sync(self) -> None:
        if self.advance is not None and self.syncs:
            for drive, position in zip(self.drives, self.advance([d.torque for d in self.drives]), strict=True):
                drive.position = position
        self.syncs += 1
        if self.before is not None:
            self.before(self.syncs)
        for drive in self.drives:
            if (message := drive.tpdo()) is not None:
                self._bus.send(message)
