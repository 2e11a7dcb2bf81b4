"""A link-side encoder that is read late, on a joint that other axes push: what it says of the transmission."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from runtime.arrays import Array
from runtime.diagnosis.candidates import FittedBase
from runtime.diagnosis.stages import diagnose
from runtime.diagnosis.twist import witnessed
from runtime.identification.identify import identify
from runtime.identification.problem import Problem
from runtime.identification.twist import TwistFit, fit_twist
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.motion.settings import UNAFFECTED
from runtime.recordings.recording import Recording
from runtime.report.diagnosed import document as diagnosed
from tests.kept import kept
from tests.plants import LINK, ROTOR

COUNT = 2 * np.pi / 400_000  # rad at the joint
RATE = 500.0  # Hz
TORQUE_NOISE = 0.05  # N m
ELASTICITY, BACKLASH = Term("elasticity", 1), Term("backlash", 1)


@dataclass(frozen=True)
class Transmission:
    """stiffness N m/rad, gap rad, skew s by which the link-side encoder is read late."""

    stiffness: float = 2000.0
    gap: float = 0.0
    skew: float = 2.5e-3


def _motion(t: Array, derivative: int) -> Array:
    """The motor's angle, rad, or a derivative of it: 1 and 3 rad/s at 0.31 and 1.3 Hz."""
    found = np.zeros_like(t)
    for peak, frequency in ((1.0, 0.31), (3.0, 1.3), (0.8, 2.9)):
        omega = 2 * np.pi * frequency
        found += peak / omega * omega**derivative * np.sin(omega * t + derivative * np.pi / 2)
    return found


def pushed(seed: int, joint: Transmission, seconds: float = 30.0, count: float = COUNT) -> Recording:
    """Other axes push the link with some N m that no model of this joint knows; the transmission yields at once.

    Drive1's rotor and link with the friction of plants.py; what hangs behind a spring this stiff lags by less than
    any motor torque shows.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    frequencies = rng.uniform(0.2, 2.5, 5)
    phases = rng.uniform(0, 2 * np.pi, 5)

    def push(time: Array) -> Array:
        waves = [np.sin(2 * np.pi * f * time + p) for f, p in zip(frequencies, phases, strict=True)]
        return np.asarray(2.0 * np.sum(waves, axis=0))

    def twist(time: Array) -> Array:
        load = LINK * _motion(time, 2) + push(time)
        return load / joint.stiffness + joint.gap / 2 * np.sign(load)

    q, qd = _motion(t, 0), _motion(t, 1)
    friction = np.where(qd > 0, 1.72, -1.05) + 1.14 * qd - 0.015 * qd**3
    tau = (ROTOR + LINK) * _motion(t, 2) + push(t) + friction + TORQUE_NOISE * rng.standard_normal(len(t))
    before = t - joint.skew
    link = _motion(before, 0) - twist(before) + 0.4
    made = Recording(
        Path("pushed.csv"),
        t,
        np.zeros(len(t), dtype=np.int64),
        np.round(q / count)[None] * count,
        tau[None],
        ("revolute",),
        (slice(0, len(t)),),
        (None,),
    )
    return replace(made, q_link=np.round(link / count)[None] * count)


def fitted(drive: Model, recording: Recording) -> tuple[FittedBase, TwistFit]:
    found = kept(identify, drive, [recording])
    fit = fit_twist(found, 0)
    assert fit is not None
    return FittedBase(found), fit


def test_a_late_link_side_encoder_is_told_from_a_soft_joint(drive: Model) -> None:
    """3 ms look like a lag of 9 mrad at 3 rad/s; the transmission yields by 3 mrad."""
    found = kept(diagnose, drive, [pushed(1, Transmission())])
    document = diagnosed(found).to_json()
    (late,) = document["encoder_skew"]
    assert late["joint"] == 1
    assert late["unit"] == "s"
    assert late["interval"][0] < 2.5e-3 < late["interval"][1]
    assert late["value"] == pytest.approx(2.5e-3, rel=0.05)
    first = document["findings"][0]
    assert (first["effect"], first["joint"]) == ("elasticity", 1)
    assert first["rms_after"] == first["rms_before"]
    assert first["evidence"]["twist"]["rms_after"] < 0.3 * first["evidence"]["twist"]["rms_before"]
    assert first["evidence"]["failed_gates"] == []
    low, high = first["parameters"]["stiffness"]["interval"]
    assert low < 2000.0 < high < 1.1 * low


def test_intervals_of_the_twist_hold(drive: Model) -> None:
    held = {"skew": 0, "stiffness": 0}
    for seed in range(10):
        _, fit = fitted(drive, pushed(10 + seed, Transmission(), seconds=12.0))
        for name, truth, e in (("skew", 2.5e-3, fit.skew), ("stiffness", 2000.0, fit.stiffness)):
            assert e is not None
            assert e.interval is not None
            held[name] += e.interval[0] < truth < e.interval[1]
    assert min(held.values()) >= 8


def test_a_late_encoder_on_a_rigid_joint_shows_nothing_else(drive: Model) -> None:
    field, fit = fitted(drive, pushed(2, Transmission(stiffness=1e9, skew=-4e-3)))
    assert fit.skew.value == pytest.approx(-4e-3, rel=0.02)
    assert witnessed(field) == []
    coarse = pushed(2, Transmission(stiffness=1e9), count=30 * COUNT)
    assert witnessed(fitted(drive, coarse)[0]) == []


def test_a_gap_is_told_from_a_spring(drive: Model) -> None:
    field, fit = fitted(drive, pushed(3, Transmission(stiffness=4000.0, gap=3e-3)))
    (found,) = witnessed(field)
    assert found.term == BACKLASH
    assert found.values["gap"].value == pytest.approx(3e-3, rel=0.05)
    assert found.values["stiffness"].value == pytest.approx(4000.0, rel=0.1)
    assert fit.skew.value == pytest.approx(2.5e-3, rel=0.1)
    field, _ = fitted(drive, pushed(3, Transmission()))
    assert [w.term for w in witnessed(field)] == [ELASTICITY]


def test_rests_that_reach_every_row_leave_nothing_of_the_twist(drive: Model) -> None:
    """A joint that turns again and again: friction is known at no row for sure."""
    found = kept(identify, drive, [pushed(3, Transmission(), seconds=8.0)])
    assert fit_twist(found, 0) is not None
    motion = found.motion.changed(
        lambda p: replace(p, without=tuple(replace(w, left=np.full_like(w.left, UNAFFECTED / 2)) for w in p.without))
    )
    assert motion.moving(0).any()
    layout, prediction = found.problem.layout, found.problem.regressors.prediction
    assert fit_twist(replace(found, problem=Problem(drive, motion, layout.terms, prediction)), 0) is None
