"""Wrong data are loud: what is wrong, at which joint, and what to type; right data and odd arms pass."""

from __future__ import annotations

import re
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from runtime.arrays import Array
from runtime.diagnosis.credibility import judged
from runtime.diagnosis.stages import diagnose
from runtime.fit_warnings import doubts, suspicions, warnings
from runtime.identification.compare import compare
from runtime.identification.identify import identify
from runtime.loop.improve import improve
from runtime.model.loader import Model
from runtime.recordings.recording import Recording, RecordingError, read, write
from runtime.report import diagnosed
from runtime.report.reasons import of_fit, reason
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import simulate
from runtime.workspace.source import Source
from tests import bank
from tests.kept import kept
from tests.plants import SIZES
from tests.runtime.conftest import Run, recorded
from tests.runtime.recordings.formats import write_mcap

DEGREES = 180 / np.pi
INERTIA = 0.2365  # kg m^2, as the drive's file has it


def analytic(seed: int, coulomb: float = 0.5, name: str = "run.csv") -> Recording:
    """20 s of a rigid drive at 1 kHz, its torque in closed form: inertia, dry and viscous friction, noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(20_000) / 1000
    q, qd, qdd = np.zeros((3, len(t)))
    for f in (0.13, 0.41, 0.97, 2.3):
        a, w, phase = 0.5 / (1 + f) ** 1.5, 2 * np.pi * f, rng.uniform(0, 2 * np.pi)
        q += a * np.sin(w * t + phase)
        qd += a * w * np.cos(w * t + phase)
        qdd -= a * w**2 * np.sin(w * t + phase)
    tau = INERTIA * qdd + coulomb * np.sign(qd) + 0.5 * qd + 0.03 * rng.standard_normal(len(t))
    q = q + 1e-5 * rng.standard_normal(len(t))
    whole = np.zeros(len(t), dtype=np.int64)
    return Recording(Path(name), t, whole, q[None], tau[None], ("revolute",), (slice(0, len(t)),), (None,))


@pytest.fixture(scope="module")
def arm_recording(model: Model) -> Recording:
    """Four joints, simulated."""
    made, _ = simulate(model, settings=SimulationSettings(seed=4, seconds=20))
    return made


def kinds(model: Model, *recordings: Recording) -> list[tuple[str, int]]:
    return [(s.kind, s.joint) for s in kept(bank.suspected, model, recordings)]


WRONG = {
    "sign": (lambda r: replace(r, tau=-r.tau), '--map tau1="-tau1"'),
    "degrees": (lambda r: replace(r, q=r.q * DEGREES), '--map q1="q1 [deg]"'),
    "ratio": (lambda r: replace(r, tau=r.tau / 100), "gear ratio of 100"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_wrong_data_of_one_joint(drive: Model, kind: str) -> None:
    """Every verb says it; diagnosis and loop add nothing, and the model file stays as it is."""
    change, cure = WRONG[kind]
    wrong = change(analytic(1))
    found = kept(bank.suspected, drive, [wrong])
    assert [(s.kind, s.joint) for s in found] == [(kind, 1)]
    assert cure in str(found[0])
    fitted = judged(kept(identify, drive, [wrong]), [wrong])
    assert fitted.verdict == "refused"
    assert cure in of_fit(fitted)
    assert any(cure in warning for warning in warnings(kept(compare, drive, [wrong]).fit))
    verdict = kept(diagnose, drive, [wrong])
    assert (verdict.verdict, verdict.findings) == ("refused", ())
    assert cure in reason(verdict)
    source = Source.shipped("drive")
    assert kept(improve, source, [wrong]).model_text == source.text


@pytest.mark.parametrize("hidden", [None, *SIZES])
def test_right_data_are_not_suspected(drive: Model, hidden: str | None) -> None:
    """Whatever effect is missing, and however large."""
    assert kinds(drive, recorded(hidden, 2)) == []
    if hidden is not None:
        assert kinds(drive, recorded(hidden, 2, 2 * SIZES[hidden])) == []


def test_wrong_data_of_one_joint_among_four(model: Model, arm_recording: Recording) -> None:
    """The joint is named, and only it."""
    r = arm_recording
    assert kinds(model, r) == []

    def scaled(values: Array, joint: int, factor: float) -> Array:
        return values * np.where(np.arange(4) == joint - 1, factor, 1.0)[:, None]

    assert kinds(model, replace(r, tau=scaled(r.tau, 3, -1.0))) == [("sign", 3)]
    assert kinds(model, replace(r, q=scaled(r.q, 2, DEGREES))) == [("degrees", 2)]


TWO_OF_ONE = {
    "sign, degrees": (lambda r: replace(r, tau=-r.tau, q=r.q * DEGREES), ["sign", "degrees"]),
    "sign, mN m": (lambda r: replace(r, tau=-1000 * r.tau), ["sign", "milli"]),
    "sign, ratio": (lambda r: replace(r, tau=-r.tau / 100), ["sign", "ratio"]),
    "degrees, ratio": (lambda r: replace(r, tau=r.tau / 100, q=r.q * DEGREES), ["degrees", "ratio"]),
}
ALL_MAPS = {"sign": '--map tau1="-tau1"', "degrees": '--map q1="q1 [deg]"', "milli": '--map tau1="-tau1 [mN m]"'}


@pytest.mark.parametrize("name", TWO_OF_ONE)
def test_two_mistakes_at_once(drive: Model, name: str) -> None:
    """Both are named, and the options that put both right are the same wherever they are typed out."""
    change, expected = TWO_OF_ONE[name]
    found = kept(bank.suspected, drive, [change(analytic(1))])
    assert [s.kind for s in found] == expected
    signal = ALL_MAPS["milli"] if "milli" in expected else ALL_MAPS["sign"]
    maps = {"sign": (signal,), "milli": (signal,), "degrees": (ALL_MAPS["degrees"],), "ratio": ()}
    assert [s.maps for s in found] == [maps[s.kind] for s in found]


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 2**16),
    ratio=st.sampled_from([100.0, 121.0, 160.0, 288.0]),
    known=st.floats(0.8, 1.25),
    coulomb=st.floats(0.2, 1.0),
)
def test_what_is_measured_at_the_motor(drive: Model, seed: int, ratio: float, known: float, coulomb: float) -> None:
    """Angle and torque, or one of them; the inertia in the file is as good as a drawing. What may as well be wrong is
    said beside the likeliest, and no option is offered that would make it worse."""
    geared = copy(drive)
    geared.joints = (replace(drive.joints[0], gear_ratio=ratio),)
    r = analytic(seed, coulomb)
    r = replace(r, tau=known * r.tau)
    both = suspicions(identify(geared, [replace(r, q=r.q * ratio, tau=r.tau / ratio)]))
    assert [s.kind for s in both] == ["motor", "ratio"]
    assert f"divide q1, and qd1 if it is recorded, by the gear ratio of {ratio:g}" in both[0].cure
    angle = suspicions(identify(geared, [replace(r, q=r.q * ratio)]))
    assert [s.kind for s in angle] in (["motor"], ["degrees"])
    assert "if it is the motor's, divide q1" in angle[0].cure
    degrees = suspicions(identify(geared, [replace(r, q=r.q * DEGREES)]))
    assert [s.kind for s in degrees] in (["degrees"], ["motor"])
    assert "if it is in degrees, pass " in degrees[0].cure


def test_a_motors_angle_that_moves_a_pendulum(model: Model, arm_recording: Recording) -> None:
    """Gravity tells it from degrees: the search puts it right."""
    ratio = model.joints[1].gear_ratio
    scale = np.array([[1.0], [ratio], [1.0], [1.0]])
    assert kinds(model, replace(arm_recording, q=arm_recording.q * scale)) == [("motor", 2)]


def test_degrees_that_a_gear_might_have_made(model: Model, arm_recording: Recording) -> None:
    """A gear of nearly as many turns as a radian has degrees: both are said, the likelier one first and to be typed."""
    geared = copy(model)
    geared.joints = tuple(replace(joint, gear_ratio=58.0) for joint in model.joints)
    scale = np.array([[1.0], [DEGREES], [1.0], [1.0]])
    (found,) = kept(bank.suspected, geared, [replace(arm_recording, q=arm_recording.q * scale)])
    assert (found.kind, found.joint, found.maps) == ("degrees", 2, ('--map q2="q2 [deg]"',))
    assert found.cure.endswith("if it is the motor's, divide q2, and qd2 if it is recorded, by the gear ratio of 58")


@pytest.mark.parametrize("wrong", [("milli", "ratio"), ("degrees", "milli")])
def test_mistakes_that_make_up_for_each_other_are_doubts(drive: Model, wrong: tuple[str, str]) -> None:
    """An inertia that is out by ten may as well be a bad guess: no verdict rests on it, and every verb says it."""
    sizes = {"milli": (1000, 1), "ratio": (1 / 100, 1), "degrees": (1, DEGREES)}
    r = analytic(1)
    tau, q = np.prod([sizes[kind] for kind in wrong], axis=0)
    fitted = kept(identify, drive, [replace(r, tau=r.tau * tau, q=r.q * q)])
    assert suspicions(fitted) == ()
    assert {s.kind for s in doubts(fitted)} == set(wrong)
    said = [w for w in warnings(fitted) if w.startswith("the data may be wrong: joint 1: ")]
    assert len(said) == 2


@pytest.mark.parametrize(
    ("stated", "scale", "cure"), [("", 1000 / 7, "mA"), ("A", 1000, "mA"), ("", 1000, "mN m"), ("N m", 1000, "mN m")]
)
def test_currents_in_another_unit(drive: Model, stated: str, scale: float, cure: str) -> None:
    """A torque constant of 7 N m/A at the joint: currents read as torques, and currents in mA read as in A."""
    geared = copy(drive)
    geared.joints = (replace(drive.joints[0], torque_constant=7.0),)
    r = analytic(1)
    units = {"tau1": stated} if stated else {}
    found = kept(bank.suspected, geared, [replace(r, tau=r.tau * scale, units=units)])
    assert [s.maps for s in found] == [(f'--map tau1="tau1 [{cure}]"',)]
    assert "current" in found[0].cure if cure == "mA" else "torque" in found[0].cure


def swapped(values: Array) -> Array:
    """Joints 1 and 2 in each other's place."""
    return np.ascontiguousarray(values[[1, 0, 2, 3]])


