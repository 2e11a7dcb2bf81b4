"""What the control step costs on a Cortex-M4F, in instructions: no more than was asked, and it may not grow."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from dataclasses import replace
from math import pi
from pathlib import Path

import kept
import motions
import numpy as np
import pytest
from compositions import there_and_back
from emulation import Meter, Processor, places

from codegen import prepare
from codegen.toolchain import cross
from runtime.execution.execute import execute
from runtime.execution.options import ExecutionSettings
from runtime.hardware.boards import UnicornBoard
from runtime.model.loader import Model
from runtime.planning.trajectory import Trajectory
from symbolic.effects import LIBRARY
from symbolic.model_file.arm import Arm

GCC = pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="needs gcc-arm-none-eabi")
KINDS = [pytest.param("zig"), pytest.param("gcc", marks=GCC)]
M4F = cross.TARGETS["cortex-m4f"]
STEP = "vishard4_controller_step_f32"
STEPS = 2000
INVERSE_DYNAMICS, FREE, CONTACT = 290, {7: 950, 10: 1030}, 2250
WHOLE = {7: {"zig": 1100, "gcc": 1100}, 10: {"zig": 1150, "gcc": 1100}}
"""Instructions at most: the controller's step by degree, and along the plate; the machine's, guard, watchdog and
counters besides, by degree and compiler. Asked: 290, and 1100 for a whole step in a free phase. The paper's free phases
are of degree 10."""


@pytest.fixture(scope="module")
def motion(vishard4: Arm, model: Model, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Trajectory], Path]:
    """The image of a motion, compiled as the firmware is."""

    def image(kind: str, plan: Trajectory) -> Path:
        directory = tmp_path_factory.mktemp("motion")
        motions.write(directory, vishard4, model, plan, STEPS)
        return kept.image(directory, motions.units(directory), kind)

    return image


def steps(image: Path) -> tuple[np.ndarray, np.ndarray]:
    """(STEPS,) instructions of every step of a motion; (STEPS, 2) its phase and status."""
    processor = Processor(image)
    meter = Meter(processor.cpu, processor.symbols, STEP)
    processor.call("motion")
    flags = np.frombuffer(processor.variable("results"), np.uint32).reshape(STEPS, 6)[:, 4:]
    return np.array(meter.counts[STEP]), flags


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("degree", [pytest.param(7, marks=pytest.mark.slow), 10])
def test_a_free_phase(motion: Callable[..., Path], model: Model, kind: str, degree: int) -> None:
    """All effects and four springs, joints fast and slow, early and late in a phase, changes of phase, limits."""
    plan = motions.plan(model, motions.free(degree), motions.slow(degree), plate=False)
    counts, flags = steps(motion(kind, plan))
    assert len(counts) == STEPS
    assert set(flags[:, 0]) == set(flags[:, 1]) == {0, 1}
    assert counts.max() <= FREE[degree]


@pytest.mark.parametrize("kind", KINDS)
def test_along_the_plate(motion: Callable[..., Path], model: Model, kind: str) -> None:
    counts, _ = steps(motion(kind, motions.plan(model, motions.sliding(model, 7))))
    assert FREE[7] < counts.max() <= CONTACT


@pytest.mark.parametrize("kind", KINDS)
def test_inverse_dynamics(motion: Callable[..., Path], model: Model, kind: str) -> None:
    """Whatever the angles."""
    processor = Processor(motion(kind, motions.plan(model, motions.slow(3))))
    name = "vishard4_inverse_dynamics_f32"
    parameters = processor.place(bytes(4 * len(model.metadata["struct"])))
    processor.call("vishard4_default_parameters_f32", parameters)
    q, qd, qdd, tau = (processor.place(bytes(16)) for _ in range(4))
    meter = Meter(processor.cpu, processor.symbols, name)
    rng = np.random.default_rng(0)
    edges = [0.0, -0.0, 1e-40, pi / 4, pi / 2, pi, -3 * pi / 4, 1e4, -1e30, np.inf, np.nan]
    angles = [*rng.uniform(-7, 7, (150, 4)), *rng.choice(edges, (100, 4))]
    for angle in angles:
        for place, values in ((q, angle), (qd, rng.uniform(-5, 5, 4)), (qdd, rng.uniform(-50, 50, 4))):
            processor.write(place, struct.pack("<4f", *values))
        processor.call(name, parameters, q, qd, qdd, tau)
    assert len(meter.counts[name]) == len(angles)
    assert max(meter.counts[name]) <= INVERSE_DYNAMICS


@pytest.mark.parametrize("kind", ["zig", pytest.param("gcc", marks=[GCC, pytest.mark.slow])])
@pytest.mark.parametrize("degree", [pytest.param(7, marks=pytest.mark.slow), 10])
def test_a_step_of_the_machine(vishard4: Arm, model: Model, kind: str, degree: int) -> None:
    """In a run on the simulated arm that is recorded at the control rate; the first step, which also looks where the
    arm stands, and the steps of an arm that waits apart."""
    directory = prepare.prepare_firmware(vishard4, LIBRARY, M4F.name, kind)
    plan = replace(there_and_back(1.6, degree=degree), springs=motions.springs())
    meters = []

    def board(directory: Path, name: str, n: int) -> UnicornBoard:
        made = UnicornBoard(directory, name, n)
        meters.append(Meter(made.cpu, places(made.image.with_suffix(".elf")), STEP, "tendon_machine_step"))
        return made

    done = execute(model, directory, plan, ExecutionSettings(trials=1, cycles=1), board=board)
    assert done.document().to_json()["status"] == "done", json.dumps(done.document().to_json())[:500]
    counts = meters[0].counts
    running = [count for count in counts["tendon_machine_step"] if count > min(counts[STEP])]
    assert len(running) == len(counts[STEP])
    assert max(running[1:]) <= WHOLE[degree][kind]
