"""The controller gives the same torques, to the bit, wherever and however it is compiled; and they are SymPy's."""

from __future__ import annotations

import ctypes
import os
import random
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from compositions import PLATE, POSTURE, trajectory
from emulation import Processor

from codegen import build, render, toolchain, verify, workspace
from codegen.controller import Controller
from runtime.hardware.settings import Settings
from runtime.loader import Model
from runtime.planning.trajectory import Phase, Trajectory
from symbolic.arm import Arm
from symbolic.effects import LIBRARY
from symbolic.model import derive

HERE = Path(__file__).resolve().parent
STEPS, NOISE = 10_000, 15
"""Of the motion; counts that the encoders' noise has as values."""
LIMIT = 45.0
"""N m, which the motion asks for more than."""
GCC = pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="needs gcc-arm-none-eabi")
QEMU = pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="needs qemu-system-arm")
ZIG = (sys.executable, "-m", "ziglang", "cc")
KINDS = [pytest.param("zig"), pytest.param("gcc", marks=GCC)]
TARGETS = list(toolchain.TARGETS)
LEVELS = ["-O0", "-O3"]
Results = np.ndarray
Images = Callable[[str, str, str], Path]


def demanding(model: Model) -> Trajectory:
    """Two phases of the joints, one of them slow, about one that slides along the plate; springs at all joints."""
    rng = np.random.default_rng(5)
    far = POSTURE[:, None] + np.cumsum(rng.uniform(-0.3, 0.3, (4, 8)), axis=1)
    w = model.contact_coordinates(POSTURE)[:, None] + 0.01 * rng.normal(size=(4, 11)) * [[0], [1], [3], [3]]
    slow = POSTURE[:, None] + 0.02 * rng.normal(size=(4, 4))
    springs = {
        joint: {"stiffness": 900.0 * joint, "radius": 0.06, "offset": float(POSTURE[joint - 1]), "pretension": 3.0}
        for joint in range(1, 5)
    }
    contact = {**PLATE, "plate": {**PLATE["plate"], "position": float(model.tip(POSTURE)[1])}}
    phases = [Phase("q", 0.9003, far), Phase("w", 1.1, w), Phase("q", 0.7, slow)]
    return trajectory(phases, springs=springs, contact=contact)


def initializer(values: Mapping[str, Any]) -> str:
    return "{" + ", ".join(f".{name} = {literal(value)}" for name, value in values.items()) + "}"


def literal(value: Any) -> str:
    """Of C: exact."""
    if isinstance(value, Mapping):
        return initializer(value)
    if isinstance(value, (list, tuple, np.ndarray)):
        return "{" + ", ".join(map(literal, value)) + "}"
    if isinstance(value, (float, np.floating)):
        return f"{float(np.float32(value)).hex()}f"
    return str(value)


