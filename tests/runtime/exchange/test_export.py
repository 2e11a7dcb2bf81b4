"""Arms for simulators: bodies that can be, which give the model's torques, in files that say what they can."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.exchange.bodies import (
    PER_BODY,
    base_map,
    full_regressor,
    is_possible,
    log_cholesky,
    project,
    pseudo_inertia,
    pseudo_parameters,
    pseudo_slopes,
    rotors_asked,
)
from runtime.notebook import exchanged
from runtime.notebook.arm import load
from runtime.workspace.source import Source
from symbolic.effects import DECLARED
from symbolic.model_file import likely
from symbolic.model_file.arm import Arm, Joint, Link
from symbolic.model_file.exchange import exporting
from symbolic.model_file.exchange.importing import imported
from symbolic.model_file.frames import StatedBody, parameters
from tests import one_joint
from tests.runtime.conftest import Refused, Run

ROBOTS = Path(__file__).resolve().parents[2] / "robots"

SMALL = """\
name = "small"
gravity = [0.5, 0.0, -9.81]
[[joint]]
name = "pan"
type = "revolute"
rotor_inertia = 0.2
gear_ratio = 50
origin = { xyz = [0.0, 0.0, 0.3], rpy = [0.1, 0.0, 0.0] }
[joint.link]
mass = 2.0
com = [0.02, 0.0, 0.05]
inertia = [0.03, 0.001, -0.004, 0.035, 0.0001, 0.02]
[joint.limits]
position = [-2.0, 2.0]
speed = 3.0
torque = 40.0
[joint.effects.coulomb_asymmetric]
positive = 1.0
negative = 1.5
[joint.effects.viscous]
coefficient = 0.7
[joint.effects.linear_spring]
stiffness = 3.0
rest = 0.2
[joint.effects.stribeck]
[[joint]]
name = "slide"
type = "prismatic"
rotor_inertia = 0.0
gear_ratio = 1
origin = { xyz = [0.1, 0.0, 0.0], rpy = [1.5707963267948966, 0.0, 0.0] }
axis = [0.0, 3.0, 4.0]
[joint.link]
mass = 1.0
com = [0.0, 0.1, 0.02]
inertia = [0.01, 0.0, 0.0, 0.012, 0.0, 0.008]
[[joint]]
name = "lift"
type = "revolute"
rotor_inertia = 0.05
gear_ratio = 80
origin = { xyz = [0.0, 0.2, 0.0], rpy = [0.0, 0.3, 0.0] }
axis = [1.0, 0.0, 0.0]
[joint.link]
mass = 0.8
com = [0.0, 0.1, 0.02]
inertia = [0.01, 0.0, 0.0, 0.012, 0.0, 0.008]
[tip]
origin = { xyz = [0.0, 0.0, 0.1] }
"""


@pytest.fixture
def run(tendon: Run, tmp_path: Path) -> Run:
    """`tendon ARGUMENTS` in a folder with small.toml."""
    (tmp_path / "small.toml").write_text(SMALL)
    return tendon


def full(arm: Arm) -> np.ndarray:
    """All inertial parameters that a file says."""
    bodies = likely.likely_bodies(arm)
    rotors = [
        likely.turning(body, joint) if joint.rotor_inertia is None else joint.rotor_inertia
        for body, joint in zip(bodies, arm.joints, strict=True)
    ]
    return np.array([*np.concatenate([parameters(body) for body in bodies]), *rotors])


def states(n: int, count: int = 20, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    q, qd, qdd = np.random.default_rng(seed).uniform(-2, 2, (3, n, count))
    return q, qd, qdd


def test_a_zero_stays_one() -> None:
    """What the search for possible bodies leaves of a zero is no number for a person to read."""
    body = StatedBody(2.0, (0.0, 0.1, 0.0), (0.03, 0.0, 1e-6, 0.04, 0.0, 0.05))
    noise = 1e-17 * np.random.default_rng(0).standard_normal(10)
    found = exporting.body_of(np.array(parameters(body)) + noise)
    assert found.com == (0.0, pytest.approx(0.1), 0.0)
    assert found.inertia == pytest.approx(body.inertia, rel=1e-9)
    assert (found.inertia[1], found.inertia[4]) == (0.0, 0.0)


# --- torques of a chain ---


@pytest.mark.parametrize("name", ["small", "vishard4"])
def test_torques_of_full_bodies_are_those_of_the_generated_code(name: str, tmp_path: Path, cache: Path) -> None:  # noqa: ARG001
    """Two routes to one number: the recursion on full bodies, and the code of base parameters."""
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    source = Source.read(path, None) if name == "small" else Source.read(Path(name), None)
    model, arm = source.compiled.model(), source.arm()
    at = states(model.n)
    own = np.einsum("npN,p->nN", full_regressor(arm, *at), full(arm))
    assert own == pytest.approx(model.inverse_dynamics(*at), rel=1e-9, abs=1e-9)
    B, W = base_map(arm, model.regressor)
    assert W @ B @ full(arm) == pytest.approx(W @ model.lump_values, rel=1e-9, abs=1e-9)


def test_a_chain_at_rest_holds_its_weight() -> None:
    """A pendulum: m g l sin q, and what slides along gravity bears all of it."""
    arm = Arm(
        "hanging",
        (0.0, 0.0, -9.81),
        (
            Joint("revolute", 0.0, 1.0, axis=(0.0, 1.0, 0.0), link=Link()),
            Joint("prismatic", 0.0, 1.0, axis=(1.0, 0.0, 0.0), link=Link()),
        ),
    )
    body = np.zeros(22)
    body[PER_BODY] = 2.0
    q = np.array([[0.3], [0.5]])
    tau = full_regressor(arm, q, 0 * q, 0 * q)[:, :, 0] @ body
    assert tau == pytest.approx([-2.0 * 9.81 * 0.5 * np.cos(0.3), -2.0 * 9.81 * np.sin(0.3)])


# --- bodies that can be ---

THETA = st.lists(st.floats(-1, 1), min_size=10, max_size=10).map(np.array)


@given(THETA)
@settings(deadline=None)
def test_every_log_cholesky_vector_is_a_body_and_every_body_is_one(theta: np.ndarray) -> None:
    body = pseudo_parameters(theta)
    assert is_possible(body)
    assert log_cholesky(body) == pytest.approx(theta, abs=1e-6)
    assert pseudo_inertia(body) == pytest.approx(pseudo_inertia(body).T)
    steps = [(pseudo_parameters(theta + e) - pseudo_parameters(theta - e)) / 2e-6 for e in 1e-6 * np.eye(10)]
    assert pseudo_slopes(theta) == pytest.approx(np.stack(steps, axis=1), abs=1e-6)


def cloud(rng: np.random.Generator) -> np.ndarray:
    """Ten parameters of some points with masses."""
    points, masses = rng.normal(0, 0.1, (12, 3)) + rng.normal(0, 0.1, 3), rng.uniform(0.05, 0.4, 12)
    moments = sum(m * (x @ x * np.eye(3) - np.outer(x, x)) for m, x in zip(masses, points, strict=True))
    return np.array([masses.sum(), *(masses @ points), *moments[np.triu_indices(3)]])


@pytest.fixture(scope="module")
def seven() -> SimpleNamespace:
    """A seven-joint arm of point clouds: its map to base parameters, what is true, and a guess at it."""
    rng = np.random.default_rng(3)
    arm = imported(ROBOTS / "panda.urdf", DECLARED, tip="panda_hand_tcp").arm
    Y = np.moveaxis(full_regressor(arm, *states(7, 60)), 1, 2).reshape(-1, 77)
    kept: list[int] = []
    for column in range(77):  # the first independent columns stand for base parameters
        if np.linalg.matrix_rank(Y[:, [*kept, column]], tol=1e-8) > len(kept):
            kept.append(column)
    B, W = base_map(arm, lambda *at: full_regressor(arm, *at)[:, kept])
    bodies = np.array([cloud(rng) for _ in range(7)])
    guess = np.array([cloud(rng) for _ in range(7)])
    return SimpleNamespace(B=B, W=W, bodies=bodies, rotors=rng.uniform(0.1, 1, 7), guess=guess, count=len(kept))


def test_a_panda_shows_48_base_parameters(seven: SimpleNamespace) -> None:
    assert seven.count == 48


def test_possible_bodies_are_found_whose_torques_are_exact(seven: SimpleNamespace) -> None:
    base = seven.B @ np.concatenate([seven.bodies.ravel(), seven.rotors])
    found = project(seven.B, seven.W, base, seven.guess, np.full(7, 0.3))
    assert found.mismatch < 1e-12
    assert all(is_possible(body) for body in found.bodies)
    assert found.rotors[2:] == pytest.approx(seven.rotors[2:])  # the others are seen with their links only


def test_what_nothing_shows_stays_at_the_reference(seven: SimpleNamespace) -> None:
    """The reference itself, where it has the base parameters; else bodies that are nearer to it than the truth."""
    base = seven.B @ np.concatenate([seven.bodies.ravel(), seven.rotors])
    found = project(seven.B, seven.W, base, seven.bodies, seven.rotors)
    assert found.bodies == pytest.approx(seven.bodies, rel=1e-6, abs=1e-9)
    other = project(seven.B, seven.W, base, seven.guess, np.full(7, 0.3))
    scale = np.array([1.0] * 4 + [0.1] * 6)

    def distance(bodies: np.ndarray, rotors: np.ndarray) -> float:
        own, there = (np.array([log_cholesky(body) for body in each]) for each in (bodies, seven.guess))
        return float(np.hypot(np.linalg.norm((own - there) / scale), np.linalg.norm(np.log(rotors / 0.3))))

    assert distance(other.bodies, other.rotors) < 0.9 * distance(seven.bodies, seven.rotors)


def test_where_no_body_has_them_the_nearest_in_torque_is_taken(seven: SimpleNamespace) -> None:
    truth = np.concatenate([seven.bodies.ravel(), seven.rotors])
    truth[:PER_BODY] *= -1
    truth[-7:] *= -1
    found = project(seven.B, seven.W, seven.B @ truth, seven.guess, np.full(7, 0.3))
    assert all(is_possible(body) for body in found.bodies)
    assert found.mismatch > 0.01
    assert (found.rotors > 0).all()


def test_a_rotor_that_nobody_states_is_what_the_bodies_leave(seven: SimpleNamespace) -> None:
    """Those that are stated stay; from a guess that is far too small the true ones are found."""
    base = seven.B @ np.concatenate([seven.bodies.ravel(), seven.rotors])
    guessed = np.arange(7) > 2
    likely = np.where(guessed, 1e-3, seven.rotors)
    asked = rotors_asked(seven.B, seven.W, base, seven.bodies, likely, guessed)
    assert asked == pytest.approx(seven.rotors)
    assert (asked[~guessed] == seven.rotors[~guessed]).all()
    larger = rotors_asked(seven.B, seven.W, base, seven.bodies, np.full(7, 2.0), guessed)
    assert (larger == 2.0).all()


def test_a_rotor_of_nothing_stays_so(seven: SimpleNamespace) -> None:
    base = seven.B @ np.concatenate([seven.bodies.ravel(), np.zeros(7)])
    found = project(seven.B, seven.W, base, seven.guess, np.zeros(7))
    assert not found.rotors.any()
    assert found.mismatch < 1e-12


# --- the verb ---


def said(run: Run, *arguments: object) -> dict:
    status, out, err = run("export", *arguments, "--json", "-")
    progress = r"(looking for physically possible bodies|deriving and compiling the model|reading \S+) …\n"
    assert (status, re.sub(progress, "", err)) == (0, "")
    document: dict = json.loads(out)
    return document


def test_a_file_that_says_everything_is_exported_as_it_is(run: Run) -> None:
    document = said(run, "small.toml", "--to", "urdf", "--out", "small.urdf")
    assert document["missing"] == 0
    again = imported(Path("small.urdf"), DECLARED).arm
    arm = Source.read(Path("small.toml"), None).arm()
    assert arm.space
    for there, own in zip(again.joints, arm.joints, strict=True):
        assert (there.name, there.type, there.gear_ratio) == (own.name, own.type, own.gear_ratio)
        assert there.origin == own.origin
        assert there.link.inertia == pytest.approx(own.link.inertia)
        assert there.link.com == pytest.approx(own.link.com)
    assert [joint.limits for joint in again.joints] == [joint.limits for joint in arm.joints]
    assert again.tip == arm.tip
    assert {re.sub(r" \(\S+ % of the torque\)", "", item) for item in document["unsaid"]} == {
        "linear_spring at joint 1",
        "coulomb_asymmetric at joint 1: its constant torque is left out",
        "stribeck at joint 1: its values are not known",
        "rotor_inertia of joints 1, 3",
        "gravity [0.5, 0.0, -9.81]: loaders take [0.0, 0.0, -9.81]",
    }
    assert '<dynamics damping="0.7" friction="1.25"/>' in Path("small.urdf").read_text()


def test_what_the_file_lacks_has_its_share_of_the_torque(run: Run) -> None:
    """Along a recording, or along a simulated motion: load friction is mu of the torque, while nothing else acts."""
    tables = "[joint.effects.load_friction]\ncoefficient = 0.25\n[joint.effects.end_stop]\n"
    Path("loaded.toml").write_text(one_joint.model_text(tables, gravity=-9.81))
    Path("plain.toml").write_text(one_joint.model_text("", gravity=-9.81))
    assert run("simulate", "plain.toml", "--seconds", "10", "--out", "run.csv")[0] == 0
    for more in ((), ("--on", "run.csv")):
        document = said(run, "loaded.toml", "--to", "mjcf", "--out", "new.xml", *more)
        friction, stop = document["effects"]
        assert (friction["effect"], friction["joint"], friction["played"]) == ("load_friction", 1, "not")
        assert friction["share"] == pytest.approx(0.25, rel=0.1)
        assert (stop["played"], stop["but"], stop["share"]) == ("not", "its values are not known", None)
        assert f"load_friction at joint 1 ({100 * friction['share']:.2g} % of the torque)" in document["unsaid"]
    result = exchanged.export(load("loaded.toml"), "new.xml", to="mjcf", on="run.csv")
    assert result.json["effects"] == document["effects"]
    status, out, err = run("export", "loaded.toml", "--to", "mjcf", "--out", "new.xml", "--on", "absent.csv")
    assert (status, out) == (2, "")
    assert "absent.csv" in err


@pytest.mark.parametrize("language", ["urdf", "bam"])
def test_the_share_of_what_stands_there_in_part_is_that_of_what_is_lost(run: Run, language: str) -> None:
    """Half the difference of two directions, of which a format has the mean."""
    tables = "[joint.effects.coulomb_asymmetric]\npositive = 1.2\nnegative = 1.1\n"
    tables += "[joint.effects.viscous_asymmetric]\npositive = 0.9\nnegative = 0.5\n"
    Path("two.toml").write_text(one_joint.model_text(tables, gravity=-9.81))
    assert run("simulate", "two.toml", "--seconds", "10", "--out", "run.csv")[0] == 0
    t, q, tau = np.genfromtxt("run.csv", delimiter=",", skip_header=1, usecols=(0, 1, 2)).T
    lost = {"coulomb_asymmetric": 0.05, "viscous_asymmetric": 0.2 * np.std(np.gradient(q, t))}
    for entry in said(run, "two.toml", "--to", language, "--out", "two.file", "--on", "run.csv")["effects"]:
        assert entry["played"] == "approximated"
        assert entry["share"] == pytest.approx(lost[entry["effect"]] / np.sqrt(np.mean(tau**2)), rel=0.05)


def test_what_was_identified_is_exported_with_its_torques(run: Run) -> None:
    """Base parameters that no body of the file has, into a URDF, and back into bodies: the torques are the model's."""
    source = Source.read(Path("small.toml"), None)
    model = source.compiled.model()
    changed = {lump.name: float(value) for lump, value in zip(model.lumps, 1.1 * model.lump_values, strict=True)}
    lines = "".join(f"{name} = {value!r}\n" for name, value in changed.items())
    Path("fitted.toml").write_text(f"{SMALL}\n[inertial]\n{lines}")
    document = said(run, "fitted.toml", "--to", "urdf", "--out", "fitted.urdf")
    assert document["missing"] < 1e-12
    again = imported(Path("fitted.urdf"), DECLARED).arm
    arm = replace(
        again,
        gravity=source.arm().gravity,
        joints=tuple(
            replace(joint, rotor_inertia=written["rotor_inertia"])
            for joint, written in zip(again.joints, document["joints"], strict=True)
        ),
    )
    at = states(3)
    own = np.einsum("npN,p->nN", full_regressor(arm, *at), full(arm))
    assert own == pytest.approx(model.inverse_dynamics(*at, lumps=1.1 * model.lump_values), rel=1e-9, abs=1e-9)


