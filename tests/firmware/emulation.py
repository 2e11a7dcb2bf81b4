"""Functions of an image, called one by one on an emulated Cortex-M, and what they cost there in instructions."""

from __future__ import annotations

import struct
import subprocess
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import unicorn
from elftools.elf.constants import SH_FLAGS
from unicorn import arm_const as arm

from codegen.toolchain import cross
from codegen.toolchain.stack import Elf

CPUS = {"cortex-m4f": arm.UC_CPU_ARM_CORTEX_M4, "cortex-m7": arm.UC_CPU_ARM_CORTEX_M7}
_CODE, _RAM, _SIZE, _STACK = 0x0000_0000, 0x2000_0000, 0x40_0000, 0x2030_0000
_SYSTEM, _CPACR, _PAGE = 0xE000_E000, 0xE000_ED88, 0x1000
_RETURN = 0x003F_FFF0
"""Where functions return to: past every image."""
_REGISTERS = (arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1, arm.UC_ARM_REG_R2, arm.UC_ARM_REG_R3)


def places(image: Path) -> dict[str, tuple[int, int]]:
    """Address and size of what has a name in an ELF image."""
    return {symbol.name: (symbol.address, symbol.size) for symbol in Elf.read(image).symbols}


class Processor:
    """An image in memory, and memory for the arguments of its functions."""

    def __init__(self, image: Path, target: str = "cortex-m4f") -> None:
        self.symbols = places(image)
        self.cpu = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self.cpu.ctl_set_cpu_model(CPUS[target])
        for place, size in ((_CODE, _SIZE), (_RAM, _SIZE), (_SYSTEM, _PAGE)):
            self.cpu.mem_map(place, size)
        file = Elf.read(image)
        for section in file.sections:
            if section["sh_flags"] & SH_FLAGS.SHF_ALLOC and section["sh_type"] != "SHT_NOBITS":
                self.cpu.mem_write(section["sh_addr"], section.data())
        self.cpu.mem_write(_CPACR, struct.pack("<I", 0x00F0_0000))
        self.cpu.reg_write(arm.UC_ARM_REG_C1_C0_2, 0x00F0_0000)
        self.cpu.reg_write(arm.UC_ARM_REG_FPEXC, 0x4000_0000)
        self._free = 0x2020_0000

    def place(self, data: bytes) -> int:
        """The address of a copy of `data`."""
        at, self._free = self._free, self._free + (len(data) + 15) // 16 * 16
        self.cpu.mem_write(at, data)
        return at

    def write(self, at: int, data: bytes) -> None:
        self.cpu.mem_write(at, data)

    def floats(self, at: int, count: int) -> list[float]:
        """Numbers in memory."""
        return list(struct.unpack(f"<{count}f", self.cpu.mem_read(at, 4 * count)))

    def variable(self, name: str) -> bytes:
        """The content of a global variable."""
        at, size = self.symbols[name]
        return bytes(self.cpu.mem_read(at, size))

    def call(self, name: str, *arguments: int, number: float = 0.0) -> None:
        """A function of pointers and whole numbers, and of one float at most."""
        self.cpu.reg_write(arm.UC_ARM_REG_S0, int.from_bytes(struct.pack("<f", number), "little"))
        for register, value in zip(_REGISTERS, arguments, strict=False):
            self.cpu.reg_write(register, value)
        rest = arguments[len(_REGISTERS) :]
        self.cpu.mem_write(_STACK, struct.pack(f"<{len(rest)}I", *rest))
        self.cpu.reg_write(arm.UC_ARM_REG_SP, _STACK)
        self.cpu.reg_write(arm.UC_ARM_REG_LR, _RETURN | 1)
        self.cpu.emu_start(self.symbols[name][0] | 1, _RETURN)


class Meter:
    """Instructions of every call of some functions, from the first one to the return, all that they call included.

    An instruction whose condition does not hold is one all the same: it takes its cycle.
    """

    def __init__(self, cpu: Any, symbols: Mapping[str, tuple[int, int]], *functions: str) -> None:
        self._counts: dict[str, list[int]] = defaultdict(list)
        self._entries = {symbols[name][0] & ~1: name for name in functions}
        self._open: list[list[Any]] = []
        self._sizes: dict[tuple[int, int], int] = {}
        # Blocks that were translated before would not be seen.
        cpu.ctl_flush_tb()
        self._hook = cpu.hook_add(unicorn.UC_HOOK_BLOCK, self._block)

    @property
    def counts(self) -> dict[str, list[int]]:
        """By function, in the order of the returns; not to be asked for within a call."""
        while self._open:
            self._close()
        return self._counts

    def _close(self) -> None:
        name, _, count = self._open.pop()
        self._counts[name].append(count)

    def _block(self, cpu: Any, at: int, size: int, _user: Any) -> None:
        while self._open and at == self._open[-1][1]:
            self._close()
        if name := self._entries.get(at):
            # Nothing calls itself: what is open has returned to where the emulation ends.
            while name in (running[0] for running in self._open):
                self._close()
            self._open.append([name, cpu.reg_read(arm.UC_ARM_REG_LR) & ~1, 0])
        if self._open:
            length = self._sizes.get((at, size)) or self._measured(cpu, at, size)
            for running in self._open:
                running[2] += length

    def _measured(self, cpu: Any, at: int, size: int) -> int:
        """Instructions of a block: the top bits of a half-word say whether another one belongs to it."""
        code = cpu.mem_read(at, size)
        place = count = 0
        while place < size:
            place += 4 if code[place + 1] >> 3 in (0b11101, 0b11110, 0b11111) else 2
            count += 1
        self._sizes[at, size] = count
        return count


def on_qemu(image: Path, target: str, directory: Path) -> None:
    """Runs an image by itself on QEMU's board of a target, in a directory, where it leaves its results."""
    command = ["qemu-system-arm", "-M", cross.TARGETS[target].machine, "-kernel", str(image), "-display", "none"]
    command += ["-monitor", "none", "-serial", "none", "-semihosting-config", "enable=on,target=native"]
    subprocess.run(command, cwd=directory, check=True, timeout=60, stdin=subprocess.DEVNULL)
