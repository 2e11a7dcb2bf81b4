"""The guide of code generation does what it says: its script runs beside generated files alone, its back end is one."""

from __future__ import annotations

import json
import random
import re
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import jinja2
import numpy as np
import pytest
from random_arms import MIXED

from codegen import pages
from codegen.pages import BANNER
from codegen.tape.tape import Tape
from codegen.verify import reference, verify
from runtime.model.loader import Model
from symbolic.model import derive
from symbolic.model_file.arm import Arm

ROOT = Path(__file__).resolve().parents[2]
GUIDE = (ROOT / "codegen" / "README.md").read_text(encoding="utf-8")


def blocks(heading: str) -> list[str]:
    """The fenced blocks below a heading, in order."""
    return re.findall(r"^```\w+\n(.*?)^```", GUIDE.split(f"## {heading}\n")[1].split("\n## ")[0], re.M | re.S)


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, np.ndarray]]:
    """What the Opti script prints, and its solution; in a folder with the two modules and nothing else."""
    here = tmp_path_factory.mktemp("opti")
    for module in ("vishard4/vishard4_casadi.py", "effects/effects_casadi.py"):
        (here / "generated" / module).parent.mkdir(parents=True)
        shutil.copyfile(ROOT / "generated" / module, here / "generated" / module)
    (script,) = blocks("In CasADi without Tendon: an Opti script")
    script += "import json\nassert not {'symbolic', 'codegen', 'runtime', 'sympy'} & set(sys.modules)\n"
    script += "solution = {'q': q, 'qd': qd, 'qdd': qdd, 'tau': tau}\n"
    script += "print(json.dumps({name: found.value(x).tolist() for name, x in solution.items()}))\n"
    (here / "script.py").write_text(script, encoding="utf-8")
    run = subprocess.run([sys.executable, "-I", "script.py"], cwd=here, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    *_, said, numbers = run.stdout.splitlines()
    return said, {name: np.array(values) for name, values in json.loads(numbers).items()}


def test_the_script_says_what_the_guide_says(solved: tuple[str, dict[str, np.ndarray]]) -> None:
    assert f"It prints `{solved[0]}`" in GUIDE


def torques(model: Model, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """By the generated C with the exact laws of friction."""
    tau = model.inverse_dynamics(q, qd, qdd)
    for j, joint in enumerate(model.joints):
        for name in ("coulomb_asymmetric", "viscous", "viscous_cubic"):
            tau[j] += model.library.torque(name, {"qd": qd[j]}, joint.effects[name])
    return tau


def test_the_script_finds_a_motion_of_the_arm(solved: tuple[str, dict[str, np.ndarray]], model: Model) -> None:
    """Its torques are those of the arm, and the usual polynomial of degree five costs more."""
    q, qd, qdd, tau = (solved[1][name] for name in ("q", "qd", "qdd", "tau"))
    moving = np.abs(qd) > 0.05
    assert moving.mean() > 0.7
    np.testing.assert_allclose(tau[moving], torques(model, q, qd, qdd)[moving], atol=1e-9)
    assert np.abs(qd[:, [0, -1]]).max() < 1e-8

    time = np.linspace(0.0, 1.0, 41)
    way = (q[:, -1] - q[:, 0])[:, None]
    shape = 10 * time**3 - 15 * time**4 + 6 * time**5
    rate = (30 * time**2 - 60 * time**3 + 30 * time**4) / 1.2
    acceleration = (60 * time - 180 * time**2 + 120 * time**3) / 1.2**2
    usual = torques(model, q[:, :1] + way * shape, way * rate, way * acceleration)
    cost, other = (np.trapezoid((t**2).sum(axis=0), 1.2 * time) for t in (tau, usual))
    assert f"{cost:.1f}" == solved[0].split()[0]
    assert cost < 0.9 * other


def test_the_back_end_of_the_guide(monkeypatch: pytest.MonkeyPatch, vishard4: Arm) -> None:
    """Its four steps, as they stand, make code that equals SymPy for every function of two arms."""
    code, template, entry, calling, target = blocks("How to add a back end")
    numpy_code: dict = {}
    exec(compile(code, "numpy_code.py", "exec"), numpy_code)
    monkeypatch.setitem(pages._PAGES.loader.mapping, "numpy", jinja2.DictLoader({"numpy.py.j2": template}))
    monkeypatch.setattr(verify, "TARGETS", dict(verify.TARGETS))
    space = dict(vars(verify))
    exec(compile(calling, "verify.py", "exec"), space)
    for arm in (vishard4, MIXED["rprrp"]):
        model = derive(arm)
        name, origin, files = arm.name, f"Arm {arm.name}.", {}
        tapes = {function.name: Tape.of(function) for function in model.functions}
        known = {"numpy_code": SimpleNamespace(**numpy_code), "page": pages.page, "BANNER": BANNER}
        known |= {"tapes": tapes, "model": model, "files": files, "name": name, "origin": origin}
        exec(compile(entry, "render.py", "exec"), known)
        module: dict = {}
        exec(compile(files[f"{name}_numpy.py"], f"{name}_numpy.py", "exec"), module)
        others = {f.name: f for f in model.functions}
        for function in model.functions:
            space |= {"targets": {}, "module": SimpleNamespace(**module), "function": function}
            exec(compile(target, "verify.py", "exec"), space)
            draw = partial(reference.arm_values, arm=arm, function=function, others=others)
            subject = verify.Subject(function, space["targets"], draw)
            (case,), _ = verify.compare(subject, [draw(random.Random(seed)) for seed in range(2)])
            assert case.target == "NumPy"
            assert case.equal, case
    assert "F3 = " in files[f"{name}_numpy.py"]
