"""The torque of an arm with all its effects, against formulas by hand and an integration by SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from one_joint import INERTIA, model_text
from scipy.integrate import solve_ivp

from runtime.notebook.arm import LoadedArm, load
from runtime.notebook.verbs import add

FRICTION = "[joint.effects.coulomb]\ntorque = 0.5\n[joint.effects.viscous]\ncoefficient = 0.7\n"
DRIVE = model_text(FRICTION)


@pytest.fixture
def arm() -> LoadedArm:
    return load("drive").with_text(DRIVE)


def test_effects_add_to_the_rigid_arm(arm: LoadedArm) -> None:
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 50, 1))
    by_hand = INERTIA * qdd + 0.5 * np.sign(qd) + 0.7 * qd
    np.testing.assert_allclose(arm.torque(q, qd, qdd), by_hand, rtol=1e-13)
    np.testing.assert_array_equal(arm.torque(q[3], qd[3], qdd[3]), arm.torque(q, qd, qdd)[3])
    np.testing.assert_allclose(arm.torque(q, qd, qdd) - arm.inverse_dynamics(q, qd, qdd), 0.5 * np.sign(qd) + 0.7 * qd)


def test_an_effect_of_the_drive_sees_the_torque_of_all_others(arm: LoadedArm) -> None:
    q, qd, qdd = np.random.default_rng(1).normal(size=(3, 50, 1))
    scaled = arm.with_text(DRIVE + "[joint.effects.torque_scale]\nfactor = 0.25\n")
    np.testing.assert_allclose(scaled.torque(q, qd, qdd), 0.25 * arm.torque(q, qd, qdd), rtol=1e-12)
    late = arm.with_text(DRIVE + "[joint.effects.torque_delay]\ntime = 0.004\n")
    t = 0.001 * np.arange(400)[:, None]
    motion = np.sin(5 * t), 5 * np.cos(5 * t), -25 * np.sin(5 * t)
    change = late.torque(*motion, dt=0.001) - arm.torque(*motion)
    slope = np.gradient(arm.torque(*motion)[:, 0], 0.001)
    np.testing.assert_allclose(np.abs(change[:, 0]), 0.004 * np.abs(slope), rtol=1e-9, atol=1e-12)


def test_an_effect_with_a_memory_needs_the_time_from_sample_to_sample(arm: LoadedArm) -> None:
    lugre = arm.with_text(DRIVE + "[joint.effects.lugre]\nstiffness = 300.0\ndamping = 1.0\n")
    for wrong in (-1.0, 0.0, np.nan, np.inf):
        with pytest.raises(ValueError, match=r"drive1: dt is .*; expected seconds from sample to sample, more than 0"):
            lugre.torque(*(np.zeros((3, 1)),) * 3, dt=wrong)
    with pytest.raises(ValueError, match="drive1: an effect depends on what was before; pass dt"):
        lugre.torque([0.0], [1.0], [0.0])
    dt = 1e-4
    t = dt * np.arange(20_000)[:, None]
    q, qd, qdd = 0.02 * np.sin(6 * t), 0.12 * np.cos(6 * t), -0.72 * np.sin(6 * t)

    def rate(time: float, z: np.ndarray) -> np.ndarray:
        speed = 0.12 * np.cos(6 * time)
        return speed - 300.0 * abs(speed) / 0.5 * z

    z = solve_ivp(rate, (0.0, t[-1, 0]), [0.0], t_eval=t[:, 0], rtol=1e-9, atol=1e-12, max_step=1e-3).y[0]
    bristle = 300.0 * z + 1.0 * np.array([rate(*at) for at in zip(t[:, 0], z, strict=True)])
    found = lugre.torque(q, qd, qdd, dt) - arm.inverse_dynamics(q, qd, qdd) - 0.7 * qd
    # The first sample has no past.
    np.testing.assert_allclose(found[2000:, 0], bristle[2000:], atol=0.01 * 0.5)


def test_a_value_that_is_not_known_is_asked_for(arm: LoadedArm) -> None:
    with pytest.raises(ValueError, match=r"stribeck@1: torque, speed"):
        add(arm, "stribeck", 1).torque([0.0], [1.0], [0.0])
