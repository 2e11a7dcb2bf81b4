"""What a model file leaves open: the same numbers in every language, and the same refusal."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from runtime.arrays import Array
from runtime.cli import main, output
from symbolic.effects import shipped
from symbolic.model_file import reader
from symbolic.model_file.arm import Arm
from tests import one_joint

ROOT = Path(__file__).resolve().parents[3]
REAL = ROOT.parent / "shared" / "data" / "real"
FILES = [*sorted((ROOT / "symbolic" / "arms").glob("*.toml")), *sorted((ROOT / "tests" / "robots").glob("*.urdf"))]
FILES += [REAL / name / f"{name}.urdf" for name in ("go2", "tx40", "ur10")]
TIPS = {"panda": "panda_hand_tcp", "go2": "FL_foot"}
SLIDE = one_joint.joint_text("[joint.effects.stribeck]\n").replace("revolute", "prismatic")
BENCH = one_joint.model_text("[joint.effects.coulomb]\n", "bench", -9.81).replace("0.20, 0.0", "0.20, 0.02") + SLIDE
PYTHON = """
import importlib.util, json, sys
import numpy as np
sys.path[:0] = [sys.argv[1]]
at = np.load(sys.argv[2])
arm = __import__(f"tendon_{sys.argv[3]}")
spec = importlib.util.spec_from_file_location("by_casadi", f"{sys.argv[1]}/{sys.argv[3]}_casadi.py")
ca = importlib.util.module_from_spec(spec)
spec.loader.exec_module(ca)
D, tau, p = ca.inertia(), ca.inverse_dynamics(), ca.parameters()
lumps = json.load(open(f"{sys.argv[1]}/metadata.json"))["lumps"]
raised = {x["name"]: x["value"] + 0.7 for x in lumps if any(p[1] == "I" for p in x.get("parts", ()))}
python = [
    [*arm.mass_matrix(q).ravel(), *arm.inverse_dynamics(q, v, a), *arm.torque(q, v, a), *arm.link_load(q, v, a, raised)]
    for q, v, a in at
]
casadi = [[*np.array(D(p, q)).ravel(), *np.array(tau(p, q, v, a)).ravel()] for q, v, a in at]
np.savez(sys.argv[4], python=python, casadi=casadi)
"""


def run(*command: object, where: Path) -> str:
    done = subprocess.run([str(part) for part in command], cwd=where, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:3000]
    return done.stdout


def inertia(arm: Arm, q: Array) -> Array:
    """D (n, n) from the velocities of the file's bodies and its rotors, 0 where it leaves them open."""
    D, R, p = np.diag([joint.rotor_inertia or 0.0 for joint in arm.joints]), np.eye(3), np.zeros(3)
    J = np.zeros((len(q), 6, len(q)))  # of the bodies' centres
    centres, tensors, masses = [], [], []
    axes: list[tuple[bool, Array, Array]] = []
    for joint, x in zip(arm.joints, q, strict=True):
        p = p + R @ joint.origin.xyz
        R = R @ Rotation.from_euler("xyz", joint.origin.rpy).as_matrix()
        axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
        turns = joint.type == "revolute"
        axes.append((turns, R @ axis, p))
        R, p = (R @ Rotation.from_rotvec(x * axis).as_matrix(), p) if turns else (R, p + R @ axis * x)
        mass, com, moments = joint.link.mass, joint.link.com, joint.link.inertia
        assert mass is not None
        assert com is not None
        assert moments is not None
        xx, xy, xz, yy, yz, zz = moments
        centres.append(p + R @ com)
        masses.append(mass)
        tensors.append(R @ [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]] @ R.T)
    for i, (centre, mass, tensor) in enumerate(zip(centres, masses, tensors, strict=True)):
        for k, (turns, along, place) in enumerate(axes[: i + 1]):
            J[i, :, k] = [*np.cross(along, centre - place), *along] if turns else [*along, 0.0, 0.0, 0.0]
        D = D + mass * J[i, :3].T @ J[i, :3] + J[i, 3:].T @ tensor @ J[i, 3:]
    return D


