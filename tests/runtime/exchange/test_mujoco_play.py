"""Two simulators of an arm: MuJoCo from the exported file, and the plant, under the same torques from one state."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from runtime.exchange.bodies import mobilities
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term, structure
from runtime.simulation.plant import Plant
from runtime.simulation.simulate import complete, excitation, torque_along
from runtime.workspace.source import Source
from symbolic.effects import DECLARED
from symbolic.effects.declaration import Effect
from symbolic.model_file import likely
from symbolic.model_file.arm import Arm
from symbolic.model_file.exchange import exporting
from symbolic.model_file.exchange.mjcf_writer import mjcf_text, power_fit
from symbolic.model_file.exchange.ways import of_effect
from symbolic.model_file.frames import parameters

pytest.importorskip("mujoco", minversion="4")
from runtime.exchange.mujoco_play import Played, PlayError

BENCH = """\
name = "bench"
gravity = [0.0, 0.0, -9.81]
[[joint]]
type = "revolute"
rotor_inertia = 0.2
gear_ratio = 50
origin = { xyz = [0.0, 0.0, 0.3], rpy = [1.5707963267948966, 0.0, 0.0] }
axis = [0.0, 0.0, 1.0]
[joint.link]
mass = 2.0
com = [0.15, 0.02, 0.05]
inertia = [0.03, 0.001, -0.004, 0.035, 0.0001, 0.02]
[[joint]]
type = "revolute"
rotor_inertia = 0.1
gear_ratio = 80
origin = { xyz = [0.3, 0.0, 0.0], rpy = [0.2, 0.3, 0.0] }
axis = [0.0, 0.0, 1.0]
[joint.link]
mass = 1.0
com = [0.1, 0.01, 0.02]
inertia = [0.01, 0.0, 0.0, 0.012, 0.0, 0.008]
[tip]
origin = { xyz = [0.2, 0.0, 0.0] }
"""
PERIOD, SECONDS = 2.5e-4, 0.3
FINE = 2e-5
"""s; a step of MuJoCo at which its own error is far below the tolerances."""
WIDE, SMALL = 0.1, 0.03
"""rad; the stated tolerances are parts of the wide motion; likely torque limits of whole arms allow the small one."""
DRY = {"coulomb@1": {"torque": 3.0}}

EFFECTS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "coulomb": DRY,
    "coulomb_asymmetric": {"coulomb_asymmetric@1": {"positive": 4.5, "negative": 3.0}},
    "viscous": {"viscous@1": {"coefficient": 1.6}},
    "viscous_asymmetric": {
        "viscous_asymmetric@1": {"positive": 2.4, "negative": 1.2},
        "viscous_asymmetric@2": {"positive": 0.5, "negative": 1.5},
    },
    "viscous_cubic": {"viscous_cubic@1": {"coefficient": 0.2}, "viscous_cubic@2": {"coefficient": -0.01}},
    "viscous_power": {"viscous_power@1": {"torque": 0.9, "exponent": 1.65}},
    "stribeck": {**DRY, "stribeck@1": {"torque": 1.5, "speed": 0.3}},
    "velocity_strengthening": {**DRY, "velocity_strengthening@1": {"torque": 3.0, "speed": 0.1}},
    "lugre": {**DRY, "stribeck@1": {"torque": 1.0, "speed": 0.3}, "lugre@1": {"stiffness": 800.0, "damping": 10.0}},
    "offset": {"offset@1": {"torque": 3.0}},
    "linear_spring": {"linear_spring@1": {"stiffness": 40.0, "rest": -0.5}},
    "parallel_spring": {"parallel_spring@1": {"stiffness": 60.0, "radius": 0.5, "offset": 0.32, "pretension": 8.0}},
    "cable": {"cable@1": {"c1": 6.0, "c2": 9.0, "c3": 13.0, "c4": 17.0}},
    "end_stop": {
        "end_stop@1": {"position": 0.36, "stiffness": 500.0, "damping": 1.0, "side": 1.0},
        "end_stop@2": {"position": 0.25, "stiffness": 400.0, "damping": 0.0, "side": -1.0},
    },
    "spring_hysteresis": {"spring_hysteresis@1": {"torque": 3.3, "width": 0.04}},
    "torque_ripple": {
        "torque_ripple@1": {"order": 3.36, "amplitude": 6.0, "phase": -0.8},
        "torque_ripple_2@1": {"order": 1.0, "amplitude": 2.0, "phase": 0.4},
    },
    "torque_scale": {"torque_scale@1": {"factor": 1.2}, "offset@1": {"torque": 2.0}},
    "torque_delay": {"torque_delay@1": {"time": 0.002}},
    "command_delay": {"command_delay": {"time": 0.002}},
    "torque_lag": {"torque_lag@1": {"time_constant": 0.0074}},
    "command_lag": {"command_lag": {"time_constant": 0.0074}},
    "elasticity": {"elasticity@1": {"stiffness": 23000.0, "damping": 7.0}},
    "backlash": {"backlash@1": {"gap": 0.0016, "stiffness": 3700.0, "damping": 23.0}},
    "gravity": {"gravity": {"gx": 9.0, "gy": -5.0, "gz": 2.0}},
    "payload": {"payload": {"mass": 0.5, "time": -1.0, "x": 0.02, "y": -0.05, "z": 0.03}},
    "coupled_friction": {"coupled_friction@1": {"torque": 3.0}},
    "coupled_gear": {
        "coupled_gear@1": {"coulomb": 3.0, "viscous": 1.2, "inertia": 0.09, "ratio": -1.0},
        "coupled_friction@1": {"torque": 1.0},
    },
}
"""The effect, and what it needs beside it: at a joint, or of the arm."""


def terms_of(named: Mapping[str, Mapping[str, float]]) -> Structure:
    found: Structure = {}
    for name, values in named.items():
        effect, _, joint = name.partition("@")
        plain, _, number = effect.rpartition("_")
        several = number.isdigit()
        term = Term(plain if several else effect, int(joint) if joint else None, int(number) if several else 1)
        found[term] = dict(values)
    return found


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """The bench's model and file, and a motion from rest without a jump in the acceleration."""
    path = tmp_path_factory.mktemp("bench") / "bench.toml"
    path.write_text(BENCH)
    source = Source.read(path, None)
    t = PERIOD * np.arange(round(SECONDS / PERIOD) + 1)
    return SimpleNamespace(model=source.compiled.model(), arm=source.arm(), t=t)


