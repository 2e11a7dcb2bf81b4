"""An arm whose joints have CiA 402 drives on one CAN bus, driven in cyclic synchronous torque.

A control period is one SYNC (0x080): every drive answers with statusword (0x6041) and position (0x6064), and is then
sent controlword (0x6040) and target torque (0x6071). Torques are N m (N) at the joints everywhere but on the bus.

What stops the motors:
  the firmware's machine switches the drives off   zero torque, then voltage off
  a drive leaves operation enabled, restarts, or misses MISSED answers   quick stop for all, then voltage off
  this computer fails   the control loop sends its heartbeat; without it the drives switch off after HOST_LOST s
                        (0x1016, 0x6007)
"""

from __future__ import annotations

import errno
import logging
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.documents.plans import DrivesEntry
from runtime.hardware.boards import HostBoard
from runtime.hardware.can_drive import (
    HOST_LOST,
    HOST_NODE,
    POWERLESS,
    CanDrive,
    Controlword,
    DriveState,
    Scale,
    limited,
    towards_enabled,
)
from runtime.hardware.link import LinkError, parse_address
from runtime.hardware.lockstep import Fault, Lockstep, Pace, Precedence
from runtime.model.loader import Model

CAN_SCHEME = "canopen"
CAN_EXAMPLE = "canopen://can0?interface=socketcan&bitrate=1000000"
BITRATE, BITRATES = 1_000_000, (10_000, 1_000_000)
"""bit/s: the default, and the range of classical CAN."""
LOAD_LIMIT = 0.8
"""Largest bus load by cyclic frames; the rest is for emergencies, heartbeats and repeated frames."""
_SENT, _ANSWERED = 4, 6
"""Bytes per period and drive: controlword and target torque; statusword and position."""


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
    defaults = {"interface": CanAddress.interface, "bitrate": str(BITRATE)}
    channel, keys = parse_address(text, CAN_SCHEME, defaults, CAN_EXAMPLE)
    rate, (low, high) = keys["bitrate"], BITRATES
    if not (rate.isascii() and rate.isdigit() and len(rate) < 10 and low <= int(rate) <= high):
        raise LinkError(f"--on {text}: bitrate is {rate}; expected {low} to {high} bit/s")
    return CanAddress(channel, keys["interface"], int(rate))


# --- bus load ---


def frame_bits(data: int) -> int:
    """Largest number of bits of a frame with so many bytes, with all stuff bits and the gap after it."""
    return 47 + 8 * data + (34 + 8 * data - 1) // 4


def bus_load(drives: int, rate: float, bitrate: int) -> float:
    """Largest bus load of `drives` at `rate` Hz, as a part of the bit rate.

    A control period has a SYNC, and an answer and a command for each drive.
    """
    return (frame_bits(0) + drives * (frame_bits(_SENT) + frame_bits(_ANSWERED))) * rate / bitrate


def check_bus_load(drives: int, rate: float, address: CanAddress) -> None:
    """Raises LinkError if control steps at `rate` Hz exceed LOAD_LIMIT, with the rate that fits."""
    part = bus_load(drives, rate, address.bitrate)
    if part <= LOAD_LIMIT:
        return
    feasible = LOAD_LIMIT / bus_load(drives, 1.0, address.bitrate)
    whole = feasible // 10 * 10 if feasible >= 10 else feasible
    raise LinkError(
        f"{address}: {drives} drives at {rate:g} Hz fill {part:.1%} of a bus of {address.bitrate / 1e6:g} Mbit/s, "
        f"over {LOAD_LIMIT:.0%}; set rate in [controller] to at most {whole:.4g} Hz, or drive the joints from a board"
    )


# --- opening the bus ---


def open_network(address: CanAddress, listen: Callable[[Any], None]) -> Any:
    """A connected canopen.Network. listen: called with every frame. Raises LinkError."""
    try:
        import can
        import canopen
    except ModuleNotFoundError as error:
        raise LinkError(
            f'{address}: {error.name} is not installed; python -m pip install "canopen>=2.3" "python-can>=4.4"'
        ) from None
    for name in ("can", "canopen"):
        # Their warnings repeat what is raised here.
        logging.getLogger(name).addHandler(logging.NullHandler())
    network: Any = canopen.Network()
    network.listeners.append(listen)
    # How often, in s, its thread checks whether to end.
    network.NOTIFIER_CYCLE = 0.1
    try:
        return network.connect(channel=address.channel, interface=address.interface, bitrate=address.bitrate)
    except can.CanInterfaceNotImplementedError as error:
        raise LinkError(f"{address}: interface {address.interface} cannot be used here: {error}") from None
    except (can.CanError, OSError, ValueError, TypeError) as error:
        known = {
            errno.ENODEV: "there is no such CAN channel; list the channels with ip link, and switch one on with "
            f"ip link set {address.channel} up type can bitrate {address.bitrate}",
            errno.EAFNOSUPPORT: "this system has no SocketCAN; load it (modprobe can_raw) or name another interface",
        }
        why = known.get(getattr(error, "errno", 0), f"cannot be opened through {address.interface}: {error}")
        raise LinkError(f"{address}: {why}") from None


