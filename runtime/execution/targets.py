"""What `--on` names: boards that drive the simulated arm, and lines to real ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from runtime.hardware import can_bus, canopen_link, serial_link
from runtime.hardware.canopen_link import CanopenLink
from runtime.hardware.host_board import HostBoard
from runtime.hardware.link import BoardLink
from runtime.hardware.lockstep import Board
from runtime.hardware.qemu_board import QemuBoard
from runtime.hardware.serial_link import SerialLink
from runtime.hardware.unicorn_board import UnicornBoard
from runtime.model.loader import Model


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


@dataclass(frozen=True)
class ArmLine:
    """A way to a real arm. All raise LinkError.

    parse   an address as it is written
    check   what can be said of it with the model, before anything is touched
    open    with the directory of the arm's firmware for this computer
    """

    parse: Callable[[str], object]
    check: Callable[[str, Model], object]
    open: Callable[[str, Model, Path], BoardLink]


LINES: dict[str, ArmLine] = {
    serial_link.SCHEME: ArmLine(
        serial_link.address, lambda _url, _model: None, lambda url, _model, _directory: SerialLink.of(url)
    ),
    can_bus.SCHEME: ArmLine(can_bus.parse, canopen_link.check, CanopenLink),
}
"""By the scheme of their address."""

KNOWN = (*SIMULATED, "serial:///dev/ttyACM0", "canopen://can0")


def scheme(on: str) -> str:
    """Of an address; empty for a word."""
    return on.partition("://")[0] if "://" in on else ""