def test_unknown_numbers_are_asked_for_by_name(run: Run) -> None:
    Path("unknown.toml").write_text(SMALL.replace("rotor_inertia = 0.05\n", ""))
    status, out, err = run("export", "unknown.toml", "--to", "urdf", "--out", "new.urdf")
    assert (status, out) == (2, "")
    assert "this needs numbers that the model file leaves out (joint 3: rotor_inertia); base parameters" in err
    assert not Path("new.urdf").exists()


def test_a_planar_arm_lies_in_the_plane_of_x_and_y(run: Run) -> None:
    document = said(run, "vishard4", "--to", "mjcf", "--out", "vishard4.xml")
    text = Path("vishard4.xml").read_text()
    assert re.findall(r'axis="([^"]+)"', text) == ["0 0 1"] * 4
    assert [joint["com"][2] for joint in document["joints"]] == [0.0] * 4
    assert any(re.fullmatch(r"plate of the arm \(\d+ % of the torque\)", item) for item in document["unsaid"])
    assert "encoder of all joints" in document["unsaid"]


def test_the_numbers_go_onto_a_urdf_and_nothing_else_changes(run: Run) -> None:
    said(run, "small.toml", "--to", "urdf", "--out", "plain.urdf")
    drawn = (
        Path("plain.urdf")
        .read_text()
        .replace(
            '  <link name="pan_link">', '  <!-- as drawn -->\n  <link name="pan_link">\n    <visual name="a > b"/>'
        )
        .replace('mass value="2"', 'mass value="7"')
        .replace('<dynamics damping="0.7" friction="1.25"/>', "")
        .replace('<link name="tip"/>', '<link name="tip"><inertial><mass value="3"/></inertial></link>')
    )
    Path("drawn.urdf").write_text(drawn)
    said(run, "small.toml", "--to", "urdf", "--out", "new.urdf", "--onto", "drawn.urdf")
    made = Path("new.urdf").read_text()
    assert '<!-- as drawn -->\n  <link name="pan_link">\n    <visual name="a > b"/>' in made
    assert 'mass value="7"' not in made
    assert 'mass value="3"' not in made
    own, there = (imported(Path(name), DECLARED).arm for name in ("plain.urdf", "new.urdf"))
    assert own == there
    assert Path("drawn.urdf").read_text() == drawn


