"""The simulated arm: energy, friction, transmissions, drives and the plate, each against another route to the same."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from codegen.prepare import prepare_arm
from runtime.model.loader import Library, Model
from runtime.model.terms import Structure, Term, structure
from runtime.simulation.equations import PlantError
from runtime.simulation.plant import Plant
from runtime.simulation.settings import RATE_WIDTH
from runtime.simulation.simulate import complete, torque_along
from symbolic.effects import LIBRARY
from symbolic.model_file import reader
from symbolic.model_file.checks import ModelError

PERIOD = 1e-3
DRIVE_INERTIA, ROTOR = 0.2365, 0.10  # kg m^2, of drive.toml: 0.10 + 0.0565 + 2 * 0.2^2

HANGING = """\
name = "hanging"
gravity = [0.0, -9.81]
[[joint]]
type = "revolute"
rotor_inertia = 0.05
gear_ratio = 50
[joint.link]
length = 0.3
mass = 1.5
com = [0.14, 0.01]
inertia = 0.012
[[joint]]
type = "revolute"
rotor_inertia = 0.02
gear_ratio = 50
[joint.link]
length = 0.25
mass = 0.8
com = [0.1, 0.0]
inertia = 0.005
"""


@pytest.fixture(scope="module")
def hanging(library: Library) -> Model:
    return Model(prepare_arm(reader.parse(HANGING, "hanging.toml")), library)


def moved(plant: Plant, torque: Callable[[float], object], seconds: float) -> np.ndarray:
    """States (N + 1, 2 n): positions and rates at the start of every period."""
    found = [np.concatenate([plant.q, plant.qd])]
    for k in range(round(seconds / plant.period)):
        plant.advance(torque(k * plant.period))
        found.append(np.concatenate([plant.q, plant.qd]))
    return np.array(found)


# --- rigid arms ---


def test_energy_is_kept_without_effects_and_torque(model: Model) -> None:
    plant = Plant(model, {}, PERIOD)
    plant.reset([0.1, 0.5, -0.7, 0.3], [1.0, -2.0, 2.0, 3.0])
    states = moved(plant, lambda _: np.zeros(4), 2.0)
    energy = [0.5 * s[4:] @ model.inertia(s[:4]) @ s[4:] for s in states[::50]]
    # Fourth order with a step of 1/16 ms: (6 rad/s / 16000)^4 and rounding.
    np.testing.assert_allclose(energy, energy[0], rtol=1e-12)


def test_energy_is_kept_under_gravity(hanging: Model) -> None:
    plant = Plant(hanging, {}, PERIOD)
    plant.reset([0.4, 0.9])
    states = moved(plant, lambda _: np.zeros(2), 2.0)

    def height(q: np.ndarray) -> float:
        a, b = q[0], q[0] + q[1]
        first = 0.14 * np.sin(a) + 0.01 * np.cos(a)
        return 1.5 * first + 0.8 * (0.3 * np.sin(a) + 0.1 * np.sin(b))

    energy = [0.5 * s[2:] @ hanging.inertia(s[:2]) @ s[2:] + 9.81 * height(s[:2]) for s in states[::50]]
    assert np.ptp(states[:, 0]) > 1.0
    np.testing.assert_allclose(energy, energy[0], atol=1e-10)


def test_friction_only_takes_energy(model: Model) -> None:
    friction = {t: v for t, v in structure(model).items() if model.library[t.effect].family == "friction"}
    plant = Plant(model, friction, PERIOD)
    plant.reset([0.1, 0.5, -0.7, 0.3], [1.0, -1.5, 2.0, 3.0])
    states = moved(plant, lambda _: np.zeros(4), 3.0)
    energy = np.array([0.5 * s[4:] @ model.inertia(s[:4]) @ s[4:] for s in states])
    # At rest, what is asymmetric can push as far as the creep within the width.
    assert np.diff(energy).max() < 0.5 * RATE_WIDTH**2
    assert np.abs(states[-1, 4:]).max() < RATE_WIDTH


SMOOTH: Structure = {
    Term("viscous", 1): {"coefficient": 1.5},
    Term("viscous_cubic", 2): {"coefficient": 0.05},
    Term("linear_spring", 1): {"stiffness": 12.0, "rest": 0.2},
    Term("cable", 2): {"c1": 0.4, "c2": -0.3, "c3": 0.1, "c4": 0.02},
    Term("torque_ripple", 2): {"order": 2.0, "amplitude": 0.2, "phase": 0.3},
    Term("offset", 1): {"torque": -0.3},
    Term("parallel_spring", 2): {"stiffness": 5000.0, "radius": 0.03, "offset": 2.5, "pretension": 10.0},
    Term("gravity"): {"gx": 0.4, "gy": -0.2},
}


def test_smooth_effects_move_as_another_integrator_has_them(hanging: Model) -> None:
    library = hanging.library
    plant = Plant(hanging, SMOOTH, PERIOD)
    plant.reset([0.3, -0.4])

    def command(t: float) -> np.ndarray:
        return np.array([2.0 * np.sin(9 * t), 1.0 * np.cos(14 * t)])

    def rate(state: np.ndarray, torque: np.ndarray) -> np.ndarray:
        q, qd = state[:2], state[2:]
        moments = hanging.call("moment_jacobian", {"q": q})
        total = torque.copy()
        for term, values in SMOOTH.items():
            for joint in (0, 1) if term.joint is None else (term.joint - 1,):
                read = {"q": q[joint], "qd": qd[joint], "ratio": 50.0}
                read |= {"moment_x": moments[0, joint], "moment_y": moments[1, joint]}
                total[joint] -= library.torque(term.effect, read, values)[0]
        return np.concatenate([qd, hanging.forward_dynamics(q, qd, total)])

    state = np.array([0.3, -0.4, 0.0, 0.0])
    states = moved(plant, command, 0.25)
    for k in range(250):
        held = command(k * PERIOD)
        step = solve_ivp(lambda _, s: rate(s, held), (0, PERIOD), state, method="DOP853", rtol=1e-11, atol=1e-12)  # noqa: B023
        state = step.y[:, -1]
    assert np.ptp(states[:, :2], axis=0).min() > 0.1
    np.testing.assert_allclose(states[-1], state, atol=1e-9)


# --- every effect of the library, backwards ---

STATED: dict[str, dict[str, float]] = {
    "plate_damping": {"coefficient": 5.0},
    "plate": {"stiffness": 600.0, "pretension": 4.0, "friction": 1.0, "position": 0.05},
    "payload": {"mass": 0.3, "time": 0.1},
    "torque_delay": {"time": 0.003},
    "command_delay": {"time": 0.003},
    "torque_lag": {"time_constant": 0.003},
    "command_lag": {"time_constant": 0.003},
    "end_stop": {"position": 0.1, "stiffness": 100.0, "damping": 0.5, "side": 1.0},
    "parallel_spring": {"stiffness": 2.0, "radius": 1.0, "offset": 0.1, "pretension": 0.3},
    "friction_patch": {"torque": 0.5, "start": 0.02, "end": 0.2},
    "elasticity": {"stiffness": 3000.0, "damping": 4.0},
    "backlash": {"gap": 0.002, "stiffness": 3000.0, "damping": 10.0},
    "lugre": {"stiffness": 300.0, "damping": 0.2},
    "viscous_power": {"torque": 0.5, "exponent": 0.6},
    "coulomb": {"torque": 1.0},
    "stribeck": {"torque": 0.4, "speed": 0.2},
    "velocity_strengthening": {"torque": 0.4, "speed": 0.2},
    "thermal_friction": {"coulomb": -0.1, "viscous": 0.3, "time_constant": 0.3},
    "coulomb_asymmetric": {"positive": 0.9, "negative": 0.6},
    "coupled_friction": {"torque": 0.2},
    "coupled_gear": {"coulomb": 0.2, "viscous": 0.1, "inertia": 0.05, "ratio": -1.0},
    "torque_ripple": {"order": 2.0, "amplitude": 0.3, "phase": 0.5},
}
# Backwards, a transmission guesses its load ahead and a gap's impacts are means over a sample; a bristle is a kink.
LOOSE = {
    "backlash": 5e-3,
    "elasticity": 5e-4,
    "lugre": 3e-3,
    **dict.fromkeys(("torque_delay", "command_delay", "torque_lag", "command_lag"), 3e-4),
}
NAMES = sorted(LIBRARY)


@pytest.mark.parametrize("name", NAMES)
def test_the_motion_asks_for_the_torque_that_made_it(name: str, hanging: Model, drive: Model) -> None:
    """Forwards through CasADi and backwards through C: the applied torque comes back."""
    info = hanging.library[name]
    arm = hanging if info.scope != "joint" else drive
    joint = 1 if info.scope in ("joint", "joints") else None
    base: Structure = {Term("coulomb", i + 1): {"torque": 0.3} for i in range(arm.n) if name != "coulomb"}
    if name == "plate_damping":
        base[Term("plate")] = STATED["plate"]
    rate = 16_000.0
    t = np.arange(round(0.6 * rate)) / rate
    path = 0.4 * np.sin(2 * np.pi * 2.5 * np.arange(600) / 1000)[None].repeat(arm.n, axis=0)
    terms = complete(arm, path, base | {Term(name, joint): STATED.get(name, {})})
    plant = Plant(arm, terms, 1 / rate)
    # From rest without a jump, and strong enough that every joint turns back several times.
    size = np.array([[5.0], [2.0]])[: arm.n]
    applied = size * np.sin(2 * np.pi * 2.5 * t) * np.minimum(t / 0.1, 1.0)
    states = moved(plant, lambda x: applied[:, round(x * rate)], 0.6)[:-1]
    q, qd = np.ascontiguousarray(states[:, : arm.n].T), np.ascontiguousarray(states[:, arm.n :].T)
    qdd = np.gradient(qd, 1 / rate, axis=1)
    back = torque_along(arm, q, qd, qdd, rate, terms)
    moving = (np.abs([*qd, qd.sum(axis=0)]) > 20 * RATE_WIDTH).all(axis=0)
    moving[:1600] = False
    # A difference over two steps sees the mean of the torques held before and after.
    mean = (applied + np.roll(applied, 1, axis=1)) / 2
    error = np.abs(back - mean)[:, moving]
    assert np.ptp(q, axis=1).min() > 0.1
    # Where something switches between two samples, a difference does not see it: hence no maximum.
    assert np.quantile(error, 0.97) < LOOSE.get(name, 1e-4)


# --- friction ---


def friction(torque: float) -> Structure:
    return {Term("coulomb_asymmetric", 1): {"positive": torque, "negative": 0.7 * torque}}


def test_static_friction_holds_what_is_below_it(drive: Model) -> None:
    plant = Plant(drive, friction(2.0), PERIOD)
    plant.reset([0.5])
    states = moved(plant, lambda _: [1.6], 1.0)
    assert np.abs(states[:, 1]).max() <= RATE_WIDTH
    plant.reset([0.5])
    states = moved(plant, lambda _: [2.4], 1.0)
    # Beyond it the rest accelerates the joint, but for the first instants.
    assert states[-1, 1] == pytest.approx(0.4 / DRIVE_INERTIA, rel=1e-3)


def test_dry_friction_far_above_the_inertia_widens_its_slope_and_still_holds(drive: Model) -> None:
    plant = Plant(drive, friction(400.0), PERIOD)
    assert plant.widths[0] > RATE_WIDTH
    states = moved(plant, lambda t: [150.0 * np.sin(40 * t)], 1.0)
    assert np.abs(states[:, 1]).max() <= plant.widths[0]


def test_a_bristle_bends_under_a_torque_below_friction_and_springs_back(drive: Model) -> None:
    terms = {**friction(2.0), Term("lugre", 1): {"stiffness": 500.0, "damping": 8.0}}
    plant = Plant(drive, terms, PERIOD)

    def rate(t: float, state: np.ndarray) -> list[float]:
        _, speed, bristle = state
        level = 2.0 if speed > 0 else 1.4
        bending = 500.0 * (speed - abs(speed) * bristle / level)
        held = bristle + 8.0 / 500.0 * bending
        return [speed, (1.2 * min(t / 0.2, 1.0) - held) / DRIVE_INERTIA, bending]

    bent = moved(plant, lambda t: [1.2 * min(t / 0.2, 1.0)], 1.0)[-1]
    other = solve_ivp(rate, (0, 1.0), np.zeros(3), max_step=1e-3, rtol=1e-8, atol=1e-12).y[:, -1]
    assert bent[0] == pytest.approx(other[0], rel=0.005)
    assert abs(bent[1]) < 1e-4
    back = moved(plant, lambda _: [0.0], 1.0)[-1]
    assert back[0] < 0.7 * bent[0]


# --- transmissions ---


@pytest.mark.parametrize(("stiffness", "damping"), [(3000.0, 0.0), (3000.0, 1.0), (60_000.0, 2.0)])
def test_elasticity_is_two_masses_on_a_spring(drive: Model, stiffness: float, damping: float) -> None:
    link = DRIVE_INERTIA - ROTOR
    plant = Plant(drive, {Term("elasticity", 1): {"stiffness": stiffness, "damping": damping}}, PERIOD)

    def rate(state: np.ndarray, torque: float) -> list[float]:
        motor, motor_rate, out, out_rate = state
        spring = stiffness * (motor - out) + damping * (motor_rate - out_rate)
        return [motor_rate, (torque - spring) / ROTOR, out_rate, spring / link]

    state, worst = np.zeros(4), 0.0
    for k in range(300):
        torque = 3.0 if k % 100 < 50 else -3.0
        state = solve_ivp(lambda _, s: rate(s, torque), (0, PERIOD), state, rtol=1e-10, atol=1e-13).y[:, -1]  # noqa: B023
        plant.advance([torque])
        worst = max(worst, abs(plant.q[0] - state[0]))
    # Second order in the step: a millionth of the spring's deflection, some millimetres, accumulates.
    assert worst < 2e-6


def test_backlash_is_a_gap_between_two_masses(drive: Model) -> None:
    link, gap, stiffness, damping = DRIVE_INERTIA - ROTOR, 0.004, 5000.0, 15.0
    plant = Plant(drive, {Term("backlash", 1): {"gap": gap, "stiffness": stiffness, "damping": damping}}, PERIOD)

    def rate(state: np.ndarray, torque: float) -> list[float]:
        motor, motor_rate, out, out_rate = state
        twist, speed = motor - out, motor_rate - out_rate
        side = np.sign(twist)
        push = stiffness * (abs(twist) - gap / 2) + damping * side * speed
        carried = side * max(push, 0.0) if abs(twist) > gap / 2 else 0.0
        return [motor_rate, (torque - carried) / ROTOR, out_rate, carried / link]

    state, worst, free = np.zeros(4), 0.0, 0
    for k in range(500):
        torque = 2.0 * np.sin(2 * np.pi * 4 * k * PERIOD)
        step = solve_ivp(lambda _, s: rate(s, torque), (0, PERIOD), state, max_step=2e-5, rtol=1e-8, atol=1e-11)  # noqa: B023
        state = step.y[:, -1]
        free += abs(state[0] - state[2]) < gap / 2
        plant.advance([torque])
        worst = max(worst, abs(plant.q[0] - state[0]))
    assert free > 40
    assert worst < 0.02 * gap


def test_a_stiff_transmission_is_simulated_in_finer_steps(drive: Model) -> None:
    soft, stiff = (
        Plant(drive, {Term("elasticity", 1): {"stiffness": k, "damping": 1e-4 * k}}, PERIOD) for k in (3e3, 1e8)
    )
    assert stiff.step < soft.step
    # As stiff as that, it is none.
    states = moved(stiff, lambda _: [2.0], 0.1)
    assert states[-1, 1] == pytest.approx(2.0 * 0.1 / DRIVE_INERTIA, rel=1e-3)


# --- drives ---


def test_what_is_recorded_exceeds_what_acts_as_the_drive_says(drive: Model) -> None:
    for terms, command, acting in (
        ({Term("torque_scale", 1): {"factor": 1.25}}, 5.0, 4.0),
        ({Term("torque_saturation", 1): {"coefficient": 0.02}}, 4.0 + 0.02 * 64, 4.0),
        ({Term("torque_saturation", 1): {"coefficient": 1 / 16, "exponent": 15.0}}, 8.0, 4.0),
        ({Term("torque_saturation", 1): {"coefficient": 1 / 16, "exponent": 15.0}}, 4.5 + 4.5 * 1.125**14, 4.5),
        (
            {Term("torque_scale", 1): {"factor": 1.1}, Term("torque_saturation", 1): {"coefficient": 0.1}},
            -(1.1 * 3.0 + 0.1 * 27.0),
            -3.0,
        ),
    ):
        plant = Plant(drive, terms, PERIOD)
        plant.reset([0.0])
        plant.advance([command])
        assert plant.qd[0] == pytest.approx(acting * PERIOD / DRIVE_INERTIA, rel=1e-9)


def test_a_delayed_torque_acts_later_by_that_time(drive: Model) -> None:
    plant = Plant(drive, {Term("torque_delay", 1): {"time": 0.004}}, PERIOD)
    rates = moved(plant, lambda _: [3.0], 0.1)[:, 1]
    # Long after the beginning, the momentum lacks what the torque would have given in that time.
    assert rates[-1] == pytest.approx(3.0 * (0.1 - 0.004) / DRIVE_INERTIA, rel=1e-6)


# --- contact ---


def test_a_pressed_plate_balances_the_torque(drive: Model) -> None:
    plate = {"stiffness": 700.0, "pretension": 24.0, "friction": 0.0, "position": 0.02}
    terms: Structure = {Term("plate"): plate, Term("viscous", 1): {"coefficient": 20.0}}
    plant = Plant(drive, terms, PERIOD)
    plant.reset([0.3])
    q = moved(plant, lambda _: [-15.0], 4.0)[-1, 0]
    force = 24.0 + 700.0 * (0.02 - 0.3 * np.sin(q))
    assert 0.3 * np.cos(q) * force == pytest.approx(15.0, rel=1e-5)
    # Less than the pretension leaves the plate where it is.
    plant.reset([0.3])
    q = moved(plant, lambda _: [-5.0], 4.0)[-1, 0]
    assert 0.3 * np.sin(q) == pytest.approx(0.02, abs=2e-5)


# --- what cannot be simulated forwards ---


def test_a_motor_without_inertia_in_front_of_a_spring_is_refused(library: Library) -> None:
    bare = reader.parse(HANGING.replace("rotor_inertia = 0.02", "rotor_inertia = 0.0"), "hanging.toml")
    with pytest.raises(
        PlantError, match=r"^hanging: no inertia moves with the motor, .* at joint 2; state a rotor_inertia"
    ):
        Plant(Model(prepare_arm(bare), library), {Term("elasticity", 2): {"stiffness": 50.0, "damping": 0.0}}, PERIOD)


def test_the_joint_that_is_too_stiff_is_named(library: Library) -> None:
    """Little that moves with a motor, and much friction: its own time constant, 10 ns, is far below any step."""
    light = reader.parse(HANGING.replace("rotor_inertia = 0.02", "rotor_inertia = 1e-5"), "hanging.toml")
    rubbing = {Term("viscous", j): {"coefficient": 1000.0 if j == 2 else 0.5} for j in (1, 2)}
    terms = rubbing | {Term("elasticity", 2): {"stiffness": 50.0, "damping": 0.0}}
    with pytest.raises(PlantError) as caught:
        Plant(Model(prepare_arm(light), library), terms, PERIOD)
    said = str(caught.value)
    assert "viscous@2, elasticity@2, or a larger rotor_inertia (joint 2: 1e-05)" in said
    assert "@1" not in said


def test_a_value_that_nobody_knows_is_asked_for_by_name(drive: Model) -> None:
    with pytest.raises(ModelError, match=r"^drive: this needs values .* \(viscous@1: coefficient\); state them"):
        Plant(drive, {Term("viscous", 1): {}}, PERIOD)


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        (
            {Term("torque_delay", 1): {"time": -0.001}},
            "torque_delay@1: time = -0.001 s: forward simulation cannot record",
        ),
        ({Term("lugre", 1): {"stiffness": 1e3, "damping": 1.0}}, "lugre@1: replaces the joint's Coulomb"),
        (
            {Term("elasticity", 1): {"stiffness": 1e13, "damping": 0.0}},
            r"too stiff for steps of 7.8e-06 s; choose smaller values of elasticity@1, or a larger rotor_inertia",
        ),
    ],
)
def test_refused_with_one_line(drive: Model, terms: Structure, message: str) -> None:
    with pytest.raises(PlantError) as caught:
        Plant(drive, terms, PERIOD)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