def by_c(made: Path, name: str, at: Array, suffix: str) -> Array:
    """D and the inverse dynamics at the samples at (N, 3, n)."""
    real, n = {"f32": ctypes.c_float, "f64": ctypes.c_double}[suffix], at.shape[2]
    run("cc", "-O0", "-shared", "-fPIC", f"{name}_{suffix}.c", "-o", f"{suffix}.so", where=made)
    library, found = ctypes.CDLL(str(made / f"{suffix}.so")), []
    parameters, D, tau = (real * 500)(), (real * (n * n))(), (real * n)()
    getattr(library, f"{name}_default_parameters_{suffix}")(parameters)
    for row in at.tolist():
        q, qd, qdd = ((real * n)(*values) for values in row)
        getattr(library, f"{name}_inertia_{suffix}")(parameters, q, D)
        getattr(library, f"{name}_inverse_dynamics_{suffix}")(parameters, q, qd, qdd, tau)
        found.append([*D, *tau])
    return np.array(found)


def by_program(made: Path, text: str, call: str, at: Array, *commands: str) -> Array:
    """What a program prints, whose `call` stands once for every sample with its numbers for Q, V and A."""
    rows = [[", ".join(map(repr, x)) for x in row] for row in at.tolist()]
    body = "\n".join(call.replace("Q", q).replace("V", v).replace("A", a) for q, v, a in rows)
    (made / commands[0].split()[-3]).write_text(text.replace("BODY", body), encoding="utf-8")
    for command in commands:
        printed = run(*command.split(), where=made)
    return np.array(printed.split(), dtype=float).reshape(len(at), -1)


def every_language(made: Path, arm: Arm, at: Array) -> dict[str, Array]:
    """D, the inverse dynamics and where there is one the torque with the effects (N, ...), by language."""
    name, core = arm.name, made / f"tendon_{arm.name}" / "_core.so"
    np.save(made / "at.npy", at)
    objects = f"{name}_f64.o {name}_effects_f64.o"
    run("cc", "-O0", "-fPIC", "-c", f"{name}_f64.c", f"{name}_effects_f64.c", where=made)
    headers = [f"-I{sysconfig.get_path('include')}", "-I."]
    run("cc", "-O0", "-fPIC", "-shared", *headers, f"tendon_{name}/_core.c", *objects.split(), "-o", core, where=made)
    run(sys.executable, "-c", PYTHON, made, made / "at.npy", name, made / "found.npz", where=made)
    found = {**np.load(made / "found.npz"), "C": by_c(made, name, at, "f64"), "C float": by_c(made, name, at, "f32")}
    cpp = f"#include <cstdio>\n#include <tendon_{name}.hpp>\nnamespace arm = tendon::{name};\n" + (
        'template <class T> void say(const T &all) { for (double x : all) std::printf("%.17e ", x); }\n'
        "int main() { arm::FeedForward f; std::array<double, arm::joints> tau;\nBODY\n}\n"
    )
    call = "{ const double q[] = {Q}, v[] = {V}, a[] = {A}; say(arm::mass_matrix(f.parameters, q)); " + (
        "say(arm::inverse_dynamics(f.parameters, q, v, a)); f.torque(q, v, a, tau); say(tau); }"
    )
    found["C++"] = by_program(made, cpp, call, at, f"g++ -std=c++17 -O0 -I. {objects} all.cpp -o all", "./all")
    if shutil.which("rustc") is not None:
        rust = f"mod {name};\nfn main() {{ let p = {name}::Parameters::default();\nBODY\n}}\n"
        calls = (f"{name}::inertia(&p, &[Q])", f"{name}::inverse_dynamics(&p, &[Q], &[V], &[A])")
        call = " ".join(f'for x in {call} {{ print!("{{:e}} ", x); }}' for call in calls)
        rustc = "rustc --edition 2021 -Copt-level=0 main.rs -o main"
        found["Rust"] = by_program(made, rust, call, at, rustc, "./main")
    return found