def test_what_is_as_in_the_model_stays_as_it_was_written(run: Run) -> None:
    """Other digits, another order, a comment within: of a body that is the model's not a byte changes."""
    said(run, "small.toml", "--to", "urdf", "--out", "plain.urdf")
    text = Path("plain.urdf").read_text()
    drawn = text.replace('<mass value="2"/>', '<!-- weighed --><mass value="2.000"/>')
    drawn = drawn.replace('damping="0.7" friction="1.25"', 'friction="1.250" damping="0.7"')
    Path("drawn.urdf").write_text(drawn)
    said(run, "small.toml", "--to", "urdf", "--out", "new.urdf", "--onto", "drawn.urdf")
    assert Path("new.urdf").read_text() == drawn
    Path("small.toml").write_text(SMALL.replace("mass = 0.8", "mass = 0.8001"))
    said(run, "small.toml", "--to", "urdf", "--out", "new.urdf", "--onto", "drawn.urdf")
    made = Path("new.urdf").read_text()
    assert '<!-- weighed --><mass value="2.000"/>' in made
    assert made.replace('value="0.8001"', 'value="0.8"') == drawn


def test_gears_go_into_the_transmissions_that_are_there(run: Run) -> None:
    """A motor that turns backwards still does; where the file leaves a gear open, or has other limits, that is said."""
    said(run, "small.toml", "--to", "urdf", "--out", "plain.urdf")
    text = Path("plain.urdf").read_text()
    drawn = text.replace("Reduction>50<", "Reduction> -30.0 <!-- by hand --><")
    Path("drawn.urdf").write_text(drawn)
    document = said(run, "small.toml", "--to", "urdf", "--out", "new.urdf", "--onto", "drawn.urdf")
    assert Path("new.urdf").read_text() == drawn.replace(" -30.0 <!-- by hand -->", "-50")
    assert document["kept"] == []
    transmission = re.findall(r"  <transmission.*?</transmission>\n", text, re.DOTALL)
    Path("open.urdf").write_text(
        text.replace(transmission[1], "")
        .replace("</robot>", transmission[0].replace(">50<", ">30<").replace("pan t", "other t") + "</robot>")
        .replace('velocity="3"', 'velocity="2"')
    )
    result = exchanged.export(load("small.toml"), "new.urdf", onto="open.urdf")
    assert result.json["kept"] == [
        "gear_ratio of joint 3, for which it states none",
        "gear_ratio of joint 1, for which it states several (50 of transmission pan transmission, 30 of transmission "
        "other transmission)",
        "limits.speed of joint 1",
    ]
    assert re.findall("Reduction>(.*?)<", Path("new.urdf").read_text()) == ["50", "30"]
    assert "The file into which it was written keeps its own: gear_ratio of joint 3, for" in repr(result)
    _, printed, _ = run("export", "small.toml", "--to", "urdf", "--out", "new.urdf", "--onto", "open.urdf")
    assert "keeps its own: gear_ratio of joint 3, for which" in " ".join(printed.split())


