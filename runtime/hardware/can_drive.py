"""A CAN bus as `--on canopen://…` names it: its address, how much fits through it, opening it."""

from __future__ import annotations

import errno
import logging
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, NoReturn
from urllib.parse import parse_qsl, unquote, urlsplit

from runtime.hardware import cia402
from runtime.hardware.cia402 import Controlword, DriveState, Entry, Scale
from runtime.hardware.link import LinkError
from runtime.hardware.lockstep import Fault
from runtime.model.loader import JointInfo

CAN_SCHEME = "canopen"
CAN_EXAMPLE = "canopen://can0?interface=socketcan&bitrate=1000000"
BITRATE, BITRATES = 1_000_000, (10_000, 1_000_000)
"""bit/s: if none is given, and what classical CAN allows."""
LOAD_LIMIT = 0.8
"""Largest part of the time that cyclic frames may fill; the rest is for emergencies, heartbeats and repetitions."""
_SENT, _ANSWERED = 4, 6
"""Bytes a period and drive: controlword and target torque; statusword and position."""


@dataclass(frozen=True)
class CanAddress:
    """channel and interface as python-can names them; bitrate in bit/s."""

    channel: str
    interface: str = "socketcan"
    bitrate: int = BITRATE

    def __str__(self) -> str:
        return f"{CAN_SCHEME}://{self.channel}"


def parse_can_address(text: str) -> CanAddress:
    """The address in `canopen://CHANNEL?interface=NAME&bitrate=NUMBER`. Raises LinkError."""
    try:
        parts = urlsplit(text)
    except ValueError as error:  # brackets that are not closed
        raise LinkError(f"--on {text}: {error}; expected {CAN_EXAMPLE}") from None
    channel = unquote(parts.netloc + parts.path)
    given = dict(parse_qsl(parts.query, keep_blank_values=True))
    if parts.scheme != CAN_SCHEME or not channel:
        raise LinkError(f"--on {text}: expected {CAN_EXAMPLE}")
    if unknown := sorted(given.keys() - {"interface", "bitrate"}):
        raise LinkError(f'--on {text}: unknown key "{unknown[0]}"; expected interface and bitrate: {CAN_EXAMPLE}')
    rate = given.get("bitrate", str(BITRATE))
    low, high = BITRATES
    if not (rate.isascii() and rate.isdigit() and len(rate) < 10 and low <= int(rate) <= high):
        raise LinkError(f"--on {text}: bitrate is {rate}; expected {low} to {high} bit/s")
    return CanAddress(channel, given.get("interface", CanAddress.interface), int(rate))


# --- how much fits through it ---


def frame_bits(data: int) -> int:
    """Bits of a frame with so many bytes at its longest: as many stuff bits as there can be, and the gap after it."""
    return 47 + 8 * data + (34 + 8 * data - 1) // 4


def period_bits(drives: int) -> int:
    """Bits of all frames of a control period: SYNC, an answer and a command a drive."""
    return frame_bits(0) + drives * (frame_bits(_SENT) + frame_bits(_ANSWERED))


def bus_load(drives: int, rate: float, bitrate: int) -> float:
    """The part of the time that the frames of `drives` at `rate` Hz fill at worst."""
    return period_bits(drives) * rate / bitrate


def check_bus_load(drives: int, rate: float, address: CanAddress) -> None:
    """Raise LinkError where a control step at `rate` Hz does not fit, with the rate that does."""
    part = bus_load(drives, rate, address.bitrate)
    if part <= LOAD_LIMIT:
        return
    feasible = LOAD_LIMIT * address.bitrate / period_bits(drives)
    whole = feasible // 10 * 10 if feasible >= 10 else feasible
    raise LinkError(
        f"{address}: {drives} drives at {rate:g} Hz fill {part:.1%} of a bus of {address.bitrate / 1e6:g} Mbit/s, "
        f"over {LOAD_LIMIT:.0%}; set rate in [controller] to at most {whole:.4g} Hz, or drive the joints from a board"
    )


# --- opening it ---


