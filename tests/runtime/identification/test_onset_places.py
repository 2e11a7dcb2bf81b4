"""The place at which a torque sets in is found among fixed places, from wherever the search began."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runtime.identification import grids, jumps
from runtime.identification.problem import Problem, Skew
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Term
from runtime.motion.band import Band
from runtime.motion.motion import prepare
from runtime.recordings.recording import Recording

DT = 1e-3
FINE = 16  # places to a step of a grid
SPRING = Term("parallel_spring", 1)
STIFFNESS = 8.0  # N m/rad


def problem(model: Model, place: float, seed: int) -> Problem:
    """Eight seconds of a joint with a spring below a place."""
    rng, t = np.random.default_rng(seed), np.arange(8000) * DT
    q = 0.5 * np.sin(2 * np.pi * 0.31 * t)[None] + 0.1 * np.sin(2 * np.pi * 2.3 * t + seed)
    qd = np.gradient(q, DT, axis=1)
    qdd = np.gradient(qd, DT, axis=1)
    tau = model.inverse_dynamics(q, qd, qdd, model.lump_values) + 1.5 * np.sign(qd) + 1.1 * qd
    tau += np.where(q < place, STIFFNESS * (q - place), 0.0) + 0.02 * rng.standard_normal(q.shape)
    q += 1e-5 * rng.standard_normal(q.shape)
    whole, everywhere = np.zeros(len(t), dtype=np.int64), (slice(0, len(t)),)
    made = Recording(Path("run.csv"), t, whole, q, tau, ("revolute",), everywhere, (None,))
    motion = prepare(
        [made], Band(20.0 * np.ones(1), "given", 5e-6 * np.ones(1), 2e-11 * np.ones(1), np.zeros(1)), model
    )
    known = {Term("coulomb", 1): {"torque": 1.5}, Term("viscous", 1): {"coefficient": 1.1}}
    return Problem(model, motion, (*known, SPRING), Prediction(model.lump_values, known))


@pytest.mark.parametrize("seed", range(3))
def test_the_same_place_from_whatever_start(drive: Model, seed: int) -> None:
    rng = np.random.default_rng(seed)
    place = float(rng.uniform(-0.2, 0.2))
    of = problem(drive, place, seed)
    (shape,) = (p for p in of.model.library.effects["parallel_spring"].shape if p.grid and p.grid.of == "position")
    best = min(grids.points(of.regressors, SPRING), key=lambda choice: _error(of, choice))
    grid = grids.axis(of.regressors, SPRING, shape, best)
    step = grid[1] - grid[0]
    found = set()
    for start in place + step * np.array([-0.7, -0.1, 0.0, 1e-9, 0.4, 0.8]):
        shapes = {t: {} for t in of.layout.terms} | {SPRING: {**best, shape.name: float(start)}}
        found.add(jumps.least_places(of, shapes, Skew(0.5))[SPRING][shape.name])
    assert max(found) - min(found) <= step / FINE
    assert all(abs(x - place) < 2 * step / FINE for x in found)


def _error(of: Problem, choice: dict[str, float]) -> float:
    shapes = {t: {} for t in of.layout.terms} | {SPRING: choice}
    return float(sum(r @ r for r in of.solve(shapes, Skew(0.5)).residual))
