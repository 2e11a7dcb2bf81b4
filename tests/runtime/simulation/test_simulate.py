"""Simulated recordings: exact inverse dynamics along the motion, the hidden effect on top, and clear refusals."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from codegen.prepare import prepare_arm, prepare_effects
from runtime.cli import output
from runtime.cli.main import app
from runtime.model.loader import Library, Model
from runtime.model.terms import Term
from runtime.recordings import recording
from runtime.recordings.columns import RecordedArm
from runtime.simulation import demo
from runtime.simulation.motion_file import read_motion
from runtime.simulation.options import SimulationSettings
from runtime.simulation.settings import NOISE
from runtime.simulation.simulate import SimulationError, parse_hidden, simulate
from symbolic.model_file import reader
from tests import plants
from tests.spatial_arms import drawn

ARMS = Path(__file__).resolve().parents[3] / "symbolic" / "arms"
MEMORYLESS_AT_A_JOINT = ["stribeck", "linear_spring", "torque_ripple", "torque_delay", "thermal_friction"]


@pytest.fixture(scope="module")
def drive() -> Model:
    return Model(prepare_arm(reader.load(ARMS / "drive.toml")), Library(prepare_effects()))


@pytest.fixture(scope="module")
def arm() -> Model:
    return Model(prepare_arm(reader.load(ARMS / "vishard4.toml")), Library(prepare_effects()))


def test_noise_free_recording_is_the_inverse_dynamics(drive: Model) -> None:
    angle = 0.4 * np.sin(2 * np.pi * 1.5 * np.arange(3000) / 1000)[None]
    made, values = simulate(drive, settings=SimulationSettings(noise=0.0), motion=angle)
    omega = 2 * np.pi * 1.5
    rate, acceleration = 0.4 * omega * np.cos(omega * made.t), -(omega**2) * angle[0]
    friction = values[Term("coulomb_asymmetric", 1)]
    expected = 0.2365 * acceleration + np.where(rate > 0, friction["positive"], -friction["negative"])
    expected += values[Term("viscous", 1)]["coefficient"] * rate
    expected += values[Term("viscous_cubic", 1)]["coefficient"] * rate**3
    # Quintic spline at 1 kHz of a 1.5 Hz sine: its second derivative is good to (omega dt)^4 away from the ends.
    inner = np.abs(rate) > 1e-6
    inner[:20] = inner[-20:] = False
    assert np.abs(made.tau[0] - expected)[inner].max() < 1e-6


@pytest.mark.parametrize("name", [*MEMORYLESS_AT_A_JOINT, "lugre", "elasticity"])
def test_hidden_effect_is_added_and_its_values_are_told(drive: Model, name: str) -> None:
    plain, _ = simulate(drive, settings=SimulationSettings(seconds=20.0, noise=0.0))
    hidden = parse_hidden(f"{name}@1", drive)
    made, values = simulate(drive, [hidden], SimulationSettings(seconds=20.0, noise=0.0))
    assert set(values[hidden.term]) == {p.name for p in drive.library[name].parameters}
    added = np.std(made.tau - plain.tau) / np.std(plain.tau)
    assert 0.005 < added < 0.5
    np.testing.assert_array_equal(made.q, plain.q)


def test_stated_values_are_used(drive: Model) -> None:
    hidden = parse_hidden("stribeck@1:torque=0.6,speed=0.15", drive)
    _, values = simulate(drive, [hidden], SimulationSettings(seconds=20.0))
    assert values[Term("stribeck", 1)] == {"torque": 0.6, "speed": 0.15}


@pytest.mark.parametrize(
    ("text", "rest"),
    [
        ("gravity:gx=1", {"gy": 0.0}),
        ("gravity:gy=-2", {"gx": 0.0}),
        ("cable@1:c2=3", {"c1": 0.0, "c3": 0.0, "c4": 0.0}),
        ("linear_spring@1:stiffness=2", {"rest": 0.0}),
    ],
)
def test_components_beside_a_stated_one_are_zero(drive: Model, text: str, rest: dict[str, float]) -> None:
    hidden = parse_hidden(text, drive)
    _, values = simulate(drive, [hidden], SimulationSettings(seconds=10.0))
    assert values[hidden.term] == hidden.values | rest


def test_sizes_of_one_sign_beside_a_stated_one_are_moderate(drive: Model) -> None:
    """A spring without damping would ring for ever: what may not change its sign has no reason to be 0."""
    hidden = parse_hidden("elasticity@1:stiffness=3000", drive)
    assert simulate(drive, [hidden], SimulationSettings(seconds=10.0))[1][hidden.term]["damping"] > 0
    gravity = simulate(drive, [parse_hidden("gravity", drive)], SimulationSettings(seconds=10.0))[1][Term("gravity")]
    assert min(abs(gravity["gx"]), abs(gravity["gy"])) > 0.1


def test_gravity_in_space_has_the_stated_direction() -> None:
    model = Model(prepare_arm(drawn("rr", seed=3)), Library(prepare_effects(space=True)))
    for axis in "xyz":
        hidden = parse_hidden(f"gravity:g{axis}=1.5", model)
        _, values = simulate(model, [hidden], SimulationSettings(seconds=10.0))
        assert values[hidden.term] == {"gx": 0.0, "gy": 0.0, "gz": 0.0, f"g{axis}": 1.5}


def test_a_payload_in_space_sits_at_the_tip_unless_its_centre_is_stated() -> None:
    """As on a planar arm; also on a gantry, whose torques no centre changes."""
    model = Model(prepare_arm(drawn("pp", seed=3)), Library(prepare_effects(space=True)))
    hidden = [parse_hidden(text, model) for text in ("payload", "payload:mass=2,y=0.1")]
    values = [simulate(model, [item], SimulationSettings(seconds=10.0))[1][item.term] for item in hidden]
    centres = [tuple(each[axis] for axis in "xyz") for each in values]
    assert centres == [(0.0, 0.0, 0.0), (0.0, 0.1, 0.0)]
    with pytest.raises(SimulationError, match='"plate" is for planar arms, and drawn_pp_3 is spatial'):
        parse_hidden("plate", model)


def test_seed_decides_motion_and_noise(arm: Model) -> None:
    first, second, other = (simulate(arm, settings=SimulationSettings(s, 10.0))[0] for s in (1, 1, 2))
    np.testing.assert_array_equal(first.tau, second.tau)
    assert np.abs(first.q - other.q).max() > 0.1


def test_another_seed_records_the_same_arm(drive: Model) -> None:
    """What is held out judges the arm that was fitted: sizes that nobody states do not follow the seed's motion."""
    hidden = [parse_hidden("stribeck@1", drive)]
    plain, other = (simulate(drive, hidden, SimulationSettings(s, 10.0))[1] for s in (0, 7))
    assert plain == other


