"""An arm whose joints have CiA 402 drives on one CAN bus, driven in cyclic synchronous torque.

A control period is one SYNC (0x080): every drive answers with statusword (0x6041) and position (0x6064), and is then
sent controlword (0x6040) and target torque (0x6071). Torques are N m (N) at the joints everywhere but on the bus.

What stops the motors, whatever fails:
  the machine       takes the drives' power: zero torque, then voltage off
  a drive           leaves operation enabled, restarts, or misses MISSED answers: quick stop for all, then voltage off
  this computer     its heartbeat is sent from the control loop: without it the drives take the voltage off themselves
                    (0x1016, 0x6007) after HOST_LOST s
"""

from __future__ import annotations

import errno
import logging
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, Self
from urllib.parse import parse_qsl, unquote, urlsplit

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
from runtime.hardware.link import LinkError
from runtime.hardware.lockstep import Fault, Lockstep, Pace, Precedence
from runtime.model.loader import Model

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


Counts = NDArray[np.int32]

MISSED = 3
"""Answers in a row that a drive may miss at most; the periods until then keep its last position."""
SWITCHING = 3.0
"""s within which drives have to be switched on; brakes take their time."""
BRAKING = 0.1
"""s that a quick stop may take before the voltage is taken off."""
_OFF = 0.1
"""s within which drives have to say that they are off."""
_MEETING = 1.0
"""s within which every drive has to answer a SYNC for the first time."""
_ANSWERING = 0.6
"""Part of a period for answers; the rest is for the control step and the commands."""
_HOST_HEARTBEAT = 0.01  # s
_SYNC, _NMT, _HEARTBEAT = 0x080, 0x000, 0x700 + HOST_NODE
_PRE_OPERATIONAL, _OPERATIONAL = 0x80, 5
_BUS_OFF = 0x40
"""Of an error frame's identifier under SocketCAN."""


def check_arm(model: Model, address: CanAddress, rate: float) -> None:
    """What can be said before the bus is touched. rate: of the control step, Hz. Raises LinkError."""
    without = [str(i) for i, joint in enumerate(model.joints, 1) if joint.drive is None]
    if without:
        where = f'the model file of "{model.name}"'
        raise LinkError(f"{where} names no drive at joint {', '.join(without)}; add [joint.drive] with node")
    check_bus_load(model.n, rate, address)


