"""A hidden effect is found, added and exported: how far is MuJoCo's motion off on the held-out run, before and after?

Before, the model has all parameters fitted and lacks the effect. Windows begin at the recorded state, and the recorded
torque acts; what is lost in translation is MuJoCo's motion against that of Tendon's equations.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.benchmarks import harness

HIDDEN = {
    "drive": "stribeck@1",
    "vishard4": "coupled_friction@2:torque=1.5",
    "ur10": "spring_hysteresis@2",
    "panda": "linear_spring@4:stiffness=20,rest=-1",
}
CASES = os.environ.get("TENDON_BENCHMARK_CASES", harness.sized("", "drive"))
"""Arms whose names begin so; in the short form the quickest."""
TENDON = "from runtime.cli.main import main; main()"
LESS, MOST_LOST = 0.7, 0.02
"""Part of the error before, and of the motion between both simulators, in windows of 0.1 s."""


def typed(folder: Path, *commands: str) -> None:
    root = Path(__file__).parents[2]
    environment = os.environ | {"PYTHONPATH": str(root), "OPENBLAS_NUM_THREADS": "1"}
    for command in commands:
        done = subprocess.run(
            [sys.executable, "-c", TENDON, *shlex.split(command)], cwd=folder, env=environment, capture_output=True
        )
        assert done.returncode in (0, 1), f"{command}: {done.stderr.decode()}"


@pytest.mark.parametrize("arm", [name for name in HIDDEN if name.startswith(CASES)])
def test_the_motion_in_mujoco_before_and_after(tmp_path: Path, arm: str) -> None:
    typed(tmp_path, f"init --like {arm} --out before.toml")
    # What is simulated are the motors' torques, whatever the arm's own sensors measure; MuJoCo has no plate to touch.
    text = re.sub(r'(?m)^torque = ".*\n', "", (tmp_path / "before.toml").read_text())
    (tmp_path / "before.toml").write_text(re.sub(r"(?ms)^\[contact.*?(?=^\[(?!contact)|\Z)", "", text))
    typed(
        tmp_path,
        *(f"simulate before.toml --hide {HIDDEN[arm]} --seconds 20 --seed {k} --out run{k}.csv" for k in (1, 2)),
        "improve before.toml run1.csv --held-out run2.csv --out after.toml --json improved.json",
        "identify before.toml run1.csv --write",
        "replay after.toml run2.csv --before before.toml --in mujoco --json replay.json",
    )
    added = [step["added"] for step in json.loads((tmp_path / "improved.json").read_text())["history"]]
    joint = int(HIDDEN[arm].partition("@")[2].partition(":")[0])
    steps = json.loads((tmp_path / "replay.json").read_text())["steps"]
    errors = [step["joints"][joint - 1]["open_loop"] for step in steps]
    # Tendon's before and after, and MuJoCo's.
    models = zip(("before", "after"), errors[:2], errors[2:], strict=True)
    rows = [
        (name, f"{own['seconds']:.1f} s", part(own, "rms", own), part(there, "rms", own), part(there, "apart", own))
        for name, alone, mujoco in models
        for own, there in zip(alone, mujoco, strict=True)
    ]
    title = f"Error of joint {joint} in MuJoCo: {arm}, {HIDDEN[arm]}"
    head = ("model", "windows", "Tendon", "MuJoCo", "lost in translation")
    harness.show(title, head, rows, [f"added: {', '.join(filter(None, added)) or 'nothing'}"])
    before, after = errors[2][0], errors[3][0]
    assert after["rms"] < LESS * before["rms"]
    assert after["apart"] / after["rms"] * after["share"] < MOST_LOST


def part(entry: dict, what: str, own: dict) -> str:
    """A figure over the motion in the windows."""
    known = entry.get(what) is not None and own["rms"]
    return f"{100 * entry[what] / own['rms'] * own['share']:.2g} %" if known else "runs away"
