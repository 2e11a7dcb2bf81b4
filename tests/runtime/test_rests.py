"""What rubs or sets in elsewhere than at a turn of a joint: rests of the end-effector, places of springs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime.estimation import tip_rests
from runtime.estimation.identify import identify_motion, prepared
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Term, structure
from runtime.motion.band import Band
from runtime.motion.motion import Motion, prepare
from runtime.recordings.recording import Recording

DT = 1e-3
POSTURE = np.array([-0.2, -0.4, -1.6, -1.0])
SWING = np.array([0.3, 0.1, 0.4, 0.2])
PLATE = Term("plate")


def recording(q: NDArray[np.float64], tau: NDArray[np.float64]) -> Recording:
    n, size = q.shape
    whole, t = np.zeros(size, dtype=np.int64), np.arange(size) * DT
    return Recording(Path("run.csv"), t, whole, q, tau, ("revolute",) * n, (slice(0, size),), (None,) * n)


@pytest.fixture(scope="module")
def swinging(model: Model) -> Motion:
    """Four joints at frequencies of their own, so that the end-effector turns where joints do not."""
    t = np.arange(6000) * DT
    turns = np.array([[0.5], [0.8], [0.6], [0.9]])
    q = POSTURE[:, None] + SWING[:, None] * np.sin(2 * np.pi * turns * t + np.arange(4)[:, None])
    rng = np.random.default_rng(0)
    tau = np.sign(np.gradient(q, DT, axis=1)) + 0.05 * rng.standard_normal(q.shape)
    silent = np.full(4, 1e-5)
    return prepare([recording(q, tau)], Band(20.0, "given", silent, np.zeros(4), 1e-16 * silent), model.library)


def rubbed(model: Model, motion: Motion, friction: float, depth: float) -> Motion:
    """With a plate whose place is so far above the lowest point of the end-effector."""
    lowest = float(np.min(model.tip(motion.pieces[0].q)[1]))
    values = {"stiffness": 600.0, "pretension": 24.0, "friction": friction, "position": lowest + depth}
    return tip_rests.eliminated(model, motion, Prediction(model.lump_values, {PLATE: values}))


def test_rows_at_a_turn_of_the_end_effector_count_at_no_joint(model: Model, swinging: Motion) -> None:
    piece, touched = swinging.pieces[0], rubbed(model, swinging, friction=6.0, depth=9.0)
    rate = np.gradient(model.tip(piece.q)[1], DT)
    turns = piece.t[np.flatnonzero(np.diff(np.sign(rate)))]
    away = np.min(np.abs(swinging.row_time[:, None] - turns), axis=1)
    for joint in range(4):
        lost = swinging.moving(joint) & ~touched.moving(joint)
        assert not touched.moving(joint)[away < 0.01].any()
        assert lost.any()
        assert away[lost].max() < 0.1


def test_where_nothing_rubs_every_row_counts(model: Model, swinging: Motion) -> None:
    for motion in (rubbed(model, swinging, 0.0, 9.0), rubbed(model, swinging, 6.0, -0.01)):
        assert all(np.array_equal(motion.moving(i), swinging.moving(i)) for i in range(4))


def test_an_excerpt_leaves_out_the_same_rows(model: Model, swinging: Motion) -> None:
    touched = rubbed(model, swinging, friction=6.0, depth=9.0)
    excerpt, rows = touched.excerpt(3000)
    assert touched.spoiled is not None
    assert excerpt.spoiled is not None
    assert np.array_equal(excerpt.spoiled, touched.spoiled[:, rows])


@pytest.mark.parametrize("astray", [-0.03, 0.04])
def test_a_place_is_found_over_the_staircase_of_its_samples(drive: Model, astray: float) -> None:
    """The same cycle again and again passes the place of a jump at the same samples: the error has wide steps there."""
    t, rng, place = np.arange(12000) * DT, np.random.default_rng(3), 0.25
    q = 0.5 * np.sin(2 * np.pi * 1.0 * t) + 0.1 * np.sin(2 * np.pi * 2.0 * t)
    qd, qdd = np.gradient(q, DT), np.gradient(np.gradient(q, DT), DT)
    spring = np.where(q < place, 3.0 * (place - q) + 0.8, 0.0)
    friction = np.where(qd > 0, 1.72, -1.05) + 1.14 * qd - 0.015 * qd**3
    tau = 0.2365 * qdd + friction - spring + 0.02 * rng.standard_normal(len(t))
    term = Term("parallel_spring", 1)
    known = {**structure(drive), term: {"offset": place + astray, "radius": 1.0}}
    fit = identify_motion(drive, prepared(drive, [recording(q[None], tau[None])]), known).fit
    assert fit.shapes[term]["offset"] == pytest.approx(place, abs=0.004)
    assert fit.prediction.values[term]["pretension"] == pytest.approx(0.8, abs=0.05)