_BUS_FAILURES = {
    errno.ENETDOWN: "the channel is down or the bus is off; check wiring, termination and bit rate, then switch it on "
    "again",
    errno.ENOBUFS: "no frame is acknowledged; check the drives' power and the bus termination",
}


@contextmanager
def bus_faults(address: CanAddress) -> Iterator[None]:
    """Turns errors of a bus in use into Fault."""
    import can

    try:
        yield
    except (can.CanError, OSError) as error:
        code = getattr(error, "error_code", 0) or getattr(error, "errno", 0)
        why = _BUS_FAILURES.get(code, f"the bus cannot be used any more: {error}")
        raise Fault(f"{address}: {why}") from None


Counts = NDArray[np.int32]

MISSED = 3
"""Number of answers in a row that a drive may miss; until then its last position is used."""
SWITCHING = 3.0
"""Time in s for switching the drives on; brakes take long to open."""
BRAKING = 0.1
"""Time in s for a quick stop before the voltage is switched off."""
_OFF = 0.1
"""Time in s within which the drives must report that they are off."""
_MEETING = 1.0
"""Time in s within which every drive must answer a first SYNC."""
_ANSWERING = 0.6
"""Part of a period in which answers must arrive; the rest is for the control step and the commands."""
_HOST_HEARTBEAT = 0.01  # s
_SYNC, _NMT, _HEARTBEAT = 0x080, 0x000, 0x700 + HOST_NODE
_PRE_OPERATIONAL, _OPERATIONAL = 0x80, 5
_BUS_OFF = 0x40
"""Bit of an error frame's identifier under SocketCAN."""


def check_arm(model: Model, address: CanAddress, rate: float) -> None:
    """Checks a model and an address before the bus is opened. rate: of the control step, Hz. Raises LinkError."""
    without = [str(i) for i, joint in enumerate(model.joints, 1) if joint.drive is None or joint.drive.node is None]
    if without:
        where = f'the model file of "{model.name}"'
        raise LinkError(f"{where} names no drive at joint {', '.join(without)}; add [joint.drive] with node")
    check_bus_load(model.n, rate, address)


