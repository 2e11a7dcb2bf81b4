"""The Python module of an arm: installed by pip into an empty folder, without Tendon or SymPy, the same bits."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
import sysconfig
from importlib.metadata import version
from pathlib import Path
from typing import Any

import guides
import numpy as np
import pytest
from packaged_arms import DT, SAMPLES, Packaged, busy, spatial

from runtime.notebook.dynamics import ArmFunctions
from symbolic.model_file.arm import Arm

pytestmark = [
    pytest.mark.xdist_group("python module"),
    pytest.mark.skipif(
        tuple(map(int, version("setuptools").split(".")[:2])) < (70, 1),
        reason="needs setuptools 70.1 or newer: pip install -e '.[dev]'",
    ),
    pytest.mark.skipif(
        not Path(sysconfig.get_path("include"), "Python.h").is_file(),
        reason="needs the headers of Python (python3-dev)",
    ),
]
BLOCKED = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"sympy", "casadi", "symbolic", "codegen", "runtime", "tendon", "scipy"}:
            raise ImportError(name)

sys.meta_path.insert(0, Blocked())
sys.path[:0] = sys.argv[1].split(":")
import numpy as np
"""


def installed(packaged: Packaged, folder: Path) -> Path:
    """The folder into which pip has installed the module."""
    source = packaged.written(folder / packaged.name)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index", "--no-deps"]
    target = folder / "target"
    run = subprocess.run(
        [*pip, "--no-build-isolation", "--target", str(target), str(source)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert "warning: " not in run.stderr
    return target


@pytest.fixture(scope="module")
def places(vishard4: Arm, tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Packaged, Path]]:
    """Arms with their installed modules."""
    arms = [Packaged(vishard4), Packaged(busy()), Packaged(spatial())]
    return {p.name: (p, installed(p, tmp_path_factory.mktemp(p.name))) for p in arms}


def script(target: Path, text: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs a script that sees the installed module and NumPy, and cannot import anything of Tendon."""
    numpy = Path(np.__file__).parent.parent
    command = [sys.executable, "-I", "-S", "-c", BLOCKED + text, f"{target}:{numpy}", *arguments]
    return subprocess.run(command, cwd=target, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", ["vishard4", "busy", "spatial"])
def test_the_same_bits_as_by_numpy(places: dict[str, Any], name: str, tmp_path: Path) -> None:
    packaged, target = places[name]
    np.savez(tmp_path / "given.npz", **{key: np.moveaxis(x, -1, 0) for key, x in packaged.inputs.items()})
    text = f"""
import inspect
import tendon_{name} as arm
given = np.load(sys.argv[2])
out = {{}}
skipped = {{"torque", "effects"}}
for key, f in inspect.getmembers(arm, inspect.isfunction):
    if f.__module__ != arm.__name__ or key.startswith("_") or key in skipped:
        continue
    names = [n for n in inspect.signature(f).parameters if n != "parameters"]
    out[key] = f(*(given[n] for n in names))
    assert np.array_equal(f(*(given[n][3] for n in names)), out[key][3], equal_nan=True), key
out["torque"] = arm.torque(given["q"], given["qd"], given["qdd"], dt={DT})
memory = arm.Memory()
steps = [arm.torque(*(given[n][k] for n in ("q", "qd", "qdd")), dt={DT}, memory=memory) for k in range({SAMPLES})]
assert np.array_equal(steps, out["torque"])
out["alone"] = arm.effects(given["q"], given["qd"], given["qdd"], dt={DT})
np.savez(sys.argv[3], **out)
"""
    run = script(target, text, str(tmp_path / "given.npz"), str(tmp_path / "out.npz"))
    assert run.returncode == 0, run.stderr
    found = dict(np.load(tmp_path / "out.npz"))
    whole = packaged.torque()
    # NumPy's spring_hysteresis shares operations between torque and memory, and so adds in another order.
    rounding = np.spacing(np.abs(whole).max()) if name == "busy" else 0.0
    assert np.abs(found.pop("torque") - whole).max() <= rounding
    rigid, alone = found["inverse_dynamics"], found.pop("alone")
    assert np.allclose(alone, whole - rigid, rtol=0.0, atol=1e-9)
    assert alone.any() == (name != "spatial")
    spelt = {"mass_matrix": "inertia", "jacobian": "tip_jacobian"}
    outputs = packaged.outputs()
    assert {spelt.get(key, key) for key in found} == set(outputs)
    for key, result in found.items():
        assert np.array_equal(result.reshape(SAMPLES, -1), outputs[spelt.get(key, key)], equal_nan=True), key


def test_names_are_those_of_the_package_tendon(places: dict[str, Any]) -> None:
    packaged, _ = places["vishard4"]
    page = ast.parse(packaged.files["tendon_vishard4/__init__.py"])
    functions = {f.name for f in page.body if isinstance(f, ast.FunctionDef) and not f.name.startswith("_")}
    ours = {name for name in vars(ArmFunctions) if not name.startswith("_")} - {"model", "name", "n"}
    assert ours <= functions


@pytest.mark.parametrize(
    ("call", "said"),
    [
        ("arm.tip(np.zeros(3))", "vishard4: q has shape (3,); expected (4,) or (N, 4)"),
        ("arm.tip(0)", "vishard4: q has shape (); expected (4,) or (N, 4)"),
        ("arm.mass_matrix(np.zeros((2, 2, 4)))", "vishard4: q has shape (2, 2, 4); expected (4,) or (N, 4)"),
        ("arm.coriolis(np.zeros((2, 4)), np.zeros((3, 4)))", "vishard4: q (2, 4), qd (3, 4) differ in samples"),
        ("arm.mass_matrix(np.zeros(4), parameters={'J9': 1.0})", "vishard4: parameters has J9; there are J1, J2"),
        ("arm.torque(np.zeros(4), 0, 0, values={'c': 1.0})", "vishard4: values has c; there are joint1_coulomb"),
        (
            "arm.mass_matrix(np.zeros(4), {'J1': None})",
            "vishard4: the model file leaves J1 open: pass parameters={...}",
        ),
        (
            "arm.torque(np.zeros(4), 0, 0, values={'joint1_viscous_coefficient': None})",
            "vishard4: the model file leaves",
        ),
        *(
            (
                f"arm.{call}(np.zeros(4), 0, 0, dt={dt})",
                f"vishard4: dt is {said}; expected seconds from sample to sample",
            )
            for call in ("torque", "effects")
            for dt, said in (("-1", "-1"), ("0.0", "0.0"), ("np.nan", "nan"), ("np.inf", "inf"))
        ),
        ("arm._core.call(99, 1, ())", "there is no such function"),
        ("arm._core.call(0, 1 << 62, ())", "so many samples do not fit into memory"),
        ("arm._core.call(0, 1, ())", "expected "),
        ("arm._core.along(1, 1, 0.1, tuple(np.zeros(3) for _ in range(7)))", "array 0: expected 16 doubles"),
        ("arm._core.along(1, 1, 0.1, tuple(np.zeros(16, int) for _ in range(7)))", "array 0: expected 16 doubles"),
    ],
)
def test_wrong_arguments_are_told(places: dict[str, Any], call: str, said: str) -> None:
    text = f"import tendon_vishard4 as arm\ntry:\n    {call}\nexcept Exception as error:\n    print(error)\n"
    run = script(places["vishard4"][1], text)
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith(said)


def test_the_script_of_the_guide(places: dict[str, Any]) -> None:
    """One call for many samples and many calls give the same last sample."""
    found = guides.blocks(guides.ROOT / "runtime" / "guides" / "controller.md")
    (text,) = (block.text for block in found if block.language == "python")
    run = script(places["vishard4"][1], text)
    assert run.returncode == 0, run.stderr
    together, alone = run.stdout.split("]")[:2]
    assert together.split("[")[1].split() == alone.split("[")[1].split() != []


def test_a_memory_needs_the_time_between_samples(places: dict[str, Any]) -> None:
    run = script(places["busy"][1], "import tendon_busy as arm\narm.torque(np.zeros(5), 0, 0)\n")
    assert "ValueError: busy: an effect depends on the samples before: pass dt" in run.stderr


def test_one_file_for_all_pythons(places: dict[str, Any]) -> None:
    for packaged, target in places.values():
        assert [path.name for path in (target / f"tendon_{packaged.name}").glob("*.so")] == ["_core.abi3.so"]
        assert next(target.glob("*.dist-info/WHEEL")).read_text().count("cp311-abi3-")
        assert (target / f"tendon_{packaged.name}" / "py.typed").is_file()


def test_types_hold(places: dict[str, Any], tmp_path: Path) -> None:
    _, target = places["vishard4"]
    (tmp_path / "use.py").write_text(
        "import tendon_vishard4 as arm\n\nD = arm.mass_matrix([0.0, 0.1, 0.2, 0.3])\nprint(D.shape, arm.JOINTS[0])\n"
    )
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", "use.py"]
    shutil.copytree(target / "tendon_vishard4", tmp_path / "tendon_vishard4")
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout
