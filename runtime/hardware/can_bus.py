"""A CAN bus as `--on canopen://…` names it: its address, how much fits through it, opening it."""

from __future__ import annotations

import errno
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl, unquote, urlsplit

from runtime.hardware.link import LinkError
from runtime.hardware.lockstep import Fault

SCHEME = "canopen"
EXAMPLE = "canopen://can0?interface=socketcan&bitrate=1000000"
BITRATE, BITRATES = 1_000_000, (10_000, 1_000_000)
"""bit/s: if none is given, and what classical CAN allows."""
LOAD_LIMIT = 0.8
"""Largest part of the time that cyclic frames may fill; the rest is for emergencies, heartbeats and repetitions."""
_SENT, _ANSWERED = 4, 6
"""Bytes a period and drive: controlword and target torque; statusword and position."""


@dataclass(frozen=True)
class Address:
    """channel and interface as python-can names them; bitrate in bit/s."""

    channel: str
    interface: str = "socketcan"
    bitrate: int = BITRATE

    def __str__(self) -> str:
        return f"{SCHEME}://{self.channel}"


def parse(text: str) -> Address:
    """The address in `canopen://CHANNEL?interface=NAME&bitrate=NUMBER`. Raises LinkError."""
    try:
        parts = urlsplit(text)
    except ValueError as error:  # brackets that are not closed
        raise LinkError(f"--on {text}: {error}; expected {EXAMPLE}") from None
    channel = unquote(parts.netloc + parts.path)
    given = dict(parse_qsl(parts.query, keep_blank_values=True))
    if parts.scheme != SCHEME or not channel:
        raise LinkError(f"--on {text}: expected {EXAMPLE}")
    if unknown := sorted(given.keys() - {"interface", "bitrate"}):
        raise LinkError(f'--on {text}: unknown key "{unknown[0]}"; expected interface and bitrate: {EXAMPLE}')
    rate = given.get("bitrate", str(BITRATE))
    low, high = BITRATES
    if not (rate.isascii() and rate.isdigit() and len(rate) < 10 and low <= int(rate) <= high):
        raise LinkError(f"--on {text}: bitrate is {rate}; expected {low} to {high} bit/s")
    return Address(channel, given.get("interface", Address.interface), int(rate))


# --- how much fits through it ---


def frame_bits(data: int) -> int:
    """Bits of a frame with so many bytes at its longest: as many stuff bits as there can be, and the gap after it."""
    return 47 + 8 * data + (34 + 8 * data - 1) // 4


def period_bits(drives: int) -> int:
    """Bits of all frames of a control period: SYNC, an answer and a command a drive."""
    return frame_bits(0) + drives * (frame_bits(_SENT) + frame_bits(_ANSWERED))


def load(drives: int, rate: float, bitrate: int) -> float:
    """The part of the time that the frames of `drives` at `rate` Hz fill at worst."""
    return period_bits(drives) * rate / bitrate


def check_load(drives: int, rate: float, address: Address) -> None:
    """Raise LinkError where a control step at `rate` Hz does not fit, with the rate that does."""
    part = load(drives, rate, address.bitrate)
    if part <= LOAD_LIMIT:
        return
    feasible = LOAD_LIMIT * address.bitrate / period_bits(drives)
    whole = feasible // 10 * 10 if feasible >= 10 else feasible
    raise LinkError(
        f"{address}: {drives} drives at {rate:g} Hz fill {part:.1%} of a bus of {address.bitrate / 1e6:g} Mbit/s, "
        f"over {LOAD_LIMIT:.0%}; set rate in [controller] to at most {whole:.4g} Hz, or drive the joints from a board"
    )


# --- opening it ---


def open_network(address: Address, listen: Callable[[Any], None]) -> Any:
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
        raise LinkError(_cannot_open(address, error)) from None


def _cannot_open(address: Address, error: Exception) -> str:
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
def faults(address: Address) -> Iterator[None]:
    """What goes wrong on a bus in use, as a Fault for people."""
    import can

    try:
        yield
    except (can.CanError, OSError) as error:
        raise Fault(f"{address}: {_went_wrong(error)}") from None


def _went_wrong(error: Exception) -> str:
    code = getattr(error, "error_code", None) or getattr(error, "errno", None)
    if code == errno.ENETDOWN:
        return "the channel is down, or the bus off; check wiring, termination and bit rate, then switch it on again"
    if code == errno.ENOBUFS:
        return "nothing that is sent is acknowledged; check that the drives have power and the bus its terminators"
    return f"the bus cannot be used any more: {error}"
