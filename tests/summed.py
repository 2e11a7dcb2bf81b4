"""The generated statistics of an arm, compiled for this computer, along a recording."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from pathlib import Path

import numpy as np

from codegen import render
from codegen.c.c_code import Precision
from codegen.c.statistics import ModelStatistics
from codegen.toolchain import build
from runtime.motion.noise import resolution
from runtime.recordings.board_sums import BoardSums
from runtime.recordings.recording import Recording
from symbolic.effects import LIBRARY
from symbolic.model import ArmModel, derive
from symbolic.model_file.arm import Arm, ArmMonitor, Control, JointMonitor

CALL = """\
#include "{name}_statistics_{s}.h"
void along(
    uint32_t count, const int32_t *counts, const {real} *per_count, const {real} *torque,
    {name}_products_{s} *products);
void along(
    uint32_t count, const int32_t *counts, const {real} *per_count, const {real} *torque,
    {name}_products_{s} *products)
{{
    static const int32_t zero[{n}];
    static {name}_parameters_{s} parameters;
    static {name}_statistics_{s} state;
    {name}_default_parameters_{s}(&parameters);
    {name}_statistics_reset_{s}(&state);
    for (uint32_t k = 0U; k < count; ++k) {{
        {name}_statistics_step_{s}(&parameters, per_count, zero, &state, &torque[{n}U * k], &counts[{n}U * k]);
    }}
    *products = state.products;
}}
"""


def with_statistics(arm: Arm, rate: float, cutoff: float) -> ArmModel:
    """The arm with a monitor that adds up, at a control rate (Hz)."""
    control = Control(rate, velocity_cutoff=rate / 10, friction_scale=0.9, friction_slope=150.0)
    joints = (JointMonitor(floor=0.1, load_floor=0.0, slowest=0.05, freedom=None),) * len(arm.joints)
    return derive(replace(arm, controller=control, monitor=ArmMonitor(cutoff, 1.0, joints, statistics=True)))


def board_sums(model: ArmModel, recording: Recording, precision: Precision) -> BoardSums:
    """What a board with this precision adds up along a recording, which was sampled at the control rate."""
    found = ModelStatistics.of(model, LIBRARY)
    assert found is not None
    n, s, name = len(model.arm.joints), precision.suffix, model.arm.name
    files = render.arm_files(model) | render.statistics_files(model, LIBRARY, precision)
    code = {path: text for path, text in files.items() if path.endswith((f"_{s}.c", f"_{s}.h"))}
    code["along.c"] = CALL.format(name=name, s=s, real=precision.kind, n=n)
    library = ctypes.CDLL(str(build.shared_library(code, "code")))
    real = np.float32 if s == "f32" else np.float64
    step = np.array([resolution(q) for q in recording.q])
    counts = np.ascontiguousarray(np.round(recording.q / step[:, None]).T, dtype=np.int32)
    torque, per_count = np.ascontiguousarray(recording.tau.T, dtype=real), step.astype(real)
    products = np.zeros(2 * found.products * real().itemsize + 4 * n, dtype=np.uint8)
    arrays = (ctypes.c_void_p(x.ctypes.data) for x in (counts, per_count, torque, products))
    library.along(ctypes.c_uint32(len(counts)), *arrays)
    sums = products[: -4 * n].view(real).astype(np.float64).reshape(2, -1).sum(axis=0)
    rows = products[-4 * n :].view(np.uint32).astype(np.float64)
    return BoardSums(Path("board.json"), name, found.document(), sums, rows)
