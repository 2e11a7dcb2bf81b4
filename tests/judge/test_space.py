"""Physics of the judge's arms in space, and that the model file says the same bodies."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.arrays import Array

from . import space
from .bench import Setting, bandwidth_of, bench
from .bodies import inertial_columns, joint_rows, torque
from .motion import desired
from .plant import PERIOD, simulate
from .space import DOWN, HOME, SPATIAL, TIP, SpatialBody, chain, tip
from .test_plant import FRICTIONLESS

SPACE = {"SPATIAL": 1.0, "GRAVITY_Z": DOWN[2]}


def falling(n: int, seconds: float, arm: dict[str, float], **values: float) -> Array:
    """A frictionless arm let go at its home: angles and rates over time."""
    rows = [{**body.parameters(), **FRICTIONLESS, **values} for body in SPATIAL[n]]
    still = np.zeros((3, n, round(seconds / PERIOD)))
    still[0] = np.array(HOME[n])[:, None]
    run = simulate(rows, still, {**SPACE, "SUBSTEPS": 16.0, **arm})
    return np.array([run.q, np.gradient(run.q, PERIOD, axis=1)])


def energy(bodies: tuple[SpatialBody, ...], q: Array, qd: Array) -> float:
    """Kinetic and potential energy at one instant, J: body by body, from its place and its velocity."""
    E, place, before = np.eye(3), np.zeros(3), np.zeros(3)
    spin, speed, total = np.zeros(3), np.zeros(3), 0.0
    for body, angle, rate in zip(bodies, q, qd, strict=True):
        arm = E @ (body.point - before)
        place, speed, before = place + arm, speed + np.cross(spin, arm), body.point
        axis = E @ body.axes[:, 2]
        spin = spin + rate * axis
        K = np.cross(np.eye(3), axis)
        E = (np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K) @ E
        away = E @ (body.centre - body.point)
        moved = speed + np.cross(spin, away)
        total += 0.5 * body.mass * moved @ moved + 0.5 * spin @ E @ body.tensor @ E.T @ spin
        total += 0.5 * body.rotor * rate**2 - body.mass * np.array(DOWN) @ (place + away)
    return total


@pytest.mark.parametrize("n", [6, 7])
def test_a_falling_arm_keeps_its_energy(n: int) -> None:
    q, qd = falling(n, 1.0, {})
    found = np.array([energy(SPATIAL[n], a, b) for a, b in zip(q.T, qd.T, strict=True)])[5:-5]
    still = np.array([energy(SPATIAL[n], a, 0 * b) for a, b in zip(q.T, qd.T, strict=True)])[5:-5]
    assert (found - still).max() > 20.0
    assert np.abs(found - found[0]).max() < 1e-3 * (found - still).max()


@pytest.mark.parametrize("n", [6, 7])
def test_virtual_work_gives_the_torques_by_which_the_plant_moves(n: int) -> None:
    """Kane's equations in the plant's C, and the linear columns: without friction or motors both balance."""
    rows = [{**body.parameters(), **FRICTIONLESS} for body in SPATIAL[n]]
    still = np.zeros((3, n, 1000))
    still[0] = np.array(HOME[n])[:, None]
    run = simulate(rows, still, SPACE)
    left = torque(SPATIAL[n], np.array([run.q + 0.5 * PERIOD * run.rate, run.rate, run.acceleration]), DOWN)
    weight = torque(SPATIAL[n], np.array([run.q, 0 * run.q, 0 * run.q]), DOWN)
    assert np.abs(left).max() < 1e-4 * np.abs(weight).max()


def test_a_payload_is_a_heavier_last_body() -> None:
    bodies, mass = SPATIAL[6], 1.5
    place = tip(bodies) + bodies[-1].axes @ np.array([0.05, -0.02, 0.06])
    last = bodies[-1]
    whole = last.mass + mass
    centre = (last.mass * last.centre + mass * place) / whole

    def about(m: float, point: Array) -> Array:
        away = point - centre
        return m * (away @ away * np.eye(3) - np.outer(away, away))

    tensor = last.tensor + about(last.mass, last.centre) + about(mass, place)
    local = last.axes.T @ tensor @ last.axes
    six = tuple(float(local[i, j]) for i, j in space.SECOND)
    com = tuple(float(x) for x in last.axes.T @ (centre - last.point))
    heavy = (*bodies[:-1], SpatialBody(last.frame, whole, com, six, *_rest(last), base=last.base))
    put = dict(zip(("PAYLOAD_X", "PAYLOAD_Y", "PAYLOAD_Z"), place.tolist(), strict=True))
    loaded, _ = falling(6, 0.5, {"PAYLOAD": mass, **put})
    rows = [{**body.parameters(), **FRICTIONLESS} for body in heavy]
    still = np.zeros((3, 6, 500))
    still[0] = np.array(HOME[6])[:, None]
    alike = simulate(rows, still, {**SPACE, "SUBSTEPS": 16.0})
    assert np.abs(loaded - alike.q).max() < 1e-9


def _rest(body: SpatialBody) -> tuple[float, tuple[float, float], float, float, float]:
    return body.rotor, body.dry, body.viscous, body.cubic, body.noise


def test_a_planar_chain_is_the_same_in_space() -> None:
    """Two routes: parallel axes along z against the plane's own columns."""
    from .bodies import Body

    plane = (
        Body(0.1, 0.3, 2.0, (0.2, 0.01), 0.05, (0.0, 0.0), 0.0, 0.0),
        Body(0.06, 0.2, 1.2, (0.1, 0.0), 0.02, (0.0, 0.0), 0.0, 0.0),
    )
    solid = chain(
        [
            SpatialBody((0, at, 0.0), b.mass, (*b.com, 0.0), (0.1, 0, 0, 0.1, 0, b.inertia), b.rotor, b.dry, 0.0, 0.0)
            for b, at in zip(plane, (0.0, plane[0].length), strict=True)
        ]
    )
    q, qd, qdd = np.random.default_rng(1).uniform(-2, 2, (3, 2, 20))
    gravity = (0.7, -9.0)
    found = torque(solid, np.array([q, qd, qdd]), (*gravity, -3.0))
    np.testing.assert_allclose(found, torque(plane, np.array([q, qd, qdd]), gravity), atol=1e-12)
    assert len(list(joint_rows(plane, q, qd, qdd, gravity))) == len(inertial_columns(plane, q, qd, qdd, gravity))


