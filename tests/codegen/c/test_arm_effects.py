"""The effects of an arm in its own C: what is in it, what is not, and the same torque in float and double.

tests/codegen/package compares the double with NumPy, bit by bit.
"""

from __future__ import annotations

import ctypes
from dataclasses import replace

import numpy as np
import pytest
from random_arms import MIXED, loaded

from codegen import render
from codegen.c.arm_effects import ArmEffects
from codegen.toolchain import build
from symbolic.effects import LIBRARY
from symbolic.model import derive
from symbolic.model_file.arm import Arm

BUSY = loaded(MIXED["rprrp"])


def test_what_other_effects_or_links_decide_is_left_out_and_said() -> None:
    effects = ArmEffects.of(derive(BUSY), LIBRARY)
    whole = {"torque_saturation", "torque_scale", "torque_delay", "torque_lag"}
    assert {site.effect.name for site, _ in effects.left_out} == {*whole, "elasticity", "backlash"}
    assert effects.remembers
    header = render.arm_effect_files(derive(BUSY), LIBRARY)["arm_rprrp_effects_f64.h"]
    assert "Not included: torque_scale@1 (reads predicted)." in header
    assert "lugre@1" in header.split("Not included")[0]


def test_an_arm_without_effects_has_the_same_functions(vishard4: Arm) -> None:
    bare = replace(vishard4, joints=tuple(replace(j, effects={}) for j in vishard4.joints), contact=None)
    effects = ArmEffects.of(derive(bare), LIBRARY)
    assert not effects.remembers
    named = [routine.declaration for routine in effects.routines(render.F64)]
    assert [text.split("(")[0].removeprefix("void vishard4_") for text in named] == [
        "default_effect_values_f64",
        "effects_start_f64",
        "effects_add_f64",
        "effects_step_f64",
    ]
    assert "Included: no effect." in render.arm_effect_files(derive(bare), LIBRARY)["vishard4_effects_f64.h"]


def test_an_open_value_is_zero_and_said(vishard4: Arm) -> None:
    first = replace(vishard4.joints[0], effects={"viscous": {}})
    arm = replace(vishard4, joints=(first, *vishard4.joints[1:]))
    text = render.arm_effect_files(derive(arm), LIBRARY)["vishard4_effects_f64.c"]
    assert "effect_values->joint1_viscous_coefficient = 0.0; /* not in the model file: to be set */" in text


@pytest.fixture(scope="module")
def code() -> ctypes.CDLL:
    model = derive(BUSY)
    files = {**render.arm_files(model), **render.arm_effect_files(model, LIBRARY)}
    return ctypes.CDLL(str(build.shared_library({k: v for k, v in files.items() if k[-2:] in (".c", ".h")}, "effects")))


def along(code: ctypes.CDLL, suffix: str, real: type) -> np.ndarray:
    """(N, n) what the effects add along a slow motion."""
    call = lambda name, *arguments: getattr(code, f"arm_rprrp_{name}_{suffix}")(*arguments)  # noqa: E731
    parameters, values, memory = ((real * 500)() for _ in range(3))
    call("default_parameters", parameters)
    call("default_effect_values", values)
    torques = []
    for k in range(200):
        phase = 0.01 * k + np.arange(5.0)
        motion = [(real * 5)(*row) for row in (0.5 * np.sin(phase), 0.5 * np.cos(phase), -0.5 * np.sin(phase))]
        tau = (real * 5)()
        if k == 0:
            call("effects_start", parameters, values, *motion, memory)
        call("effects_add", parameters, values, *motion, memory, tau)
        call("effects_step", parameters, values, *motion, real(0.01), memory)
        torques.append(list(tau))
    return np.array(torques)


def test_float_is_double_within_its_rounding(code: ctypes.CDLL) -> None:
    double, single = along(code, "f64", ctypes.c_double), along(code, "f32", ctypes.c_float)
    scale = np.abs(double).max(axis=0)
    assert (scale > 0.1).all()
    assert (np.abs(single - double).max(axis=0) < 2e-5 * scale).all()