TWO_OF_FOUR = {
    "two signs": (lambda r: replace(r, tau=r.tau * np.array([[-1.0], [-1], [1], [1]])), ["sign 1", "sign 2"]),
    "degrees, exchanged torques": (
        lambda r: replace(r, q=r.q * DEGREES, tau=swapped(r.tau)),
        ["degrees 1", "degrees 2", "degrees 3", "degrees 4", "exchanged 1"],
    ),
    "a sign, exchanged positions": (
        lambda r: replace(r, q=swapped(r.q), tau=r.tau * np.array([[-1.0], [1], [1], [1]])),
        ["sign 1", "exchanged 1"],
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", TWO_OF_FOUR)
def test_two_mistakes_among_four_joints(model: Model, arm_recording: Recording, name: str) -> None:
    change, expected = TWO_OF_FOUR[name]
    found = kept(bank.suspected, model, [change(arm_recording)])
    assert [f"{s.kind} {s.joint}" for s in found] == expected


@pytest.mark.slow
def test_a_sign_and_a_ratio_leave_a_fit(model: Model, arm_recording: Recording) -> None:
    """Torques so small that no column stands out of the encoders' noise: the fit ends, and the sign is told."""
    ratios = np.array([joint.gear_ratio for joint in model.joints])[:, None]
    wrong = arm_recording.tau / ratios * np.array([[-1.0], [1], [1], [1]])
    found = kept(bank.suspected, model, [replace(arm_recording, tau=wrong)])
    assert ("sign", 1) in [(s.kind, s.joint) for s in found]


@pytest.mark.parametrize("what", ["tau", "q"])
def test_exchanged_joints(model: Model, arm_recording: Recording, what: str) -> None:
    order = [1, 0, 2, 3]
    wrong = replace(arm_recording, **{what: np.ascontiguousarray(getattr(arm_recording, what)[order])})
    found = kept(bank.suspected, model, [wrong])
    assert [s.kind for s in found] == ["exchanged"]
    assert f'--map {what}1="{what}2" --map {what}2="{what}1"' in str(found[0])


def test_joints_in_another_order(model: Model, arm_recording: Recording) -> None:
    """As drivers log them that sort by name: positions and torques stand together, in each other's place."""
    order = [0, 2, 1, 3]
    q, tau = (np.ascontiguousarray(x[order]) for x in (arm_recording.q, arm_recording.tau))
    found = kept(bank.suspected, model, [replace(arm_recording, q=q, tau=tau)])
    assert [s.kind for s in found] == ["exchanged"]
    said = "joint 2: what is recorded as q2 and tau2 fits joint 3, and that of joint 3 fits joint 2; "
    assert str(found[0]).startswith(said)
    assert str(found[0]).endswith('pass --map q2="q3" --map q3="q2" --map tau2="tau3" --map tau3="tau2"')


@pytest.mark.parametrize("held_out", [False, True])
@pytest.mark.parametrize("joints", [1, 4])
def test_each_recording_by_itself(
    tendon: Run, tmp_path: Path, model: Model, arm_recording: Recording, joints: int, held_out: bool
) -> None:
    """A right recording beside a wrong one hides nothing: file, joint and cure are named."""
    if joints == 1:
        right, other, change, cure = analytic(1), analytic(2), *WRONG["sign"]
    else:
        other, _ = simulate(model, settings=SimulationSettings(seed=5, seconds=20))
        right, cure = arm_recording, '--map tau3="tau4" --map tau4="tau3"'

        def change(r: Recording) -> Recording:
            return replace(r, tau=np.ascontiguousarray(r.tau[[0, 1, 3, 2]]))

    write(tmp_path / "right.csv", right)
    write(tmp_path / "wrong.csv", change(other))
    arm, paths = "drive" if joints == 1 else "vishard4", [tmp_path / "right.csv", tmp_path / "wrong.csv"]
    if held_out:
        verbs = [["improve", arm, paths[0], "--held-out", paths[1], "--out", tmp_path / "better.toml"]]
    else:
        verbs = [[verb, arm, *paths] for verb in ("identify", "compare", "diagnose")]
    for typed in verbs:
        status, out, err = tendon(*typed)
        assert status == 2
        assert err.count("wrong.csv: joint ") == 1
        assert f"wrong.csv: joint {1 if joints == 1 else 3}: " in err
        assert f"{cure}; --map holds for every recording, and others are right" in err
        assert "They agree" not in out
    assert not (tmp_path / "better.toml").exists()
    both = judged(identify(model, [arm_recording, other]), [arm_recording, other]) if joints == 4 else None
    assert both is None or both.suspicions == ()


def test_a_torque_that_is_mostly_missed_is_no_result(tendon: Run, tmp_path: Path) -> None:
    """Its greatest part follows neither the motion nor a mistake that is known."""
    r, rng = analytic(3), np.random.default_rng(0)
    slow = gaussian_filter1d(rng.standard_normal(len(r.t)), 300)
    write(tmp_path / "run.csv", replace(r, tau=r.tau + 10 * r.tau.std() * slow / slow.std()))
    for verb in ("identify", "diagnose", "improve"):
        status, out, _ = tendon(verb, "drive", tmp_path / "run.csv")
        assert status == 1
        assert "% of its torque is missed, more than half, " in out
    status, out, _ = tendon("compare", "drive", tmp_path / "run.csv")
    assert status == 0
    assert "% of its torque is missed, more than half, " in out


def test_a_passive_joint_is_left_out_and_said(model: Model, arm_recording: Recording) -> None:
    """Its torque never changes while it moves; the others are fitted as if it were recorded."""
    tau = arm_recording.tau.copy()
    tau[1] = 0.0
    result = kept(compare, model, [replace(arm_recording, tau=tau)])
    said = warnings(result.fit)
    assert any(w.startswith("joint 2: left out of the fit: tau2 is constant") for w in said)
    assert all(s.relative < 0.02 for s in result.joints)


@pytest.mark.parametrize("copied", ["fitted", "held out"])
def test_a_recording_given_twice(drive: Model, copied: str) -> None:
    one = analytic(1)
    copy = replace(one, path=Path("copy.csv"))
    fitted, held = ([one, copy], []) if copied == "fitted" else ([one], [copy])
    with pytest.raises(RecordingError, match=r"copy.csv: holds the same samples as run.csv; .* leave one out"):
        kept(diagnose, drive, fitted, held)


def rows(tmp_path: Path, recording: Recording, step: float = 1.0) -> Path:
    path = tmp_path / "run.csv"
    cells = zip(step * recording.t[:2000], recording.q[0], recording.tau[0], strict=False)
    path.write_text("t [s],q1,tau1\n" + "".join(f"{a:.12g},{b:.12g},{c:.12g}\n" for a, b, c in cells))
    return path


@pytest.mark.parametrize(("step", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_a_clock_in_another_unit(tmp_path: Path, step: float, unit: str) -> None:
    """The error types the cure out, and the cure cures, against the unit that the header states."""
    path = rows(tmp_path, analytic(1), step)
    cure = f"t [{unit}]"
    with pytest.raises(RecordingError) as error:
        read(path, None)
    assert f'--map t="{cure}"' in str(error.value)
    assert read(path, None, {"t": cure}).dt == pytest.approx(1e-3)


def test_a_minus_turns_a_column_round(tmp_path: Path) -> None:
    path = rows(tmp_path, analytic(1))
    given, turned = read(path, None), read(path, None, {"tau1": "-tau1 [mN m]", "q1": "-q1"})
    np.testing.assert_allclose(turned.tau, -1e-3 * given.tau)
    np.testing.assert_allclose(turned.q, -given.q)
    with pytest.raises(RecordingError, match="has a minus; only positions, rates, torques and commands have one"):
        read(path, None, {"t": "-t"})


def test_a_fit_that_may_be_believed_says_its_error(drive: Model) -> None:
    document = diagnosed.judged(judged(kept(identify, drive, [analytic(1)]), [analytic(1)])).to_json()
    assert document["verdict"] == "fitted"
    joint = document["joints"][0]
    assert joint["relative"] < 0.03
    assert joint["rms"] == pytest.approx(joint["floor"], rel=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.0253, -0.018])
def test_the_verdict_of_torques_that_another_clock_stamps(drive: Model, tmp_path: Path, late: float) -> None:
    """Set right to a part of a sample, it is that of torques that are stamped with the positions."""
    whole = recorded("stribeck", 2)
    efforts = {"t": whole.t[::2] + 1 + late, "tau": whole.tau[:, ::2]}
    topics = [("/joint_states", ("axis",), {"t": whole.t + 1, "q": whole.q}), ("/efforts", ("axis",), efforts)]
    apart = read(write_mcap(tmp_path / "run.mcap", topics), None)
    found = kept(diagnose, drive, [apart])
    assert (found.verdict, [f.term.effect for f in found.findings]) == ("effect", ["stribeck"])


def test_one_speed_tells_no_parameters(drive: Model) -> None:
    t = np.arange(6000) / 1000
    rng = np.random.default_rng(0)
    q, tau = 0.5 * t + 1e-5 * rng.standard_normal(6000), 2.0 + 0.1 * rng.standard_normal(6000)
    whole = np.zeros(6000, dtype=np.int64)
    steady = Recording(Path("run.csv"), t, whole, q[None], tau[None], ("revolute",), (slice(0, 6000),), (None,))
    found = judged(kept(identify, drive, [steady]), [steady])
    assert found.why == "inseparable"
    assert "does not separate" in of_fit(found)


@pytest.mark.parametrize(("friction", "verdict"), [((0.5, 0.5), "fitted"), ((0.5, 0.8), "refused")])
def test_recordings_that_disagree_in_friction(drive: Model, friction: Sequence[float], verdict: str) -> None:
    """The parameter is named, by the fit as by the diagnosis; without a thermometer nothing tells why."""
    both = [analytic(k + 1, coulomb, f"run{k}.csv") for k, coulomb in enumerate(friction)]
    fitted, found = judged(kept(identify, drive, both), both), kept(diagnose, drive, both)
    assert fitted.verdict == verdict
    assert (found.verdict == "refused") == (verdict == "refused")
    assert len(diagnosed.document(found).recordings) == len(diagnosed.judged(fitted).recordings) == 2
    if verdict == "refused":
        assert "coulomb_asymmetric@1" in reason(found)
        assert re.search(r"0\.(50|49)\d* N m in run0.csv and 0\.(80|79)\d* N m in run1.csv", reason(found))
        assert not found.findings


def test_a_spring_under_a_slow_sine_is_no_wrong_sign(drive: Model) -> None:
    """Turned round, its torque would be an inertia's; but it drives the motion, against friction. Its other sign is
    still found."""
    t = np.arange(60_000) / 1000
    q, qd, qdd = 0.3 * np.sin(t), 0.3 * np.cos(t), -0.3 * np.sin(t)
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(t))
    tau = INERTIA * qdd + 3.0 * q + 0.4 * np.sign(qd) + 0.5 * qd + noise
    whole, few = np.zeros(len(t), dtype=np.int64), (slice(0, len(t)),)
    made = Recording(Path("slow.csv"), t, whole, q[None], tau[None], ("revolute",), few, (None,))
    assert kinds(drive, made) == []
    stiff = replace(analytic(3), tau=-analytic(3).tau)
    assert kinds(drive, stiff) == [("sign", 1)]