def open_network(address: CanAddress, listen: Callable[[Any], None]) -> Any:
    """A connected canopen.Network; `listen` hears every frame. Raises LinkError with what to do about it."""
    try:
        import can
        import canopen
    except ModuleNotFoundError as error:
        raise LinkError(
            f'{address}: {error.name} is not installed; python -m pip install "canopen>=2.3" "python-can>=4.4"'
        ) from None
    for name in ("can", "canopen"):
        # What matters of their remarks is raised, and said once.
        logging.getLogger(name).addHandler(logging.NullHandler())
    network: Any = canopen.Network()
    network.listeners.append(listen)
    # It looks this often whether it is to end; nothing else depends on it.
    network.NOTIFIER_CYCLE = 0.1
    try:
        return network.connect(channel=address.channel, interface=address.interface, bitrate=address.bitrate)
    except can.CanInterfaceNotImplementedError as error:
        raise LinkError(f"{address}: interface {address.interface} cannot be used here: {error}") from None
    except (can.CanError, OSError, ValueError, TypeError) as error:
        raise LinkError(_open_failure(address, error)) from None


def _open_failure(address: CanAddress, error: Exception) -> str:
    code = getattr(error, "errno", None)
    if code == errno.ENODEV:
        return (
            f"{address}: there is no such CAN channel; ip link shows those that are there, and "
            f"ip link set {address.channel} up type can bitrate {address.bitrate} switches one on"
        )
    if code == errno.EAFNOSUPPORT:
        return f"{address}: this system has no SocketCAN; load it (modprobe can_raw) or name another interface"
    return f"{address}: cannot be opened through {address.interface}: {error}"


@contextmanager
def bus_faults(address: CanAddress) -> Iterator[None]:
    """What goes wrong on a bus in use, as a Fault for people."""
    import can

    try:
        yield
    except (can.CanError, OSError) as error:
        raise Fault(f"{address}: {_bus_failure(error)}") from None


def _bus_failure(error: Exception) -> str:
    code = getattr(error, "error_code", None) or getattr(error, "errno", None)
    if code == errno.ENETDOWN:
        return "the channel is down, or the bus off; check wiring, termination and bit rate, then switch it on again"
    if code == errno.ENOBUFS:
        return "nothing that is sent is acknowledged; check that the drives have power and the bus its terminators"
    return f"the bus cannot be used any more: {error}"


HOST_NODE = 127
"""Node id of the computer: whose heartbeat the drives watch."""
HOST_LOST = 0.1
"""s without the computer's heartbeat after which a drive takes the voltage off by itself."""
DRIVE_HEARTBEAT = 0.1
"""s between the drives' own heartbeats: they tell why a drive no longer answers."""
_SDO_TIMEOUT = 1.0  # s
_TRIES = 20
"""Readings of the mode until a drive has changed to it."""
_PDO_OFF = 1 << 31
_EVERY_SYNC, _AT_ONCE = 1, 255
"""Transmission types of a PDO."""
_ANSWER, _COMMAND = struct.Struct("<Hi"), struct.Struct("<Hh")

_HOST_HEARTBEAT = Entry(0x1016, 1, "I", "consumer heartbeat time")
_HEARTBEAT = Entry(0x1017, 0, "H", "producer heartbeat time")


@dataclass
class Answer:
    """What a drive said last."""

    statusword: int = 0
    position: int = 0

    @property
    def state(self) -> DriveState:
        return cia402.state_of(self.statusword)


