"""The firmware's image on an emulated Cortex-M in this process (unicorn).

The emulator has a processor and memory, and no interrupts: a UART is a pair of functions here, and where the image
sleeps (WFI) the emulation returns, so that the next bytes can be given.
"""

from __future__ import annotations

import struct
import threading
from collections import deque
from pathlib import Path
from typing import Any

from runtime.hardware.emulated import PATIENCE, PlantLine
from runtime.hardware.link import LinkError, LinkLost
from runtime.hardware.lockstep import Counts, Float32

_CODE, _RAM, _MEMORY = 0x0000_0000, 0x2000_0000, 0x40_0000
_HOST_UART, _PLANT_UART, _PAGE = 0x4000_4000, 0x4000_5000, 0x1000
_SYSTEM, _CPACR, _FPU_ON, _FPEXC_ON = 0xE000_E000, 0xE000_ED88, 0x00F0_0000, 0x4000_0000
_DATA, _STATE, _RECEIVED = 0x00, 0x04, 2
_NOWHERE = 0xFFFF_FFFE
_SLEEPS = 100
"""Times in a row that the image may fall asleep before it has answered."""


class UnicornBoard:
    """A board with the flat image `name`.bin of a directory of codegen.prepare.prepare_firmware; n: joints.

    Raises LinkError where the emulator is missing.
    """

    def __init__(self, directory: Path, name: str, n: int) -> None:
        try:
            import unicorn
            from unicorn import arm_const
        except ImportError as error:
            raise LinkError("--on unicorn needs the emulator: pip install unicorn") from error
        self.image = directory / f"{name}.bin"
        self._line = PlantLine(n)
        self._host, self._plant = _Uart(), _Uart()
        self._pc = arm_const.UC_ARM_REG_PC
        self._broken = unicorn.UcError
        self.cpu = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self.cpu.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M4)
        for place, size in ((_CODE, _MEMORY), (_RAM, _MEMORY), (_SYSTEM, _PAGE)):
            self.cpu.mem_map(place, size)
        self.cpu.mem_write(_CODE, self.image.read_bytes())
        for place, uart in ((_HOST_UART, self._host), (_PLANT_UART, self._plant)):
            self.cpu.mmio_map(place, _PAGE, uart.load, None, uart.store, None)
        # The image enables the unit by a register that is mere memory here.
        self.cpu.mem_write(_CPACR, struct.pack("<I", _FPU_ON))
        self.cpu.reg_write(arm_const.UC_ARM_REG_C1_C0_2, _FPU_ON)
        self.cpu.reg_write(arm_const.UC_ARM_REG_FPEXC, _FPEXC_ON)
        stack, reset = struct.unpack("<II", self.cpu.mem_read(_CODE, 8))
        self.cpu.reg_write(arm_const.UC_ARM_REG_SP, stack)
        self.cpu.reg_write(self._pc, reset | 1)
        self._watch = _Watch(self.cpu)
        self._run()

    def receive(self, data: bytes) -> None:
        self._host.waiting.extend(data)

    def send(self) -> bytes:
        if self._host.waiting:
            self._run()
        return self._host.taken()

    def period(self, counts: Counts, time_us: int, fault: int) -> tuple[bool, Float32]:
        self._plant.waiting.extend(self._line.period(counts, time_us, fault))
        for _ in range(_SLEEPS):
            self._run()
            if len(self._plant.sent) >= self._line.size:
                break
        return self._line.answer(self._plant.taken())

    def close(self) -> None:
        self._watch.end()

    def _run(self) -> None:
        """Until the image sleeps."""
        self._watch.begin()
        try:
            self.cpu.emu_start(self.cpu.reg_read(self._pc) | 1, _NOWHERE)
        except self._broken as error:
            at = self.cpu.reg_read(self._pc)
            raise LinkLost(f"the emulated board has crashed at 0x{at:08x} ({error})") from error
        if self._watch.expired():
            raise LinkLost(f"the emulated board hangs at 0x{self.cpu.reg_read(self._pc):08x}")


class _Uart:
    """Data and state registers of a UART whose sender is always free."""

    def __init__(self) -> None:
        self.waiting: deque[int] = deque()
        self.sent = bytearray()

    def load(self, _cpu: Any, offset: int, _size: int, _user: Any) -> int:
        if offset == _STATE:
            return _RECEIVED if self.waiting else 0
        return self.waiting.popleft() if offset == _DATA and self.waiting else 0

    def store(self, _cpu: Any, offset: int, _size: int, value: int, _user: Any) -> None:
        if offset == _DATA:
            self.sent.append(value & 0xFF)

    def taken(self) -> bytes:
        data = bytes(self.sent)
        self.sent.clear()
        return data


class _Watch:
    """Ends an emulation that does not sleep by itself: one thread that looks now and then, not a timer for each."""

    _LOOK = 1.0

    def __init__(self, cpu: Any) -> None:
        self._cpu, self._runs, self._ended = cpu, 0, threading.Event()
        self._running = self._over = False
        threading.Thread(target=self._look, daemon=True).start()

    def begin(self) -> None:
        self._runs += 1
        self._over = False
        self._running = True

    def expired(self) -> bool:
        """After a run: whether it was ended from here."""
        self._running = False
        return self._over

    def end(self) -> None:
        self._ended.set()

    def _look(self) -> None:
        seen, waited = 0, 0.0
        while not self._ended.wait(self._LOOK):
            waited = waited + self._LOOK if self._running and self._runs == seen else 0.0
            seen = self._runs
            if waited >= PATIENCE:
                self._over = True
                self._cpu.emu_stop()
