"""What `--on` names: boards that drive the simulated arm, and lines to real ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from runtime.hardware import canopen_arm, link
from runtime.hardware.boards import HostBoard, QemuBoard, UnicornBoard
from runtime.hardware.canopen_arm import CanopenLink
from runtime.hardware.link import BoardLink, SerialLink
from runtime.hardware.lockstep import Board
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
    link.SERIAL_SCHEME: ArmLine(
        link.serial_address, lambda _url, _model: None, lambda url, _model, _directory: SerialLink.of(url)
    ),
    canopen_arm.CAN_SCHEME: ArmLine(canopen_arm.parse_can_address, canopen_arm.check_link, CanopenLink),
}
"""By the scheme of their address."""

KNOWN = (*SIMULATED, "serial:///dev/ttyACM0", "canopen://can0")


def scheme(on: str) -> str:
    """Of an address; empty for a word."""
    return on.partition("://")[0] if "://" in on else ""
