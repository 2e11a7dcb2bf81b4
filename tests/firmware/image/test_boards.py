"""Emulated boards that hang, crash or are killed: a lost link, the recording kept, nothing left behind."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_arm import THERE_AND_BACK, trajectory
from driven import Rig, rig
from emulation import places

from codegen.toolchain.stack import Elf
from runtime.hardware import boards
from runtime.hardware.boards import QemuBoard, UnicornBoard
from runtime.hardware.link import LinkError, LinkLost
from runtime.model.loader import Model
from runtime.workspace.source import Source

needs_qemu = pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="needs qemu-system-arm")
AT = 50


@pytest.fixture(scope="module")
def image(bench: Source) -> Path:
    return bench.compiled.controller("cortex-m4f")


@pytest.fixture
def make(arm: Model, image: Path) -> Any:
    """A bench on an emulated board, to which something happens in motion."""
    made: list[Rig] = []

    def on(board: Callable[..., Any], happens: Callable[[Any], None]) -> Rig:
        one = rig(arm, image, trajectory(THERE_AND_BACK), board)
        made.append(one)

        def twist(period: int, counts: Any) -> Any:
            if period == AT:
                happens(one.lockstep.board)
            return counts

        one.arm.twist = twist
        return one

    yield on
    for one in made:
        one.session.close()


def check_lost(one: Rig, words: str) -> None:
    found = one.driven()
    assert found.stop is not None
    assert found.stop.name == "link_lost"
    assert words in found.stop.reason
    # The host reads a few periods at once; the last of them are lost with the board.
    assert AT - 20 <= len(found.t) <= AT
    np.testing.assert_allclose(found.t, 1e-3 * np.arange(len(found.t)), atol=1e-9)


def instead_of_a_step(instruction: bytes) -> Callable[[UnicornBoard], None]:
    def overwrite(board: UnicornBoard) -> None:
        place, size = places(board.image.with_suffix(".elf"))["tendon_machine_step"]
        board.cpu.mem_write(place & ~1, instruction * (size // len(instruction)))
        board.cpu.ctl_flush_tb()

    return overwrite


def test_an_image_that_hangs(make: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(boards, "PATIENCE", 0.3)
    monkeypatch.setattr(boards._Watch, "_LOOK", 0.1)
    check_lost(make(UnicornBoard, instead_of_a_step(b"\xfe\xe7")), "the emulated board hangs at 0x")


def test_an_image_that_crashes(make: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(boards, "PATIENCE", 0.3)
    monkeypatch.setattr(boards._Watch, "_LOOK", 0.1)
    check_lost(make(UnicornBoard, instead_of_a_step(b"\x00\xde")), "the emulated board ")


@needs_qemu
def test_an_emulator_that_is_killed(make: Any) -> None:
    check_lost(make(QemuBoard, lambda board: board._process.kill()), "the emulated board ")


@needs_qemu
def test_an_emulator_that_stands_still(make: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def halt(board: QemuBoard) -> None:
        assert board._process is not None
        os.kill(board._process.pid, signal.SIGSTOP)
        monkeypatch.setattr(boards, "PATIENCE", 0.5)

    check_lost(make(QemuBoard, halt), "the emulated board has not answered for 0.5 s")


@needs_qemu
def test_no_emulator_outlives_its_parent(image: Path) -> None:
    """Not even one that is killed."""
    script = (
        "import os, sys, signal; from pathlib import Path; from runtime.hardware.boards import QemuBoard\n"
        f"board = QemuBoard(Path({str(image)!r}), 'bench', 1)\n"
        "print(board._process.pid, board._place.name, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    pid, place = done.stdout.split()
    shutil.rmtree(place)
    deadline = time.monotonic() + 10
    while Path(f"/proc/{pid}").exists() and "Z" not in Path(f"/proc/{pid}/stat").read_text().split(")")[1][:3]:
        assert time.monotonic() < deadline, "QEMU is still there"
        time.sleep(0.02)


@needs_qemu
def test_an_emulator_that_does_not_start_says_why(image: Path, tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"qemu-system-arm does not start: .*unsupported machine type"):
        QemuBoard(image, "bench", 1, machine="toaster")
    shutil.copy(image / "protocol.json", tmp_path)
    # It takes both lines before it looks for its image: on a busy machine it is gone before either is heard.
    said = r"(does not start|the emulated board is gone): .*other\.elf"
    with pytest.raises((LinkError, LinkLost), match=said), closing(QemuBoard(tmp_path, "other", 1)) as board:
        board.period(np.zeros(1, dtype=np.int32), 0, 0)


@pytest.mark.parametrize("data", [b"", b"\x5a\x01\x00\x00", b"\x5b\x01" + bytes(4), b"\x5a\x01" + bytes(5)])
def test_what_is_no_answer_is_a_lost_link(data: bytes) -> None:
    with pytest.raises(LinkLost, match=f"answered {len(data)} bytes to a control period; expected 6"):
        boards.PlantLine(1).answer(data)


def test_the_image_says_where_its_memory_is(image: Path) -> None:
    place, size = places(image / "bench.elf")["machine"]
    assert 0x2000_0000 <= place < place + size < 0x2040_0000
    start, flat = Elf.read(image / "bench.elf").binary()
    assert (start, flat) == (0, (image / "bench.bin").read_bytes())