def prescribed(
    t: np.ndarray, n: int, reach: float, middle: np.ndarray | float = 0.3, slowest: float = 4.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n, N) each: sines of `slowest` Hz and up to a half more that fade in within 0.1 s."""
    hz, h = slowest * (1 + np.arange(n)[:, None] / max(n - 1, 1) / 2), 1e-4

    def at(t: np.ndarray) -> np.ndarray:
        s = np.clip(t / 0.1, 0, 1)
        return middle + reach * s**3 * (10 - 15 * s + 6 * s**2) * np.sin(2 * np.pi * hz * t)

    before, q, after = at(t - h), at(t), at(t + h)
    return q, (after - before) / (2 * h), (after - 2 * q + before) / h**2


def exported(
    arm: Arm, terms: Structure, path: Path, library: Mapping[str, Effect] = DECLARED
) -> tuple[Played, exporting.ExportedArm]:
    """The arm with these effects as MuJoCo has it from the file."""
    joints, whole = list(arm.joints), dict(arm.effects)
    for term, values in terms.items():
        if term.joint is None:
            whole[term.name] = values
        else:
            own = joints[term.joint - 1]
            joints[term.joint - 1] = replace(own, effects={**own.effects, term.name: values})
    arm = replace(arm, joints=tuple(joints), effects=whole)
    bodies = likely.likely_bodies(arm)
    rotors = [joint.rotor_inertia or 0.0 for joint in arm.joints]
    behind = np.array(exporting.elastic(arm, library))
    moved = mobilities(arm, np.array([parameters(body) for body in bodies]), np.array(rotors), behind)
    made = exporting.exported(arm, library, "mjcf", bodies, rotors, moved.tolist())
    path.write_text(mjcf_text(made))
    return Played(path), made


def plant_states(
    model: Model, terms: Structure, t: np.ndarray, tau: np.ndarray, q: np.ndarray, qd: np.ndarray
) -> list[np.ndarray]:
    """The plant's states (positions, rates, memories, ...); its drives have had the first torque for long."""
    plant = Plant(model, terms, t[1] - t[0])
    plant.reset(q, qd)
    plant._state[-1 - model.n : -1] = tau[:, 0]
    out = [plant._state.copy()]
    for k in range(len(t) - 1):
        plant.advance((tau[:, k] + tau[:, k + 1]) / 2)
        out.append(plant._state.copy())
    return out


def stated(terms: Structure) -> float:
    """The largest of the tolerances that the table states of effects."""
    return max(of_effect(DECLARED[term.effect], "mjcf").tolerance for term in terms)