def header(settings: Settings, page: Mapping[str, Any], zero: list[int]) -> str:
    """The motion's settings as C."""
    t, n = settings.trajectory, page["n"]
    drive = {**settings.drive, "zero": zero, "torque_limit": [LIMIT] * n}
    config = {"parameters": settings.parameters, "effects": settings.effects, **drive}
    fields = {r["name"]: [f["name"] for f in r["fields"]] for r in page["records"]}
    contact = {name: t[name] for name in fields["vishard4_contact_f32"]}
    springs = [{name: t[f"spring_{name}"][j] for name in page["springs"]} for j in range(n)]
    lines = ['#include "vishard4_controller_f32.h"', f"#define STEPS {STEPS}U", f"#define NOISE {NOISE}U"]
    lines.append(f"static const int32_t begin[{n}] = {literal(zero)};")
    lines.append(f"static const vishard4_contact_f32 contact = {literal(contact)};")
    lines.append(f"static const float points[{settings.points.size}] = {literal(settings.points.ravel())};")
    phases = [
        f"{{.coordinates = {p['coordinates']}U, .degree = {p['degree']}U, .duration = {literal(p['duration'])}, "
        f".points = &points[{n * p['first_row']}], .contact = {'&contact' if p['touches'] else 'NULL'}}}"
        for p in settings.phases
    ]
    lines.append(f"static const vishard4_phase_f32 phases[{len(phases)}] = {{{', '.join(phases)}}};")
    lines.append(f"static const vishard4_config_f32 config = {literal(config)};")
    given = {"count": t["count"], "periodic": t["periodic"], "elbow": float(t["elbow"]), "springs": springs}
    lines.append(f"static const vishard4_trajectory_f32 trajectory = {initializer(given)[:-1]}, .phases = phases}};")
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def sources(vishard4: Arm, model: Model, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with the generated C and the motion."""
    directory = tmp_path_factory.mktemp("motion")
    derived = derive(vishard4)
    files = render.arm_files(derived) | render.controller_files(derived, LIBRARY)
    for path, text in files.items():
        if path.endswith(("_f32.c", "_f32.h")):
            (directory / path).write_text(text)
    prepared = workspace.prepare_firmware(vishard4, LIBRARY)
    # Two of the encoders' counters overflow on the way.
    zero = [0, 2**31 - 9000, -(2**31) + 5000, -77]
    settings = Settings.of(prepared, model, demanding(model))
    (directory / "motion.h").write_text(header(settings, Controller.of(derived, LIBRARY).document(), zero))
    for name in ("motion.c", "motion.ld"):
        shutil.copy(HERE / name, directory)
    return directory


def units(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.glob("*.c"))


def on_this_computer(directory: Path, command: tuple[str, ...], level: str) -> Results:
    """The motion's results as a shared library of this computer gives them."""
    library = directory / f"host{abs(hash((command, level)))}.so"
    flags = [flag for flag in build.FLAGS if not flag.startswith("-O")]
    # Else zig compiles runtime libraries first.
    flags += ["-fno-sanitize=all", "-nostdlib"] if "ziglang" in command else []
    environment = os.environ | {"ZIG_GLOBAL_CACHE_DIR": str(build.cache_directory() / "zig")}
    subprocess.run(
        [*command, *flags, level, *units(directory), "-o", str(library)], cwd=directory, check=True, env=environment
    )
    loaded = ctypes.CDLL(str(library))
    loaded.motion()
    return shaped(bytes((ctypes.c_uint32 * (STEPS * 6)).in_dll(loaded, "results")))


def shaped(data: bytes) -> Results:
    return np.frombuffer(data, np.uint32).reshape(STEPS, 6)


@pytest.fixture(scope="module")
def expected(sources: Path) -> Results:
    return on_this_computer(sources, build.compiler(), "-O2")


@pytest.fixture(scope="module")
def images(sources: Path) -> Images:
    """Of compiler, processor and optimisation; each compiled once."""
    made: dict[tuple[str, str, str], Path] = {}

    def image(kind: str, target: str, level: str) -> Path:
        key = (kind, target, level)
        if key not in made:
            made[key] = toolchain.compile_image(
                sources,
                units(sources),
                "motion.ld",
                toolchain.TARGETS[target],
                toolchain.find(kind),
                output=f"{'-'.join(key)}/motion",
                include=(".",),
                optimisation=level,
            ).elf
        return made[key]

    return image


def test_the_motion_is_demanding(expected: Results) -> None:
    """All phases, limits reached, and no torque that is no number."""
    torque, phase, status = expected[:, :4].view(np.float32), expected[:, 4], expected[:, 5]
    assert set(phase) == {0, 1, 2}
    assert set(status) == {0, 1}
    assert 100 < np.count_nonzero(status) < STEPS / 2
    assert np.isfinite(torque).all()
    assert np.abs(torque).max() == LIMIT
    assert len(np.unique(torque)) > 3 * STEPS


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("command", [build.compiler(), ZIG], ids=["cc", "zig"])
def test_on_this_computer(sources: Path, expected: Results, command: tuple[str, ...], level: str) -> None:
    assert (on_this_computer(sources, command, level) == expected).all()


@pytest.mark.parametrize("level", [*LEVELS, toolchain.FAST, toolchain.SMALL])
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("kind", KINDS)
def test_on_unicorn(images: Images, expected: Results, kind: str, target: str, level: str) -> None:
    processor = Processor(images(kind, target, level), target)
    processor.call("motion")
    assert (shaped(processor.variable("results")) == expected).all()


@QEMU
@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("kind", KINDS)
def test_on_qemu(images: Images, expected: Results, tmp_path: Path, kind: str, target: str, level: str) -> None:
    machine = toolchain.TARGETS[target].machine
    command = ["qemu-system-arm", "-M", machine, "-kernel", str(images(kind, target, level)), "-display", "none"]
    command += ["-monitor", "none", "-serial", "none", "-semihosting-config", "enable=on,target=native"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=60, stdin=subprocess.DEVNULL)
    assert (shaped((tmp_path / "results.bin").read_bytes()) == expected).all()


@pytest.mark.parametrize("kind", KINDS)
def test_on_unicorn_it_is_what_sympy_says(vishard4: Arm, tmp_path: Path, kind: str) -> None:
    """Every function of the arm and the controller's compensations, by 1e-5 of the sum of |terms|."""
    derived = derive(vishard4)
    for path, text in render.probe_files(derived, LIBRARY).items():
        (tmp_path / path).write_text(text)
    shutil.copy(HERE / "motion.ld", tmp_path)
    target, tools = toolchain.TARGETS["cortex-m4f"], toolchain.find(kind)
    image = toolchain.compile_image(tmp_path, units(tmp_path), "motion.ld", target, tools, include=(".",))
    processor = Processor(image.elf)
    for subject in [*verify.arm_subjects(vishard4), *verify.controller_subjects(vishard4, LIBRARY)]:
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