@pytest.mark.parametrize(
    ("model", "said"),
    [("drive", "coulomb_asymmetric at joint 1; viscous at joint 1; viscous_cubic at joint 1\n"), ("vishard4", "")],
)
def test_values_that_the_model_file_leaves_open_are_said(
    model: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    verb = ["simulate", model, "--out", str(tmp_path / "run.csv"), "--seconds", "3", "--hide", "offset@1:torque=1"]
    assert output.run(app, verb) == 0
    printed = capsys.readouterr().out
    assert ("open in the model file" in printed) == bool(said)
    assert printed.endswith(said)
    assert "offset at joint 1: torque 1" in printed


def test_repeats_repeat_and_noise_is_as_stated(arm: Model) -> None:
    made, _ = simulate(arm, settings=SimulationSettings(seconds=20.0, repeats=2))
    half = made.q.shape[1] // 2
    np.testing.assert_array_equal(made.q[:, :half], made.q[:, half : 2 * half])
    difference = (made.tau[:, 2000 : half - 2000] - made.tau[:, half + 2000 : 2 * half - 2000]) / np.sqrt(2)
    expected = NOISE * np.sqrt(np.mean(made.tau**2, axis=1))
    # 6000 samples: the standard deviation is known to 1/sqrt(12000), here within five of that.
    assert difference.std(axis=1) == pytest.approx(expected, rel=0.05)


def test_motion_stays_within_the_limits(arm: Model) -> None:
    made, _ = simulate(arm, settings=SimulationSettings(5, 20.0))
    for q, joint in zip(made.q, arm.joints, strict=True):
        if joint.speed_limit is not None:
            assert np.abs(np.gradient(made.q_desired, made.t, axis=1)).max(axis=1)[0] <= 1.05 * joint.speed_limit
        if joint.position_limits is not None:
            assert joint.position_limits[0] <= q.min()
            assert q.max() <= joint.position_limits[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stribek@1", "stribek"),
        ("stribeck", 'found joint "", expected 1 to 1'),
        ("stribeck@2", 'found joint "2", expected 1 to 1'),
        ("stribeck@1:sped=2", 'no parameter "sped"'),
        ("stribeck@1:speed=fast", 'found "speed=fast", expected a number'),
        ("stribeck@1:speed=nan", "expected a finite number"),
        ("gravity@1", "leave out @1"),
        ("coupled_friction@1", "acts on two joints and drive has one"),
    ],
)
def test_what_cannot_be_hidden_is_one_line(drive: Model, text: str, message: str) -> None:
    with pytest.raises(SimulationError) as caught:
        parse_hidden(text, drive)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_values_out_of_bounds_and_effects_twice_are_refused(drive: Model) -> None:
    with pytest.raises(SimulationError, match=r"stribeck@1: torque = -1.0; expected a value from 0 to inf"):
        simulate(drive, [parse_hidden("stribeck@1:torque=-1,speed=0.1", drive)], SimulationSettings(seconds=10.0))
    with pytest.raises(SimulationError, match="already has this effect"):
        simulate(drive, [parse_hidden("viscous@1", drive)], SimulationSettings(seconds=10.0))
    with pytest.raises(SimulationError, match="expected 1 joints of drive"):
        simulate(drive, motion=np.zeros((2, 1000)))