def plant_motion(
    model: Model, terms: Structure, t: np.ndarray, tau: np.ndarray, q: np.ndarray, qd: np.ndarray
) -> np.ndarray:
    """(N, n): what the plant does."""
    return np.array([state[: model.n] for state in plant_states(model, terms, t, tau, q, qd)])


def off(there: np.ndarray, own: np.ndarray) -> float:
    """The largest distance of two motions (N, n), in parts of what each joint moves."""
    return float((np.abs(there - own).max(axis=0) / np.abs(own - own[0]).max(axis=0)).max())


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_moves_the_arm_in_mujoco_as_in_the_plant(bench: SimpleNamespace, name: str, tmp_path: Path) -> None:
    """Within the tolerance that the table states of it."""
    terms = terms_of(EFFECTS[name])
    played, _ = exported(bench.arm, terms, tmp_path / "bench.xml")
    q, qd, qdd = prescribed(bench.t, 2, WIDE)
    tau = torque_along(bench.model, q, qd, qdd, 1 / PERIOD, terms)
    own = plant_motion(bench.model, terms, bench.t, tau, q[:, 0], qd[:, 0])
    there, _ = played.play(bench.t, tau.T, q[:, 0], qd[:, 0], step=FINE)
    assert (np.abs(own - own[0]).max(axis=0) > 0.05).all()
    error, tolerance = off(there, own), stated(terms)
    print(f"{name}: {error:.2g} of {tolerance:g}")
    assert error < tolerance
    without, _ = exported(bench.arm, {}, tmp_path / "without.xml")
    plain, _ = without.play(bench.t, tau.T, q[:, 0], qd[:, 0])
    assert off(plain, own) > 3 * error, "the effect is in the file"


ARMS = {"drive": "linear_spring", "vishard4": "coupled_friction", "ur10": "torque_ripple", "panda": "spring_hysteresis"}
"""The arms that ship, and an effect more at their first joint."""
SPATIAL = [pytest.param(name, marks=pytest.mark.slow) for name in ("ur10", "panda")]


@pytest.mark.parametrize("name", ["drive", "vishard4", *SPATIAL])
def test_a_whole_arm_moves_as_in_the_plant(name: str, cache: Path, tmp_path: Path) -> None:  # noqa: ARG001
    """The arms that ship, with likely rotors and friction where their files leave them out, and an effect more: within
    the tolerance that the table states of the friction, whose error at a reversal is as large in a small motion."""
    compiled, _ = Source.shipped(name).compiled.with_likely_numbers()
    model, n = compiled.model(), len(compiled.arm.joints)
    t = PERIOD * np.arange(round(SECONDS / PERIOD) + 1)
    middle = [sum(joint.limits.position or (0.0, 0.6)) / 2 for joint in compiled.arm.joints]
    q, qd, qdd = prescribed(t, n, SMALL, np.array(middle)[:, None], slowest=1.5)
    path = excitation(model, np.random.default_rng(0), 4.0, 1)
    terms = complete(model, path, {**structure(model), Term(ARMS[name], 1): {}})
    terms = {term: values for term, values in terms.items() if model.library[term.effect].scope != "contact"}
    arm = replace(compiled.arm, contact=None)  # which MuJoCo does not play
    played, made = exported(arm, terms, tmp_path / "arm.xml", compiled.library)
    assert {effect.standing.played for effect in made.effects} <= {"exact", "approximated"}
    tau = torque_along(model, q, qd, qdd, 1 / PERIOD, terms)
    own = plant_motion(model, terms, t, tau, q[:, 0], qd[:, 0])
    there, _ = played.play(t, tau.T, q[:, 0], qd[:, 0], step=FINE)
    error, tolerance = off(there, own), stated(terms) * WIDE / SMALL
    print(f"{name}: {error:.2g} of {tolerance:g}")
    assert error < tolerance


def test_without_mujoco_it_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(PlayError, match=r"the package mujoco is not installed: pip install mujoco.*`mjcf`"):
        Played(tmp_path / "arm.xml")