def numbers_left_open(arm: Arm) -> set[tuple[int, str]]:
    """Of joints: rotors, links and effects."""
    library = shipped(arm.space)
    found = {(k, key) for k, joint in enumerate(arm.joints, 1) for key in joint.unknown}
    for k, joint in enumerate(arm.joints, 1):
        for effect, values in joint.effects.items():
            named = (p.name for p in library[effect].parameters if p.default is None and p.name not in values)
            found |= {(k, f"{effect}.{name}") for name in named}
    return found


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}/{file.name}")
def test_the_same_inertia_in_every_language(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if not file.is_file():
        pytest.skip(f"needs {file}")
    model, made = tmp_path / "arm.toml", tmp_path / "made"
    if file.suffix == ".urdf":
        tip = ["--tip", TIPS[file.stem]] if file.stem in TIPS else []
        assert output.run(main.app, ["import", str(file), *tip, "--out", str(model)]) == 0
    else:
        shutil.copy(file, model)
    arm = reader.load(model)
    rng, n = np.random.default_rng(1), len(arm.joints)
    ends = np.array([joint.limits.position or (-3.0, 3.0) for joint in arm.joints]).T
    at = np.stack([rng.uniform(*ends, (20, n)), *rng.uniform(-2.0, 2.0, (2, 20, n))], 1)
    D = np.array([inertia(arm, q) for q in at[:, 0]])
    definite = np.linalg.eigvalsh(D).min() > 1e-12
    capsys.readouterr()
    generate = ["generate", str(model), "--rust", "--out", str(made)]
    assert output.run(main.app, generate) == (0 if definite else 2)
    if not definite:  # the tx40's last link has no inertia about its joint, and its rotor is open
        assert "D is not positive definite in 1000 of 1000 random poses" in (said := capsys.readouterr().err)
        assert "joints 1, 2, 3, 4, 5, 6: rotor_inertia" in said
        assert not made.exists()
        assert output.run(main.app, [*generate, "--open"]) == 0
    said = capsys.readouterr().out
    left_open = json.loads((made / "metadata.json").read_text(encoding="utf-8"))["open"]
    assert {(number["joint"], number["parameter"]) for number in left_open} == numbers_left_open(arm)
    assert {number["value"] for number in left_open} <= {0.0}
    for page in (f"{arm.name}_f32.h", f"{arm.name}_effects_f64.h", f"tendon_{arm.name}.hpp", f"{arm.name}.rs"):
        banner = (made / page).read_text(encoding="utf-8")[:900]
        assert all(number["parameter"] in banner and number["parameter"] in said for number in left_open)
    found = every_language(made, arm, at)
    for language, values in found.items():
        rounding = 1e-5 if language == "C float" else 1e-12
        assert np.abs(values[:, : n * n].reshape(-1, n, n) - D).max() <= rounding * np.abs(D).max(), language
        rigid = found["C"][:, n * n :]
        assert np.abs(values[:, n * n : n * n + n] - rigid).max() <= rounding * np.abs(rigid).max(), language
    assert np.allclose(found["C++"][:, n * n + n :], found["python"][:, n * n + n : n * n + 2 * n], rtol=1e-12)
    if arm.space and all(joint.rotor_inertia is None for joint in arm.joints):  # what a link carries has no rotor in it
        assert np.allclose(found["python"][:, -n:], found["C"][:, n * n :], rtol=1e-10, atol=1e-10)
    if "Rust" not in found:
        pytest.skip("the other languages are equal; Rust needs rustc")


@pytest.mark.parametrize("key", ["mass", "com", "inertia"])
def test_a_link_that_is_open_is_refused_by_name(key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, made = tmp_path / "bench.toml", tmp_path / "made"
    model.write_text("".join(line for line in BENCH.splitlines(True) if not line.startswith(f"{key} ")))
    for verb in (["generate", str(model), "--out", str(made)], ["firmware", str(model), "--out", str(made)]):
        assert output.run(main.app, verb) == 2
        assert f"(joints 1, 2: {key})" in capsys.readouterr().err
        assert not made.exists()
    assert output.run(main.app, ["generate", str(model), "--out", str(made), "--open", "--rust"]) == 0
    said = capsys.readouterr().out
    assert f"left open, without a value: joint 1: {key}; joint 2: " in said
    assert "coulomb.torque" in said.split("taken as 0")[1].split("\n")[0]
    document = json.loads((made / "metadata.json").read_text(encoding="utf-8"))
    assert {"joint": 1, "parameter": key, "value": None} in document["open"]
    assert {"joint": 2, "parameter": "stribeck.speed", "value": None} in document["open"]
    lacking = [lump["name"] for lump in document["lumps"] if lump["value"] is None]
    assert lacking
    with pytest.raises(AssertionError, match=f"bench needs a value of {', '.join(lacking)}"):
        every_language(made, reader.load(model), np.zeros((1, 3, 2)))
    assert np.isnan(by_c(made, "bench", np.ones((1, 3, 2)), "f64")).any()
    assert f"{lacking[0]}: f64::NAN" in (made / "bench.rs").read_text(encoding="utf-8")
