"""Matrices and kinematics in space against products of exponentials in NumPy, which know no link frames.

With S the unit twist of a joint at q = 0, a body that stands at M there stands at exp(S_1 q_1) .. exp(S_i q_i) M.
Source: Lynch & Park 2017, Modern Robotics, chapters 4 and 5.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import spatial_arms
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from spatial_arms import Array, call, places, standing, state

from symbolic.model import ArmModel
from symbolic.model_file.arm import Arm
from symbolic.rigid_body.spatial.kinematics import nominal_com

TYPES = ("r", "p", "rp", "rr", "prr", "rrpr", "rrrrrr", "rrprrpr")


def drawn(types: str, seed: int) -> tuple[Arm, ArmModel]:
    arm = spatial_arms.drawn(types, seed)
    return arm, spatial_arms.derived(arm)


def slopes(places_of: object, q: Array, h: float = 1e-6) -> list[Array]:
    """(n,) derivatives by the joints, by central differences."""
    steps = np.eye(len(q)) * h
    return [(places_of(q + step) - places_of(q - step)) / (2 * h) for step in steps]  # type: ignore[operator]


def pseudo_inertia(mass: float, com: Array, inertia: tuple[float, ...]) -> Array:
    xx, xy, xz, yy, yz, zz = inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    sigma = np.zeros((4, 4))
    sigma[:3, :3] = np.trace(tensor) / 2 * np.eye(3) - tensor + mass * np.outer(com, com)
    sigma[:3, 3] = sigma[3, :3] = mass * np.array(com)
    sigma[3, 3] = mass
    return sigma


def inertia(arm: Arm, q: Array) -> Array:
    """D from the kinetic energy of all bodies, sum of tr(dT Sigma dT^T), and the rotors."""
    D = np.diag([joint.rotor_inertia or 0.0 for joint in arm.joints])
    for i, joint in enumerate(arm.joints):
        sigma = pseudo_inertia(joint.link.mass or 0.0, np.array(joint.link.com), joint.link.inertia or (0.0,) * 6)
        dT = slopes(lambda x, i=i: places(arm, x)[0][i], q)
        D = D + [[np.trace(a @ sigma @ b.T) for b in dT] for a in dT]
    return D


def potential(arm: Arm, q: Array) -> float:
    frames, _ = places(arm, q)
    heights = [
        (joint.link.mass or 0.0) * np.dot(arm.gravity, (T @ [*joint.link.com, 1.0])[:3])
        for joint, T in zip(arm.joints, frames, strict=True)
    ]
    return -float(sum(heights))


ARMS = [2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 1, 3))]
"""Seeds of the arms; one arm of each of TYPES is derived a seed."""
CASES = st.tuples(st.sampled_from(TYPES), st.integers(0, 1000))


@pytest.mark.xdist_group("exponentials")
@pytest.mark.parametrize("seed", ARMS)
@settings(max_examples=6, deadline=None)
@given(case=CASES)
def test_tip_and_its_motion(seed: int, case: tuple[str, int]) -> None:
    types, drawing = case
    (arm, model), (q, qd, _) = drawn(types, seed), state(len(types), drawing)
    T = places(arm, q)[1]
    assert_allclose(call(model, "tip", q), T[:3, 3], atol=1e-11)
    assert_allclose(call(model, "tip_rotation", q), T[:3, :3], atol=1e-11)
    turns = [dT @ np.linalg.inv(T) for dT in slopes(lambda x: places(arm, x)[1], q)]
    moves = [(W @ T)[:3, 3] for W in turns]
    J = np.array([[*v, W[2, 1], W[0, 2], W[1, 0]] for v, W in zip(moves, turns, strict=True)]).T
    assert_allclose(call(model, "tip_jacobian", q), J, atol=1e-8)
    assert_allclose(call(model, "tip_rate", q, qd), J @ qd, atol=1e-7)


@pytest.mark.xdist_group("exponentials")
@pytest.mark.parametrize("seed", ARMS)
@settings(max_examples=6, deadline=None)
@given(case=CASES)
def test_inertia_and_gravity_are_those_of_the_energies(seed: int, case: tuple[str, int]) -> None:
    types, drawing = case
    (arm, model), (q, _, _) = drawn(types, seed), state(len(types), drawing)
    D, expected = call(model, "inertia", q), inertia(arm, q)
    assert_allclose(D, expected, atol=1e-7 * np.abs(expected).max())
    assert np.array_equal(D, D.T)
    assert np.linalg.eigvalsh(D).min() > 0
    rotors = np.diag([joint.rotor_inertia for joint in arm.joints])
    assert_allclose(call(model, "link_inertia", q), D - rotors, atol=1e-12)
    slope = [potential(arm, q + h) - potential(arm, q - h) for h in 1e-5 * np.eye(len(q))]
    assert_allclose(call(model, "gravity", q), np.array(slope) / 2e-5, atol=1e-6)


@pytest.mark.xdist_group("exponentials")
@pytest.mark.parametrize("seed", ARMS)
@settings(max_examples=6, deadline=None)
@given(case=CASES)
def test_dynamics_fit_together(seed: int, case: tuple[str, int]) -> None:
    """D qdd + C qd + g is the recursion's torque, forward dynamics its inverse, and power the rate of energy."""
    types, drawing = case
    model, (q, qd, qdd) = drawn(types, seed)[1], state(len(types), drawing)
    tau = call(model, "inverse_dynamics", q, qd, qdd)
    D, C, g = (call(model, "inertia", q), call(model, "coriolis", q, qd), call(model, "gravity", q))
    assert_allclose(D @ qdd + C @ qd + g, tau, atol=1e-10 * np.abs(tau).max() + 1e-12)
    found = call(model, "forward_dynamics", q, qd, tau)
    assert_allclose(found, qdd, atol=1e-9 * np.linalg.cond(D))
    h = 1e-5
    rate = (call(model, "inertia", q + h * qd) - call(model, "inertia", q - h * qd)) / (2 * h)
    skew = rate - 2 * C
    assert_allclose(skew, -skew.T, atol=1e-6 * (1 + np.abs(C).max()))


