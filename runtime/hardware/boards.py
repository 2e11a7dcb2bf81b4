"""Boards that drive a simulated arm: the firmware in this process, and its image in two emulators.

An emulated board waits for `0xA5, counts i32 each, time_us u32, fault u32`, which is its control period, and answers
`0x5A, enabled u8, torque float each`, little-endian.
"""

from __future__ import annotations

import contextlib
import ctypes
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from runtime.hardware.link import DELIMITER, Codec, LinkError, LinkLost, ReceivedMessage
from runtime.hardware.lockstep import Counts, Float32

_SEND = 4096
"""Bytes that are taken from a board at once."""


class HostBoard:
    """The firmware's state machine in this process.

    directory   of codegen.prepare.prepare_firmware for the host, with lib.so
    _name       unused; other boards need the arm's name for their image
    n           number of joints
    """

    def __init__(self, directory: Path, _name: str, n: int) -> None:
        self._library = ctypes.CDLL(str(directory / "lib.so"))
        size = self._function("tendon_machine_size", ctypes.c_uint32)()
        # Doubles, for alignment.
        self._memory = (ctypes.c_double * (-(-size // 8)))()
        self._receive = self._function("tendon_machine_receive")
        self._step = self._function("tendon_machine_step")
        self._send = self._function("tendon_machine_send", ctypes.c_uint32)
        self._is_enabled = self._function("tendon_machine_enabled", ctypes.c_bool)
        self._counts: Counts = np.zeros(n, dtype=np.int32)
        self._torque: Float32 = np.zeros(n, dtype=np.float32)
        self._out = (ctypes.c_uint8 * _SEND)()
        # Pointers are made once, so that calls are fast.
        self._machine = ctypes.byref(self._memory)
        self._pointers = tuple(ctypes.c_void_p(array.ctypes.data) for array in (self._counts, self._torque))
        self._function("tendon_machine_start")(self._machine)

    def receive(self, data: bytes) -> None:
        self._receive(self._machine, data, ctypes.c_uint32(len(data)))

    def send(self) -> bytes:
        count = self._send(self._machine, self._out, _SEND)
        return ctypes.string_at(self._out, count) if count else b""

    def period(self, counts: Counts, time_us: int, fault: int) -> tuple[bool, Float32]:
        self._counts[:] = counts
        read, write = self._pointers
        self._step(self._machine, read, ctypes.c_uint32(time_us), ctypes.c_uint32(fault), write)
        return self._is_enabled(self._machine), self._torque

    def close(self) -> None:
        """Nothing to close."""

    def _function(self, name: str, result: type | None = None) -> ctypes._NamedFuncPointer:
        function = getattr(self._library, name)
        function.restype = result
        return function


_PERIOD_MARK, _ANSWER_MARK = 0xA5, 0x5A
PATIENCE = 30.0
"""Real time in s that an emulator may take for one answer on a busy computer before it counts as hung."""


class PlantLine:
    """The messages between an emulated board and the simulated arm of n joints."""

    def __init__(self, n: int) -> None:
        self._question = struct.Struct(f"<B{n}iII")
        self._head = struct.Struct("<BB")
        self.size = self._head.size + 4 * n

    def period(self, counts: Counts, time_us: int, fault: int) -> bytes:
        return self._question.pack(_PERIOD_MARK, *counts.tolist(), time_us, fault)

    def answer(self, data: bytes) -> tuple[bool, Float32]:
        """Whether the drives are on, and the torques (n,). Raises LinkLost for anything else."""
        if len(data) != self.size or data[0] != _ANSWER_MARK:
            raise LinkLost(f"the emulated board answered {len(data)} bytes to a control period; expected {self.size}")
        return bool(data[1]), np.frombuffer(data, np.dtype("<f4"), offset=self._head.size)


_CODE, _RAM, _MEMORY = 0x0000_0000, 0x2000_0000, 0x40_0000
_HOST_UART, _PLANT_UART, _PAGE = 0x4000_4000, 0x4000_5000, 0x1000
_SYSTEM, _CPACR, _FPU_ON, _FPEXC_ON = 0xE000_E000, 0xE000_ED88, 0x00F0_0000, 0x4000_0000
_DATA, _STATE, _RECEIVED = 0x00, 0x04, 2
_NOWHERE = 0xFFFF_FFFE
_SLEEPS = 100
"""How often in a row the image may sleep before it answers."""


class UnicornBoard:
    """An emulated Cortex-M4F (Unicorn) with the image `name`.bin of a directory of codegen.prepare.prepare_firmware.

    n   number of joints
    Raises LinkError if the emulator is not installed.
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
        # The image enables the FPU by a register that is plain memory in this emulator.
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
        """Runs the image until it sleeps."""
        self._watch.begin()
        try:
            self.cpu.emu_start(self.cpu.reg_read(self._pc) | 1, _NOWHERE)
        except self._broken as error:
            at = self.cpu.reg_read(self._pc)
            raise LinkLost(f"the emulated board has crashed at 0x{at:08x} ({error})") from error
        if self._watch.expired():
            raise LinkLost(f"the emulated board hangs at 0x{self.cpu.reg_read(self._pc):08x}")


class _Uart:
    """Data and state registers of a UART whose transmitter is always free."""

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
    """Stops an emulation that does not sleep: one thread that checks every second, not a timer for each run."""

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
        """After a run: whether the watch stopped it."""
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


_PROGRAM = "qemu-system-arm"
_LOG, _WORDS = "log", 300
_CHUNK = 65_536
_ANSWER_WAIT = 1.0
"""Real time in s for an answer to the host, which arrives independently of the control periods."""
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG


class QemuBoard:
    """A board emulated by QEMU with the image `name`.elf of a directory of codegen.prepare.prepare_firmware.

    n   number of joints     machine   QEMU's board: mps2-an386 has a Cortex-M4F, mps2-an500 a Cortex-M7
    Raises LinkError if QEMU is not installed or does not start.
    """

    def __init__(self, directory: Path, name: str, n: int, machine: str = "mps2-an386") -> None:
        program = shutil.which(_PROGRAM)
        if program is None:
            raise LinkError(f"--on qemu needs {_PROGRAM}, which is not installed: apt install qemu-system-arm")
        self._line = PlantLine(n)
        self._codec = Codec.from_json(directory / "protocol.json")
        self._owed: set[int] = set()
        self._sockets: list[socket.socket] = []
        self._place = tempfile.TemporaryDirectory(prefix="tendon-qemu-")
        self._process: subprocess.Popen[bytes] | None = None
        try:
            self._start(program, directory / f"{name}.elf", machine)
        except BaseException:
            self.close()
            raise
        self._host, self._plant = self._sockets

    def receive(self, data: bytes) -> None:
        self._put(self._host, data)
        self._owed |= {message.sequence for message in self._messages(data)}

    def send(self) -> bytes:
        """All bytes for the host: whole frames, and the answers to the host's commands.

        They arrive independently of the control periods. Waiting for them makes runs reproducible.
        """
        data = self._taken(0.0)
        while self._waits(data):
            more = self._taken(_ANSWER_WAIT)
            if not more:
                # The command was lost.
                self._owed.clear()
                break
            data += more
        return data

    def _waits(self, data: bytes) -> bool:
        if self._owed:
            self._owed -= {m.values["sequence"] for m in self._messages(data) if m.name == "ack"}
        return bool(self._owed) or (data != b"" and not data.endswith(DELIMITER))

    def period(self, counts: Counts, time_us: int, fault: int) -> tuple[bool, Float32]:
        self._put(self._plant, self._line.period(counts, time_us, fault))
        found = b""
        while len(found) < self._line.size:
            try:
                found += self._received(self._plant, self._line.size - len(found), PATIENCE)
            except TimeoutError as error:
                raise LinkLost(f"the emulated board has not answered for {PATIENCE:g} s") from error
        return self._line.answer(found)

    def close(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        for line in self._sockets:
            line.close()
        self._sockets = []
        self._place.cleanup()

    def _start(self, program: str, image: Path, machine: str) -> None:
        paths = [str(Path(self._place.name) / line) for line in ("host", "plant")]
        listening = [socket.socket(socket.AF_UNIX) for _ in paths]
        serial = [part for path in paths for part in ("-serial", f"unix:{path}")]
        command = [program, "-M", machine, "-kernel", str(image), "-nographic", "-monitor", "none", *serial]
        with (Path(self._place.name) / _LOG).open("wb") as errors, contextlib.ExitStack() as stack:
            for line, path in zip(listening, paths, strict=True):
                stack.callback(line.close)
                line.bind(path)
                line.listen(1)
                line.settimeout(0.1)
            # In a session of its own, so that Ctrl-C reaches only this process, which stops the arm first.
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=errors,
                stderr=errors,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )
            for line in listening:
                # Appended one by one, so that close() finds the first if the second fails.
                self._sockets.append(self._accepted(line))

    def _accepted(self, listening: socket.socket) -> socket.socket:
        assert self._process is not None
        deadline = time.monotonic() + PATIENCE
        while self._process.poll() is None and time.monotonic() < deadline:
            with contextlib.suppress(TimeoutError):
                line, _ = listening.accept()
                return line
        raise LinkError(f"{_PROGRAM} does not start: {self._last_words() or 'it prints nothing'}")

    def _put(self, line: socket.socket, data: bytes) -> None:
        line.settimeout(PATIENCE)
        try:
            line.sendall(data)
        except OSError as error:
            raise self._gone() from error

    def _taken(self, timeout: float) -> bytes:
        """Bytes from the board to the host; b"" if none arrive in time."""
        try:
            return self._received(self._host, _CHUNK, timeout)
        except (BlockingIOError, TimeoutError):
            return b""

    def _messages(self, data: bytes) -> list[ReceivedMessage]:
        found = (self._codec.decode(frame) for frame in data.split(DELIMITER)[:-1] if frame)
        return [message for message in found if isinstance(message, ReceivedMessage)]

    def _received(self, line: socket.socket, most: int, timeout: float) -> bytes:
        line.settimeout(timeout)
        try:
            data = line.recv(most)
        except ConnectionError as error:
            raise self._gone() from error
        if not data:
            raise self._gone()
        return data

    def _gone(self) -> LinkLost:
        return LinkLost(f"the emulated board is gone: {self._last_words() or 'QEMU has ended'}")

    def _last_words(self) -> str:
        words = (Path(self._place.name) / _LOG).read_text(errors="replace")
        return " ".join(words.split())[-_WORDS:]


_LIBC = ctypes.CDLL(None)


def _die_with_parent() -> None:
    if sys.platform == "linux":
        _LIBC.prctl(_DIE_WITH_PARENT, signal.SIGKILL)
