"""Batch kernels against the functions of one call, bit for bit where both come from one tape."""

from __future__ import annotations

import ctypes
import os
import random
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_arms import MIXED

from codegen import effect_functions as ef
from codegen import render
from codegen.toolchain import build
from codegen.verify import reference, verify
from runtime.model.loader import Library, Model
from symbolic.effects import LIBRARY
from symbolic.effects.declaration import DT
from symbolic.model import derive
from symbolic.model_file.arm import Arm

SAMPLES = 37


def test_every_function_of_an_arm(vishard4: Arm, model: Model) -> None:
    for subject in verify.arm_subjects(derive(vishard4)):
        function = subject.function
        rng = random.Random(function.name)
        struct = dict(zip(function.struct.symbols, function.struct.defaults, strict=True))
        points = [subject.draw(rng) | struct for _ in range(SAMPLES)]
        arguments = {
            a.name: np.array([[values[s] for values in points] for s in a.symbols]).reshape(*a.shape, SAMPLES)
            for a in function.inputs
        }
        found = model.call(function.name, arguments)
        single = np.array([subject.targets["C double"](values) for values in points]).T
        assert np.array_equal(found.reshape(-1, SAMPLES), single), function.name


@pytest.mark.parametrize("name", [name for name, effect in LIBRARY.items() if effect.states])
def test_states_along_the_samples(name: str, library: Library) -> None:
    """start, then torque and step in turn, by the functions of one call."""
    effect = LIBRARY[name]
    calls = {s.function.name: s.targets.get("C double") for s in verify.effect_subjects([effect])}
    rng = random.Random(name)
    base = reference.effect_values(rng, effect) | {DT: 1e-3}
    points = [
        base | {s.symbol: reference.effect_values(rng, effect)[s.symbol] for s in effect.signals}
        for _ in range(SAMPLES)
    ]
    expected = []
    states = calls[ef.start(effect).name](points[0])
    for values in points:
        values |= dict(zip((s.symbol for s in effect.states), states, strict=True))
        expected += calls[ef.torque(effect).name](values)
        states = calls[ef.step(effect).name](values)
    found = library.torque(
        name,
        {s.name: np.array([v[s.symbol] for v in points]) for s in effect.signals},
        {p.name: base[p.symbol] for p in effect.parameters},
        dt=1e-3,
    )
    # Torque and step share one tape in the batch, so the last bits may differ; the scale is the largest torque.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.max(np.abs(expected)))


@pytest.mark.parametrize("choices", [1, 3, 9])
@pytest.mark.parametrize("name", [*(name for name, effect in LIBRARY.items() if effect.states), "stribeck", "offset"])
def test_many_choices_in_the_band(name: str, choices: int, library: Library) -> None:
    """Through the filter at once as one after another, bit for bit; more than lanes, and fewer."""
    effect, rng = LIBRARY[name], random.Random(name)
    points = [reference.effect_values(rng, effect) for _ in range(4 * SAMPLES)]
    signals = {s.name: np.array([v[s.symbol] for v in points]) for s in effect.signals} | {
        "t": np.arange(4.0 * SAMPLES)
    }
    shapes = [
        {p.name: reference.effect_values(rng, effect)[p.symbol] for p in effect.parameters if p.role == "shape"}
        for _ in range(choices)
    ]
    kernel = np.random.default_rng(0).standard_normal(21)
    found = library.columns_in_band(name, [signals], shapes, 1e-3, kernel, 5)[:, 0]
    alone = [library.decimate(kernel, 5, library.columns(name, signals, shape, 1e-3)) for shape in shapes]
    assert np.array_equal(found, alone, equal_nan=True)
    few = {n: x[:20] for n, x in signals.items()}
    assert library.columns_in_band(name, [few], shapes, 1e-3, kernel, 5).size == 0


