"""What `--on` names: boards that drive the simulated arm, and lines to real ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from runtime.hardware import serial_link
from runtime.hardware.host_board import HostBoard
from runtime.hardware.link import Link
from runtime.hardware.lockstep import Board
from runtime.hardware.qemu_board import QemuBoard
from runtime.hardware.serial_link import SerialLink
from runtime.hardware.unicorn_board import UnicornBoard


@dataclass(frozen=True)
class Simulated:
    """A board in step with the simulated arm. build: the firmware's target that it runs."""

    build: str
    board: Callable[[Path, str, int], Board]


SIMULATED: Mapping[str, Simulated] = {
    "simulation": Simulated("host", HostBoard),
    "unicorn": Simulated("cortex-m4f", UnicornBoard),
    "qemu": Simulated("cortex-m4f", partial(QemuBoard, machine="mps2-an386")),
}

LINES: Mapping[str, Callable[[str], Link]] = {serial_link.SCHEME: SerialLink.of}
"""By the scheme of their address."""

KNOWN = (*SIMULATED, "serial:///dev/ttyACM0")


def scheme(on: str) -> str:
    """Of an address; empty for a word."""
    return on.partition("://")[0] if "://" in on else ""
