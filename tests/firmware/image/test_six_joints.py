"""A spatial arm of six joints through the whole chain: the same recording on this computer and on emulated boards, bit
for bit, and an image that fits them."""

from __future__ import annotations

import json
import shutil
import struct
from math import pi
from pathlib import Path

import kept
import motions
import numpy as np
import pytest
from emulation import Meter, Processor, places

from codegen import prepare, render
from codegen.toolchain import cross
from runtime.execution.execute import SIMULATED, Execution, execute
from runtime.execution.options import ExecutionSettings
from runtime.hardware.boards import UnicornBoard
from runtime.model.loader import Library, Model
from runtime.planning.trajectory import Phase, Trajectory
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file.arm import Arm
from tests.six_joints import START, six_joints

pytestmark = pytest.mark.xdist_group("six joints")
QEMU = pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="needs qemu-system-arm")
EMULATED = [pytest.param("unicorn"), pytest.param("qemu", marks=[QEMU, pytest.mark.slow])]
M4F = cross.TARGETS["cortex-m4f"]
STEP, INVERSE_DYNAMICS = "six_controller_step_f32", "six_inverse_dynamics_f32"
TEXT, STACK = 20 * 1024, 1024
"""Bytes that the image may have; planar arms of four joints are held to 16 kB of text and the same stack."""
WHOLE, RIGID = 2000, 700
"""Instructions at most: of a control period with guard, watchdog and counters, and of the inverse dynamics in it,
whatever the angles."""


ALONE = """#include "six_f32.h"
six_parameters_f32 parameters;
float q[6], qd[6], qdd[6], tau[6];
void start(void);
void start(void)
{
    six_default_parameters_f32(&parameters);
    six_inverse_dynamics_f32(&parameters, q, qd, qdd, tau);
}
typedef struct {
    void *stack;
    void (*reset)(void);
} table;
extern const table vectors;
const table vectors __attribute__((section(".vectors"), used)) = {(void *)0x20300000, start};
"""


@pytest.fixture(scope="module")
def arm() -> Arm:
    return six_joints()


@pytest.fixture(scope="module")
def six(arm: Arm, library: Library) -> Model:
    return Model(prepare.prepare_arm(arm), library)


@pytest.fixture(scope="module")
def plan() -> Trajectory:
    """All joints from rest to rest, 0.4 rad or less away, with a spring at joint 2."""
    start = np.array(list(START.values()))
    way = np.array([0.4, 0.3, -0.3, 0.3, -0.4, 0.4])
    points = start[:, None] + way[:, None] * np.array([0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0])
    spring = {2: {"stiffness": 3000.0, "radius": 0.06, "offset": -1.0, "pretension": 3.0}}
    return Trajectory("six", "reach", (Phase("q", 0.6, points),), False, 1.0, True, spring, {})


def on(six: Model, arm: Arm, plan: Trajectory, target: str) -> Execution:
    board = SIMULATED[target]
    directory = prepare.prepare_firmware(arm, LIBRARY, board.build)
    return execute(six, directory, plan, ExecutionSettings(trials=1, cycles=1), board=board.board)


@pytest.fixture(scope="module")
def here(six: Model, arm: Arm, plan: Trajectory) -> Execution:
    return on(six, arm, plan, "simulation")


def test_the_simulated_arm_follows(here: Execution) -> None:
    document = here.document().to_json()
    assert document["status"] == "done"
    trial = here.trials[0]
    assert np.abs(trial.q - trial.q_desired).max() < 0.02


@pytest.mark.parametrize("target", EMULATED)
def test_the_same_recording_bit_for_bit(six: Model, arm: Arm, plan: Trajectory, here: Execution, target: str) -> None:
    there = on(six, arm, plan, target)
    for name in ("t", "q", "q_desired", "tau", "saturated"):
        own, other = (np.asarray(getattr(done.trials[0], name)) for done in (here, there))
        np.testing.assert_array_equal(own, other, err_msg=name)


def test_the_image_fits(board: Path) -> None:
    image = json.loads((board / "image.json").read_text())
    assert image["text"] <= TEXT
    assert image["stack"]["worst"] <= STACK
    assert image["forbidden"] == []


@pytest.fixture(scope="module")
def board(arm: Arm) -> Path:
    """The firmware for the emulated board."""
    return prepare.prepare_firmware(arm, LIBRARY, M4F.name, "zig")


def test_what_a_control_period_costs(six: Model, board: Path, plan: Trajectory) -> None:
    meters = []

    def metered(directory: Path, name: str, n: int) -> UnicornBoard:
        made = UnicornBoard(directory, name, n)
        meters.append(Meter(made.cpu, places(made.image.with_suffix(".elf")), STEP, "tendon_machine_step"))
        return made

    done = execute(six, board, plan, ExecutionSettings(trials=1, cycles=1), board=metered)
    assert done.document().to_json()["status"] == "done"
    counts = meters[0].counts
    running = [count for count in counts["tendon_machine_step"] if count > min(counts[STEP])]
    assert max(running[1:]) <= WHOLE


def test_what_the_inverse_dynamics_cost(six: Model, arm: Arm, tmp_path: Path) -> None:
    for path, text in render.arm_files(derive(arm)).items():
        if path.endswith(("_f32.c", "_f32.h")):
            (tmp_path / path).write_text(text)
    (tmp_path / "alone.c").write_text(ALONE)
    shutil.copy(Path(motions.__file__).with_name("motion.ld"), tmp_path)
    processor = Processor(kept.image(tmp_path, motions.units(tmp_path), "zig"))
    parameters = processor.place(bytes(4 * len(six.metadata["struct"])))
    processor.call("six_default_parameters_f32", parameters)
    q, qd, qdd, tau = (processor.place(bytes(24)) for _ in range(4))
    meter = Meter(processor.cpu, processor.symbols, INVERSE_DYNAMICS)
    rng = np.random.default_rng(0)
    edges = [0.0, -0.0, 1e-40, pi / 4, pi / 2, pi, -3 * pi / 4, 1e4, -1e30, np.inf, np.nan]
    angles = [*rng.uniform(-7, 7, (60, 6)), *rng.choice(edges, (60, 6))]
    for angle in angles:
        for place, values in ((q, angle), (qd, rng.uniform(-5, 5, 6)), (qdd, rng.uniform(-50, 50, 6))):
            processor.write(place, struct.pack("<6f", *values))
        processor.call(INVERSE_DYNAMICS, parameters, q, qd, qdd, tau)
    assert max(meter.counts[INVERSE_DYNAMICS]) <= RIGID
