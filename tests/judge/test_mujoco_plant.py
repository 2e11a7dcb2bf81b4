"""Physics of MuJoCo's arms as the judge uses them, against the judge's own equations and by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from runtime.arrays import Array

mujoco = pytest.importorskip("mujoco", minversion="4.0", reason="needs mujoco 4: pip install -e '.[mjcf]'")

from . import mujoco_arms, mujoco_plant  # noqa: E402
from .bench import Setting  # noqa: E402
from .bodies import BELIEVED, torque  # noqa: E402
from .hidden import Setup  # noqa: E402
from .mujoco_hidden import MECHANISMS  # noqa: E402
from .mujoco_world import MUJOCO  # noqa: E402
from .plant import PERIOD  # noqa: E402
from .size import in_band  # noqa: E402
from .space import DOWN, HOME  # noqa: E402

ARMS = sorted(mujoco_arms.NAMES)
STILL = {"DRY_POSITIVE": 0.0, "DRY_NEGATIVE": 0.0, "VISCOUS_POSITIVE": 0.0, "VISCOUS_NEGATIVE": 0.0, "CUBIC": 0.0}


def gravity(n: int) -> tuple[float, ...]:
    return DOWN if n in HOME else (3.0, -9.0, 0.0)


def of_arm(n: int) -> dict[str, float]:
    return {f"GRAVITY_{axis}": x for axis, x in zip("XYZ", gravity(n), strict=True)}


def rows(n: int, **values: float) -> list[dict[str, float]]:
    """Rows of an arm with a weak controller."""
    made = MUJOCO.specimen(mujoco_arms.bodies(n), BELIEVED, np.random.default_rng(1))
    return [{**row, "KP": 0.0, "KD": 0.0, **values} for row in made]


def built(n: int, rows: Sequence[dict[str, float]], arm: dict[str, float]) -> tuple[Any, Any]:
    model = mujoco_plant.plan(n, rows, arm).spec.compile()
    return model, mujoco.MjData(model)


def states(n: int, count: int = 20) -> Array:
    """(3, n, count) angles, rates, accelerations."""
    found: Array = np.random.default_rng(n).uniform(-1.5, 1.5, (3, n, count))
    return found


@pytest.mark.parametrize("n", ARMS)
def test_the_arm_has_the_torques_of_the_judges_own_equations(n: int) -> None:
    """Recursion in MuJoCo, virtual work or Newton and Euler in the judge; friction in motion, rotors and all."""
    put = rows(n)
    model, data = built(n, put, of_arm(n))
    bodies = mujoco_arms.bodies(n)
    command = np.random.default_rng(2).uniform(-20.0, 20.0, n)
    for q, v, _ in np.moveaxis(states(n), 2, 0):
        data.qpos[:], data.qvel[:], data.ctrl[:] = q, v, command
        mujoco.mj_forward(model, data)
        found = torque(bodies, np.array([q, v, data.qacc])[:, :, None], gravity(n))[:, 0]
        found += [row["VISCOUS_POSITIVE"] * x + row["CUBIC"] * x**3 for row, x in zip(put, v, strict=True)]
        np.testing.assert_allclose(found - data.qfrc_constraint, command, rtol=1e-9, atol=1e-9)
        sliding = np.abs(v) > 0.2
        dry = np.array([row["DRY_POSITIVE"] for row in put])
        np.testing.assert_allclose(-data.qfrc_constraint[sliding], (dry * np.sign(v))[sliding], rtol=1e-9)


@pytest.mark.parametrize("n", ARMS)
def test_a_falling_arm_keeps_its_energy(n: int) -> None:
    still = np.zeros((3, n, 1000))
    still[0] = np.array(HOME.get(n, [0.0] * n))[:, None]
    run = mujoco_plant.simulate(n, rows(n, **STILL), of_arm(n), still, 0.0 * still[0], 0.0 * still[0])
    model, data = built(n, rows(n, **STILL), of_arm(n))
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    total, kinetic = [], []
    rate = np.gradient(run.q, PERIOD, axis=1)
    for q, v in zip(run.q.T[5:-5:20], rate.T[5:-5:20], strict=True):
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(model, data)
        alike = 0.5 * v @ torque(mujoco_arms.bodies(n), np.array([q, 0 * v, v])[:, :, None], (0.0, 0.0, 0.0))[:, 0]
        assert data.energy[1] == pytest.approx(alike, rel=1e-9)
        total.append(sum(data.energy))
        kinetic.append(data.energy[1])
    assert max(kinetic) > 1.0
    assert np.ptp(total) < 2e-4 * max(kinetic)


@pytest.mark.parametrize("n", ARMS)
def test_a_clean_recording_holds_nothing_but_the_model(n: int) -> None:
    """What the band keeps of torque, less the judge's own equations along the motion, is a small part of the noise."""
    setting = Setting(joints=n, simulator="mujoco", gravity=gravity(n))
    rng = np.random.default_rng(5)
    t = np.arange(6000) * PERIOD
    phase = rng.uniform(0, 6, (n, 1))
    ramp = np.clip(t, 0.0, 1.0) ** 3
    angle = np.array(HOME.get(n, [0.0] * n))[:, None] + 0.4 * ramp * np.sin(3.0 * t + phase)
    rate = np.gradient(angle, PERIOD, axis=1)
    wanted = np.stack([angle, rate, np.gradient(rate, PERIOD, axis=1)])
    bodies = mujoco_arms.bodies(n)
    bench = MUJOCO.bench(setting, wanted, rng, False, MUJOCO.specimen(bodies, BELIEVED, rng))
    run = bench.run([])
    left = run.tau + bench.background
    left -= torque(bodies, np.array([run.q + 0.5 * PERIOD * run.rate, run.rate, run.acceleration]), gravity(n))
    for i, row in enumerate(bench.rows):
        left[i] -= row["VISCOUS_POSITIVE"] * run.rate[i] + row["CUBIC"] * run.rate[i] ** 3
        left[i] -= row["DRY_POSITIVE"] * (run.above[i] - run.below[i])
    assert np.all(np.sqrt(np.mean(in_band(left) ** 2, axis=1)) < 0.35 * bench.floor())


