"""ns per call of inverse dynamics in space: the generated C against Pinocchio in C++ and as C by CasADi, in one run."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import spatial_arms
from harness import SHORT, best, show, sized
from pinocchio_reference import Missing, Reference
from spatial_arms import Array

from codegen import render
from codegen.tape.tape import Tape
from codegen.toolchain import build
from symbolic.model import ArmModel, derive

SAMPLES = 1000
"""No power of two, with which the elements of a sample, count apart, would fall on the same places of the cache."""
ROUNDS, REPETITIONS = sized((5, 60), (1, 2))
EQUAL = 1e-9
"""Of the largest torque."""
CASADI, RNEA = 2.0, 12.0
"""How many times as fast as Pinocchio through CasADi to C, and as Pinocchio's rnea(), a call for the UR10e is at least:
what holds in every run."""
BATCH = 2.0
"""How many times as fast as a call a sample of a batch of the UR10e is at least, with vectors of four."""
ASKED = 2.0, 17.0
"""What is aimed at. Through CasADi it is 2.8 to 3.1 times; against rnea(), which takes 0.6 to 2.9 us by processor and
by what else the machine does, 14 to 15 times."""
OURS = """
void loop_ours(size_t rounds, size_t count, const double *q, const double *qd, const double *qdd, double *tau)
{{
    {name}_parameters_f64 p;
    {name}_default_parameters_f64(&p);
    for (size_t r = 0; r < rounds; ++r) {{
        for (size_t k = 0; k < count; ++k) {{
            {name}_inverse_dynamics_f64(&p, q + {n} * k, qd + {n} * k, qdd + {n} * k, tau + {n} * k);
        }}
    }}
}}

void loop_batch(size_t rounds, size_t count, const double *q, const double *qd, const double *qdd, double *tau)
{{
    {name}_parameters_f64 p;
    {name}_default_parameters_f64(&p);
    for (size_t r = 0; r < rounds; ++r) {{
        {name}_inverse_dynamics_batch_f64(count, &p, q, qd, qdd, tau);
    }}
}}
"""
THEIRS = """
int pinocchio_rnea(const double **arg, double **res, long long *iw, double *w, int mem);
void loop_theirs(size_t rounds, size_t count, const double *q, const double *qd, const double *qdd, double *tau)
{{
    static double w[16384];
    static long long iw[64];
    for (size_t r = 0; r < rounds; ++r) {{
        for (size_t k = 0; k < count; ++k) {{
            const double *arg[8] = {{q + {n} * k, qd + {n} * k, qdd + {n} * k}};
            double *res[4] = {{tau + {n} * k}};
            pinocchio_rnea(arg, res, iw, w, 0);
        }}
    }}
}}
"""


def _library(model: ArmModel, pinocchio: Reference) -> Path:
    """Everything that is C, by one compiler with the flags of the generated code."""
    name, n = model.arm.name, len(model.arm.joints)
    sources = {path: text for path, text in render.arm_files(model).items() if path.endswith(("f64.c", "f64.h"))}
    sources["pinocchio_rnea.c"] = pinocchio.c_code()
    loops = OURS.format(name=name, n=n) + THEIRS.format(n=n)
    sources["loops.c"] = f'#include <stddef.h>\n#include "{name}_f64.h"\n{loops}'
    return build.shared_library(sources, f"kernels_{name}", build.STRAIGHT)


def _instructions(library: Path, function: str) -> str:
    """How many instructions a compiled function has, which no load of the machine changes; by binutils' objdump."""
    objdump = shutil.which("objdump")
    if objdump is None:
        return "instructions not counted: install objdump (binutils)"
    command = [objdump, "--disassemble", "--no-show-raw-insn", str(library)]
    listing = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    body = re.search(rf"<{function}>:\n(.*?)(?:\n\n|\Z)", listing, re.DOTALL)
    assert body is not None, f"{library} has no function {function}"
    mnemonics = re.findall(r"^\s*[0-9a-f]+:\t(\S+)", body[1], re.MULTILINE)
    # What follows the return fills up to the next function.
    count = next(k for k, name in enumerate(mnemonics, 1) if name.startswith("ret"))
    repeated = any(name.startswith(("j", "b.", "cb", "tb")) for name in mnemonics[:count])
    return f"{count} instructions a call" + (", some of them in a loop" if repeated else ", each executed once")


def _called(kernel: Callable[..., None], arrays: list[Array]) -> Callable[[], None]:
    pointers = [ctypes.c_void_p(a.ctypes.data) for a in arrays]
    return lambda: kernel(ctypes.c_size_t(ROUNDS), ctypes.c_size_t(SAMPLES), *pointers)


@pytest.mark.parametrize("name", ["ur10e", "panda"])
def test_inverse_dynamics(name: str) -> None:
    """Every variant gives the same torques; then each is timed."""
    arm = spatial_arms.known(name)
    try:
        pinocchio = Reference(arm)
    except Missing as error:
        pytest.skip(str(error))
    model, n = derive(arm), len(arm.joints)
    compiled, rng = _library(model, pinocchio), np.random.default_rng(0)
    library = ctypes.CDLL(str(compiled))
    motion = [rng.uniform(-s, s, (SAMPLES, n)) for s in (np.pi, 3.0, 20.0)]
    expected = np.zeros((SAMPLES, n))
    pinocchio.loop(1, *motion, expected)
    across = [np.ascontiguousarray(a.T) for a in (*motion, expected * 0)]
    along = [np.zeros_like(expected) for _ in range(3)]
    cases = {
        "generated C, a call": (_called(library.loop_ours, [*motion, along[0]]), along[0]),
        "generated C, a sample of a batch": (_called(library.loop_batch, across), across[3].T),
        "Pinocchio's model through CasADi to C": (_called(library.loop_theirs, [*motion, along[1]]), along[1]),
        "Pinocchio, C++ rnea()": (lambda: pinocchio.loop(ROUNDS, *motion, along[2]), along[2]),
    }
    times = {}
    for case, (run, found) in cases.items():
        run()
        assert np.abs(found - expected).max() < EQUAL * np.abs(expected).max(), case
        times[case] = best(run, REPETITIONS) / (ROUNDS * SAMPLES)
    own = times["generated C, a call"]
    rows = [(case, f"{1e9 * seconds:.1f}", f"{seconds / own:.2f}") for case, seconds in times.items()]
    reached = [times[case] / own for case in ("Pinocchio's model through CasADi to C", "Pinocchio, C++ rnea()")]
    operations = Tape.of(next(f for f in model.functions if f.name == "inverse_dynamics")).count()
    notes = [
        f"generated C: {_instructions(compiled, f'{name}_inverse_dynamics_f64')}, for {operations['arithmetic']} "
        f"operations and {operations['sincos']} sincos",
        f"{SAMPLES} random samples; every C by one compiler with the same flags; torques equal to 1e-9",
        "times as fast as through CasADi, and as rnea(): "
        + ", ".join(f"{found:.1f} (aimed at: {asked:g})" for found, asked in zip(reached, ASKED, strict=True)),
    ]
    show(f"Inverse dynamics of the {name}", ("variant", "ns", "ratio"), rows, notes)
    if name == "ur10e" and not SHORT:
        assert reached[0] > CASADI
        assert reached[1] > RNEA
        assert own / times["generated C, a sample of a batch"] > BATCH
