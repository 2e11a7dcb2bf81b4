"""Pinocchio's inverse dynamics of an arm of revolute joints: its C++ in a C++ loop, and as C by CasADi.

Needs the packages `pin` and `cmeel-eigen` (the extra "benchmark") and a C++ compiler. The wheel of Pinocchio
has no pinocchio.casadi, but it has the headers: rnea<casadi::SX> is instantiated from them. What is compiled
here takes up to a minute the first time and is kept in the user's cache.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import os
import shutil
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import casadi
import numpy as np

from runtime.arrays import Array
from symbolic.model_file.arm import Arm, Joint
from symbolic.model_file.frames import rotation

# What Pinocchio's own build sets; its joint variant has more members than Boost's limits.
_DEFINES = (
    *("-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30", "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS"),
    *("-DBOOST_FUSION_INVOKE_MAX_ARITY=12", "-DNDEBUG"),
)

# links: gravity (3), then n rows: the joint's place in the frame before, R (9) and p (3); mass, centre of mass (3),
# inertia about it (9), rotor inertia. All joints turn about z.
_MODEL = """
#include <string>
namespace pin = pinocchio;

template <typename S> static pin::ModelTpl<S> arm(int n, const double *links)
{
    typedef Eigen::Matrix<S, 3, 1> Vector;
    typedef Eigen::Matrix<S, 3, 3> Matrix;
    pin::ModelTpl<S> model;
    for (int k = 0; k < 3; ++k) {
        model.gravity.linear()[k] = S(links[k]);
    }
    pin::JointIndex parent = 0;
    for (int i = 0; i < n; ++i) {
        const double *link = links + 3 + 26 * i;
        Matrix turn, inertia;
        Vector at, centre;
        for (int k = 0; k < 9; ++k) {
            turn(k / 3, k % 3) = S(link[k]);
            inertia(k / 3, k % 3) = S(link[16 + k]);
        }
        for (int k = 0; k < 3; ++k) {
            at[k] = S(link[9 + k]);
            centre[k] = S(link[13 + k]);
        }
        const pin::SE3Tpl<S> place(turn, at);
        parent = model.addJoint(parent, pin::JointModelRevoluteTpl<S, 0, 2>(), place, "q" + std::to_string(i + 1));
        const S mass = link[12];
        const pin::InertiaTpl<S> body(mass, centre, inertia);
        model.appendBodyToJoint(parent, body, pin::SE3Tpl<S>::Identity());
    }
    for (int i = 0; i < n; ++i) {
        model.armature[i] = S(links[3 + 26 * i + 25]);
    }
    return model;
}
"""

_LOOP = (
    """
#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/rnea.hpp>
"""
    + _MODEL
    + """
extern "C" void pinocchio_loop(
    int n, const double *links, size_t rounds, size_t count,
    const double *q, const double *qd, const double *qdd, double *tau)
{
    const pin::Model model = arm<double>(n, links);
    pin::Data data(model);
    Eigen::VectorXd position(n), velocity(n), acceleration(n);
    for (size_t r = 0; r < rounds; ++r) {
        for (size_t k = 0; k < count; ++k) {
            position = Eigen::Map<const Eigen::VectorXd>(q + k * n, n);
            velocity = Eigen::Map<const Eigen::VectorXd>(qd + k * n, n);
            acceleration = Eigen::Map<const Eigen::VectorXd>(qdd + k * n, n);
            Eigen::Map<Eigen::VectorXd>(tau + k * n, n) = pin::rnea(model, data, position, velocity, acceleration);
        }
    }
}
"""
)

_EMIT = (
    """
#include <pinocchio/autodiff/casadi.hpp>
#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <cstring>
"""
    + _MODEL
    + """
