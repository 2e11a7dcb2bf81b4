"""A servo drive of the profile CiA 402 (IEC 61800-7-201) in cyclic synchronous torque mode, as a node of a CAN bus.

First the profile, without a bus: objects, states, torque in per mille, errors in words. Then the drive: set up by SDO,
commanded by PDO.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import Enum, IntEnum
from threading import Condition
from typing import Any, NoReturn

from runtime.hardware.link import LinkError
from runtime.model.loader import JointInfo


@dataclass(frozen=True)
class Entry:
    """An entry of a drive's object dictionary; `form`: its type as in `struct`."""

    index: int
    sub: int
    form: str
    name: str

    def pack(self, value: int) -> bytes:
        return struct.pack(f"<{self.form}", value)

    def unpack(self, data: bytes) -> int:
        """Accepts more bytes than the entry has, as some drives send. Raises struct.error for fewer."""
        return int(struct.unpack_from(f"<{self.form}", data)[0])

    @property
    def mapping(self) -> int:
        """Its value in a PDO's mapping (0x1600, 0x1A00): index, subindex, bits."""
        return self.index << 16 | self.sub << 8 | 8 * struct.calcsize(f"<{self.form}")

    def __str__(self) -> str:
        return f"{self.name} (0x{self.index:04X}:{self.sub:02X})"


DEVICE_TYPE = Entry(0x1000, 0, "I", "device type")
PROFILE = 402
"""Lower half of a drive's device type."""
ERROR_CODE = Entry(0x603F, 0, "H", "error code")
CONTROLWORD = Entry(0x6040, 0, "H", "controlword")
STATUSWORD = Entry(0x6041, 0, "H", "statusword")
MODE = Entry(0x6060, 0, "b", "mode of operation")
MODE_DISPLAY = Entry(0x6061, 0, "b", "mode of operation display")
SUPPORTED_MODES = Entry(0x6502, 0, "I", "supported drive modes")
CYCLIC_TORQUE, CYCLIC_TORQUE_BIT = 10, 1 << 9
"""Cyclic synchronous torque: the mode's number, and its bit among the supported ones."""
POSITION = Entry(0x6064, 0, "i", "position actual value")
TARGET_TORQUE = Entry(0x6071, 0, "h", "target torque")
MAX_TORQUE = Entry(0x6072, 0, "H", "max torque")
RATED_TORQUE = Entry(0x6076, 0, "I", "motor rated torque")
ENCODER_INCREMENTS = Entry(0x608F, 1, "I", "encoder increments")
ENCODER_TURNS = Entry(0x608F, 2, "I", "motor revolutions")
GEAR_MOTOR = Entry(0x6091, 1, "I", "gear ratio, motor revolutions")
GEAR_SHAFT = Entry(0x6091, 2, "I", "gear ratio, shaft revolutions")
PERIOD = Entry(0x60C2, 1, "B", "interpolation time period")
PERIOD_EXPONENT = Entry(0x60C2, 2, "b", "interpolation time index")
ON_LOST_HOST = Entry(0x6007, 0, "h", "abort connection option code")
DISABLE_VOLTAGE_THEN = 2
"""Value of ON_LOST_HOST: a drive that misses the computer's heartbeat switches off its power stage."""


# --- states ---


