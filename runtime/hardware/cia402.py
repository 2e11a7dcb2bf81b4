"""CiA 402 (IEC 61800-7-201), the profile of servo drives: objects, states, torque in per mille, errors in words.

Only what cyclic synchronous torque needs. Nothing here knows of a bus.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import Enum, IntEnum


@dataclass(frozen=True)
class Entry:
    """An entry of a drive's object dictionary; `form` as in `struct`."""

    index: int
    sub: int
    form: str
    name: str

    def pack(self, value: int) -> bytes:
        return struct.pack(f"<{self.form}", value)

    def unpack(self, data: bytes) -> int:
        """Some drives answer with more bytes than the entry has. Raises struct.error for fewer."""
        return int(struct.unpack_from(f"<{self.form}", data)[0])

    @property
    def mapping(self) -> int:
        """How a PDO's mapping (0x1600, 0x1A00) names it: index, subindex, bits."""
        return self.index << 16 | self.sub << 8 | 8 * struct.calcsize(f"<{self.form}")

    def __str__(self) -> str:
        return f"{self.name} (0x{self.index:04X}:{self.sub:02X})"


DEVICE_TYPE = Entry(0x1000, 0, "I", "device type")
PROFILE = 402
"""In the lower half of a drive's device type."""
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
"""Value of ON_LOST_HOST: a drive that misses its computer takes the voltage off the motor."""


# --- states ---


class DriveState(Enum):
    """Of a drive, in the standard's words."""

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
"""Bits of the statusword that tell the state, and what they are in it."""

POWERLESS = frozenset({DriveState.NOT_READY, DriveState.SWITCH_ON_DISABLED, DriveState.READY, DriveState.FAULT})
"""States in which the power stage is off: no torque, whatever was asked for."""
_LIMIT_BIT = 1 << 11


def state_of(statusword: int) -> DriveState:
    """What a statusword says."""
    return next((state for mask, bits, state in _STATES if statusword & mask == bits), DriveState.UNKNOWN)


def limited(statusword: int) -> bool:
    """Whether the drive holds back because of a limit of its own (of current, of heat)."""
    return bool(statusword & _LIMIT_BIT)


class Controlword(IntEnum):
    """Controlwords."""

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
    """The next controlword on the way to operation enabled; `before`: the one that was sent last.

    A fault is reset by a rising edge of its bit, so two words take turns. States that a drive leaves by itself, and
    a quick stop, are met with voltage off.
    """
    if state is DriveState.FAULT and before is not Controlword.FAULT_RESET:
        return Controlword.FAULT_RESET
    return _TOWARDS_ENABLED.get(state, Controlword.DISABLE_VOLTAGE)


# --- torque ---

_LARGEST = 32767
"""Per mille that the target torque's 16 bits hold; the motor's sign may turn, so to either side."""


@dataclass(frozen=True)
class Scale:
    """Between a joint's torque and a drive's target torque.

    gear_ratio     turns of the motor per turn (rad per m) of the joint
    direction      1, or −1 where the motor turns against the joint
    rated_torque   of the motor, N m: what 1000 per mille are
    max_torque     per mille that the drive lets through
    """

    gear_ratio: float
    direction: int
    rated_torque: float
    max_torque: int = _LARGEST

    @property
    def resolution(self) -> float:
        """N m (N) at the joint of one per mille: commands are rounded to it."""
        return self.gear_ratio * self.rated_torque / 1000.0

    @property
    def largest(self) -> float:
        """N m (N) at the joint that can be commanded."""
        return self.resolution * min(self.max_torque, _LARGEST)

    def per_mille(self, torque: float) -> int:
        """Target torque nearest to `torque` N m (N) at the joint, within what can be commanded.

        Raises ValueError where it is not finite.
        """
        if not abs(torque) < float("inf"):
            raise ValueError(f"a torque of {torque} cannot be commanded")
        most = min(self.max_torque, _LARGEST)
        # Clamped before it is rounded: the ratio may be larger than any integer of the drive.
        return self.direction * round(max(-most, min(most, torque / self.resolution)))

    def torque(self, per_mille: int) -> float:
        """N m (N) at the joint."""
        return self.direction * per_mille * self.resolution


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
    """An emergency's or the error code's (0x603F) number in words, the most specific that the standards have."""
    for mask in (0xFFFF, 0xFFF0, 0xFF00, 0xF000):
        if text := _ERRORS.get(code & mask):
            return f"0x{code:04X}, {text}"
    return f"0x{code:04X}"


def register_text(register: int) -> str:
    """The error register's bits in words."""
    return ", ".join(word for bit, word in enumerate(_REGISTER) if word and register & 1 << bit)
