"""Many shapes solved at once have the errors that each has when it is solved alone."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from runtime.identification import grids
from runtime.identification.problem import Problem, Skew, first_least
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Term, Values
from runtime.motion.band import Band
from runtime.motion.motion import Motion, prepare
from runtime.recordings.recording import Recording
from runtime.workspace.source import Source
from tests.one_joint import joint_text

SKEWS: tuple[Literal["no", "shared", "each"], ...] = ("no", "shared", "each")

DT = 1e-3
WAYS = 7
DRY, VISCOUS = 1.5, 1.1  # N m, N m s/rad
FRICTION = "[joint.effects.coulomb]\n[joint.effects.viscous]\n"
JOINTS = "".join(joint_text(FRICTION, rotor) for rotor in (0.3, 0.1))
TWO_JOINTS = f'name = "two_joints"\ngravity = [0.0, -9.81]\n{JOINTS}'
VALUES = {"coulomb": {"torque": DRY}, "viscous": {"coefficient": VISCOUS}}


@pytest.fixture(scope="module")
def models(drive: Model, tmp_path_factory: pytest.TempPathFactory) -> dict[int, Model]:
    """By number of joints."""
    path = tmp_path_factory.mktemp("arm") / "two_joints.toml"
    path.write_text(TWO_JOINTS)
    return {1: drive, 2: Source.read(path, None).compiled.model()}


def moved(model: Model, seed: int, rests: bool) -> Motion:
    """Three seconds under friction that falls with speed, a spring that sets in at a place, and noise. rests: whether
    what may be held where a joint turns is eliminated."""
    rng, t = np.random.default_rng(seed), np.arange(3000) * DT
    q = np.zeros((model.n, len(t)))
    for frequency in (0.7, 1.9, 4.3):
        phase = rng.uniform(0, 2 * np.pi, (model.n, 1))
        q += 0.4 / frequency * np.sin(2 * np.pi * frequency * t + phase)
    qd = np.gradient(q, DT, axis=1)
    qdd = np.gradient(qd, DT, axis=1)
    tau = model.inverse_dynamics(q, qd, qdd, model.lump_values) + VISCOUS * qd
    tau += (DRY + 2.5 * np.exp(-np.abs(qd) / 0.1)) * np.sign(qd)
    tau += np.where(q < 0.1, q - 0.4, 0.0) + 0.05 * rng.standard_normal(q.shape)
    q += 1e-4 * rng.standard_normal(q.shape)
    whole, everywhere = np.zeros(len(t), dtype=np.int64), (slice(0, len(t)),)
    made = Recording(Path("run.csv"), t, whole, q, tau, ("revolute",) * model.n, everywhere, (None,) * model.n)
    n = np.ones(model.n)
    motion = prepare([made], Band(20.0 * n, "given", 5e-6 * n, 2e-11 * n, 0.0 * n), model)
    return motion if rests else motion.with_standstill


def problem(model: Model, motion: Motion, term: Term) -> Problem:
    """Of the arm with friction and the term, after a fit that knew neither the term nor the right friction."""
    every = {Term(name, i + 1): values for i in range(model.n) for name, values in VALUES.items()}
    prediction = Prediction(model.lump_values, dict(every))
    made = Problem(model, motion, (*every, term), prediction)
    made.weights = made.weights * np.linspace(1.0, 0.3, model.n)
    return made


def ways(of: Problem, term: Term, rng: np.random.Generator) -> list[dict[Term, Values]]:
    """Some of the grid of the term, one of them twice."""
    choices = grids.points(of.regressors, term)
    assert len(choices) > 1
    tried = [choices[k] for k in rng.permutation(len(choices))[:WAYS]]
    return [{**{other: {} for other in of.layout.terms}, term: shape} for shape in [*tried, tried[0]]]


def error(of: Problem, shapes: dict[Term, Values], skew: Skew) -> float:
    residual = of.solve(shapes, skew).residual
    return float(sum(w**2 * (r @ r) for r, w in zip(residual, of.weights, strict=True)))


CASES = [
    *((n, Term(effect, n)) for n in (1, 2) for effect in ("parallel_spring", "lugre", "backlash")),
    (2, Term("stribeck", 2)),
    (2, Term("plate")),
    (2, Term("elasticity", 1)),
]


@pytest.mark.parametrize("rests", [True, False], ids=["rests eliminated", "all known"])
@pytest.mark.parametrize(("n", "term"), CASES, ids=str)
def test_at_once_as_one_after_another(models: dict[int, Model], n: int, term: Term, rests: bool) -> None:
    """The other problem is solved on a motion of its own, so that no column is computed for both."""
    for seed, unknown in enumerate(SKEWS):
        together, alone = (problem(models[n], moved(models[n], seed, rests), term) for _ in range(2))
        rng, skew = np.random.default_rng(seed), Skew(0.4 + 0.3 * seed, unknown)
        tried = ways(together, term, rng)
        together.foresee(term, [shapes[term] for shapes in tried], tried[0])
        own = [error(alone, shapes, skew) for shapes in tried]
        assert np.ptp(own) > 1e-6 * min(own)
        np.testing.assert_allclose(together.errors(tried, skew), own, rtol=1e-9)
        # Whatever was solved before leaves nothing behind.
        np.testing.assert_allclose([error(together, shapes, skew) for shapes in tried], own, rtol=1e-9)
        np.testing.assert_allclose(alone.errors(tried[::-1], skew), own[::-1], rtol=1e-9)


def test_of_equals_the_first_is_taken() -> None:
    """Rounding tells two shapes apart that put nothing into a torque; noise tells others apart by more."""
    assert first_least(np.array([2.0, 1.0 + 1e-14, 1.0, 3.0])) == 1
    assert first_least(np.array([2.0, 1.0 + 1e-7, 1.0, 3.0])) == 2
    assert first_least(np.zeros(3)) == 0