@pytest.mark.parametrize("n", [6, 7])
def test_an_arm_at_rest_carries_its_weight(n: int) -> None:
    still = np.zeros((3, n, 500))
    still[0] = np.array(HOME[n])[:, None]
    put = rows(n, **{**STILL, "KP": 2e3, "KD": 1e2})
    weight = torque(mujoco_arms.bodies(n), still, DOWN)
    run = mujoco_plant.simulate(n, put, of_arm(n), still, weight, 0.0 * weight)
    np.testing.assert_allclose(run.tau, weight, rtol=1e-9, atol=1e-6)


def opposing(angle: float, rate: float = 0.0, **values: float) -> float:
    """N m by which a mechanism opposes one joint at rest at an angle."""
    model, data = built(1, rows(1, **STILL, **values), {})
    data.qpos[0], data.qvel[0] = angle, rate
    mujoco.mj_forward(model, data)
    return float(-data.qfrc_passive[0] - data.qfrc_actuator[0])


@pytest.mark.parametrize(
    ("values", "law"),
    [
        ({"SPRING": 3.0, "SPRING_REST": 0.2}, lambda q: 3.0 * (q - 0.2)),
        ({"SPRING": 1.0, "CABLE_SQUARE": 0.5, "CABLE_CUBE": 2.0}, lambda q: q + 0.5 * q**2 + 2.0 * q**3),
        ({"PULL": 4.0, "PULL_FROM": 0.1}, lambda q: -4.0 * max(0.1 - q, 0.0)),
        ({"STOP": 50.0, "STOP_AT": 0.4, "STOP_SIDE": 1.0}, lambda q: 50.0 * max(q - 0.4, 0.0)),
        ({"STOP": 50.0, "STOP_AT": -0.4, "STOP_SIDE": -1.0}, lambda q: -50.0 * max(-0.4 - q, 0.0)),
        ({"RIPPLE": 0.3, "RIPPLE_ORDER": 7.0, "RIPPLE_PHASE": 1.0}, lambda q: -0.3 * np.sin(7.0 * q + 1.0)),
    ],
)
def test_springs_and_cogging_are_what_they_are_said_to_be(values: dict[str, float], law: Any) -> None:
    for angle in (-0.9, -0.3, 0.0, 0.25, 0.8):
        assert opposing(angle, **values) == pytest.approx(law(angle), abs=1e-12)


def pushed(row: dict[str, float], torque_at: Array, arm: dict[str, float] | None = None) -> Any:
    """One joint without friction or controller, driven by a torque (N,)."""
    count = len(torque_at)
    return mujoco_plant.simulate(
        1, rows(1, **STILL, **row), arm or {}, np.zeros((3, 1, count)), torque_at[None], np.zeros((1, count))
    )


def test_a_delay_and_a_lag_are_as_long_as_they_are_said_to_be() -> None:
    inertia = torque(mujoco_arms.bodies(1), np.array([[[0.0]], [[0.0]], [[1.0]]]))[0, 0]
    step = np.full(400, 1.0)
    late = pushed({"DELAY": 0.02}, step)
    lagging = pushed({"LAG": 0.02}, step)
    t = (np.arange(400) + 0.5) * PERIOD
    # The last stage of a Runge-Kutta step reads what is commanded a step later.
    assert np.sum(1.0 - late.acceleration[0] * inertia) * PERIOD == pytest.approx(0.02, abs=0.2 * PERIOD)
    np.testing.assert_allclose(lagging.acceleration[0] * inertia, 1 - np.exp(-t / 0.02), atol=0.03)
    np.testing.assert_allclose(pushed({"GAIN": 0.8}, step).acceleration[0] * inertia, 0.8, atol=1e-6)
    limited = pushed({"LIMIT": 0.5, "LIMIT_FORM": 3.0}, step)
    np.testing.assert_allclose(limited.acceleration[0] * inertia, 0.5, atol=1e-6)


