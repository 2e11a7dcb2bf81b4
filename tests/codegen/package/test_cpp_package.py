"""The C++ header and the CMake package: a project finds them, gets the bits of C and NumPy, and allocates nothing."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import guides
import numpy as np
import pytest
import watched_arm
from packaged_arms import DT, SAMPLES, Packaged, busy, spatial
from six_joints import six_joints

from runtime.notebook.effects_along import whole_torque
from symbolic.effects import LIBRARY
from symbolic.model_file import reader
from symbolic.model_file.arm import Arm

EIGEN = next(
    (p for p in ("/usr/include/eigen3", "/usr/local/include/eigen3") if Path(p, "Eigen", "Core").is_file()), None
)
WARNINGS = ("-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", "-fno-exceptions", "-fno-rtti")
NEEDS_EIGEN = pytest.mark.skipif(EIGEN is None, reason="needs Eigen (libeigen3-dev)")
COMPILERS = [
    pytest.param(name, marks=pytest.mark.skipif(shutil.which(name) is None, reason=f"needs {name}"))
    for name in ("g++", "clang++")
]
PROJECT = """\
cmake_minimum_required(VERSION 3.16)
project(controller CXX)
find_package(tendon_{name} REQUIRED)
add_executable(controller controller.cpp)
target_link_libraries(controller PRIVATE tendon::{name})
target_compile_options(controller PRIVATE -O1 {flags})
target_link_options(controller PRIVATE -Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc)
"""
PROGRAM = """\
#include <cstdio>
#include <cstdlib>
#include <cstring>
{eigen}
#include <tendon_{name}.hpp>

namespace arm = tendon::{name};

static unsigned allocated = 0;
extern "C" void *__real_malloc(std::size_t size);
extern "C" void *__wrap_malloc(std::size_t size) {{ ++allocated; return __real_malloc(size); }}
extern "C" void *__wrap_calloc(std::size_t, std::size_t) {{ std::abort(); }}
extern "C" void *__wrap_realloc(void *, std::size_t) {{ std::abort(); }}
void *operator new(std::size_t size) {{ ++allocated; return __real_malloc(size); }}
void *operator new[](std::size_t size) {{ ++allocated; return __real_malloc(size); }}

template <class A, class B>
static void same(const A &one, const B &other, std::size_t numbers) {{
  if (std::memcmp(one.data(), other.data(), numbers * sizeof(double)) != 0) {{
    std::fprintf(stderr, "other bits\\n");
    std::exit(3);
  }}
}}

{given}
static double results[{samples}][{width}];

static void fill() {{
  arm::FeedForward forward;
  const arm::Parameters parameters = arm::default_parameters();
  for (std::size_t k = 0; k < {samples}; ++k) {{
    double *out = results[k];
    const auto keep = [&out](const auto &result) {{
      std::memcpy(out, result.data(), sizeof result);
      out += sizeof result / sizeof(double);
    }};
{calls}
    if (k == 0) {{
      forward.start(given_q[k], given_qd[k], given_qdd[k]);
    }}
    std::array<double, arm::joints> tau;
    forward.torque(given_q[k], given_qd[k], given_qdd[k], tau);
    keep(tau);
    forward.step(given_q[k], given_qd[k], given_qdd[k], {dt});
  }}
}}

int main() {{
{check}
  fill();
  if (allocated != 0) {{
    std::fprintf(stderr, "%u allocations\\n", allocated);
    return 2;
  }}
  std::fwrite(results, sizeof results, 1, stdout);
  return 0;
}}
"""


def program(packaged: Packaged, eigen: bool) -> str:
    """A program that calls everything with arrays, pointers and C, and with Eigen's vectors, and writes the results."""
    pages = packaged.model.metadata["functions"]
    given = []
    for name, values in packaged.inputs.items():
        rows = ", ".join("{" + ", ".join(float(x).hex() for x in row) + "}" for row in values.reshape(-1, SAMPLES).T)
        size = values.size // SAMPLES
        given.append(f"static const double given_{name}[{SAMPLES}][{size}] = {{{rows}}};")
    spelt = {"inertia": "mass_matrix", "tip_jacobian": "jacobian"}
    calls = []
    for name, page in pages.items():
        (_, shape), size = page["outputs"][0], int(np.prod(page["outputs"][0][1]))
        texts = [f"given_{a}[k]" + "[0]" * (not s) for a, s in page["inputs"]]
        pointers = [
            f"tendon::Input<{s[0]}>{{&given_{a}[k][0]}}" if s else f"given_{a}[k][0]" for a, s in page["inputs"]
        ]
        passed = ", ".join(texts)
        calls += [
            "{",
            f"  const auto result = arm::{spelt.get(name, name)}(parameters, {passed});",
            f"  std::array<double, {size}> again;",
            f"  arm::{spelt.get(name, name)}(parameters, {', '.join(pointers)}, again);",
            f"  same(result, again, {size});",
            f"  {packaged.name}_{name}_f64(&parameters, {passed}, again.data());",
            f"  same(result, again, {size});",
            *(of_eigen(spelt.get(name, name), page["inputs"], shape) if eigen else []),
            "  keep(result);",
            "}",
        ]
    width = sum(int(np.prod(page["outputs"][0][1])) for page in pages.values()) + len(packaged.arm.joints)
    return PROGRAM.format(
        name=packaged.name,
        eigen="#define EIGEN_RUNTIME_NO_MALLOC\n#include <Eigen/Core>" if eigen else "#define TENDON_WITHOUT_EIGEN",
        given="\n".join(given),
        samples=SAMPLES,
        width=width,
        calls="\n".join("    " + line for line in calls),
        dt=DT,
        check="  Eigen::internal::set_is_malloc_allowed(false);" if eigen else "",
    )