class CanDrive:
    """The drive of a joint (1-based) in a connected canopen.Network.

    spoke    called, by the network's thread, after an answer to a SYNC or a restart
    heard    whether it has answered the last one
    misses   how many in a row it had not answered when that was waited for; a late answer ends the row
    """

    def __init__(self, network: Any, joint: int, info: JointInfo, spoke: Callable[[], None]) -> None:
        import canopen

        assert info.drive is not None
        self.joint, self.info, self._keys = joint, info, info.drive
        self.node = info.drive.node
        self.name = f"joint {joint}: the drive (node {self.node})"
        self.answer = Answer()
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
        """Check that it is the drive of this joint, and make it ready for a control period of so many s.

        Raises LinkError.
        """
        self._remote.nmt.state = "PRE-OPERATIONAL"
        self._check_kind()
        self._check_counts()
        scale = self._scale()
        self._map()
        self._write(cia402.ON_LOST_HOST, cia402.DISABLE_VOLTAGE_THEN, self._unwatched)
        self._write(_HOST_HEARTBEAT, HOST_NODE << 16 | round(1e3 * HOST_LOST), self._unwatched)
        self._write(_HEARTBEAT, round(1e3 * DRIVE_HEARTBEAT))
        self._write(cia402.TARGET_TORQUE, 0)
        self._set_period(period)
        self._set_mode()
        self.restarted, self.emergency = False, None
        return scale

    def operational(self) -> None:
        """Begin to answer SYNCs."""
        self._remote.nmt.state = "OPERATIONAL"

    def release(self) -> None:
        """Watch for this computer no longer: it goes without a fault."""
        with suppress(LinkError):
            self._write(_HOST_HEARTBEAT, 0)

    def error(self) -> str:
        """Why it failed, in words: its emergency message, or its error code, asked for."""
        if self.emergency is not None:
            return self.emergency
        code = self._optional(cia402.ERROR_CODE)
        return cia402.error_text(code) if code else "it does not say why"

    @property
    def network_state(self) -> str:
        """Of the node, as its heartbeat or boot-up message said last: OPERATIONAL, STOPPED..."""
        return str(self._remote.nmt.state)

    def _check_kind(self) -> None:
        kind = self._read(cia402.DEVICE_TYPE)
        if kind & 0xFFFF != cia402.PROFILE:
            self._refuse(f"is of profile {kind & 0xFFFF}; expected a servo drive of CiA {cia402.PROFILE}")
        if not self._read(cia402.SUPPORTED_MODES) & cia402.CYCLIC_TORQUE_BIT:
            self._refuse(f"has no cyclic synchronous torque mode ({cia402.SUPPORTED_MODES}); update its firmware")

    def _check_counts(self) -> None:
        """A drive that counts otherwise than the model file would move the joint by another angle."""
        found, turns = self._read(cia402.ENCODER_INCREMENTS), self._read(cia402.ENCODER_TURNS)
        if found != (self.info.encoder_counts or 0) * turns:
            each = f"{found / turns:g}" if turns else "no"
            self._refuse(
                f"has {each} counts per turn of the motor ({cia402.ENCODER_INCREMENTS}), "
                f"the model file {self.info.encoder_counts}; correct [joint.encoder] counts or the drive"
            )
        motor, shaft = self._optional(cia402.GEAR_MOTOR), self._optional(cia402.GEAR_SHAFT)
        if motor != shaft:
            self._refuse(
                f"divides positions by a gear ratio of {motor}:{shaft} itself ({cia402.GEAR_MOTOR}); "
                "expected counts of the motor: set it to 1:1, gear_ratio is in the model file"
            )

    def _scale(self) -> Scale:
        rated = self._keys.rated_torque
        if rated is None:
            rated = self._read(cia402.RATED_TORQUE) / 1e3  # it says mN m
        if not rated > 0:
            self._refuse(f"gives {cia402.RATED_TORQUE} as 0; set it, or rated_torque under [joint.drive]")
        scale = Scale(self.info.gear_ratio, self._keys.direction, rated, self._read(cia402.MAX_TORQUE))
        limit, unit = self.info.torque_limit, self.info.force_unit
        # A limit between two steps of the command is still the limit.
        if limit is not None and limit > scale.largest + scale.resolution:
            self._refuse(
                f"lets {scale.largest:.4g} {unit} through ({cia402.MAX_TORQUE}: {scale.max_torque} per mille of "
                f"{rated:g} N m), less than the joint's limit of {limit:g} {unit}; lower [joint.limits] torque"
            )
        return scale

    def _map(self) -> None:
        """The PDOs: a mapping can be written only while its PDO is off."""
        for number in (2, 3, 4):
            if self._optional(Entry(0x1800 + number - 1, 1, "I", f"TPDO {number}")) is not None:
                self._write(Entry(0x1800 + number - 1, 1, "I", f"TPDO {number}"), _PDO_OFF)
        answer, command = (cia402.STATUSWORD, cia402.POSITION), (cia402.CONTROLWORD, cia402.TARGET_TORQUE)
        self._map_one("TPDO 1", 0x1800, 0x1A00, 0x180, _EVERY_SYNC, answer)
        self._map_one("RPDO 1", 0x1400, 0x1600, 0x200, _AT_ONCE, command)

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
        """Of the SYNCs, where the drive wants to know and can be told: value * 10^exponent s."""
        if self._optional(cia402.PERIOD) is None:
            return
        for exponent in (-3, -4, -5, -6):
            value = round(period / 10.0**exponent)
            if 1 <= value <= 255 and abs(value * 10.0**exponent - period) < 1e-9:
                self._write(cia402.PERIOD, value)
                self._write(cia402.PERIOD_EXPONENT, exponent)
                return

    def _set_mode(self) -> None:
        self._write(cia402.MODE, cia402.CYCLIC_TORQUE)
        for _ in range(_TRIES):
            if (mode := self._read(cia402.MODE_DISPLAY)) == cia402.CYCLIC_TORQUE:
                return
        self._refuse(f"stays in mode {mode} ({cia402.MODE_DISPLAY}); expected {cia402.CYCLIC_TORQUE}")

    _unwatched = "then it would hold its last torque if this computer stopped; it cannot be driven from here"

    def _read(self, entry: Entry) -> int:
        return self._talk(entry, "read", lambda: entry.unpack(self._remote.sdo.upload(entry.index, entry.sub)))

    def _write(self, entry: Entry, value: int, otherwise: str = "see its manual") -> None:
        def send() -> int:
            self._remote.sdo.download(entry.index, entry.sub, entry.pack(value))
            return value

        self._talk(entry, f"set to {value}", send, otherwise)

    def _talk(self, entry: Entry, what: str, do: Callable[[], int], otherwise: str = "see its manual") -> int:
        """`do`, with every failure as a LinkError."""
        import canopen

        try:
            return do()
        except canopen.SdoAbortedError as error:
            why = canopen.SdoAbortedError.CODES.get(error.code, f"abort code 0x{error.code:08X}")
            self._refuse(f"does not let {entry} be {what} ({why}); {otherwise}")
        except canopen.SdoCommunicationError:
            self._refuse("does not answer; is it on, its node id and its bit rate right?")
        except struct.error:
            self._refuse(f"answers {entry} with too few bytes; {otherwise}")

    def _optional(self, entry: Entry) -> int | None:
        """None where the drive has no such entry."""
        import canopen

        try:
            return entry.unpack(self._remote.sdo.upload(entry.index, entry.sub))
        except (canopen.SdoAbortedError, canopen.SdoCommunicationError, struct.error):
            return None

    def _refuse(self, what: str) -> NoReturn:
        raise LinkError(f"{self.name} {what}")

    # --- a period, by PDO ---

    @property
    def counts(self) -> int:
        """Of the encoder, in the joint's direction. The register wraps; so does its negative."""
        return (self._keys.direction * self.answer.position + 2**31) % 2**32 - 2**31

    def command(self, word: Controlword, torque: int = 0) -> None:
        """torque in per mille of the rated one."""
        self._network.send_message(0x200 + self.node, _COMMAND.pack(word, torque))

    def _on_answer(self, _id: int, data: bytearray, _time: float) -> None:
        if len(data) == _ANSWER.size:
            self.answer = Answer(*_ANSWER.unpack(data))
            self.heard, self.misses = True, 0
            self._spoke()

    def _on_emergency(self, message: Any) -> None:
        if not message.code & 0xFF00:  # what was wrong is over
            self.emergency = None
            return
        register = cia402.register_text(message.register)
        self.emergency = cia402.error_text(message.code) + (f" (error register: {register})" if register else "")

    def _on_heartbeat(self, state: int) -> None:
        if state == 0:
            self.restarted = True
            self._spoke()
