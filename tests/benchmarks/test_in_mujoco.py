"""A hidden effect is found, added and exported: how far is MuJoCo's motion off on the held-out run, before and after?

Before, the model has all parameters fitted and lacks the effect. Windows begin at the recorded state, and the recorded
torque acts; what is lost in translation is MuJoCo's motion against Tendon's.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from runtime.exchange.mujoco_play import Played
from runtime.replay.replay import PlayedWindows, Replay
from runtime.workspace.source import Source
from tests.benchmarks import harness

HIDDEN = {
    "drive": "stribeck@1",
    "vishard4": "coupled_friction@2:torque=1.5",
    "ur10": "stribeck@2",
    "panda": "linear_spring@4:stiffness=20,rest=-1",
}
CASES = os.environ.get("TENDON_BENCHMARK_CASES", harness.sized("", "drive"))
"""Arms whose names begin so; in the short form the quickest."""
TENDON = "from runtime.cli.main import main; main()"
LESS, MOST_LOST = 0.7, 0.02
"""Part of the error before, and of the motion between both simulators, in windows of 0.3 s."""


def typed(folder: Path, *commands: str) -> None:
    root = Path(__file__).parents[2]
    environment = os.environ | {"PYTHONPATH": str(root), "OPENBLAS_NUM_THREADS": "1"}
    for command in commands:
        done = subprocess.run(
            [sys.executable, "-c", TENDON, *shlex.split(command)], cwd=folder, env=environment, capture_output=True
        )
        assert done.returncode in (0, 1), f"{command}: {done.stderr.decode()}"


def replayed(folder: Path, name: str) -> list[tuple[PlayedWindows, np.ndarray]]:
    """For each length, the windows as Tendon plays them, and the positions (W, K, n) that MuJoCo plays."""
    source = Source.read(folder / f"{name}.toml", None)
    model, recordings = source.compiled.model(), source.recordings([folder / "run2.csv"], None, False)
    replay, played = Replay.of_file(model, recordings), Played(folder / f"{name}.xml")
    found = []
    for each in replay.opened:
        t = each.dt * np.arange(each.windows.length + 1)
        tau, q, qd = (each.windows.cut(replay.tracks, signal) for signal in ("tau", "q", "qd"))
        found.append((each, played.windows(t, tau, q[:, 0], qd[:, 0])))
    return found


def share(x: np.ndarray, recorded: np.ndarray) -> float:
    """The rms of x (W, K) over that of a joint's motion in a window: the median of windows, some of which run away."""
    moved = np.sqrt(np.mean((recorded - recorded[:, :1]) ** 2))
    with np.errstate(all="ignore"):
        each = np.sqrt(np.mean(x**2, axis=1)) / moved
    return float(np.median(np.where(np.isfinite(each), each, np.inf)))


def errors(joint: int, found: tuple[PlayedWindows, np.ndarray]) -> tuple[float, float, float]:
    """Of a joint (0-based): Tendon's motion and MuJoCo's against the recorded one, and one against the other."""
    own, recorded, there = found[0].played[:, :, joint], found[0].recorded[:, :, joint], found[1][:, :, joint]
    own_error, error, lost = (share(x, recorded) for x in (own - recorded, there - recorded, there - own))
    return own_error, error, lost


@pytest.mark.parametrize("arm", [name for name in HIDDEN if name.startswith(CASES)])
def test_the_motion_in_mujoco_before_and_after(tmp_path: Path, arm: str) -> None:
    runs = [f"simulate {arm} --hide {HIDDEN[arm]} --seconds 20 --seed {k} --out run{k}.csv" for k in (1, 2)]
    typed(tmp_path, *runs, f"init --like {arm} --out before.toml")
    # What is simulated are the motors' torques, whatever the arm's own sensors measure.
    stated = (tmp_path / "before.toml").read_text().splitlines(keepends=True)
    (tmp_path / "before.toml").write_text("".join(line for line in stated if not line.startswith("torque =")))
    typed(
        tmp_path,
        "improve before.toml run1.csv --held-out run2.csv --out after.toml",
        "identify before.toml run1.csv --write",
        *(f"export {name}.toml --to mjcf --out {name}.xml" for name in ("before", "after")),
    )
    before, after = (replayed(tmp_path, name) for name in ("before", "after"))
    joint = int(HIDDEN[arm].partition("@")[2].partition(":")[0]) - 1
    rows = [
        (name, f"{each.windows.length * each.dt:.1f} s", *(f"{100 * x:.2g} %" for x in errors(joint, (each, there))))
        for name, found in (("before", before), ("after", after))
        for each, there in found
    ]
    words = [set(Source.read(tmp_path / f"{name}.toml", None).text.split()) for name in ("before", "after")]
    added = sorted(word.strip("[]").rpartition(".")[2] for word in words[1] - words[0] if "effects." in word)
    head = ("model", "windows", "Tendon", "MuJoCo", "lost in translation")
    title = f"Error of joint {joint + 1} in MuJoCo: {arm}, {HIDDEN[arm]}"
    harness.show(title, head, rows, [f"added: {', '.join(added) or 'nothing'}"])
    (_, error, _), (_, better, lost) = errors(joint, before[1]), errors(joint, after[1])
    assert better < LESS * error
    assert lost < MOST_LOST
