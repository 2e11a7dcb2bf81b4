"""The monitor says the same, to the bit, wherever it is compiled, and costs no more than was asked."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import kept
import numpy as np
import pytest
from emulation import Meter, Processor, on_qemu

from codegen import render
from codegen.c.monitor import SIGNALS, VERDICTS
from codegen.toolchain import build, cross
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file import reader
from tests.watched_arm import watched_text

pytestmark = pytest.mark.xdist_group("monitor")
HERE = Path(__file__).resolve().parent.parent
GCC = pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="needs gcc-arm-none-eabi")
QEMU = pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="needs qemu-system-arm")
KINDS = [pytest.param("zig"), pytest.param("gcc", marks=GCC)]
STEP = "arm_monitor_step_f32"
MOST = 400
"""Instructions of a step at four joints: asked."""
JOINTS, CHANGED, CHANGES, RATE = 4, 2, 8000, 1000
UNITS = ["watched.c", "alone.c", "arm_monitor_f32.c"]


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The monitor of an arm with four joints, and what asks it."""
    directory = tmp_path_factory.mktemp("watched")
    model = derive(reader.parse(watched_text(JOINTS), "arm.toml"))
    files = render.controller_files(model, LIBRARY) | render.arm_files(model)
    for path in ("arm_monitor_f32.c", "arm_monitor_f32.h", "tendon_math_f32.h"):
        (directory / path).write_text(files[path])
    for path in ("watched.c", "alone.c", "motion.ld"):
        shutil.copy(HERE / path, directory)
    return directory


def shaped(data: bytes) -> np.ndarray:
    return np.frombuffer(data, np.uint32).reshape(-1, 2 * JOINTS)


def on_this_computer(sources: Path, level: str) -> np.ndarray:
    command = [*build.compiler(), *build.FLAGS, level]

    def fill(into: Path) -> None:
        subprocess.run([*command, *UNITS, "-o", str(into / "watched.so")], cwd=sources, check=True)

    loaded = ctypes.CDLL(
        str(build.entry(f"watched-{build.key(*command, '', *kept.texts(sources))}", fill) / "watched.so")
    )
    loaded.motion()
    size = ctypes.c_uint32.in_dll(loaded, "results_bytes").value
    return shaped(bytes((ctypes.c_uint8 * size).in_dll(loaded, "results")))


@pytest.fixture(scope="module")
def expected(sources: Path) -> np.ndarray:
    return on_this_computer(sources, "-O2")


def test_it_tells_the_joint_that_changes_and_what_its_residual_follows(expected: np.ndarray) -> None:
    said = expected[:, 1::2]
    verdict, signal = (said >> 24) & 15, said >> 28
    assert (verdict[:CHANGES] == VERDICTS["holds"]).all()
    others = np.delete(verdict, CHANGED, axis=1)
    assert (others == VERDICTS["holds"]).all()
    first = int(np.argmax(verdict[:, CHANGED] != VERDICTS["holds"]))
    assert CHANGES < first < CHANGES + 3 * RATE
    assert (verdict[first:, CHANGED] != VERDICTS["holds"]).all()
    assert signal[-1, CHANGED] == SIGNALS["velocity"]


@pytest.mark.parametrize("level", ["-O0", "-O3"])
def test_on_this_computer(sources: Path, expected: np.ndarray, level: str) -> None:
    assert (on_this_computer(sources, level) == expected).all()


@pytest.mark.parametrize("kind", KINDS)
def test_on_unicorn_it_says_the_same_within_its_instructions(sources: Path, expected: np.ndarray, kind: str) -> None:
    processor = Processor(kept.image(sources, UNITS, kind))
    meter = Meter(processor.cpu, processor.symbols, STEP)
    processor.call("motion")
    assert (shaped(processor.variable("results")) == expected).all()
    counts = np.array(meter.counts[STEP])
    print(f"\n{kind}: {counts.mean():.0f} instructions a step, at most {counts.max()}")
    assert len(counts) == len(expected)
    assert counts.max() <= MOST


@pytest.mark.slow
@pytest.mark.parametrize("target", list(cross.TARGETS))
@pytest.mark.parametrize("level", ["-O0", "-O3", cross.SMALL])
@pytest.mark.parametrize("kind", KINDS)
def test_on_unicorn_at_every_level(sources: Path, expected: np.ndarray, kind: str, level: str, target: str) -> None:
    processor = Processor(kept.image(sources, UNITS, kind, target, level), target)
    processor.call("motion")
    assert (shaped(processor.variable("results")) == expected).all()


@QEMU
@pytest.mark.parametrize("target", list(cross.TARGETS))
@pytest.mark.parametrize("kind", KINDS)
def test_on_qemu(sources: Path, expected: np.ndarray, tmp_path: Path, kind: str, target: str) -> None:
    on_qemu(kept.image(sources, UNITS, kind, target), target, tmp_path)
    assert (shaped((tmp_path / "results.bin").read_bytes()) == expected).all()