def of_eigen(function: str, inputs: Sequence[tuple[str, list[int]]], shape: list[int]) -> list[str]:
    """The same call with a map, a vector and a matrix of Eigen."""
    rows, columns = (*shape, 1)[:2]
    names = [f"{a}_" if s else f"given_{a}[k][0]" for a, s in inputs]
    kinds = [f"Eigen::Matrix<double, {s[0]}, 1>" for _, s in inputs if s]
    maps = [f"const Eigen::Map<const {kind}> {a}_(given_{a}[k]);" for (a, _), kind in zip(inputs, kinds, strict=False)]
    order = "Eigen::ColMajor" if columns == 1 else "Eigen::RowMajor"
    return [
        *(f"  {line}" for line in maps),
        f"  Eigen::Matrix<double, {rows}, {columns}, {order}> of_eigen;",
        f"  arm::{function}(parameters, {', '.join(names)}, of_eigen);",
        f"  same(result, of_eigen, {rows * columns});",
        f"  const {kinds[0]} copy = {names[0]};",
        f"  const auto from_copy = arm::{function}(parameters, {', '.join(['copy', *names[1:]])});",
        f"  const Eigen::Matrix<double, {rows}, {columns}> usual = tendon::as_matrix<{rows}, {columns}>(from_copy);",
        f"  const double last = of_eigen({rows - 1}, 0);",
        f"  if (last == last && usual({rows - 1}, 0) != last) {{",
        "    std::exit(4);",
        "  }",
    ]


def run(command: Sequence[str], cwd: Path) -> bytes:
    done = subprocess.run(command, cwd=cwd, capture_output=True, check=False)
    assert done.returncode == 0, f"{command}\n{done.stdout.decode()[-2000:]}{done.stderr.decode()[-2000:]}"
    return done.stdout


@pytest.mark.skipif(shutil.which("cmake") is None, reason="needs cmake")
@pytest.mark.parametrize(
    ("name", "eigen"),
    [
        pytest.param("vishard4", True, marks=NEEDS_EIGEN),
        ("busy", False),
        pytest.param("busy", True, marks=[NEEDS_EIGEN, pytest.mark.slow]),
        pytest.param("six", True, marks=[NEEDS_EIGEN, pytest.mark.slow]),
    ],
)
def test_another_project_finds_it(vishard4: Arm, tmp_path: Path, name: str, eigen: bool) -> None:
    packaged = Packaged({"vishard4": lambda: vishard4, "busy": busy, "six": six_joints}[name]())
    source, prefix, project = packaged.written(tmp_path / "arm"), tmp_path / "prefix", tmp_path / "project"
    run(["cmake", "-S", str(source), "-B", "built", f"-DCMAKE_INSTALL_PREFIX={prefix}"], tmp_path)
    run(["cmake", "--build", "built"], tmp_path)
    run(["cmake", "--install", "built"], tmp_path)
    project.mkdir()
    flags = [*WARNINGS, *([f"-isystem {EIGEN}"] if eigen else [])]
    (project / "CMakeLists.txt").write_text(PROJECT.format(name=name, flags=" ".join(flags)))
    (project / "controller.cpp").write_text(program(packaged, eigen))
    # Elsewhere than it was built: an installation may not point back.
    shutil.rmtree(source)
    run(["cmake", "-S", ".", "-B", "built", f"-DCMAKE_PREFIX_PATH={prefix}"], project)
    run(["cmake", "--build", "built"], project)
    found = np.frombuffer(run([str(project / "built" / "controller")], project)).reshape(SAMPLES, -1)
    expected = [*packaged.outputs().values()]
    functions = np.hstack(expected)
    assert np.array_equal(found[:, : functions.shape[1]], functions, equal_nan=True)
    whole = packaged.torque()
    rounding = np.spacing(np.abs(whole).max()) if name == "busy" else 0.0  # see test_python_module.py
    assert np.abs(found[:, functions.shape[1] :] - whole).max() <= rounding