def test_a_second_hinge_twists_by_the_torque_over_its_stiffness() -> None:
    """At a constant acceleration the spring carries the link's share."""
    body = mujoco_arms.bodies(1)[0]
    link = body.inertia + body.mass * body.com[0] ** 2
    run = pushed({"STIFFNESS": 2e3, "STIFFNESS_DAMPING": 10.0}, np.full(600, 1.0))
    twist = (run.q - run.link)[0, -200:]
    np.testing.assert_allclose(twist, 1.0 / (link + body.rotor) * link / 2e3, rtol=1e-2)
    gap = pushed({"LOOSE": 0.01}, np.sin(2 * np.pi * 2.0 * np.arange(1500) * PERIOD))
    assert 0.0049 < np.abs(gap.q - gap.link).max() < 0.0056


def test_a_payload_weighs_from_its_time_on() -> None:
    n, start, mass = 6, 0.3, 2.0
    bodies = mujoco_arms.bodies(n)
    place = bodies[-1].point + bodies[-1].axes @ np.array([0.02, -0.01, 0.15])
    still = np.zeros((3, n, 1500))
    still[0] = np.array(HOME[n])[:, None]
    arm = {**of_arm(n), "PAYLOAD": mass, "PAYLOAD_TIME": start}
    arm.update(dict(zip(("PAYLOAD_X", "PAYLOAD_Y", "PAYLOAD_Z"), place.tolist(), strict=True)))
    put = rows(n, **{**STILL, "KP": 4e3, "KD": 2e2})
    weight = torque(bodies, still, DOWN)
    run = mujoco_plant.simulate(n, put, arm, still, weight, 0.0 * weight)
    assert np.abs(run.tau - weight)[:, : round(start / PERIOD)].max() < 1e-6
    end = run.q[:, -1:]
    more = run.tau[:, -1] - torque(bodies, np.array([end, 0 * end, 0 * end]), DOWN)[:, 0]
    lifted = [height(bodies, end[:, 0] + step, place) for step in 1e-6 * np.eye(n)]
    lift = (np.array(lifted) - height(bodies, end[:, 0], place)) / 1e-6
    np.testing.assert_allclose(more, mass * 9.81 * lift, rtol=1e-2, atol=1e-2)


def height(bodies: Any, angles: Array, place: Array) -> float:
    """m, of a point of the last body that is at `place` where all angles are zero."""
    for body, angle in zip(reversed(bodies), reversed(angles), strict=True):
        axis, arm = body.axes[:, 2], place - body.point
        along = axis * (axis @ arm)
        place = body.point + along + np.cos(angle) * (arm - along) + np.sin(angle) * np.cross(axis, arm)
    return float(place[2])


def test_what_mujoco_has_no_mechanism_for_is_refused() -> None:
    with pytest.raises(KeyError, match="WAVE"):
        mujoco_plant.plan(1, rows(1, WAVE=1.0), {})
    with pytest.raises(KeyError, match="same in both directions"):
        mujoco_plant.plan(1, rows(1, DRY_POSITIVE=2.0), {})


@pytest.mark.parametrize("name", MECHANISMS)
def test_every_mechanism_is_felt(name: str) -> None:
    """On the smallest arm that can have it, in three seconds of motion."""
    entry = MECHANISMS[name]
    n = next(n for n in ARMS if entry.least_joints <= n <= entry.most_joints)
    setting = Setting(joints=n, simulator="mujoco", **{**entry.needs, "gravity": gravity(n)})
    t = np.arange(3000) * PERIOD
    angle = np.array(HOME.get(n, [0.0] * n))[:, None] + 0.5 * np.clip(t, 0.0, 1.0) ** 3 * np.sin(
        4.0 * t + np.arange(n)[:, None]
    )
    rate = np.gradient(angle, PERIOD, axis=1)
    wanted = np.stack([angle, rate, np.gradient(rate, PERIOD, axis=1)])
    bodies, rng = mujoco_arms.bodies(n), np.random.default_rng(3)
    bench = MUJOCO.bench(setting, wanted, rng, False, MUJOCO.specimen(bodies, BELIEVED, rng))
    hidden = entry.draw(Setup(bodies, 0, wanted, rng))
    if not hidden.left_out:
        changed = bench.run([(hidden, 0, hidden.amount)]).tau - bench.run([]).tau
        assert np.abs(changed).max() > 1e-2