class DriveState(Enum):
    """States of a drive, in the standard's words."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    FAULT_REACTION = "fault reaction active"
    FAULT = "fault"
    UNKNOWN = "no state of CiA 402"


_STATES = (
    (0x4F, 0x00, DriveState.NOT_READY),
    (0x4F, 0x40, DriveState.SWITCH_ON_DISABLED),
    (0x6F, 0x21, DriveState.READY),
    (0x6F, 0x23, DriveState.SWITCHED_ON),
    (0x6F, 0x27, DriveState.ENABLED),
    (0x6F, 0x07, DriveState.QUICK_STOP),
    (0x4F, 0x0F, DriveState.FAULT_REACTION),
    (0x4F, 0x08, DriveState.FAULT),
)
"""Mask and bits of the statusword for each state."""

POWERLESS = frozenset({DriveState.NOT_READY, DriveState.SWITCH_ON_DISABLED, DriveState.READY, DriveState.FAULT})
"""States in which the power stage is off, so that there is no torque."""
_LIMIT_BIT = 1 << 11


def state_of(statusword: int) -> DriveState:
    """The state in a statusword."""
    return next((state for mask, bits, state in _STATES if statusword & mask == bits), DriveState.UNKNOWN)


def limited(statusword: int) -> bool:
    """Whether the drive limits its torque, because of its current or temperature."""
    return bool(statusword & _LIMIT_BIT)


class Controlword(IntEnum):
    DISABLE_VOLTAGE = 0x00
    QUICK_STOP = 0x02
    SHUTDOWN = 0x06
    SWITCH_ON = 0x07
    ENABLE_OPERATION = 0x0F
    FAULT_RESET = 0x80


_TOWARDS_ENABLED = {
    DriveState.SWITCH_ON_DISABLED: Controlword.SHUTDOWN,
    DriveState.READY: Controlword.SWITCH_ON,
    DriveState.SWITCHED_ON: Controlword.ENABLE_OPERATION,
    DriveState.ENABLED: Controlword.ENABLE_OPERATION,
}


def towards_enabled(state: DriveState, before: Controlword) -> Controlword:
    """The next controlword on the way to operation enabled. before: the last one sent.

    A fault is reset by a rising edge of its bit, so that reset and disable voltage alternate. Disable voltage is also
    the answer to a quick stop and to states that a drive leaves by itself.
    """
    if state is DriveState.FAULT and before is not Controlword.FAULT_RESET:
        return Controlword.FAULT_RESET
    return _TOWARDS_ENABLED.get(state, Controlword.DISABLE_VOLTAGE)


# --- torque ---

_LARGEST = 32767
"""Largest target torque in per mille, 16 bits, in either direction."""


@dataclass(frozen=True)
class Scale:
    """Conversion between a joint's torque and a drive's target torque.

    gear_ratio     turns of the motor per turn (rad per m) of the joint
    direction      1, or −1 if the motor turns against the joint
    rated_torque   of the motor in N m, 1000 per mille
    max_torque     the drive's limit in per mille
    """

    gear_ratio: float
    direction: int
    rated_torque: float
    max_torque: int = _LARGEST

    @property
    def resolution(self) -> float:
        """Torque at the joint of one per mille, N m or N; commands are rounded to it."""
        return self.gear_ratio * self.rated_torque / 1000.0

    @property
    def largest(self) -> float:
        """Largest torque at the joint that can be commanded, N m or N."""
        return self.resolution * min(self.max_torque, _LARGEST)

    def per_mille(self, torque: float) -> int:
        """Target torque nearest to `torque` (N m or N) at the joint, clamped. Raises ValueError if it is not finite."""
        if not abs(torque) < float("inf"):
            raise ValueError(f"a torque of {torque} cannot be commanded")
        most = min(self.max_torque, _LARGEST)
        # Clamped before rounding: the ratio may be larger than any integer of the drive.
        return self.direction * round(max(-most, min(most, torque / self.resolution)))


# --- errors ---

_ERRORS = {
    0x1000: "generic error",
    0x2000: "current",
    0x2100: "current, device input side",
    0x2200: "current inside the device",
    0x2300: "current, device output side",
    0x2310: "continuous over-current",
    0x2320: "short circuit or earth leakage",
    0x2330: "earth leakage",
    0x2340: "short circuit",
    0x3000: "voltage",
    0x3100: "mains voltage",
    0x3200: "DC link voltage",
    0x3210: "DC link over-voltage",
    0x3220: "DC link under-voltage",
    0x3300: "output voltage",
    0x4000: "temperature",
    0x4100: "ambient temperature",
    0x4200: "temperature of the device",
    0x4210: "the device is too hot",
    0x4300: "temperature of the drive",
    0x4310: "the drive is too hot",
    0x5000: "device hardware",
    0x5100: "supply",
    0x5200: "control hardware",
    0x5300: "operating unit",
    0x5400: "power section",
    0x5500: "data storage",
    0x6000: "device software",
    0x6010: "software reset by the drive's watchdog",
    0x6100: "internal software",
    0x6200: "user software",
    0x6300: "data set",
    0x7000: "additional modules",
    0x7100: "power",
    0x7110: "brake chopper",
    0x7120: "motor",
    0x7121: "motor blocked",
    0x7122: "motor error or commutation",
    0x7200: "measurement circuit",
    0x7300: "sensor",
    0x7305: "incremental encoder 1",
    0x7306: "incremental encoder 2",
    0x7310: "speed sensor",
    0x7320: "position sensor",
    0x7400: "computation circuit",
    0x7500: "communication module",
    0x8000: "monitoring",
    0x8100: "communication",
    0x8110: "CAN overrun: messages lost",
    0x8120: "CAN in error passive mode",
    0x8130: "the computer's heartbeat was missing",
    0x8140: "recovered from bus off",
    0x8150: "two nodes send with one id",
    0x8200: "protocol",
    0x8210: "PDO not processed: its length is wrong",
    0x8220: "PDO is too long",
    0x8250: "RPDO was missing",
    0x8300: "torque control",
    0x8311: "excess torque",
    0x8400: "velocity control",
    0x8500: "position control",
    0x8600: "positioning control",
    0x8611: "following error",
    0x8612: "reference limit",
    0x9000: "external error",
    0xF000: "additional functions",
    0xFF00: "specific to the device, see its manual",
}
_REGISTER = ("generic", "current", "voltage", "temperature", "communication", "profile", "", "manufacturer")
"""Bits of the error register (0x1001)."""


def error_text(code: int) -> str:
    """The code of an emergency or of 0x603F in words, as specific as the standards define it."""
    for mask in (0xFFFF, 0xFFF0, 0xFF00, 0xF000):
        if text := _ERRORS.get(code & mask):
            return f"0x{code:04X}, {text}"
    return f"0x{code:04X}"


HOST_NODE = 127
"""Node id of the computer, whose heartbeat the drives watch."""
HOST_LOST = 0.1
"""Time in s without the computer's heartbeat after which a drive switches off."""
DRIVE_HEARTBEAT = 0.1
"""Period in s of the drives' heartbeats, which show why a drive no longer answers."""
_SDO_TIMEOUT = 1.0  # s
_TRIES = 20
"""How often the mode is read until it has changed."""
_PDO_OFF = 1 << 31
_EVERY_SYNC, _AT_ONCE = 1, 255
"""Transmission types of a PDO."""
_ANSWER, _COMMAND = struct.Struct("<Hi"), struct.Struct("<Hh")