class CanopenArm:
    """The joints of a model on a bus: opened when made, set up by `start`, silent and without power after `close`.

    pace       of the control periods; their length is that of the model's control step
    patience   s to wait for the answers to a SYNC; None: a part of the period
    Raises LinkError where it cannot be driven as it is, Fault when it no longer can.
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
        self._drives = [CanDrive(self._network, i, j, self._on_word) for i, j in enumerate(model.joints, 1)]
        self._sent = [Controlword.DISABLE_VOLTAGE] * model.n

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        self.close()

    # --- what a board does with an arm ---

    def start(self, q: ArrayLike, rng: np.random.Generator) -> Counts:  # noqa: ARG002 - it stands where it stands
        """The drives set up, without power yet. What their encoders count (n,)."""
        # One that has restarted has forgotten everything.
        if not self.scales or any(drive.restarted for drive in self._drives):
            with bus_faults(self.address):
                self.scales = tuple(drive.set_up(self.pace.length) for drive in self._drives)
                for drive in self._drives:
                    drive.operational()
        self._fault = None
        self._meet()
        return self.counts()

    def counts(self) -> Counts:
        """Begin a period: a SYNC and the answers to it."""
        with self._or_stop():
            self._exchange()
        self._check()
        return np.array([drive.counts for drive in self._drives], dtype=np.int32)

    def apply(self, torque: ArrayLike) -> None:
        """Torques (n,) N m (N), rounded to the drives' resolution and held; nothing while the drives are off."""
        with self._or_stop():
            if self._on:
                asked = [s.per_mille(float(t)) for s, t in zip(self.scales, np.asarray(torque), strict=True)]
                self._command(Controlword.ENABLE_OPERATION, asked)

    def enable(self, on: bool) -> None:
        """Switch the drives on, at zero torque, or off. Both take periods, in which nothing is controlled."""
        if on:
            with self.pace.left_out():
                self._switch_on()
        elif self._powered:
            with self.pace.left_out():
                self._on = False
                self._confirm(self._switch_off())

    def close(self) -> None:
        """Power off, and the bus given back; may be called twice. Raises Fault if a drive does not say it is off."""
        if self._network is None:
            return
        self._on = False
        try:
            still = self._switch_off() if self._powered else []
            with suppress(Fault), bus_faults(self.address):
                for drive in self._drives:
                    # One that may have power goes on watching: without a heartbeat it switches off by itself.
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
        """Whether some drive may have power: it has been told more than to be without, even on the way to being on."""
        return any(word is not Controlword.DISABLE_VOLTAGE for word in self._sent)

    def figures(self) -> dict[str, Any]:
        """What became of it, in SI: the bus, punctuality, and what a torque is rounded to."""
        kept = self.pace.kept
        return {
            "channel": self.address.channel,
            "bitrate": self.address.bitrate,
            "load": self.load,
            "late_rms": kept.rms,
            "late_worst": kept.worst,
            "overruns": kept.overruns,
            "missed_answers": self.missed,
            "resolution": [scale.resolution for scale in self.scales],
            "largest_torque": [scale.largest for scale in self.scales],
            "limited_by_drive": self.limited.tolist(),
        }

    def _meet(self) -> None:
        """SYNCs until every drive has answered one: until then it has told of no position."""
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
        """A SYNC, and what the drives say; who says nothing is counted."""
        with bus_faults(self.address):
            for drive in self._drives:
                drive.heard = False
            self._network.send_message(_SYNC, b"")
            self._beat()
            with self._heard:
                self._heard.wait_for(self._is_complete, self._patience)
        for k, drive in enumerate(self._drives):
            if not drive.heard:
                drive.misses += 1
                self.missed += 1
            self.limited[k] += self._on and limited(drive.answer.statusword)

    def _is_complete(self) -> bool:
        """Whether all have answered; nobody waits for a drive that is lost."""
        return all(drive.heard or drive.restarted or drive.misses >= MISSED for drive in self._drives)

    def _check(self) -> None:
        """Raise Fault, all drives stopped, if one can no longer be relied on."""
        if self._bus_off:
            self._fail(f"{self.address}: the bus is off; check wiring, termination and bit rate")
        for drive in self._drives:
            if drive.restarted:
                self._fail(f"{drive.name} has restarted by itself; look at its supply")
            if drive.misses >= MISSED:
                state = drive.network_state.lower()
                also = "" if state == "operational" else f"; its node is {state}"
                self._fail(f"{drive.name} has not answered {MISSED} times in a row{also}")
            if self._on and drive.answer.state is not DriveState.ENABLED:
                state = drive.answer.state.value
                self._fail(f'{drive.name} left "{DriveState.ENABLED.value}" for "{state}"', drive)

    def _command(self, word: Controlword, torques: Iterable[int]) -> None:
        with bus_faults(self.address):
            for k, (drive, torque) in enumerate(zip(self._drives, torques, strict=True)):
                drive.command(word, torque)
                self._sent[k] = word

    def _beat(self) -> None:
        """Drives begin to watch with the first heartbeat: none is sent before they have power."""
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
            if all(drive.answer.state is DriveState.ENABLED for drive in self._drives):
                self._on = True
                return
            with self._or_stop(), bus_faults(self.address):
                for k, drive in enumerate(self._drives):
                    self._sent[k] = towards_enabled(drive.answer.state, self._sent[k])
                    drive.command(self._sent[k])
        drive = next(drive for drive in self._drives if drive.answer.state is not DriveState.ENABLED)
        state = drive.answer.state.value
        self._fail(f'{drive.name} could not be switched on within {SWITCHING:g} s: it is in "{state}"', drive)

    def _switch_off(self) -> list[CanDrive]:
        """Zero torque, then voltage off. The drives that did not say that they are off."""
        return self._until(Controlword.DISABLE_VOLTAGE, _OFF, lambda drive: drive.answer.state in POWERLESS)

    def _quick_stop(self) -> list[CanDrive]:
        """Braking by the drives as they are set up to (0x605A), then voltage off. Who is not off after it."""
        self._until(
            Controlword.QUICK_STOP,
            BRAKING,
            lambda drive: drive.answer.state not in (DriveState.ENABLED, DriveState.QUICK_STOP),
        )
        return self._switch_off()

    def _until(self, word: Controlword, seconds: float, done: Callable[[CanDrive], bool]) -> list[CanDrive]:
        """This word and zero torque, until all drives are done or the time is over; those that are not."""
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
        """Nothing is done any more after a fault; what fails inside stops all drives."""
        if self._fault is not None:
            raise Fault(self._fault)
        try:
            yield
        except (Fault, ValueError) as error:
            self._fail(str(error))

    def _fail(self, what: str, drive: CanDrive | None = None) -> NoReturn:
        """Stop all drives, and say why; `drive`: the one that knows more."""
        self._on = False
        still = self._quick_stop()
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

    def _on_word(self) -> None:
        with self._heard:
            self._heard.notify_all()

    def _on_error_frame(self, message: Any) -> None:
        if message.is_error_frame and message.arbitration_id & _BUS_OFF:
            self._bus_off = True


def _not_off(drives: list[CanDrive]) -> str:
    return (
        f"{' and '.join(drive.name for drive in drives)} did not confirm to be off; "
        f"without this computer's heartbeat the voltage goes off after {HOST_LOST:g} s"
    )


LATE = 0.01
"""s between two control steps at most. A computer is less punctual than a microcontroller's timer: what stops that
after half a period would stop this for nothing."""


def check_link(url: str, model: Model) -> None:
    """What can be said of an address before the bus is touched. Raises LinkError."""
    address = parse_can_address(url)
    # Without a rate there is nothing to say of the load; what a controller lacks is named where its settings are made.
    if model.controller is not None:
        check_arm(model, address, model.controller["rate"])


class CanopenLink(Lockstep):
    """A Link to the drives of a model, set up and without power yet.

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

    def figures(self) -> Mapping[str, Any]:
        return {"drives": {**self.arm.figures(), "real_time": self._precedence.granted}}

    def close(self) -> None:
        try:
            with self._open:
                super().close()
        except Fault as fault:
            # What was recorded is kept all the same.
            self.fault = self.fault or str(fault)