@pytest.mark.parametrize("eigen", [False, pytest.param(True, marks=NEEDS_EIGEN)])
@pytest.mark.parametrize("compiler", COMPILERS)
def test_no_warnings(vishard4: Arm, tmp_path: Path, compiler: str, eigen: bool) -> None:
    """Several arms in one source, whose headers share a part; and the headers of C, which C++ may call as well."""
    watched = reader.parse(watched_arm.watched_text(2), "watched.toml", LIBRARY)
    arms = [Packaged(vishard4), Packaged(busy()), Packaged(spatial()), Packaged(watched)]
    for packaged in arms:
        packaged.written(tmp_path / packaged.name)
    of_c = {
        path: text
        for packaged in arms
        for path, text in packaged.files.items()
        if path.endswith(("_f32.h", "_f64.h")) and not path.startswith("tendon_")
    }
    assert [path for path, text in of_c.items() if 'extern "C" {' not in text] == []
    includes = "".join(
        f'#include "{path}"\n' for path in [*of_c, *(f"tendon_{packaged.name}.hpp" for packaged in arms)]
    )
    (tmp_path / "all.cpp").write_text(
        f"{includes}static_assert(tendon::spatial::joints == 3 && tendon::vishard4::joint_names.size() == 4);\n"
    )
    paths = [f"-I{packaged.name}" for packaged in arms] + ([f"-isystem{EIGEN}"] if eigen else [])
    run([compiler, *WARNINGS, *paths, "-fsyntax-only", "all.cpp"], tmp_path)


def test_what_does_not_fit_is_refused_by_the_compiler(vishard4: Arm, tmp_path: Path) -> None:
    Packaged(vishard4).written(tmp_path)
    head = '#include "tendon_vishard4.hpp"\nnamespace arm = tendon::vishard4;\nint main() {\n'
    given = "  std::array<double, 4> four{}; std::array<double, 3> three{}; const std::array<double, 16> kept{};\n"
    command, end = ["c++", *WARNINGS, "-fsyntax-only", "call.cpp"], "(void)three; (void)kept; }\n"
    (tmp_path / "call.cpp").write_text(f"{head}{given}  arm::mass_matrix(arm::default_parameters(), four); {end}")
    run(command, tmp_path)
    for wrong in (
        "arm::mass_matrix(arm::default_parameters(), three);",
        "arm::mass_matrix(arm::default_parameters(), four, kept);",
        "arm::mass_matrix(arm::default_parameters(), four.data());",
        "arm::mass_matrix(four);",
    ):
        (tmp_path / "call.cpp").write_text(f"{head}{given}  {wrong} {end}")
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
        assert done.returncode != 0, wrong
        assert b"mass_matrix" in done.stderr


GIVEN = """
#include <cstdio>
int main() {
  Compensation controller;
  controller.desired_.qd = {0.2, 0.2, 0.2, 0.2};
  controller.update({}, {});
  const Solver solver;
  const Eigen::VectorXd q = Eigen::VectorXd::Constant(4, 0.3), qd = Eigen::VectorXd::Constant(4, 0.2);
  for (std::size_t j = 0; j < 4; ++j) {
    std::printf("%.17g ", controller.command_interfaces_[j].value);
  }
  for (Eigen::Index j = 0; j < 4; ++j) {
    std::printf("%.17g ", solver.getFrictionVector(qd)(j));
  }
  for (Eigen::Index j = 0; j < 4; ++j) {
    std::printf("%.17g ", solver.getInertiaMatrix(q)(j, 1));
  }
}
"""


@NEEDS_EIGEN
def test_the_pieces_of_the_guide_compile_and_compute(vishard4: Arm, tmp_path: Path) -> None:
    """With stand-ins for ROS 2."""
    packaged, here = Packaged(vishard4), Path(__file__).parent
    packaged.written(tmp_path)
    guide = guides.ROOT / "runtime" / "guides" / "controller.md"
    pieces = {block.file: block.text for block in guides.blocks(guide) if block.file}
    chosen = [pieces["compensation_controller.cpp"], pieces["solver.cpp"]]
    (tmp_path / "pieces.cpp").write_text('#include "stand_ins.hpp"\n' + "".join(chosen) + GIVEN)
    c = [f"vishard4_{part}f64.c" for part in ("", "effects_")]
    run(["cc", "-std=c99", "-O1", "-ffp-contract=off", "-c", *c], tmp_path)
    includes = ["-I.", f"-I{here}", f"-isystem{EIGEN}"]
    command = ["c++", "-std=c++17", "-Wall", "-Wextra", "-Werror", *includes, "pieces.cpp"]
    run([*command, *(path.replace(".c", ".o") for path in c), "-o", "pieces"], tmp_path)
    found = np.array(run(["./pieces"], tmp_path).split(), dtype=float)
    zero, rates = np.zeros((4, 1)), np.full((4, 1), 0.2)
    whole = whole_torque(packaged.model, zero, rates, zero, dt=DT)[:, 0]
    # The stand-ins' arm has gains of zero. The plate is out of reach where all angles are zero.
    assert np.array_equal(found[:4], whole)
    rigid = packaged.model.inverse_dynamics(zero, rates, zero)[:, 0]
    assert np.allclose(found[4:8], whole - rigid, rtol=0.0, atol=1e-12)
    assert np.array_equal(found[8:], packaged.model.inertia(np.full(4, 0.3))[:, 1])
