"""Many samples at once, several in a vector: every one has the bits of a call for itself alone."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np
import pytest
import spatial_arms
from random_arms import MIXED

from codegen import render
from codegen.c import c_code, c_lanes
from codegen.tape.tape import Tape
from codegen.toolchain import build
from symbolic.functions import SymbolicFunction
from symbolic.model import ArmModel, derive
from symbolic.model_file.arm import Arm

ARMS = {arm.name: arm for arm in (MIXED["rprrp"], spatial_arms.known("rx90"), spatial_arms.drawn("rrpr", 4))}
COUNTS = (0, 1, 2, 7, 8, 9, 37)
"""Of samples: below a vector's lanes, whole vectors, and some left over."""
BLOCKS = (37, c_code.BLOCK, 2 * c_code.BLOCK + 5)
"""Of functions that go on from another one, a block of samples after the other."""


def counts(function: SymbolicFunction) -> tuple[int, ...]:
    if function.continues is not None:
        return BLOCKS
    return COUNTS if function.name == "inverse_dynamics" else COUNTS[-1:]


@cache
def derived(name: str) -> ArmModel:
    return derive(ARMS[name])


def library(model: ArmModel) -> ctypes.CDLL:
    files = {path: text for path, text in render.arm_files(model).items() if path.endswith(("f64.c", "f64.h"))}
    return ctypes.CDLL(str(build.shared_library(files, model.arm.name, build.STRAIGHT)))


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def one_by_one(call: ctypes._CFuncPtr, arrays: list[np.ndarray], size: int) -> np.ndarray:
    parameters, *inputs = arrays
    results = np.zeros((size, inputs[0].shape[1]))
    for k, result in enumerate(results.T):
        out, vectors = np.zeros(size), [np.ascontiguousarray(a[:, k]) for a in inputs]
        call(pointer(parameters), *map(pointer, vectors), pointer(out))
        result[:] = out
    return results


@pytest.mark.parametrize("flags", [None, ()], ids=["widest", "plain"])
@pytest.mark.parametrize("name", ARMS)
def test_every_sample_has_the_bits_of_its_own_call(
    name: str, flags: tuple[str, ...] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    if flags is not None:
        monkeypatch.setattr(build, "vector_flags", lambda _=None: flags)
    model = derived(name)
    compiled, rng = library(model), np.random.default_rng(1)
    parameters = np.array(model.struct.defaults)
    going_on = {f.name for f in model.functions if f.continues is not None}
    assert going_on == ({"link_load", "link_inertia"} if model.arm.space else set())
    for function in model.functions:
        assert c_lanes.in_lanes(Tape.of(function)), function.name
        for count in counts(function):
            inputs = [rng.uniform(-4, 4, (len(a.symbols), count)) for a in function.inputs]
            size = len(function.outputs[0].expressions)
            found = np.full((size, count), np.nan)
            batch = getattr(compiled, f"{name}_{function.name}_batch_f64")
            batch(ctypes.c_size_t(count), pointer(parameters), *map(pointer, inputs), pointer(found))
            call = getattr(compiled, f"{name}_{function.name}_f64")
            expected = one_by_one(call, [parameters, *inputs], size)
            np.testing.assert_array_equal(found, expected, err_msg=f"{function.name} of {count}")


def test_what_vectors_do_not_have_stays_a_loop(vishard4: Arm) -> None:
    """The contact's inverse takes an arc tangent."""
    function = derive(vishard4).function("contact_inverse")
    assert not c_lanes.in_lanes(Tape.of(function))


EACH = """
#include "tendon_lanes_f64.h"
void each(int count, const double *x, double *sine, double *cosine);
void alone(int count, const double *x, double *sine, double *cosine);
void each(int count, const double *x, double *sine, double *cosine)
{
    tendon_sincos_each_f64(count, x, sine, cosine);
}
void alone(int count, const double *x, double *sine, double *cosine)
{
    for (int k = 0; k < count; ++k) {
        tendon_sincos_f64(x[k], &sine[k], &cosine[k]);
    }
}
"""


@pytest.mark.parametrize("flags", [None, ()], ids=["widest", "plain"])
def test_angles_taken_together_have_the_bits_of_one_alone(
    flags: tuple[str, ...] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    if flags is not None:
        monkeypatch.setattr(build, "vector_flags", lambda _=None: flags)
    arm = render.arm_files(derived("rx90"))
    files = {path: arm[path] for path in ("tendon_lanes_f64.h", "tendon_math_f64.h")} | {"each.c": EACH}
    compiled, rng = ctypes.CDLL(str(build.shared_library(files, "each", build.STRAIGHT))), np.random.default_rng(2)
    for count in range(1, 17):
        x = np.zeros(16)
        x[:count] = rng.uniform(-4000, 4000, count)
        found, expected = np.zeros((2, 2, 16))
        for call, (sine, cosine) in ((compiled.each, found), (compiled.alone, expected)):
            call(count, pointer(x), pointer(sine), pointer(cosine))
        assert found[:, :count].tobytes() == expected[:, :count].tobytes()