class CanopenArm:
    """The drives of a model's joints on a bus: opened by the constructor, configured by `start`, off after `close`.

    pace       clock of the control periods
    patience   time in s to wait for the answers to a SYNC; None: a part of the period
    Raises LinkError if the arm cannot be driven, Fault when it fails.
    """

    def __init__(self, model: Model, address: CanAddress, pace: Pace, patience: float | None = None) -> None:
        check_arm(model, address, 1.0 / pace.length)
        self.address, self.model, self.pace = address, model, pace
        self.load = bus_load(model.n, 1.0 / pace.length, address.bitrate)
        self.scales: tuple[Scale, ...] = ()
        self.missed = 0
        self.limited = np.zeros(model.n, dtype=np.int64)
        self._patience = _ANSWERING * pace.length if patience is None else patience
        self._heard = threading.Condition()
        self._on, self._bus_off = False, False
        self._beats: int | None = None
        self._fault: str | None = None
        self._network: Any = open_network(address, self._on_error_frame)
        self._drives = [CanDrive(self._network, i, j, self._heard) for i, j in enumerate(model.joints, 1)]
        self._sent = [Controlword.DISABLE_VOLTAGE] * model.n

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        self.close()

    # --- SteppedArm ---

    def start(self, q: ArrayLike, rng: np.random.Generator) -> Counts:  # noqa: ARG002 - a real arm cannot be placed
        """Configures the drives, still without power; their encoder counts (n,)."""
        # A drive that has restarted has lost its configuration.
        if not self.scales or any(drive.restarted for drive in self._drives):
            with bus_faults(self.address):
                self.scales = tuple(drive.set_up(self.pace.length) for drive in self._drives)
                for drive in self._drives:
                    drive.operational()
        self._fault = None
        self._meet()
        return self.counts()

    def counts(self) -> Counts:
        """Begins a period with a SYNC; the counts (n,) in the answers."""
        with self._or_stop():
            self._exchange()
        self._check()
        return np.array([drive.counts for drive in self._drives], dtype=np.int32)

    def apply(self, torque: ArrayLike) -> None:
        """Commands torques (n,) N m or N, rounded to the drives' resolution; nothing while the drives are off."""
        with self._or_stop():
            if self._on:
                asked = [s.per_mille(float(t)) for s, t in zip(self.scales, np.asarray(torque), strict=True)]
                self._command(Controlword.ENABLE_OPERATION, asked)

    def enable(self, on: bool) -> None:
        """Switches the drives on at zero torque, or off. Both take several periods, in which nothing is controlled."""
        if on:
            with self.pace.left_out():
                self._switch_on()
        elif self._powered:
            with self.pace.left_out():
                self._on = False
                self._confirm(self._switch_off())

    def close(self) -> None:
        """Switches off and closes the bus; may be called twice. Raises Fault if a drive stays on."""
        if self._network is None:
            return
        self._on = False
        try:
            still = self._switch_off() if self._powered else []
            with suppress(Fault), bus_faults(self.address):
                for drive in self._drives:
                    # A drive that may have power keeps watching, and switches off without the heartbeat.
                    if drive.heard and drive not in still:
                        drive.release()
                self._network.send_message(_NMT, bytes((_PRE_OPERATIONAL, 0)))
        finally:
            network, self._network = self._network, None
            with suppress(Fault), bus_faults(self.address):
                network.disconnect()
        self._confirm(still)

    @property
    def _powered(self) -> bool:
        return any(word is not Controlword.DISABLE_VOLTAGE for word in self._sent)

    def figures(self, real_time: bool) -> DrivesEntry:
        """Statistics. real_time: whether this process has real-time priority."""
        kept = self.pace.kept
        return DrivesEntry(
            channel=self.address.channel,
            bitrate=self.address.bitrate,
            load=self.load,
            late_rms=kept.rms,
            late_worst=kept.worst,
            overruns=kept.overruns,
            missed_answers=self.missed,
            resolution=[scale.resolution for scale in self.scales],
            largest_torque=[scale.largest for scale in self.scales],
            limited_by_drive=self.limited.tolist(),
            real_time=real_time,
        )

    def _meet(self) -> None:
        """Sends SYNCs until every drive has answered one and its position is known."""
        for _ in range(self._periods(_MEETING)):
            for drive in self._drives:
                drive.misses = 0
            self.pace.period()
            self._exchange()
            if all(drive.heard for drive in self._drives):
                return
        silent = next(drive for drive in self._drives if not drive.heard)
        self._fail(f"{silent.name} answers no SYNC")

    # --- a period ---

    def _exchange(self) -> None:
        """Sends a SYNC, waits for the answers, and counts the missing ones."""
        with bus_faults(self.address):
            for drive in self._drives:
                drive.heard = False
            self._network.send_message(_SYNC, b"")
            self._beat()
            with self._heard:
                # Drives that are lost are not waited for.
                self._heard.wait_for(
                    lambda: all(d.heard or d.restarted or d.misses >= MISSED for d in self._drives), self._patience
                )
        for k, drive in enumerate(self._drives):
            if not drive.heard:
                drive.misses += 1
                self.missed += 1
            self.limited[k] += self._on and limited(drive.statusword)

    def _check(self) -> None:
        """Stops all drives and raises Fault if one has failed."""
        if self._bus_off:
            self._fail(f"{self.address}: the bus is off; check wiring, termination and bit rate")
        for drive in self._drives:
            if drive.restarted:
                self._fail(f"{drive.name} has restarted by itself; check its supply")
            if drive.misses >= MISSED:
                state = drive.network_state.lower()
                also = "" if state == "operational" else f"; its node is {state}"
                self._fail(f"{drive.name} has not answered {MISSED} times in a row{also}")
            if self._on and drive.state is not DriveState.ENABLED:
                state = drive.state.value
                self._fail(f'{drive.name} left "{DriveState.ENABLED.value}" for "{state}"', drive)

    def _command(self, word: Controlword, torques: Iterable[int]) -> None:
        with bus_faults(self.address):
            for k, (drive, torque) in enumerate(zip(self._drives, torques, strict=True)):
                drive.command(word, torque)
                self._sent[k] = word

    def _beat(self) -> None:
        """Sends the computer's heartbeat when it is due; the first one, before power, starts the drives' watch."""
        if self._beats is None:
            return
        every = max(1, round(_HOST_HEARTBEAT / self.pace.length))
        if self._beats % every == 0:
            self._network.send_message(_HEARTBEAT, bytes((_OPERATIONAL,)))
        self._beats += 1

    # --- on and off ---

    def _switch_on(self) -> None:
        self._beats = self._beats or 0
        for drive in self._drives:
            drive.emergency = None
        for _ in range(self._periods(SWITCHING)):
            self.pace.period()
            self.counts()
            if all(drive.state is DriveState.ENABLED for drive in self._drives):
                self._on = True
                return
            with self._or_stop(), bus_faults(self.address):
                for k, drive in enumerate(self._drives):
                    self._sent[k] = towards_enabled(drive.state, self._sent[k])
                    drive.command(self._sent[k])
        drive = next(drive for drive in self._drives if drive.state is not DriveState.ENABLED)
        state = drive.state.value
        self._fail(f'{drive.name} could not be switched on within {SWITCHING:g} s: it is in "{state}"', drive)

    def _switch_off(self) -> list[CanDrive]:
        return self._until(Controlword.DISABLE_VOLTAGE, _OFF, lambda drive: drive.state in POWERLESS)

    def _until(self, word: Controlword, seconds: float, done: Callable[[CanDrive], bool]) -> list[CanDrive]:
        """Sends a word and zero torque until all drives are done or time is over; the drives that are not done."""
        left = list(self._drives)
        with suppress(Fault):
            for _ in range(self._periods(seconds)):
                self._command(word, [0] * len(self._drives))
                self.pace.period()
                self._exchange()
                left = [drive for drive in self._drives if drive.misses or not done(drive)]
                if all(drive.misses >= MISSED for drive in left):
                    break
        return left

    @contextmanager
    def _or_stop(self) -> Iterator[None]:
        """After a fault, raises it again; an error inside stops all drives."""
        if self._fault is not None:
            raise Fault(self._fault)
        try:
            yield
        except (Fault, ValueError) as error:
            self._fail(str(error))

    def _fail(self, what: str, drive: CanDrive | None = None) -> NoReturn:
        """Stops all drives and raises Fault. drive: the one whose error is reported with it."""
        self._on = False
        braking = (DriveState.ENABLED, DriveState.QUICK_STOP)
        # As configured in the drives (0x605A).
        self._until(Controlword.QUICK_STOP, BRAKING, lambda drive: drive.state not in braking)
        still = self._switch_off()
        why = "" if drive is None else f": {drive.error()}"
        self._fault = f"{what}{why}" + (f"; {_not_off(still)}" if still else "")
        raise Fault(self._fault)

    def _confirm(self, still: list[CanDrive]) -> None:
        if still:
            self._fault = _not_off(still)
            raise Fault(self._fault)

    def _periods(self, seconds: float) -> int:
        return max(2, round(seconds / self.pace.length))

    # --- called by the network's thread ---

    def _on_error_frame(self, message: Any) -> None:
        if message.is_error_frame and message.arbitration_id & _BUS_OFF:
            self._bus_off = True