def panda() -> str:
    """The model that ships, with rotors."""
    return Source.shipped("panda").text.replace("gear_ratio = 1 ", "rotor_inertia = 0.2\ngear_ratio = 100 ")


def test_fingers_keep_their_bodies_and_other_programs_their_words(run: Run) -> None:
    """What moves by joints of its own would stand without mass, which no simulator can move."""
    Path("panda.toml").write_text(panda())
    document = said(run, "panda.toml", "--to", "urdf", "--out", "new.urdf", "--onto", str(ROBOTS / "panda.urdf"))
    made = Path("new.urdf").read_text()
    assert made.count('<mass value="0.015"/>') == 2
    assert '<mass value="0.73"/>' not in made
    assert made.count('<dynamics D="1" K="7000" damping="0.003" friction="0.0" mu_coulomb="0" mu_viscous="16"/>') == 7
    assert document["joints"][6]["mass"] == pytest.approx(0.735522 + 0.73 + 2 * 0.015)
    again = imported(Path("new.urdf"), DECLARED, tip="panda_hand_tcp").arm
    own = Source.shipped("panda").arm()
    for there, here in zip(again.joints, own.joints, strict=True):
        assert there.link.mass == pytest.approx(here.link.mass)
        assert there.link.com == pytest.approx(here.link.com, abs=1e-9)
        assert there.link.inertia == pytest.approx(here.link.inertia, abs=1e-9)