extern "C" int pinocchio_emit(int n, const double *links, char *text, size_t room)
{
    typedef casadi::SX S;
    pin::ModelTpl<S> model = arm<S>(n, links);
    pin::DataTpl<S> data(model);
    const S q = S::sym("q", n), qd = S::sym("qd", n), qdd = S::sym("qdd", n);
    Eigen::Matrix<S, Eigen::Dynamic, 1> position(n), velocity(n), acceleration(n);
    for (int i = 0; i < n; ++i) {
        position[i] = q(i);
        velocity[i] = qd(i);
        acceleration[i] = qdd(i);
    }
    pin::rnea(model, data, position, velocity, acceleration);
    S tau(n, 1);
    for (int i = 0; i < n; ++i) {
        tau(i) = data.tau[i];
    }
    const std::string found = casadi::Function("pinocchio_rnea", {q, qd, qdd}, {tau}).serialize();
    if (found.size() >= room) {
        return 1;
    }
    std::memcpy(text, found.c_str(), found.size() + 1);
    return 0;
}
"""
)


class Missing(RuntimeError):
    """What is not installed, in one line."""


def _numbers(arm: Arm) -> list[float]:
    """An arm of revolute joints about z, as _MODEL reads it."""
    return [*arm.gravity, *(x for joint in arm.joints for x in _body(joint))]


def _body(joint: Joint) -> list[float]:
    assert joint.type == "revolute"
    assert joint.axis == (0.0, 0.0, 1.0)
    xx, xy, xz, yy, yz, zz = joint.link.inertia
    place = [*np.array(rotation(joint.origin.rpy)).ravel(), *joint.origin.xyz]
    return [*place, joint.link.mass, *joint.link.com, xx, xy, xz, xy, yy, yz, xz, yz, zz, joint.rotor_inertia]


class Reference:
    """Both libraries compiled and loaded. Raises Missing."""

    def __init__(self, arm: Arm) -> None:
        self.n = len(arm.joints)
        self.links: Array = np.array(_numbers(arm), dtype=float)
        with ThreadPoolExecutor() as pool:
            loop, emit = pool.map(lambda build: build(), (_loop_library, _emit_library))
        self._loop, self._emit = ctypes.CDLL(str(loop)), ctypes.CDLL(str(emit))

    def loop(self, rounds: int, q: Array, qd: Array, qdd: Array, tau: Array) -> None:
        """rnea() of every sample, `rounds` times; arrays (N, n), tau is written."""
        count, n = q.shape
        arrays = (ctypes.c_void_p(a.ctypes.data) for a in (q, qd, qdd, tau))
        links = ctypes.c_void_p(self.links.ctypes.data)
        self._loop.pinocchio_loop(n, links, ctypes.c_size_t(rounds), ctypes.c_size_t(count), *arrays)

    def function(self) -> casadi.Function:
        """rnea<casadi::SX>: tau of q, qd, qdd, parameters folded in."""
        text = ctypes.create_string_buffer(1 << 22)
        links = ctypes.c_void_p(self.links.ctypes.data)
        if self._emit.pinocchio_emit(self.n, links, text, ctypes.c_size_t(len(text))):
            raise Missing("Pinocchio's model as a CasADi function is longer than expected")
        return casadi.Function.deserialize(text.value.decode())

    def c_code(self) -> str:
        """The same as C: `int pinocchio_rnea(const double **arg, double **res, ...)`."""
        generator = casadi.CodeGenerator("pinocchio_c")
        generator.add(self.function())
        return generator.dump()


def _prefix() -> Path:
    """Where cmeel's wheels put their headers and libraries."""
    spec = importlib.util.find_spec("pinocchio")
    if spec is None or spec.origin is None:
        raise Missing("Pinocchio is not installed: pip install pin cmeel-eigen (the extra benchmark)")
    prefix = next((p for p in Path(spec.origin).parents if p.name == "cmeel.prefix"), None)
    if prefix is None or not (prefix / "include" / "pinocchio").is_dir():
        raise Missing("Pinocchio is installed without its headers: pip install pin")
    if not (prefix / "include" / "eigen3").is_dir():
        raise Missing("Eigen's headers are not installed: pip install cmeel-eigen (the extra benchmark)")
    return prefix


def _loop_library() -> Path:
    prefix = _prefix()
    # The wheel's own instantiation of rnea<double>, as its users call it.
    libraries = (f"-L{prefix / 'lib'}", "-lpinocchio_default", f"-Wl,-rpath,{prefix / 'lib'}")
    return _library(_LOOP, ("-O2", "-DPINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION"), libraries)


def _emit_library() -> Path:
    home = Path(casadi.__file__).parent
    # Run once, so not optimised: that halves the minute of compilation.
    return _library(_EMIT, ("-O0", f"-I{home / 'include'}"), (f"-L{home}", "-lcasadi", f"-Wl,-rpath,{home}"))


def _library(source: str, options: tuple[str, ...], libraries: tuple[str, ...]) -> Path:
    """A compiled source in the user's cache (not that of the test run, which begins empty)."""
    prefix = _prefix()
    compiler = next(filter(None, map(shutil.which, (os.environ.get("CXX", "c++"), "g++", "clang++"))), None)
    if compiler is None:
        raise Missing("Pinocchio's C++ needs a C++ compiler: install g++")
    try:
        versions = [version(name) for name in ("pin", "casadi", "cmeel-eigen")]
    except PackageNotFoundError as error:
        raise Missing(f"{error.name} is not installed: pip install pin cmeel-eigen (the extra benchmark)") from error
    include = prefix / "include"
    command = [compiler, "-std=c++17", *_DEFINES, *options, "-fPIC", "-shared", f"-I{include}", f"-I{include}/eigen3"]
    digest = hashlib.sha256("\0".join([source, *versions, *command, *libraries]).encode()).hexdigest()[:24]
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "tendon" / "benchmarks"
    final = home / f"pinocchio-{digest}.so"
    if not final.exists():
        home.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=home) as scratch:
            made = Path(scratch) / "made.so"
            code = Path(scratch) / "source.cpp"
            code.write_text(source)
            result = subprocess.run(
                [*command, str(code), "-o", str(made), *libraries], capture_output=True, text=True, check=False
            )
            if result.returncode:
                first = next((line for line in result.stderr.splitlines() if "error" in line), "no message")
                raise Missing(f"Pinocchio's headers do not compile with {compiler}: {first[:200]}")
            made.rename(final)
    return final
