"""The firmware's image on a board emulated by QEMU: a process of its own, with real interrupts and real UARTs."""

from __future__ import annotations

import contextlib
import ctypes
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from runtime.hardware.emulated import PATIENCE, PlantLine
from runtime.hardware.frames import DELIMITER, Codec, ReceivedMessage
from runtime.hardware.link import LinkError, LinkLost
from runtime.hardware.lockstep import Counts, Float32

_PROGRAM = "qemu-system-arm"
_LOG, _WORDS = "log", 300
_CHUNK = 65_536
_ANSWER_WAIT = 1.0
"""s of real time that an answer to the host may take: it comes beside the control periods, not in them."""
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG


class QemuBoard:
    """A board with the image `name`.elf of a directory of codegen.prepare.prepare_firmware; n: joints.

    machine   of QEMU: mps2-an386 is a Cortex-M4F, mps2-an500 a Cortex-M7
    Raises LinkError where QEMU is missing or does not start.
    """

    def __init__(self, directory: Path, name: str, n: int, machine: str = "mps2-an386") -> None:
        program = shutil.which(_PROGRAM)
        if program is None:
            raise LinkError(f"--on qemu needs {_PROGRAM}, which is not here: apt install qemu-system-arm")
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
        """All that has come: whole frames, and the answers to what was asked.

        They come by a line of their own, beside the control periods: without waiting for them it would be chance
        whether a period passes in between.
        """
        data = self._taken(0.0)
        while self._waits(data):
            more = self._taken(_ANSWER_WAIT)
            if not more:
                # What was asked has been lost on its way.
                self._owed.clear()
                break
            data += more
        return data

    def _waits(self, data: bytes) -> bool:
        """Whether more has to come after `data`."""
        if self._owed:
            self._owed -= {m.values["sequence"] for m in self._messages(data) if m.name == "ack"}
        return bool(self._owed) or (data != b"" and not data.endswith(DELIMITER))

    def period(self, counts: Counts, time_us: int, fault: int) -> tuple[bool, Float32]:
        self._put(self._plant, self._line.period(counts, time_us, fault))
        return self._line.answer(self._answer())

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
        listening = [_listener(path) for path in paths]
        serial = [part for path in paths for part in ("-serial", f"unix:{path}")]
        command = [program, "-M", machine, "-kernel", str(image), "-nographic", "-monitor", "none", *serial]
        with (Path(self._place.name) / _LOG).open("wb") as errors, contextlib.ExitStack() as stack:
            for line in listening:
                stack.callback(line.close)
            # A session of its own: Ctrl-C is for us to hear, who stop the arm first.
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=errors,
                stderr=errors,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )
            for line in listening:
                # One by one, so that the first is closed where no second comes.
                self._sockets.append(self._accepted(line))

    def _accepted(self, listening: socket.socket) -> socket.socket:
        assert self._process is not None
        deadline = time.monotonic() + PATIENCE
        while self._process.poll() is None and time.monotonic() < deadline:
            with contextlib.suppress(TimeoutError):
                line, _ = listening.accept()
                return line
        raise LinkError(f"{_PROGRAM} does not start: {self._last_words() or 'it says nothing'}")

    def _put(self, line: socket.socket, data: bytes) -> None:
        line.settimeout(PATIENCE)
        try:
            line.sendall(data)
        except OSError as error:
            raise self._gone() from error

    def _taken(self, timeout: float) -> bytes:
        """What the board has said to the host; b"" if nothing comes in time."""
        try:
            return self._received(self._host, _CHUNK, timeout)
        except (BlockingIOError, TimeoutError):
            return b""

    def _messages(self, data: bytes) -> list[ReceivedMessage]:
        found = (self._codec.decode(frame) for frame in data.split(DELIMITER)[:-1] if frame)
        return [message for message in found if isinstance(message, ReceivedMessage)]

    def _answer(self) -> bytes:
        found = b""
        while len(found) < self._line.size:
            try:
                found += self._received(self._plant, self._line.size - len(found), PATIENCE)
            except TimeoutError as error:
                raise LinkLost(f"the emulated board has not answered for {PATIENCE:g} s; it hangs") from error
        return found

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


def _listener(path: str) -> socket.socket:
    line = socket.socket(socket.AF_UNIX)
    line.bind(path)
    line.listen(1)
    line.settimeout(0.1)
    return line


_LIBC = ctypes.CDLL(None)


def _die_with_parent() -> None:
    """In the child, before it becomes QEMU: no emulator is left behind by a parent that was killed. Linux can."""
    if sys.platform == "linux":
        _LIBC.prctl(_DIE_WITH_PARENT, signal.SIGKILL)