def test_a_body_lighter_than_its_fingers_is_said(run: Run) -> None:
    Path("panda.toml").write_text(panda().replace("mass = 1.495522", "mass = 0.01"))
    onto = ("--to", "urdf", "--out", "new.urdf", "--onto", ROBOTS / "panda.urdf")
    status, out, err = run("export", "panda.toml", *onto)
    assert (status, out) == (2, "")
    assert 'joint "panda_joint7": the links attached there by movable joints (panda_' in err
    assert not Path("new.urdf").exists()


def test_what_drives_and_controllers_are_told_is_unsaid(run: Run) -> None:
    told = "torque_constant = 5.0\n[joint.encoder]\ncounts = 2000\n[joint.limits]\nspeed = 3.0\n[joint.link]"
    Path("told.toml").write_text(re.sub(r"\[joint.limits\]\n(\w.*\n)*", "", SMALL).replace("[joint.link]", told, 1))
    unsaid = {to: said(run, "told.toml", "--to", to, "--out", f"new.{to}")["unsaid"] for to in ("urdf", "mjcf")}
    for items in unsaid.values():
        assert {"torque_constant of joint 1", "encoder of joint 1"} <= set(items)
    assert ("limits.speed of joint 1" in unsaid["urdf"], "limits.speed of joint 1" in unsaid["mjcf"]) == (False, True)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--to", "mjcf", "--out", "new", "--onto", "x.urdf"), "--onto x.urdf: only a URDF can be written into"),
        (("--to", "urdf", "--out", "small.toml"), "small.toml: is read here; choose another name to write to"),
        (("--to", "urdf", "--out", "no/where"), "there is no directory no; make it first"),
        (("--to", "sdf", "--out", "new"), "'sdf' is not one of 'urdf', 'mjcf'"),
        (("--to", "urdf", "--out", "new", "--onto", "absent.urdf"), "absent.urdf: no such file; expected a URDF"),
        (
            ("--to", "urdf", "--out", "new", "--onto", str(ROBOTS / "panda.urdf")),
            'has no joint "pan", which the model has',
        ),
    ],
)
def test_mistakes_are_one_line_and_nothing_is_written(
    refused: Refused, arguments: tuple[str, ...], message: str
) -> None:
    Path("small.toml").write_text(SMALL)
    assert message in refused("export", "small.toml", *arguments)
    assert not Path("new").exists()
    assert Path("small.toml").read_text() == SMALL


