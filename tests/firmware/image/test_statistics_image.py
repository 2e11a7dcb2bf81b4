"""The statistics on the board: the same bits everywhere, bounded memory and bounded steps."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import kept
import numpy as np
import pytest
from emulation import Meter, Processor, on_qemu

from codegen import render
from codegen.toolchain import build
from symbolic.effects import LIBRARY
from symbolic.model_file.arm import Arm
from tests.summed import with_statistics

pytestmark = pytest.mark.xdist_group("statistics")
HERE = Path(__file__).resolve().parent.parent
GCC = pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="needs gcc-arm-none-eabi")
QEMU = pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="needs qemu-system-arm")
KINDS = [pytest.param("zig"), pytest.param("gcc", marks=GCC)]
STEP = "free4_statistics_step_f32"
MOST_BYTES, MOST, MEAN = 4096, 3700, 770
"""Bytes of everything that is kept, asked for four joints; instructions of a step, at most and on the
average, of the 168,000 of a millisecond."""
UNITS = ["summed.c", "alone.c", "free4_statistics_f32.c", "free4_f32.c"]


@pytest.fixture(scope="module")
def sources(vishard4: Arm, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("summed")
    model = with_statistics(replace(vishard4, name="free4", contact=None), 1000.0, 8.0)
    files = render.arm_files(model) | render.statistics_files(model, LIBRARY)
    for path, text in files.items():
        if path.endswith(("_f32.c", "_f32.h")):
            (directory / path).write_text(text)
    for path in ("summed.c", "alone.c", "motion.ld"):
        shutil.copy(HERE / path, directory)
    return directory


@pytest.fixture(scope="module")
def expected(sources: Path) -> bytes:
    command = [*build.compiler(), *build.FLAGS, "-O2"]

    def fill(into: Path) -> None:
        subprocess.run([*command, *UNITS, "-o", str(into / "summed.so")], cwd=sources, check=True)

    made = build.entry(f"summed-{build.key(*command, '', *kept.texts(sources))}", fill)
    loaded = ctypes.CDLL(str(made / "summed.so"))
    loaded.motion()
    assert ctypes.c_uint32.in_dll(loaded, "state_bytes").value <= MOST_BYTES
    size = ctypes.c_uint32.in_dll(loaded, "results_bytes").value
    return bytes((ctypes.c_uint8 * size).in_dll(loaded, "results"))


def test_rows_were_added(expected: bytes) -> None:
    rows = np.frombuffer(expected[-16:], np.uint32)
    assert (rows > 50).all()


@pytest.mark.parametrize("kind", KINDS)
def test_on_unicorn(sources: Path, expected: bytes, kind: str) -> None:
    processor = Processor(kept.image(sources, UNITS, kind))
    meter = Meter(processor.cpu, processor.symbols, STEP)
    processor.call("motion")
    assert processor.variable("results") == expected
    counts = np.array(meter.counts[STEP])
    print(f"\n{kind}: {counts.mean():.0f} instructions a step, at most {counts.max()}")
    assert counts.max() <= MOST
    assert counts.mean() <= MEAN


@QEMU
@pytest.mark.parametrize("kind", KINDS)
def test_on_qemu(sources: Path, expected: bytes, tmp_path: Path, kind: str) -> None:
    on_qemu(kept.image(sources, UNITS, kind), "cortex-m4f", tmp_path)
    assert (tmp_path / "results.bin").read_bytes() == expected