def test_an_elastic_joint_goes_on_from_where_it_is_bent(bench: SimpleNamespace, tmp_path: Path) -> None:
    """In the middle of a motion: with its deflection and that one's rate; a bent spring alone is as good as nothing."""
    terms = terms_of(EFFECTS["elasticity"])
    played, _ = exported(bench.arm, terms, tmp_path / "bench.xml")
    q, qd, qdd = prescribed(bench.t, 2, 0.1)
    tau = torque_along(bench.model, q, qd, qdd, 1 / PERIOD, terms)
    states = np.array(plant_states(bench.model, terms, bench.t, tau, q[:, 0], qd[:, 0]))
    at, rate = states[600, :2], states[600, 2:4]
    (deflection, its_rate), rest = states[600, 4:6], states[600:, :2]
    error = {}
    for name, bent in (("bent", np.array([[deflection, 0.0], [its_rate, 0.0]])), ("unbent", np.zeros((2, 2)))):
        there, _ = played.play(bench.t[600:], tau[:, 600:].T, at, rate, bent, step=FINE)
        error[name] = off(there, rest)
    assert error["bent"] < of_effect(DECLARED["elasticity"], "mjcf").tolerance
    assert error["unbent"] > 5 * error["bent"]


def test_a_hysteresis_goes_on_from_where_it_has_slipped_to(bench: SimpleNamespace, tmp_path: Path) -> None:
    terms = terms_of(EFFECTS["spring_hysteresis"])
    played, _ = exported(bench.arm, terms, tmp_path / "bench.xml")
    q, qd, qdd = prescribed(bench.t, 2, 0.1)
    tau = torque_along(bench.model, q, qd, qdd, 1 / PERIOD, terms)
    states = np.array(plant_states(bench.model, terms, bench.t, tau, q[:, 0], qd[:, 0]))
    at, rest = states[600, :2], states[600:, :2]
    error = []
    for rests in (played.rests(states[:601, :2])[-1], np.repeat(at[0], 4)):
        there, _ = played.play(bench.t[600:], tau[:, 600:].T, at, states[600, 2:4], rests=rests, step=FINE)
        error.append(off(there, rest))
    assert error[0] < of_effect(DECLARED["spring_hysteresis"], "mjcf").tolerance
    assert error[1] > 5 * error[0]


def test_a_motion_that_runs_away_is_no_number(bench: SimpleNamespace, tmp_path: Path) -> None:
    """Friction that falls with the cubed rate has no bound; the next window is played as if there had been none."""
    away = terms_of({"viscous_cubic@1": {"coefficient": -5.0}})
    played, _ = exported(bench.arm, away, tmp_path / "bench.xml")
    t, tau = 0.001 * np.arange(30), np.zeros((2, 30, 2))
    starts = np.zeros((2, 2)), np.array([[30.0, 0.0], [0.0, 0.0]])
    q = played.windows(t, tau, *starts, np.zeros((2, 2, 2)), np.zeros((2, 0)))
    assert np.isnan(q[0, -1]).all()
    assert np.isfinite(q[0, 0]).all()
    assert np.isfinite(q[1]).all()


def test_every_effect_that_mujoco_plays_is_tried() -> None:
    assert set(EFFECTS) == {name for name, effect in DECLARED.items() if of_effect(effect, "mjcf").played != "not"}


def test_a_polynomial_that_is_one_is_found() -> None:
    for power, expected in ((1.0, (1, 0, 0)), (2.0, (0, 1, 0)), (3.0, (0, 0, 1))):
        assert power_fit(power, 2.5) == pytest.approx(expected, abs=1e-9)


def test_what_cannot_be_played_is_one_line(bench: SimpleNamespace, tmp_path: Path) -> None:
    path = tmp_path / "other.xml"
    path.write_text("<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>")
    with pytest.raises(PlayError, match=r"other.xml: its first actuators are not a motor"):
        Played(path)
    path.write_text("<mujoco><nothing/></mujoco>")
    with pytest.raises(PlayError, match=r"other.xml: MuJoCo cannot read it: .*4\.0 or newer"):
        Played(path)
    played, _ = exported(bench.arm, {}, tmp_path / "bench.xml")
    with pytest.raises(PlayError, match=r"torques of shape \(3, 3\): expected \(3, 2\)"):
        played.play([0, 1, 2], np.zeros((3, 3)), [0, 0], [0, 0])


def test_what_is_not_played_is_listed(bench: SimpleNamespace, tmp_path: Path) -> None:
    named = {"torque_delay@1": {"time": -0.01}, "load_friction@2": {"coefficient": 0.1}, "friction_patch@1": {}}
    _, made = exported(bench.arm, terms_of(named), tmp_path / "bench.xml")
    assert set(made.unsaid) == {
        "torque_delay at joint 1: no torque acts before its command",
        "load_friction at joint 2",
        "friction_patch at joint 1: its values are not known",
    }
