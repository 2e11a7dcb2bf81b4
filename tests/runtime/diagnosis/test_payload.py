"""A payload that is picked up between two runs: its moment is tried there, and known as well as the motion shows it."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from runtime.arrays import Array
from runtime.diagnosis.stages import diagnose
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.recordings.recording import Recording
from tests.kept import kept

RUN_S, RUNS, RATE = 6.0, 5, 500
PAYLOAD = Term("payload")
MASS, ARM = 0.6, 0.30  # kg at the tip, m from the axis


def runs(picked_up: float, seed: int = 0, pause: tuple[float, float] = (0.0, 0.0)) -> Recording:
    """Runs of a rigid drive, each from rest and with its own clock, a mass at its tip from a moment on.

    picked_up   s since the recording began
    pause       s, first and last instant of each run between which nothing is recorded
    """
    rng = np.random.default_rng(seed)
    n = int(RUN_S * RATE)
    t = np.arange(n) / RATE
    columns: list[list[Array]] = [[], [], [], []]
    for k in range(RUNS):
        q, qd, qdd = np.zeros((3, n))
        for f in (0.5, 1.3, 2.1):
            w, a = 2 * np.pi * f, 0.25 / f * rng.uniform(0.6, 1.2)
            phase = rng.uniform(0, 2 * np.pi)
            q, qd, qdd = (
                q + a * np.sin(w * t + phase),
                qd + a * w * np.cos(w * t + phase),
                qdd - a * w**2 * np.sin(w * t + phase),
            )
        inertia = 0.2365 + MASS * ARM**2 * (k * RUN_S + t > picked_up)
        tau = inertia * qdd + 0.5 * np.sign(qd) + 0.5 * qd + 0.05 * rng.standard_normal(n)
        kept = (t <= pause[0]) | (t >= pause[1])
        parts = (np.full(n, k), t, q + 1e-5 * rng.standard_normal(n), tau)
        for column, part in zip(columns, parts, strict=True):
            column.append(part[kept])
    run, t, q, tau = (np.concatenate(c) for c in columns)
    cuts = [0, *(np.flatnonzero((np.diff(run) != 0) | (np.diff(t) > 2 / RATE)) + 1), len(t)]
    segments = tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(cuts))
    return Recording(Path("run.csv"), t, run.astype(np.int64), q[None], tau[None], ("revolute",), segments, (None,))


@pytest.mark.parametrize(
    ("picked_up", "pause"),
    [(3 * RUN_S, (0.0, 0.0)), (2 * RUN_S + 2.5, (0.0, 0.0)), (1 * RUN_S + 3.0, (2.0, 4.0))],
    ids=["between runs", "within a run", "in a gap"],
)
def test_a_payload_from_a_moment_on(drive: Model, picked_up: float, pause: tuple[float, float]) -> None:
    """Named with its mass; the interval of the moment holds it, and is that of a pause where there is one."""
    found = kept(diagnose, drive, [runs(picked_up, pause=pause)])
    assert found.findings[0].term == PAYLOAD
    values = found.steps[1].fit.inference.values[PAYLOAD]
    assert values["mass"].value == pytest.approx(MASS, rel=0.05)
    low, high = values["time"].interval or (np.nan, np.nan)
    assert low <= picked_up <= high
    assert high - low < (pause[1] - pause[0]) + 1.2
    if pause[1]:
        assert high - low > 0.9 * (pause[1] - pause[0])