@pytest.mark.parametrize("arm", ["small", "planar"])
def test_gravity_that_was_found_is_gravity(run: Run, arm: str) -> None:
    """A base that leans, identified beside the model file's gravity: MuJoCo pulls in the sum of both."""
    planar = one_joint.model_text("", gravity=-9.81)
    text, found, whole = {
        "small": (SMALL, "gx = 0.25\ngy = -0.5\ngz = 0.5\n", [0.75, -0.5, -9.31]),
        "planar": (planar, "gx = 0.25\ngy = 0.5\n", [0.25, -9.31, 0.0]),
    }[arm]
    Path("leaning.toml").write_text(f"{text}\n[effects.gravity]\n{found}")
    document = said(run, "leaning.toml", "--to", "mjcf", "--out", "new.xml")
    assert document["gravity"] == pytest.approx(whole)
    assert not [item for item in document["unsaid"] if "gravity" in item]
    written = re.findall(r'gravity="([^"]+)"', Path("new.xml").read_text())[0]
    assert list(map(float, written.split())) == pytest.approx(whole)
    urdf = said(run, "leaning.toml", "--to", "urdf", "--out", "new.urdf")["unsaid"]
    assert [item.startswith(f"gravity {document['gravity']}: loaders") for item in urdf if "gravity" in item] == [True]
    Path("leaning.toml").write_text(f"{text}\n[effects.gravity]\n")
    unknown = said(run, "leaning.toml", "--to", "mjcf", "--out", "new.xml")
    assert "gravity of the arm: its values are not known" in unknown["unsaid"]