@pytest.mark.xdist_group("exponentials")
@pytest.mark.parametrize("types", ["rr", "rrpr", "rrrrrr"])
def test_tip_load_is_what_a_body_at_the_tip_asks(types: str) -> None:
    """A point mass at c of the tip's frame, added to the last link as a body of no size."""
    c, m = np.array([0.1, -0.2, 0.3]), 1.7
    (arm, model), (q, qd, qdd) = drawn(types, 2), state(len(types), 5)
    at = (standing(arm.tip) @ [*c, 1.0])[:3]
    bare, last = arm.joints[:-1], arm.joints[-1]
    own = last.link
    total = (own.mass or 0.0) + m
    com = ((own.mass or 0.0) * np.array(own.com) + m * at) / total
    sigma = pseudo_inertia(own.mass or 0.0, np.array(own.com), own.inertia or (0.0,) * 6)
    sigma = sigma + pseudo_inertia(m, at, (0.0,) * 6) - pseudo_inertia(total, com, (0.0,) * 6)
    tensor = np.trace(sigma[:3, :3]) * np.eye(3) - sigma[:3, :3]
    about = (tensor[0, 0], tensor[0, 1], tensor[0, 2], tensor[1, 1], tensor[1, 2], tensor[2, 2])
    heavy = replace(last, link=replace(own, mass=total, com=tuple(com), inertia=about))
    loaded = spatial_arms.torques(replace(arm, joints=(*bare, heavy)), q, qd, qdd)
    more = loaded - spatial_arms.torques(arm, q, qd, qdd)
    x, y, z = c
    load = call(model, "tip_load", q, qd, qdd)
    assert_allclose(m * load @ [1, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], more, atol=1e-9)


@pytest.mark.xdist_group("exponentials")
@pytest.mark.parametrize("types", ["rp", "rrpr"])
def test_moment_jacobian_is_the_slope_of_gravity(types: str) -> None:
    (arm, model), (q, _, _) = drawn(types, 2), state(len(types), 4)

    def moment(x: Array) -> Array:
        frames, _ = places(arm, x)
        return sum((j.link.mass or 0.0) * (T @ [*j.link.com, 1.0])[:3] for j, T in zip(arm.joints, frames, strict=True))

    assert_allclose(call(model, "moment_jacobian", q), np.array(slopes(moment, q)).T, atol=1e-7)


def test_masses_that_are_not_known_are_nominal() -> None:
    """Half way to the next joint; without a way, across the axis: gravity then has a lever."""
    arm = spatial_arms.known("rx90")
    assert nominal_com(arm, 2) == pytest.approx([0.0, 0.225, 0.0])
    assert nominal_com(arm, 0) == [1.0, 0.0, 0.0]
