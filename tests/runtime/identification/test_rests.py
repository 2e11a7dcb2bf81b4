"""What rubs or sets in elsewhere than at a turn of a joint: rests of the end-effector, places of springs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime.arrays import Mask
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import prepared, without_torques_at_tip_rests
from runtime.identification.regressors import Regressors
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Term, structure
from runtime.motion.band import Band
from runtime.motion.motion import Motion, prepare
from runtime.recordings.recording import Recording
from runtime.workspace.source import Source
from tests import spatial_wrist, wrist

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
    return prepare([recording(q, tau)], Band(np.full(4, 20.0), "given", silent, np.zeros(4), 1e-16 * silent), model)


def rubbed(model: Model, motion: Motion, friction: float, depth: float) -> Motion:
    """With a plate whose place is so far above the lowest point of the end-effector."""
    lowest = float(np.min(model.tip(motion.pieces[0].q)[1]))
    values = {"stiffness": 600.0, "pretension": 24.0, "friction": friction, "position": lowest + depth}
    return without_torques_at_tip_rests(model, motion, Prediction(model.lump_values, {PLATE: values}))


def more_unknown(touched: Motion, motion: Motion, joint: int) -> Mask:
    """(N,) samples of the first piece that a plate made unknown to a joint."""
    return touched.pieces[0].without[joint].samples & ~motion.pieces[0].without[joint].samples


def test_no_joint_holds_a_force_at_a_turn_of_the_end_effector(model: Model, swinging: Motion) -> None:
    """Whatever the plate holds at its turns is in the recorded rows of every joint, and in no equation of one."""
    piece, touched = swinging.pieces[0], rubbed(model, swinging, friction=6.0, depth=9.0)
    rate = np.gradient(model.tip(piece.q)[1], DT)
    turns = piece.t[np.flatnonzero(np.diff(np.sign(rate)))]
    held = np.random.default_rng(1).uniform(-1, 1, len(piece.t))
    for joint in range(4):
        unknown = touched.pieces[0].without[joint].samples
        at_turns = np.min(np.abs(piece.t[:, None] - turns), axis=1) < 2 * DT
        assert unknown[at_turns].all()
        assert more_unknown(touched, swinging, joint).any()
        for torque in (np.where(at_turns, 1.0, 0.0), np.where(unknown, held, 0.0)):
            rows = piece.in_band(torque)
            left = touched.pieces[0].equation(rows, joint)[touched.moving(joint)]
            assert np.abs(rows).max() > 10 * touched.quiet[joint]
            assert np.abs(left).max() < touched.quiet[joint]


def test_what_the_end_effector_does_elsewhere_is_known(model: Model, swinging: Motion) -> None:
    touched = rubbed(model, swinging, friction=6.0, depth=9.0)
    piece = swinging.pieces[0]
    rate = np.abs(np.gradient(model.tip(piece.q)[1], DT))
    for joint in range(4):
        more = more_unknown(touched, swinging, joint)
        assert rate[more].max() < 0.1 * rate.max()


def test_where_nothing_rubs_every_torque_is_known(model: Model, swinging: Motion) -> None:
    for motion in (rubbed(model, swinging, 0.0, 9.0), rubbed(model, swinging, 6.0, -0.01)):
        assert not any(more_unknown(motion, swinging, i).any() for i in range(4))
        assert all(np.array_equal(motion.moving(i), swinging.moving(i)) for i in range(4))


def test_regressors_of_a_motion_know_nothing_of_another(model: Model, swinging: Motion) -> None:
    """With all torques known, nothing is left of what rests took out of columns that were asked for before."""
    term, prediction = Term("coulomb", 1), Prediction(model.lump_values, {})
    resting = Regressors(model, swinging, prediction)
    before = resting.columns(term, 0, {})
    whole = replace(resting, motion=swinging.with_standstill).columns(term, 0, {})
    assert np.array_equal(whole, Regressors(model, swinging.with_standstill, prediction).columns(term, 0, {}))
    assert not np.array_equal(whole, before)


def test_an_excerpt_knows_as_little(model: Model, swinging: Motion) -> None:
    touched = rubbed(model, swinging, friction=6.0, depth=9.0)
    excerpt, _ = touched.excerpt(3000)
    first = touched.pieces[0]
    for piece in excerpt.pieces:
        start = int(np.searchsorted(first.t, piece.t[0]))
        for mine, whole in zip(piece.without, first.without, strict=True):
            assert np.array_equal(mine.samples, whole.samples[start : start + len(piece.t)])


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
    fit = fit_motion(drive, prepared(drive, [recording(q[None], tau[None])]), known)
    assert fit.shapes[term]["offset"] == pytest.approx(place, abs=0.004)
    assert fit.prediction.values[term]["pretension"] == pytest.approx(0.8, abs=0.05)


def test_dry_friction_at_a_turn_is_told_from_what_the_other_joints_ask(
    cache: Path,  # noqa: ARG001 - the model is compiled there
    tmp_path: Path,
) -> None:
    """A joint that carries five others: their motion and weight move its torque by far more than its friction."""
    path = tmp_path / "arm.toml"
    path.write_text(spatial_wrist.MODEL)
    six = Source.read(path, None).compiled.model()
    motion = prepared(six, [spatial_wrist.record(wrist.CoupledMotor(), seed=0, seconds=9.0)])
    assert motion.band.torque_floor() / motion.quiet == pytest.approx(spatial_wrist.DRY, rel=0.12)
