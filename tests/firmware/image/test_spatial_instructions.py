"""Instructions of the inverse dynamics of arms in space on an emulated Cortex-M4F, whatever the angles."""

from __future__ import annotations

import shutil
import struct
from math import pi
from pathlib import Path

import kept
import numpy as np
import pytest
import spatial_arms
from emulation import Meter, Processor

from codegen import render
from symbolic.model import derive

GCC = pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="needs gcc-arm-none-eabi")
MOST = {"ur10e": 820, "iiwa": 1000}
"""Instructions; asked: 1000 for six joints."""
CALLS = """#include "{name}_f32.h"
void start(
    {name}_parameters_f32 *p, const float q[{n}], const float qd[{n}], const float qdd[{n}], float tau[{n}]);
void start(
    {name}_parameters_f32 *p, const float q[{n}], const float qd[{n}], const float qdd[{n}], float tau[{n}])
{{
    {name}_default_parameters_f32(p);
    {name}_inverse_dynamics_f32(p, q, qd, qdd, tau);
}}
"""


@pytest.mark.parametrize("kind", [pytest.param("zig"), pytest.param("gcc", marks=GCC)])
@pytest.mark.parametrize("name", MOST)
def test_inverse_dynamics(name: str, kind: str, tmp_path: Path) -> None:
    model = derive(spatial_arms.known(name))
    n = len(model.arm.joints)
    for path, text in render.arm_files(model).items():
        if path.endswith("f32.h") or path == f"{name}_f32.c":
            (tmp_path / path).write_text(text)
    (tmp_path / "motion.c").write_text(CALLS.format(name=name, n=n))
    shutil.copy(Path(kept.__file__).with_name("motion.ld"), tmp_path)
    processor = Processor(kept.image(tmp_path, ["motion.c", f"{name}_f32.c"], kind))
    meter = Meter(processor.cpu, processor.symbols, f"{name}_inverse_dynamics_f32")
    parameters = processor.place(bytes(4 * len(model.struct.symbols)))
    q, qd, qdd, tau = (processor.place(bytes(4 * n)) for _ in range(4))
    rng = np.random.default_rng(0)
    edges = [0.0, -0.0, 1e-40, pi / 4, pi / 2, pi, -3 * pi / 4, 1e4, -1e30, np.inf, np.nan]
    angles = [*rng.choice(edges, (60, n)), *rng.uniform(-7, 7, (100, n))]
    for angle in angles:
        rates, accelerations = rng.uniform(-5, 5, n), rng.uniform(-50, 50, n)
        for place, values in ((q, angle), (qd, rates), (qdd, accelerations)):
            processor.write(place, struct.pack(f"<{n}f", *values))
        processor.call("start", parameters, q, qd, qdd, tau)
    counts = meter.counts[f"{name}_inverse_dynamics_f32"]
    assert len(counts) == len(angles)
    assert max(counts) <= MOST[name]
    expected = spatial_arms.torques(spatial_arms.known(name), angle, rates, accelerations)
    np.testing.assert_allclose(processor.floats(tau, n), expected, atol=1e-5 * np.abs(expected).max())