@pytest.mark.parametrize("n", [6, 7])
def test_the_model_file_says_where_the_joints_are(n: int) -> None:
    """Frames of URDF, composed by hand, are the plant's in the base."""
    from symbolic.model_file import reader

    from .bodies import model_text

    arm = reader.parse(model_text(SPATIAL[n], (), DOWN), "judge.toml")
    axes, point = np.eye(3), np.zeros(3)
    for joint, body in zip(arm.joints, SPATIAL[n], strict=True):
        roll, pitch, yaw = joint.origin.rpy
        assert pitch == yaw == 0.0
        point = point + axes @ np.array(joint.origin.xyz)
        turn = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
        axes = axes @ turn
        np.testing.assert_allclose(axes @ np.array(joint.axis), body.axes[:, 2], atol=1e-12)
        np.testing.assert_allclose(point, body.point, atol=1e-12)
        np.testing.assert_allclose(axes @ np.array(joint.link.com) + point, body.centre, atol=1e-12)
    np.testing.assert_allclose(point + axes @ np.array([0, 0, TIP]), tip(SPATIAL[n]), atol=1e-12)


@pytest.mark.parametrize("n", [6, 7])
def test_no_posture_of_a_motion_is_lighter_than_its_controller_takes_it(n: int) -> None:
    """Else it oscillates there: the inertia before the first joint falls to a tenth as the arm folds."""
    setting, rng = Setting(joints=n, coarse=10.0, gravity=DOWN), np.random.default_rng(1)
    wanted = desired(rng, n, "brief")
    wanted[0] += np.array(HOME[n])[:, None]
    rows = [body.parameters() for body in SPATIAL[n]]
    made = bench(setting, wanted, rng, False, rows)
    places = wanted[0, :, ::700]
    for i, row in enumerate(made.rows):
        push = np.zeros((3, *places.shape))
        push[0], push[2, i] = places, 1.0
        assert row["KP"] < 1.1 * torque(SPATIAL[n], push)[i].min() * bandwidth_of(10.0) ** 2