def test_in_a_notebook(run: Run) -> None:  # noqa: ARG001 - a folder with small.toml
    result = exchanged.export(load("small.toml"), "small.xml", to="mjcf")
    assert Path("small.xml").read_text().count("<joint ") == 3
    assert repr(result).startswith(
        "small.xml: small\nThe file does not say, or not exactly: stribeck at joint 1: its values are not known"
    )
    result.show()


def test_a_lag_of_the_drives_is_one_of_the_simulator_s_actuators(run: Run) -> None:
    """After a time constant, MuJoCo's force is within 1/e of a step; URDF has no word for it."""
    mujoco = pytest.importorskip("mujoco")
    Path("lagging.toml").write_text(SMALL + "\n[effects.command_lag]\ntime_constant = 0.02\n", encoding="utf-8")
    document = said(run, "lagging.toml", "--to", "mjcf", "--out", "lagging.xml")
    assert not any("command_lag" in item for item in document["unsaid"])
    model = mujoco.MjModel.from_xml_path("lagging.xml")
    data, step = mujoco.MjData(model), float(model.opt.timestep)
    data.ctrl[:] = 1.0
    for _ in range(round(0.02 / step) + 1):
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.actuator_force, 1 - np.exp(-1.0), atol=0.01)
    assert "command_lag at" in str(said(run, "lagging.toml", "--to", "urdf", "--out", "lagging.urdf")["unsaid"])


