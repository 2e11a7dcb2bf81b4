"""The newcomer's path on a real arm, in ten lines of a notebook: from its log to the torques of a better model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

REAL = Path(__file__).parents[4] / "shared" / "data" / "real" / "ur10"

NOTEBOOK = """
import pandas as pd, tendon
arm = tendon.load("ur10")
log = pd.read_csv("fit.csv.gz")
run = tendon.recording(log, arm)
assert not tendon.inspect(run, arm).suspicions
diagnosis = tendon.diagnose(arm, run)
better = tendon.improve(arm, run, held_out="held.csv.gz")
for finding in better.added:
    print(finding.effect, finding.joint, finding.error_before, finding.error_after)
tau = better.arm.torque(run.q.T, run.qd.T, 0, run.dt)
"""


@pytest.mark.slow
def test_the_path_reads_like_prose_and_lowers_the_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if not REAL.is_dir():
        pytest.skip("../shared/data/real is not there")
    monkeypatch.chdir(REAL)
    cell: dict = {}
    assert len(NOTEBOOK.strip().splitlines()) == 10
    exec(NOTEBOOK, cell)
    better, tau, diagnosis = cell["better"], cell["tau"], cell["diagnosis"]
    assert diagnosis.findings[0].joint == 1
    assert len(capsys.readouterr().out.splitlines()) == len(better.added) > 1
    assert [f"{f.effect}@{f.joint}" for f in better.added] == [step.added for step in better.history[1:]]
    for finding in better.added:
        assert finding.error_after < finding.error_before
    first, last = (np.array(better.history[k].held_out_relative) for k in (0, -1))
    assert (last**2).sum() < 0.7 * (first**2).sum()
    # Without accelerations: at joint 2 gravity and friction are nearly all of the torque.
    run = cell["run"]
    assert tau.shape == run.q.T.shape
    assert np.linalg.norm(run.tau[1] - tau[:, 1]) < 0.15 * np.linalg.norm(run.tau[1])
