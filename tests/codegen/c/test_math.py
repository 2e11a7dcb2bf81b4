"""The inlined elementary functions, by units in the last place."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest

from codegen import render
from codegen.c.c_code import F32, F64, Precision
from codegen.toolchain import build

PRECISIONS = {"f32": F32, "f64": F64}
REAL: dict[str, Any] = {"f32": np.float32, "f64": np.float64}
BIND = """
void {name}(size_t n, const {real} *x, const {real} *y, {real} *out)
{{
    for (size_t i = 0; i < n; ++i) {{
        (void)y;
        out[i] = {call};
    }}
}}
"""
CALLS = {
    "sin": "tendon_sin_{s}(x[i])",
    "cos": "tendon_cos_{s}(x[i])",
    "exp": "tendon_exp_{s}(x[i])",
    "rise": "tendon_rise_{s}(x[i])",
    "log": "tendon_log_{s}(x[i])",
    "atan2": "tendon_atan2_{s}(x[i], y[i])",
    "pow": "tendon_pow_{s}(x[i], y[i])",
}


def compiled(precision: Precision) -> Callable[..., np.ndarray]:
    s = precision.suffix
    text = f'#include <stddef.h>\n#include "tendon_math_{s}.h"\n' + "".join(
        BIND.format(name=f"all_{name}", real=precision.kind, call=call.format(s=s)) for name, call in CALLS.items()
    )
    files = {"probe.c": text, f"tendon_math_{s}.h": render.math_header(precision)}
    library = ctypes.CDLL(str(build.shared_library(files, "probe")))

    def run(name: str, x: np.ndarray, y: np.ndarray | None = None) -> np.ndarray:
        x = np.ascontiguousarray(x, REAL[s])
        y = x if y is None else np.ascontiguousarray(y, REAL[s])
        out = np.empty_like(x)
        pointers = [ctypes.c_void_p(a.ctypes.data) for a in (x, y, out)]
        getattr(library, f"all_{name}")(ctypes.c_size_t(len(x)), *pointers)
        return out

    return run


@pytest.fixture(scope="module")
def functions() -> dict[str, Callable[..., np.ndarray]]:
    return {suffix: compiled(precision) for suffix, precision in PRECISIONS.items()}


def ulps(found: np.ndarray, exact: list[mpmath.mpf]) -> float:
    """Largest error in units in the last place of the exact value."""
    kind = found.dtype.type
    worst = 0.0
    for y, x in zip(found, exact, strict=True):
        unit = np.spacing(np.maximum(np.abs(kind(float(x))), np.finfo(kind).tiny))
        worst = max(worst, float(abs(mpmath.mpf(float(y)) - x) / mpmath.mpf(float(unit))))
    return worst


def angles(suffix: str) -> np.ndarray:
    """Random ones up to 4000, and the neighbours of every 20th multiple of pi/2, where cancellation is worst."""
    rng = np.random.default_rng(1)
    near = (np.arange(1, 2546, 20) * np.pi / 2).astype(REAL[suffix])
    spread = np.concatenate([rng.uniform(-4000, 4000, 1500), rng.uniform(-4, 4, 1500), rng.uniform(-1e-3, 1e-3, 100)])
    below, above = np.nextafter(near, REAL[suffix](0)), np.nextafter(near, REAL[suffix](9999))
    return np.concatenate([spread.astype(REAL[suffix]), near, -near, below, above])


# An exhaustive run over all floats gave 1.53 ulp up to 100 and 2.33 up to 4000; doubles 2.1 in 2e7 random ones.
@pytest.mark.parametrize(("suffix", "largest", "limit"), [("f32", 100, 1.6), ("f32", 4000, 2.4), ("f64", 4000, 2.2)])
@pytest.mark.parametrize("name", ["sin", "cos"])
def test_sine_and_cosine(functions: dict, name: str, suffix: str, largest: float, limit: float) -> None:
    x = angles(suffix)
    x = x[np.abs(x) <= largest]
    with mpmath.workdps(40):
        exact = [getattr(mpmath, name)(mpmath.mpf(float(v))) for v in x]
        assert ulps(functions[suffix](name, x), exact) <= limit


@pytest.mark.parametrize(("suffix", "low", "high"), [("f32", -87, 88), ("f64", -708, 709)])
def test_exponential(functions: dict, suffix: str, low: float, high: float) -> None:
    rng = np.random.default_rng(2)
    x = np.concatenate([rng.uniform(low, high, 1500), rng.uniform(-1, 1, 1000), [0.0]]).astype(REAL[suffix])
    with mpmath.workdps(40):
        assert ulps(functions[suffix]("exp", x), [mpmath.exp(mpmath.mpf(float(v))) for v in x]) <= 1.5


@pytest.mark.parametrize("suffix", ["f32", "f64"])
def test_exponential_at_its_ends(functions: dict, suffix: str) -> None:
    """0 far below, finite and large far above, not-a-number stays one."""
    low, high, nan = functions[suffix]("exp", np.array([-1e4, 1e4, np.nan]))
    assert low == 0
    assert np.isfinite(high)
    assert high > 1e38
    assert np.isnan(nan)


@pytest.mark.parametrize(("suffix", "limit"), [("f32", 1.5e-7), ("f64", 3e-16)])
def test_rise(functions: dict, suffix: str, limit: float) -> None:
    """1 - exp(-x): by its absolute error; nothing at 0, all of 1 far out."""
    rng = np.random.default_rng(6)
    x = np.concatenate([rng.uniform(0, 30, 2000), rng.uniform(0, 1, 3000), rng.uniform(0, 1e-5, 100)])
    x = x.astype(REAL[suffix])
    found = functions[suffix]("rise", x)
    with mpmath.workdps(40):
        exact = [-mpmath.expm1(-mpmath.mpf(float(v))) for v in x]
        assert max(abs(mpmath.mpf(float(y)) - e) for y, e in zip(found, exact, strict=True)) <= limit
    assert functions[suffix]("rise", np.array([0.0, 40.0, 1e6, 1e30])).tolist() == [0.0, 1.0, 1.0, 1.0]
    assert np.isnan(functions[suffix]("rise", np.array([np.nan]))).all()


@pytest.mark.parametrize("suffix", ["f32", "f64"])
def test_logarithm(functions: dict, suffix: str) -> None:
    rng = np.random.default_rng(3)
    wide = np.exp(rng.uniform(-80, 80, 1500))
    x = np.concatenate([wide, rng.uniform(0.5, 2, 1500)]).astype(REAL[suffix])
    with mpmath.workdps(40):
        assert ulps(functions[suffix]("log", x), [mpmath.log(mpmath.mpf(float(v))) for v in x]) <= 1.0


@pytest.mark.parametrize("suffix", ["f32", "f64"])
def test_angle_of_a_point(functions: dict, suffix: str) -> None:
    rng = np.random.default_rng(4)
    y, x = rng.normal(size=(2, 3000)).astype(REAL[suffix])
    with mpmath.workdps(40):
        exact = [mpmath.atan2(mpmath.mpf(float(a)), mpmath.mpf(float(b))) for a, b in zip(y, x, strict=True)]
        assert ulps(functions[suffix]("atan2", y, x), exact) <= 3.0


@pytest.mark.parametrize("suffix", ["f32", "f64"])
def test_angle_on_the_axes(functions: dict, suffix: str) -> None:
    y, x = np.array([0, 0, 1, -1, 0, 1.0]), np.array([0, 1, 0, 0, -1, 1.0])
    assert functions[suffix]("atan2", y, x) == pytest.approx(np.arctan2(y, x), rel=1e-7)


@pytest.mark.parametrize(("suffix", "unit"), [("f32", 1.2e-7), ("f64", 2.3e-16)])
def test_power(functions: dict, suffix: str, unit: float) -> None:
    """exp(p log x): relative error of a few roundings times 1 + |p log x|; 0 to any power is 0."""
    rng = np.random.default_rng(5)
    x = np.exp(rng.uniform(-5, 5, 1000)).astype(REAL[suffix])
    p = rng.uniform(0.05, 3, 1000).astype(REAL[suffix])
    exact = x.astype(np.longdouble) ** p.astype(np.longdouble)
    scale = 1 + np.abs(p * np.log(x))
    assert np.max(np.abs(functions[suffix]("pow", x, p) / exact - 1) / scale) < 3 * unit
    assert not functions[suffix]("pow", np.zeros(2), np.array([0.5, 2.0])).any()


def test_float_needs_no_double() -> None:
    """Every literal of the float version has its suffix, and no type is wider."""
    text = render.math_header(F32)
    assert "double" not in text.split("*/", 2)[2]
    assert struct.calcsize("f") == 4