_HOST_HEARTBEAT = Entry(0x1016, 1, "I", "consumer heartbeat time")
_HEARTBEAT = Entry(0x1017, 0, "H", "producer heartbeat time")


class CanDrive:
    """The drive of a joint (1-based) in a connected canopen.Network.

    spoke    notified by the network's thread after an answer to a SYNC or a restart
    heard    whether it has answered the last SYNC
    misses   number of SYNCs in a row that it has not answered in time; a late answer resets it
    """

    def __init__(self, network: Any, joint: int, info: JointInfo, spoke: Condition) -> None:
        import canopen

        assert info.drive is not None
        assert info.drive.node is not None
        self.joint, self.info, self._keys = joint, info, info.drive
        self.node = info.drive.node
        self.name = f"joint {joint}: the drive (node {self.node})"
        self.statusword, self._position = 0, 0
        self.emergency: str | None = None
        self.restarted = False
        self.heard, self.misses = False, 0
        self._network, self._spoke = network, spoke
        self._remote = canopen.RemoteNode(self.node, canopen.ObjectDictionary())
        self._remote.sdo.RESPONSE_TIMEOUT = _SDO_TIMEOUT
        network.add_node(self._remote)
        self._remote.emcy.add_callback(self._on_emergency)
        self._remote.nmt.add_heartbeat_callback(self._on_heartbeat)
        network.subscribe(0x180 + self.node, self._on_answer)

    # --- set-up, by SDO ---

    def set_up(self, period: float) -> Scale:
        """Checks that the drive fits the joint, and configures it for a control period in s. Raises LinkError."""
        self._remote.nmt.state = "PRE-OPERATIONAL"
        kind = self._read(DEVICE_TYPE) & 0xFFFF
        if kind != PROFILE:
            self._refuse(f"has the profile {kind}; expected a servo drive, CiA {PROFILE}")
        if not self._read(SUPPORTED_MODES) & CYCLIC_TORQUE_BIT:
            self._refuse(f"has no cyclic synchronous torque mode ({SUPPORTED_MODES}); update its firmware")
        self._check_counts()
        scale = self._scale()
        self._map()
        self._write(ON_LOST_HOST, DISABLE_VOLTAGE_THEN, self._unwatched)
        self._write(_HOST_HEARTBEAT, HOST_NODE << 16 | round(1e3 * HOST_LOST), self._unwatched)
        self._write(_HEARTBEAT, round(1e3 * DRIVE_HEARTBEAT))
        self._write(TARGET_TORQUE, 0)
        self._set_period(period)
        self._write(MODE, CYCLIC_TORQUE)
        if not any(self._read(MODE_DISPLAY) == CYCLIC_TORQUE for _ in range(_TRIES)):
            self._refuse(f"stays in mode {self._read(MODE_DISPLAY)} ({MODE_DISPLAY}); expected {CYCLIC_TORQUE}")
        self.restarted, self.emergency = False, None
        return scale

    def operational(self) -> None:
        """From now on the drive answers SYNCs."""
        self._remote.nmt.state = "OPERATIONAL"

    def release(self) -> None:
        """The drive stops watching this computer, which may then disappear without a fault."""
        with suppress(LinkError):
            self._write(_HOST_HEARTBEAT, 0)

    def error(self) -> str:
        """Why it failed: its emergency message, or its error code."""
        if self.emergency is not None:
            return self.emergency
        code = self._optional(ERROR_CODE)
        return error_text(code) if code else "it reports no reason"

    @property
    def network_state(self) -> str:
        """The node's state in its last heartbeat or boot-up message: OPERATIONAL, STOPPED, …"""
        return str(self._remote.nmt.state)

    def _check_counts(self) -> None:
        """Counts per turn and gear ratio must be those of the model file, or the joint would move by another angle."""
        found, turns = self._read(ENCODER_INCREMENTS), self._read(ENCODER_TURNS)
        if found != (self.info.encoder_counts or 0) * turns:
            each = f"{found / turns:g}" if turns else "no"
            self._refuse(
                f"has {each} counts per turn of the motor ({ENCODER_INCREMENTS}), "
                f"and the model file {self.info.encoder_counts}; correct [joint.encoder] counts or the drive"
            )
        motor, shaft = self._optional(GEAR_MOTOR), self._optional(GEAR_SHAFT)
        if motor != shaft:
            self._refuse(
                f"divides positions by a gear ratio of {motor}:{shaft} ({GEAR_MOTOR}); expected counts of the motor; "
                "set it to 1:1 (gear_ratio is in the model file)"
            )

    def _scale(self) -> Scale:
        rated = self._keys.rated_torque
        if rated is None:
            rated = self._read(RATED_TORQUE) / 1e3  # it says mN m
        if not rated > 0:
            self._refuse(f"has {RATED_TORQUE} 0; set it, or rated_torque under [joint.drive]")
        scale = Scale(self.info.gear_ratio, self._keys.direction, rated, self._read(MAX_TORQUE))
        limit, unit = self.info.torque_limit, self.info.force_unit
        # The limit may lie between two steps of the command.
        if limit is not None and limit > scale.largest + scale.resolution:
            self._refuse(
                f"is limited to {scale.largest:.4g} {unit} ({MAX_TORQUE}: {scale.max_torque} per mille of "
                f"{rated:g} N m), less than the joint's limit of {limit:g} {unit}; lower [joint.limits] torque"
            )
        return scale

    def _map(self) -> None:
        """Maps the PDOs; a mapping can be written only while its PDO is off."""
        for number in (2, 3, 4):
            if self._optional(Entry(0x1800 + number - 1, 1, "I", f"TPDO {number}")) is not None:
                self._write(Entry(0x1800 + number - 1, 1, "I", f"TPDO {number}"), _PDO_OFF)
        answer, command = (STATUSWORD, POSITION), (CONTROLWORD, TARGET_TORQUE)
        self._map_one("TPDO 1", 0x1800, 0x1A00, base=0x180, kind=_EVERY_SYNC, entries=answer)
        self._map_one("RPDO 1", 0x1400, 0x1600, base=0x200, kind=_AT_ONCE, entries=command)

    def _map_one(self, name: str, at: int, mapping: int, base: int, kind: int, entries: tuple[Entry, ...]) -> None:
        identifier = Entry(at, 1, "I", f"{name}, identifier")
        count = Entry(mapping, 0, "B", f"{name}, number of entries")
        self._write(identifier, _PDO_OFF | base + self.node)
        self._write(Entry(at, 2, "B", f"{name}, transmission type"), kind)
        self._write(count, 0)
        for sub, entry in enumerate(entries, 1):
            self._write(Entry(mapping, sub, "I", f"{name}, entry {sub}"), entry.mapping)
        self._write(count, len(entries))
        self._write(identifier, base + self.node)

    def _set_period(self, period: float) -> None:
        """Sets the period of the SYNCs, value * 10^exponent s, if the drive has this entry."""
        if self._optional(PERIOD) is None:
            return
        for exponent in (-3, -4, -5, -6):
            value = round(period / 10.0**exponent)
            if 1 <= value <= 255 and abs(value * 10.0**exponent - period) < 1e-9:
                self._write(PERIOD, value)
                self._write(PERIOD_EXPONENT, exponent)
                return

    _unwatched = "it would keep its last torque if this computer stopped, so it cannot be driven from here"

    def _read(self, entry: Entry) -> int:
        with self._talking(entry, "read"):
            return entry.unpack(self._remote.sdo.upload(entry.index, entry.sub))

    def _write(self, entry: Entry, value: int, otherwise: str = "see its manual") -> None:
        with self._talking(entry, f"set to {value}", otherwise):
            self._remote.sdo.download(entry.index, entry.sub, entry.pack(value))

    @contextmanager
    def _talking(self, entry: Entry, what: str, otherwise: str = "see its manual") -> Iterator[None]:
        """Turns failures of an SDO transfer into LinkError."""
        import canopen

        try:
            yield
        except canopen.SdoAbortedError as error:
            why = canopen.SdoAbortedError.CODES.get(error.code, f"abort code 0x{error.code:08X}")
            self._refuse(f"refuses {entry} to be {what} ({why}); {otherwise}")
        except canopen.SdoCommunicationError:
            self._refuse("does not answer; is it on, and are its node id and bit rate right?")
        except struct.error:
            self._refuse(f"answers {entry} with too few bytes; {otherwise}")

    def _optional(self, entry: Entry) -> int | None:
        """The value, or None if the drive does not have the entry."""
        import canopen

        try:
            return entry.unpack(self._remote.sdo.upload(entry.index, entry.sub))
        except (canopen.SdoAbortedError, canopen.SdoCommunicationError, struct.error):
            return None

    def _refuse(self, what: str) -> NoReturn:
        raise LinkError(f"{self.name} {what}")

    # --- a period, by PDO ---

    @property
    def state(self) -> DriveState:
        """By its last answer."""
        return state_of(self.statusword)

    @property
    def counts(self) -> int:
        """Encoder counts in the joint's direction; the register wraps, and so does its negative."""
        return (self._keys.direction * self._position + 2**31) % 2**32 - 2**31

    def command(self, word: Controlword, torque: int = 0) -> None:
        """Sends a controlword and a target torque in per mille of the rated torque."""
        self._network.send_message(0x200 + self.node, _COMMAND.pack(word, torque))

    def _on_answer(self, _id: int, data: bytearray, _time: float) -> None:
        if len(data) == _ANSWER.size:
            self.statusword, self._position = _ANSWER.unpack(data)
            self.heard, self.misses = True, 0
            self._notify()

    def _on_emergency(self, message: Any) -> None:
        if not message.code & 0xFF00:  # the error has been reset
            self.emergency = None
            return
        register = ", ".join(word for bit, word in enumerate(_REGISTER) if word and message.register & 1 << bit)
        self.emergency = error_text(message.code) + (f" (error register: {register})" if register else "")

    def _on_heartbeat(self, state: int) -> None:
        if state == 0:
            self.restarted = True
            self._notify()

    def _notify(self) -> None:
        with self._spoke:
            self._spoke.notify_all()
