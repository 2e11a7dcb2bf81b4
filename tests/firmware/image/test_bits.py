"""The controller gives the same torques, to the bit, wherever and however it is compiled; and they are SymPy's."""

from __future__ import annotations

import ctypes
import os
import random
import shutil
import struct
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import kept
import motions
import numpy as np
import pytest
from emulation import Processor, on_qemu

from codegen import render
from codegen.toolchain import build, cross
from codegen.verify import verify
from runtime.model.loader import Model
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file.arm import Arm

pytestmark = pytest.mark.xdist_group("bits")
SLOW = pytest.mark.slow
STEPS = 10_000
"""Of the motion."""
GCC = pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="needs gcc-arm-none-eabi")
QEMU = pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="needs qemu-system-arm")
ZIG = (sys.executable, "-m", "ziglang", "cc")
KINDS = [pytest.param("zig"), pytest.param("gcc", marks=GCC)]
TARGETS = list(cross.TARGETS)
LEVELS = ["-O0", "-O3"]
Results = np.ndarray


@pytest.fixture(scope="module")
def sources(vishard4: Arm, model: Model, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with the generated C and a motion: wide, along the plate, slow."""
    directory = tmp_path_factory.mktemp("motion")
    plan = motions.plan(model, motions.free(7), motions.sliding(model, 10), motions.slow(3))
    motions.write(directory, vishard4, model, plan, STEPS)
    return directory


def on_this_computer(directory: Path, command: tuple[str, ...], level: str) -> Results:
    """The motion's results as a shared library of this computer gives them."""
    # Else zig compiles runtime libraries first.
    own = ("-fno-sanitize=all", "-nostdlib") if "ziglang" in command else ()
    flags = [*build.FLAGS, *own, level]
    environment = os.environ | {"ZIG_GLOBAL_CACHE_DIR": str(build.cache_directory() / "zig")}

    def fill(into: Path) -> None:
        units, output = motions.units(directory), str(into / "motion.so")
        subprocess.run([*command, *flags, *units, "-o", output], cwd=directory, check=True, env=environment)

    key = build.key(*command, *flags, "", *kept.texts(directory))
    loaded = ctypes.CDLL(str(build.entry(f"motion-{key}", fill) / "motion.so"))
    loaded.motion()
    return shaped(bytes((ctypes.c_uint32 * (STEPS * 6)).in_dll(loaded, "results")))


def shaped(data: bytes) -> Results:
    return np.frombuffer(data, np.uint32).reshape(STEPS, 6)


@pytest.fixture(scope="module")
def expected(sources: Path) -> Results:
    return on_this_computer(sources, build.compiler(), "-O2")


def image(sources: Path, kind: str, target: str, level: str) -> Path:
    return kept.image(sources, motions.units(sources), kind, target, level)


def test_the_motion_is_demanding(expected: Results) -> None:
    """All phases, limits reached, and no torque that is no number."""
    torque, phase, status = expected[:, :4].view(np.float32), expected[:, 4], expected[:, 5]
    assert set(phase) == {0, 1, 2}
    assert set(status) == {0, 1}
    assert 100 < np.count_nonzero(status) < STEPS / 2
    assert np.isfinite(torque).all()
    assert np.abs(torque).max() == motions.LIMIT
    assert len(np.unique(torque)) > 3 * STEPS


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("command", [build.compiler(), ZIG], ids=["cc", "zig"])
def test_on_this_computer(sources: Path, expected: Results, command: tuple[str, ...], level: str) -> None:
    assert (on_this_computer(sources, command, level) == expected).all()


@pytest.mark.parametrize("level", [*(pytest.param(x, marks=SLOW) for x in LEVELS), cross.FAST, cross.SMALL])
@pytest.mark.parametrize("target", ["cortex-m4f", *(pytest.param(x, marks=SLOW) for x in TARGETS if x != "cortex-m4f")])
@pytest.mark.parametrize("kind", KINDS)
def test_on_unicorn(sources: Path, expected: Results, kind: str, target: str, level: str) -> None:
    processor = Processor(image(sources, kind, target, level), target)
    processor.call("motion")
    assert (shaped(processor.variable("results")) == expected).all()


@QEMU
@SLOW
@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("kind", KINDS)
def test_on_qemu(sources: Path, expected: Results, tmp_path: Path, kind: str, target: str, level: str) -> None:
    on_qemu(image(sources, kind, target, level), target, tmp_path)
    assert (shaped((tmp_path / "results.bin").read_bytes()) == expected).all()


@pytest.mark.parametrize("kind", ["zig", pytest.param("gcc", marks=[GCC, SLOW])])
def test_on_unicorn_it_is_what_sympy_says(vishard4: Arm, tmp_path: Path, kind: str) -> None:
    """Every function of the arm and the controller's compensations, by 1e-5 of the sum of |terms|."""
    derived = derive(vishard4)
    for path, text in render.probe_files(derived, LIBRARY).items():
        (tmp_path / path).write_text(text)
    # Functions are called one by one; an image has to have an entry all the same.
    (tmp_path / "start.c").write_text("void start(void);\nvoid start(void)\n{\n}\n")
    shutil.copy(motions.HERE / "motion.ld", tmp_path)
    processor = Processor(kept.image(tmp_path, motions.units(tmp_path), kind))
    for subject in [*verify.arm_subjects(derived), *verify.controller_subjects(derived, LIBRARY)]:
        emulated = verify.Subject(subject.function, {"C float": called(processor, subject)}, subject.draw)
        rng = random.Random(3)
        cases, _ = verify.compare(emulated, [subject.draw(rng) for _ in range(40)])
        assert all(case.equal for case in cases), cases


def called(processor: Processor, subject: verify.Subject) -> verify.Run:
    """A float function of the image, with its arguments and outputs in the processor's memory."""
    function = subject.function
    groups = [] if function.struct is None else [function.struct.symbols]
    groups += [a.symbols for a in function.inputs if a.shape]
    lone = [a.symbols[0] for a in function.inputs if not a.shape]
    sizes = [len(o.expressions) for o in function.outputs]
    places = [processor.place(bytes(4 * len(symbols))) for symbols in groups]
    outputs = [processor.place(bytes(4 * size)) for size in sizes]

    def run(values: Mapping[Any, float]) -> list[float]:
        for place, symbols in zip(places, groups, strict=True):
            processor.write(place, struct.pack(f"<{len(symbols)}f", *(values[s] for s in symbols)))
        number = values[lone[0]] if lone else 0.0
        processor.call(f"vishard4_{function.name}_f32", *places, *outputs, number=number)
        return [x for place, size in zip(outputs, sizes, strict=True) for x in processor.floats(place, size)]

    return run