@given(taps=st.integers(1, 90), factor=st.integers(1, 30), samples=st.integers(1, 400))
def test_any_filter_at_once(library: Library, taps: int, factor: int, samples: int) -> None:
    """As one row after another, bit for bit: outputs in groups, what is left over of them, and filters too short."""
    rng = np.random.default_rng([taps, factor, samples])
    effect = LIBRARY["lugre"]
    signals = {s.name: rng.uniform(0.5, 2.0, samples) for s in effect.signals}
    shapes = [{p.name: rng.uniform(0.1, 3.0) for p in effect.parameters if p.role == "shape"} for _ in range(3)]
    kernel = rng.standard_normal(taps)
    found = library.columns_in_band("lugre", [signals], shapes, 1e-3, kernel, factor)[:, 0]
    alone = [library.decimate(kernel, factor, library.columns("lugre", signals, shape, 1e-3)) for shape in shapes]
    assert np.array_equal(found, alone)


@pytest.mark.parametrize("choices", [1, 3])
@pytest.mark.parametrize("name", ["elasticity", "backlash", "lugre", "stribeck"])
def test_several_joints_at_once(name: str, choices: int, library: Library) -> None:
    """As each on its own: what stands between the joints differs, and where the memory is each joint's own, all."""
    effect, rng = LIBRARY[name], np.random.default_rng(1)
    own = {s.name: rng.uniform(0.5, 2.0, 300) for s in effect.signals}
    joints = [
        {
            s.name: rng.uniform(0.5, 2.0, 300) if s.between or not effect.gives_way else own[s.name]
            for s in effect.signals
        }
        for _ in range(3)
    ]
    shapes = [{p.name: rng.uniform(0.1, 3.0) for p in effect.parameters if p.role == "shape"} for _ in range(choices)]
    kernel = rng.standard_normal(21)
    found = library.columns_in_band(name, joints, shapes, 1e-3, kernel, 5)
    alone = [library.columns_in_band(name, [signals], shapes, 1e-3, kernel, 5)[:, 0] for signals in joints]
    assert np.array_equal(found, np.stack(alone, axis=1))
    assert np.ptp(found, axis=1).max() > 0


@pytest.mark.parametrize("suffix", ["f64", "f32"])
def test_the_struct_starts_as_the_model_file_says(vishard4: Arm, suffix: str) -> None:
    derived = derive(vishard4)
    library = verify.libraries(render.arm_files(derived), vishard4.name)[suffix]
    real = {"f64": ctypes.c_double, "f32": ctypes.c_float}[suffix]
    fields = (real * len(derived.struct.symbols))()
    getattr(library, f"vishard4_default_parameters_{suffix}")(fields)
    assert list(fields) == [real(value).value for value in derived.struct.defaults]


def other_compilers() -> list[str]:
    """Besides the one in use; the ziglang wheel counts."""
    found = [name for name in ("gcc", "clang") if shutil.which(name)]
    if build.importlib.util.find_spec("ziglang"):
        found.append(f"{sys.executable} -m ziglang cc")
    return [name for name in found if Path(shutil.which(name.split()[0])).resolve() != _own()]


def _own() -> Path:
    return Path(shutil.which(build.compiler()[0])).resolve()


@pytest.mark.slow  # firmware/test_bits.py has both compilers, too
def test_another_compiler_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    others = other_compilers()
    if not others:
        pytest.skip("one compiler only; install clang or the ziglang wheel to compare")
    arm = MIXED["rprrp"]
    subjects = verify.arm_subjects(derive(arm))
    for other in others:
        monkeypatch.setenv("CC", other)
        build.vector_flags.cache_clear()
        again = verify.arm_subjects(derive(arm))
        monkeypatch.delenv("CC")
        build.vector_flags.cache_clear()
        for first, second in zip(subjects, again, strict=True):
            values = first.draw(random.Random(1))
            for target in ("C double", "C float"):
                assert first.targets[target](values) == second.targets[target](values), (other, first.function.name)
    assert "CC" not in os.environ