OWN = """\
from tendon.effects import SIGNAL, WIDTH_RATE, Effect, Parameter, absolute, elements, parameter
from tendon.effects import units as u

QD = SIGNAL["qd"].symbol
EFFECTS = (
    Effect(
        name="drag",
        scope="joint",
        family="friction",
        torque=parameter("coefficient") * absolute(QD, WIDTH_RATE) * QD,
        parameters=(Parameter("coefficient", u.FORCE / u.RATE**2, "torque per squared rate"),),
        elements=(elements.PowerDamper(parameter("size"), 2),),
        summary="s", equation="e", trace="t", experiment="x", source="b",
    ),
)
"""


def test_an_effect_of_one_s_own_says_its_elements(run: Run) -> None:
    """As those of the library do; one that is no parameter's is refused in a line."""
    Path("drag.py").write_text(OWN)
    Path("drag.toml").write_text(one_joint.model_text("[joint.effects.drag]\ncoefficient = 0.3\n"))
    arguments = ("export", "drag.toml", "--to", "mjcf", "--out", "drag.xml", "--effects", "drag.py")
    status, out, err = run(*arguments)
    assert (status, out) == (2, "")
    assert 'effect "drag": its elements use p_size; expected its parameters alone' in err
    Path("drag.py").write_text(OWN.replace('parameter("size")', 'parameter("coefficient")'))
    assert run(*arguments)[0] == 0
    damping = re.findall(r' damping="([^"]+)"', Path("drag.xml").read_text())[0]
    assert [float(x) for x in damping.split()] == pytest.approx([0.0, 0.3, 0.0], abs=1e-9)
    Path("drag.py").write_text(OWN.replace('(elements.PowerDamper(parameter("size"), 2),)', "(2,)"))
    assert "elements item 1 is 2; expected Element(...)" in run(*arguments)[2]


def test_another_arm_of_the_same_names_is_told_apart(run: Run) -> None:
    said(run, "small.toml", "--to", "urdf", "--out", "plain.urdf")
    text = Path("plain.urdf").read_text()
    Path("longer.urdf").write_text(text.replace('xyz="0 0.2 0"', 'xyz="0 0.21 0"'))
    Path("turned.urdf").write_text(text.replace('rpy="0 0.3 0"', 'rpy="0 0.31 0"'))
    Path("across.urdf").write_text(text.replace('axis xyz="1 0 0"', 'axis xyz="0 1 0"'))
    others = {"longer": "another origin", "turned": "another rotation", "across": "another type or axis"}
    for name, what in others.items():
        status, _, err = run("export", "small.toml", "--to", "urdf", "--out", "new", "--onto", f"{name}.urdf")
        assert status == 2
        assert f'joint "lift" has {what} than in the model: another arm?' in err


def test_mujoco_takes_the_file_and_gives_the_torques(run: Run) -> None:
    import mujoco

    said(run, "small.toml", "--to", "mjcf", "--out", "small.xml")
    there, model = mujoco.MjModel.from_xml_path("small.xml"), Source.read(Path("small.toml"), None).compiled.model()
    there.dof_damping[:], there.dof_frictionloss[:], there.jnt_stiffness[:] = 0, 0, 0
    there.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, at = mujoco.MjData(there), states(3)
    own = model.inverse_dynamics(*at)
    for k in range(own.shape[1]):
        data.qpos[:], data.qvel[:], data.qacc[:] = (x[:, k] for x in at)
        mujoco.mj_inverse(there, data)
        # To 1e-8: releases of MuJoCo differ in how closely they find the principal axes of an inertia.
        assert data.qfrc_inverse == pytest.approx(own[:, k], rel=1e-8, abs=1e-8)
