"""ns per call of the 4R arm's inverse dynamics: the generated C against Pinocchio, CasADi and SymPy, all in one run."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import casadi
import lagrange_reference
import numpy as np
from harness import best, show, sized
from pinocchio_reference import Missing, Reference

from codegen import render
from codegen.toolchain import build
from codegen.verify import verify
from runtime.arrays import Array
from runtime.model.loader import Model
from symbolic.model import derive
from symbolic.model_file.arm import Arm

SAMPLES = 1024  # 160 kB with double precision: in the second cache
ROUNDS, REPETITIONS = sized((5, 60), (1, 2))
EQUAL = 1e-9  # N m of about 30: far above rounding, far below any difference in the equations
# Float rounds to 6e-8 of each term; some thirty terms of up to 100 N m meet in a torque.
EQUAL_FLOAT = 2e-4

# All variants are called alike: one call a sample into another translation unit.
LOOP = """
void loop_{name}(size_t rounds, size_t count, const {real} *q, const {real} *qd, const {real} *qdd, {real} *tau)
{{
{before}
    for (size_t r = 0; r < rounds; ++r) {{
        for (size_t k = 0; k < count; ++k) {{
            {call}
        }}
    }}
}}
"""
GENERATED = LOOP.replace(
    "{before}", "    vishard4_parameters_{bits} p;\n    vishard4_default_parameters_{bits}(&p);"
).replace("{call}", "vishard4_inverse_dynamics_{bits}(&p, q + 4 * k, qd + 4 * k, qdd + 4 * k, tau + 4 * k);")
CASADI = "int {name}(const double **arg, double **res, long long *iw, double *w, int mem);" + LOOP.replace(
    "{before}", "    static double w[4096];\n    static long long iw[64];"
).replace(
    "{call}",
    "const double *arg[8] = {{{first}q + 4 * k, qd + 4 * k, qdd + 4 * k}};\n"
    "            double *res[4] = {{tau + 4 * k}};\n            {name}(arg, res, iw, w, 0);",
)
LAGRANGE = "void lagrange(const double *q, const double *qd, const double *qdd, double *tau);" + LOOP.replace(
    "{before}", ""
).replace("{call}", "lagrange(q + 4 * k, qd + 4 * k, qdd + 4 * k, tau + 4 * k);")


def test_inverse_dynamics(vishard4: Arm, model: Model) -> None:
    """Every variant gives the same torques; then each is timed."""
    rng = np.random.default_rng(0)
    q, qd, qdd = (rng.uniform(-s, s, (SAMPLES, 4)) for s in (np.pi, 3.0, 20.0))
    files = render.arm_files(derive(vishard4))
    ours = verify.casadi_module(files, "vishard4").inverse_dynamics()
    textbook, operations = lagrange_reference.c_code(vishard4, "lagrange")
    notes = [f"{SAMPLES} random samples; SymPy's variant counts {operations} operations, the generated one 73"]
    pinocchio: Reference | None = None
    try:
        pinocchio = Reference(vishard4)
    except Missing as error:
        notes.append(f"SKIPPED, without Pinocchio: {error}; SymPy's LagrangesMethod stands in")
    library = _library(files, textbook, ours, pinocchio)

    expected = np.ascontiguousarray(model.inverse_dynamics(q.T, qd.T, qdd.T).T)
    cases: list[tuple[str, float]] = []

    def case(name: str, loop: Any, real: type[np.floating[Any]] = np.float64) -> None:
        arrays = [np.ascontiguousarray(a, dtype=real) for a in (q, qd, qdd, np.zeros_like(q))]
        loop(ROUNDS, *arrays)
        error = float(np.abs(arrays[3] - expected).max())
        assert error < (EQUAL if real is np.float64 else EQUAL_FLOAT), f"{name} differs by {error:.2g} N m"
        cases.append((name, best(lambda: loop(ROUNDS, *arrays), REPETITIONS) / (ROUNDS * SAMPLES)))

    case("generated C, a call, double", _loop(library, "f64"))
    case("generated C, a call, float", _loop(library, "f32"), np.float32)
    cases.append(("generated C, batch, double", _batch(library, model, q, qd, qdd, expected)))
    if pinocchio is not None:
        case("Pinocchio, C++ rnea()", pinocchio.loop)
        case("Pinocchio's model through CasADi to C", _loop(library, "pinocchio_rnea"))
    case("SymPy's LagrangesMethod + cse to C", _loop(library, "lagrange"))
    case("our function through CasADi to C", _loop(library, "casadi_ours"))
    cases.append(("our function in CasADi's own VM", _virtual_machine(ours, model, q, qd, qdd, expected)))
    _report(cases, notes)


def _library(files: dict[str, str], textbook: str, ours: Any, pinocchio: Reference | None) -> ctypes.CDLL:
    """Everything that is C, by one compiler with the flags of the generated code."""
    generator = casadi.CodeGenerator("casadi_c")
    generator.add(_renamed(ours, "casadi_ours"))
    sources = {path: text for path, text in files.items() if path.endswith((".c", ".h"))}
    sources |= {"lagrange.c": textbook, "casadi_ours.c": generator.dump()}
    head = '#include <stddef.h>\n#include "vishard4_f64.h"\n#include "vishard4_f32.h"\n'
    loops = [GENERATED.format(name=bits, bits=bits, real=real) for bits, real in (("f64", "double"), ("f32", "float"))]
    defaults = "vishard4_parameters_f64 p;\n    vishard4_default_parameters_f64(&p);\n"
    own = CASADI.format(name="casadi_ours", real="double", first="(const double *)&p, ")
    loops += [
        own.replace("static double w", f"{defaults}    static double w"),
        LAGRANGE.format(name="lagrange", real="double"),
    ]
    if pinocchio is not None:
        sources["pinocchio_rnea.c"] = pinocchio.c_code()
        loops.append(CASADI.format(name="pinocchio_rnea", real="double", first=""))
    sources["loops.c"] = head + "\n".join(loops)
    return ctypes.CDLL(str(build.shared_library(sources, "kernels")))


def _renamed(function: Any, name: str) -> Any:
    inputs = [casadi.SX.sym(function.name_in(i), function.sparsity_in(i)) for i in range(function.n_in())]
    return casadi.Function(name, inputs, function.call(inputs))


def _loop(library: ctypes.CDLL, name: str) -> Callable[..., None]:
    kernel = getattr(library, f"loop_{name}")

    def run(rounds: int, *arrays: Array) -> None:
        pointers = (ctypes.c_void_p(a.ctypes.data) for a in arrays)
        kernel(ctypes.c_size_t(rounds), ctypes.c_size_t(SAMPLES), *pointers)

    return run


def _batch(library: ctypes.CDLL, model: Model, q: Array, qd: Array, qdd: Array, expected: Array) -> float:
    """Seconds a sample of the batch kernel, which takes the samples last."""
    arrays = [np.ascontiguousarray(a.T) for a in (q, qd, qdd)]
    tau = np.zeros_like(arrays[0])
    parameters = np.array([field["default"] for field in model.metadata["struct"]])
    pointers = [ctypes.c_void_p(a.ctypes.data) for a in (parameters, *arrays, tau)]
    kernel = library.vishard4_inverse_dynamics_batch_f64

    def run() -> None:
        for _ in range(ROUNDS):
            kernel(ctypes.c_size_t(SAMPLES), *pointers)

    run()
    assert np.abs(tau.T - expected).max() < EQUAL
    return best(run, REPETITIONS) / (ROUNDS * SAMPLES)


def _virtual_machine(function: Any, model: Model, q: Array, qd: Array, qdd: Array, expected: Array) -> float:
    """Seconds a sample where CasADi evaluates all samples in one call from Python."""
    parameters = [field["default"] for field in model.metadata["struct"]]
    mapped = function.map(SAMPLES)
    buffer, run = mapped.buffer()
    # CasADi counts down the columns of (n, N), which are the rows of (N, n).
    columns = [np.tile(parameters, SAMPLES), q.ravel(), qd.ravel(), qdd.ravel()]
    tau = np.zeros(q.size)
    for number, column in enumerate(columns):
        buffer.set_arg(number, memoryview(column))
    buffer.set_res(0, memoryview(tau))
    run()
    assert np.abs(tau.reshape(-1, 4) - expected).max() < EQUAL
    return best(run, REPETITIONS) / SAMPLES


def _report(cases: list[tuple[str, float]], notes: list[str]) -> None:
    unit = cases[0][1]
    rows = [(name, f"{1e9 * seconds:.1f}", f"{seconds / unit:.2f}") for name, seconds in cases]
    notes.append("all results equal to 1e-9 N m (float: 2e-4); every C by one compiler with the same flags")
    show("Inverse dynamics of the 4R arm", ("variant", "ns", "ratio"), rows, notes)