def test_a_torque_without_bounds_names_its_effect(drive: Model) -> None:
    hidden = parse_hidden("elasticity@1:stiffness=0,damping=0", drive)
    with pytest.raises(
        SimulationError,
        match=r"not finite along this motion: elasticity@1 with stiffness = 0, damping = 0; choose other",
    ):
        simulate(drive, [hidden], SimulationSettings(seconds=5.0))


def test_written_recording_reads_back(arm: Model, tmp_path: Path) -> None:
    made, _ = simulate(arm, settings=SimulationSettings(seconds=4.0))
    for name in ("made.csv", "made.csv.gz"):
        recording.write(tmp_path / name, made)
        back = recording.read(tmp_path / name, RecordedArm(arm.joints, arm.spatial))
        # Nine digits are written.
        np.testing.assert_allclose(back.tau, made.tau, rtol=1e-8)
        np.testing.assert_allclose(back.q, made.q, rtol=1e-8, atol=1e-12)


def test_motion_file_is_resampled(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    t = np.arange(0, 2, 0.01)
    lines = "".join(f"{x:.9f},{np.sin(3 * x):.12f}\n" for x in t)
    path.write_text("t [s],q1 [rad]\n" + lines)
    q = read_motion(path, 1)
    assert q.shape == (1, 1990)
    assert np.abs(q[0] - np.sin(3 * np.arange(1990) / 1000)).max() < 1e-8


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,q2\n0,1\n", "line 1: no column q1"),
        ("t,q1\n0,1\n0.1,x\n", "line 3: expected 2 numbers"),
        ("t,q1\n0,1\n0,1\n", "line 3: expected finite numbers and a time that increases"),
        (
            "t,q1\n" + "".join(f"{k * 1000},{k}\n" for k in range(9)),
            "lasts 8000 s; expected at most 3600 s; is its time in",
        ),
        ("t,q1\n0,1\n0.1,1\n", "only 2 samples"),
    ],
)
def test_what_is_wrong_with_a_motion_file_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "motion.csv"
    path.write_text(text)
    with pytest.raises(SimulationError) as caught:
        read_motion(path, 1)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("pipe", "is a pipe or a device, which can be read only once; save it to a file first"),
        ("folder", "is a directory; expected a motion: a CSV of t,q1"),
        ("none", "no such file; expected a motion: a CSV of t,q1"),
        ("bytes", "byte 0xff is not UTF-8"),
        ("long line", "line 1: is longer than 1000000 bytes"),
        ("cut gzip", "the gzip file is cut off; copy it again"),
    ],
)
def test_what_is_no_motion_file_neither_hangs_nor_fills_the_memory(tmp_path: Path, kind: str, message: str) -> None:
    path = tmp_path / "motion.csv"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind != "none":
        written = {
            "bytes": b"\xff,q1\n",
            "long line": b"0" * 20_000_000,
            "cut gzip": gzip.compress(b"t,q1\n0,1\n" * 99),
        }
        path.write_bytes(written[kind][: -20 if kind == "cut gzip" else None])
    with pytest.raises(SimulationError) as caught:
        read_motion(path, 1)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_torque_that_no_drive_has_is_refused(drive: Model) -> None:
    hidden = parse_hidden("stribeck@1:torque=1e300,speed=0.1", drive)
    with pytest.raises(SimulationError, match=r"the torque reaches 1e\+300 N m .*, expected at most 1e\+12; choose"):
        simulate(drive, [hidden], SimulationSettings(seconds=5.0))


# --- the plants of the demo and of other tests ---------------------------------------------------------------------


def _friction_over_rate(q: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rate and torque without the known inertia's, as means over 50 ms."""
    smooth = np.convolve(q, np.hanning(41) / np.hanning(41).sum(), "same")
    rate = np.gradient(smooth, 1e-3)
    rest = tau - demo.INERTIA * np.gradient(rate, 1e-3)
    cut = len(q) // 50 * 50
    return rate[:cut].reshape(-1, 50).mean(axis=1), rest[:cut].reshape(-1, 50).mean(axis=1)


def test_demo_plant_shows_its_friction_and_hides_the_rise_at_creep() -> None:
    t, q, tau = demo.record(seed=4)
    assert t[-1] < 80
    rate, rest = _friction_over_rate(q, tau)
    for low, high, creep in ((0.03, 0.06, 0.55), (1.0, 3.0, 0.0)):
        inside = (rate > low) & (rate < high)
        v = rate[inside]
        expected = 1.72 + 1.14 * v - 0.015 * v**3 + creep
        # Noise of 0.2/sqrt(50) a bin; creep varies by 0.04 N m between the bins; the median passes over reversals.
        assert abs(np.median(rest[inside] - expected)) < 0.06


@pytest.mark.parametrize("hidden", [None, *plants.SIZES])
def test_plants_differ_by_what_they_hide(hidden: str | None) -> None:
    clean, made = plants.record(None, seed=6, repeats=1), plants.record(hidden, seed=6, repeats=1)
    assert np.isfinite(made.tau).all()
    assert len({len(x) for x in (made.t, made.q, made.tau, made.temperature)}) == 1
    difference = np.std(made.tau - clean.tau)
    assert (difference == 0) if hidden is None else (difference > 0.05)