def _not_off(drives: list[CanDrive]) -> str:
    return (
        f"{' and '.join(drive.name for drive in drives)} did not report to be off; "
        f"without this computer's heartbeat they switch off after {HOST_LOST:g} s"
    )


LATE = 0.01
"""Longest time in s between two control steps. A computer is less punctual than a microcontroller's timer, whose
limit of half a period would stop it without need."""


def check_link(url: str, model: Model) -> None:
    """Checks an address and a model before the bus is opened. Raises LinkError."""
    address = parse_can_address(url)
    # Without a controller, Settings.of reports what is missing.
    if model.controller is not None:
        check_arm(model, address, model.controller["rate"])


class CanopenLink(Lockstep):
    """A BoardLink to the drives of a model, configured and still without power.

    url         canopen://CHANNEL?interface=NAME&bitrate=NUMBER
    directory   of the arm's firmware, built for this computer
    pace, patience   see CanopenArm; None: real time
    Raises LinkError, Fault.
    """

    arm: CanopenArm

    def __init__(
        self, url: str, model: Model, directory: Path, pace: Pace | None = None, patience: float | None = None
    ) -> None:
        assert model.controller is not None
        period = 1.0 / model.controller["rate"]
        pace = pace or Pace(period)
        address = parse_can_address(url)
        with ExitStack() as stack:
            self._precedence = Precedence()
            stack.callback(self._precedence.give_up)
            arm = stack.enter_context(CanopenArm(model, address, pace, patience))
            super().__init__(HostBoard(directory, model.name, model.n), arm, period, pace)
            self.late = LATE
            self.start(np.zeros(model.n), np.random.default_rng(0))
            self._open = stack.pop_all()

    def figures(self) -> DrivesEntry:
        return self.arm.figures(self._precedence.granted)

    def close(self) -> None:
        try:
            with self._open:
                super().close()
        except Fault as fault:
            # The recording is kept.
            self.fault = self.fault or str(fault)
