"""tendon inspect: what is in a file, and for each mistake that users make the cure, as it is typed."""

from __future__ import annotations

import gzip
import json
import shlex
from pathlib import Path

import numpy as np
import pytest

from runtime.arrays import Array
from runtime.inspection.guesses import map_options
from runtime.inspection.inspection import of_rates, without_model
from runtime.inspection.signals import shift_entries
from runtime.recordings.contents import RecordedField
from runtime.recordings.recording import Recording, read
from tests.runtime.recordings.formats import write_mcap

DEGREES = 180 / np.pi
INERTIA = 0.2365  # kg m^2, as the drive's file has it


def motion(seconds: float = 20.0) -> dict[str, Array]:
    """t, q, qd, tau of a drive at 1 kHz: inertia, dry and viscous friction, noise; it ends where it began."""
    rng = np.random.default_rng(5)
    t = np.arange(round(1000 * seconds)) / 1000
    q, qd, qdd = np.zeros((3, len(t)))
    for k, f in enumerate((0.15, 0.4, 0.95, 2.3)):
        a, w = 0.5 / (1 + f) ** 1.5, 2 * np.pi * f
        q += a * np.sin(w * t + k)
        qd += a * w * np.cos(w * t + k)
        qdd -= a * w**2 * np.sin(w * t + k)
    tau = INERTIA * qdd + 0.5 * np.sign(qd) + 0.5 * qd + 0.03 * rng.standard_normal(len(t))
    return {"t": t, "q1": q + 1e-5 * rng.standard_normal(len(t)), "qd1": qd, "tau1": tau}


def write(path: Path, columns: dict[str, Array], header: bool = True) -> Path:
    first = [",".join(columns)] if header else []
    rows = np.column_stack(list(columns.values()))
    path.write_text("\n".join([*first, *(",".join(f"{x:.9g}" for x in row) for row in rows)]))
    return path


def changed(**signals) -> dict[str, Array]:
    return {name: x for name, x in (motion() | signals).items() if x is not None}


MISTAKES = {
    "sign": (lambda m: changed(tau1=-m["tau1"]), '--map tau1="-tau1"'),
    "degrees": (lambda m: changed(q1=m["q1"] * DEGREES, qd1=None), '--map q1="q1 [deg]"'),
    "degrees beside a rate": (lambda m: changed(q1=m["q1"] * DEGREES), '--map q1="q1 [deg]"'),
    "degrees and their rate": (
        lambda m: changed(q1=m["q1"] * DEGREES, qd1=m["qd1"] * DEGREES),
        'All at once: --map q1="q1 [deg]" --map qd1="qd1 [deg/s]"',
    ),
    "rate in degrees": (lambda m: changed(qd1=m["qd1"] * DEGREES), '--map qd1="qd1 [deg/s]"'),
    "rate in rpm": (lambda m: changed(qd1=m["qd1"] * 30 / np.pi), '--map qd1="qd1 [rpm]"'),
    "rate turned round": (lambda m: changed(qd1=-m["qd1"]), '--map qd1="-qd1"'),
    "ms": (lambda m: changed(t=m["t"] * 1000), '--map t="t [ms]"'),
    "mN m": (lambda m: changed(tau1=m["tau1"] * 1000), '--map tau1="tau1 [mN m]"'),
    "ratio": (lambda m: changed(tau1=m["tau1"] / 100), "gear ratio of 100"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_each_mistake_is_answered_by_its_cure(tmp_path, tendon, name):
    mistake, cure = MISTAKES[name]
    path = write(tmp_path / "run.csv", mistake(motion()))
    status, out, _ = tendon("inspect", path, "drive")
    assert status == 1
    assert cure in out
    assert "Nothing looks wrong" not in out


@pytest.mark.parametrize("name", [n for n in MISTAKES if n not in ("ratio", "mN m", "degrees beside a rate")])
def test_the_cure_cures(tmp_path, tendon, name):
    """What is typed as it stands leaves nothing to say."""
    mistake, cure = MISTAKES[name]
    path = write(tmp_path / "run.csv", mistake(motion()))
    status, out, _ = tendon("inspect", path, "drive", *shlex.split(cure.removeprefix("All at once: ")))
    assert (status, "Nothing looks wrong." in out) == (0, True), out


def test_right_data_are_not_suspected(tmp_path, tendon):
    path = write(tmp_path / "run.csv", motion())
    document = tmp_path / "run.json"
    status, out, _ = tendon("inspect", path, "drive", "--json", document, "--picture", tmp_path / "run.svg")
    assert status == 0
    assert "Nothing looks wrong." in out
    assert "20000 samples, 20 s at 1000 Hz" in out
    found = json.loads(document.read_text())
    assert (found["format"], found["suspicions"], found["problem"]) == ("CSV", [], None)
    assert found["clock"]["gaps"] == 0
    q = found["signals"][0]
    assert q["signal"] == "q1"
    assert q["noise"] == pytest.approx(1e-5, rel=0.15)
    assert {p["name"]: p["told"] for p in found["parameters"]}["J1"] == "well"
    assert 0 < found["misses"][0]["part"] < 0.05
    assert b"<svg" in (tmp_path / "run.svg").read_bytes()


def test_without_a_model_the_signals_are_asked(tmp_path, tendon):
    path = write(tmp_path / "run.csv", changed(tau1=-motion()["tau1"], qd1=None))
    status, out, _ = tendon("inspect", path)
    assert status == 1
    assert "its torque brakes the motion on average" in out
    assert '--map tau1="-tau1"' in out
    status, out, _ = tendon("inspect", path, "--map", "tau1=-tau1")
    assert "Nothing looks wrong; with MODEL more can be checked." in out


def test_a_missing_header(tmp_path, tendon):
    path = write(tmp_path / "run.csv", changed(qd1=None), header=False)
    status, out, _ = tendon("inspect", path, "drive")
    assert status == 1
    assert "its first line is no header but 3 numbers; name its 3 columns with --columns t,q1,tau1" in out
    assert tendon("inspect", path, "drive", "--columns", "t,q1,tau1")[0] == 0
    assert tendon("compare", "drive", path, "--columns", "t,q1,tau1")[0] == 0


@pytest.mark.parametrize(
    ("numbers", "layouts"),
    [
        (3, ["t,q1,tau1"]),
        (4, ["t,q1,qd1,tau1"]),
        (6, ["t,q1,tau1,-,-,-"]),
        (7, ["t,q1,q2,q3,tau1,tau2,tau3", "t,q1,q2,qd1,qd2,tau1,tau2"]),
    ],
)
def test_a_missing_header_without_a_model(tmp_path, tendon, numbers, layouts):
    """Whatever number of joints comes out even is said."""
    path = tmp_path / "run.csv"
    np.savetxt(path, np.ones((20, numbers)), delimiter=",")
    _, out, _ = tendon("inspect", path)
    assert out.splitlines()[-1].endswith(" or ".join(f"--columns {names}" for names in layouts))


def test_columns_that_may_be_rates_or_not(tmp_path, tendon):
    """Both are said, and the wrong one is told by the data."""
    m = motion()
    path = write(tmp_path / "run.csv", {**changed(qd1=None), "q1_desired": m["q1"]}, header=False)
    _, out, _ = tendon("inspect", path, "drive")
    assert out.splitlines()[-1].endswith("--columns t,q1,qd1,tau1 or --columns t,q1,tau1,-")
    _, out, _ = tendon("inspect", path, "drive", "--columns", "t,q1,qd1,tau1")
    assert out.splitlines()[-1].startswith("Joint 1: qd1 is not the derivative of q1, which explains")
    status, out, _ = tendon("inspect", path, "drive", "--columns", "t,q1,tau1,-")
    assert (status, out.splitlines()[-1]) == (0, "Nothing looks wrong.")


def test_a_fit_that_may_not_be_believed(tmp_path, tendon):
    """As identify refuses it; nothing is then called right."""
    path = write(tmp_path / "run.csv", changed(tau1=np.cos(motion()["t"]), qd1=None))
    _, out, _ = tendon("inspect", path, "drive")
    assert out.splitlines()[-1].startswith("The fit is unreliable: ")
    assert tendon("identify", "drive", path)[0] == 1


def test_a_missing_header_of_fewer_columns_than_the_arm_has(tmp_path, tendon):
    path = tmp_path / "run.csv"
    np.savetxt(path, np.ones((20, 7)), delimiter=",")
    _, out, _ = tendon("inspect", path, "vishard4")
    assert out.splitlines()[-1].endswith("expected at least 9: t,q1,q2,q3,q4,tau1,tau2,tau3,tau4")


def test_a_missing_header_and_more(tmp_path, tendon):
    """Each cure is appended to what was typed before."""
    m = motion()
    columns = {"t": m["t"] * 1000, "q1": m["q1"] * DEGREES, "tau1": -m["tau1"]}
    path = write(tmp_path / "run.csv", columns, header=False)
    typed, said = ["--columns", "t,q1,tau1"], []
    for _ in range(2):
        out = tendon("inspect", path, "drive", *typed)[1]
        said.append(out.splitlines()[-1])
        typed += shlex.split(said[-1].partition("All at once: ")[2] or said[-1].rpartition("pass ")[2])
    assert said[0].endswith('if t is in ms, pass --map t="#1 [ms]"')
    assert said[1] == 'All at once: --map tau1="-#3" --map q1="#2 [deg]"'
    status, out, _ = tendon("inspect", path, "drive", *typed)
    assert (status, out.splitlines()[-1]) == (0, "Nothing looks wrong.")


@pytest.mark.parametrize(
    ("field", "unit"),
    [("pos_act_deg", "deg"), ("axis.vel_deg_s", "deg/s"), ("arm/torque_mNm", "mN m"), ("Iq", "A"), ("i_mA", "mA")],
)
def test_a_name_that_says_another_unit(tmp_path, tendon, field, unit):
    """Every verb says it; a unit that is stated is believed."""
    signal = {"deg": "q1", "deg/s": "qd1", "mN m": "tau1", "A": "tau1", "mA": "tau1"}[unit]
    path = write(tmp_path / "run.csv", {field if name == signal else name: x for name, x in motion().items()})
    typed = ["--map", f"{signal}={field}"]
    said = f'{signal} is read in SI, and the name of its field, "{field}", ends in the unit {unit}'
    cure = f'pass --map {signal}="{field} [{unit}]"'
    out = tendon("inspect", path, "drive", *typed)[1]
    assert said in out
    assert cure in out
    assert f"{path}: joint 1: {said}; if so, {cure}\n" in tendon("compare", "drive", path, *typed)[2]
    stated = {"deg": "rad", "deg/s": "rad/s"}.get(unit, "N m")
    assert "ends in" not in tendon("inspect", path, "drive", "--map", f"{signal}={field} [{stated}]")[1]


def test_degrees_where_no_inertia_is_stated(tmp_path, tendon):
    """Then no fit can tell; a joint that turns so far is asked about, unless its unit is stated."""
    arm = tmp_path / "arm.toml"
    known = "--plane --joints r --length 0.3 --gravity 0,0 --gear-ratio 100 --name arm"
    assert tendon("init", *known.split(), "--out", arm)[0] == 0
    path = write(tmp_path / "run.csv", changed(q1=motion()["q1"] * DEGREES, qd1=None))
    assert 'turns; if it is in degrees, pass --map q1="q1 [deg]"' in tendon("inspect", path, arm)[1]
    for unit in ("rad", "deg"):
        assert "Nothing looks wrong." in tendon("inspect", path, arm, "--map", f"q1=q1 [{unit}]")[1]


@pytest.mark.parametrize("scale", [1.0, 1000.0, 0.01])
def test_an_inertia_that_the_file_leaves_open_is_shown(tmp_path, tendon, scale):
    """By which a person tells newton metres from others, and the joint's from the motor's: no fit does."""
    arm = tmp_path / "arm.toml"
    known = "--plane --joints r --length 0.3 --gravity 0,0 --gear-ratio 100 --name arm"
    assert tendon("init", *known.split(), "--out", arm)[0] == 0
    path = write(tmp_path / "run.csv", changed(tau1=motion()["tau1"] * scale, qd1=None))
    found = json.loads(tendon("inspect", path, arm, "--json", "-")[1])
    assert found["inertias"] == [{"joint": 1, "value": pytest.approx(INERTIA * scale, rel=0.02), "unit": "kg m^2"}]
    assert "Fitted inertia, which the model file leaves open: " in tendon("inspect", path, arm)[1]


def test_currents_without_a_model(tmp_path, tendon):
    path = write(tmp_path / "run.csv", {name.replace("tau1", "tau1 [mA]"): x for name, x in motion().items()})
    status, out, _ = tendon("inspect", path, "--json", "-")
    torque = next(s for s in json.loads(out)["signals"] if s["signal"] == "tau1")
    assert (status, torque["unit"]) == (0, "A")
    assert torque["largest"] == pytest.approx(motion()["tau1"].max() / 1000)


def test_even_steps_are_called_so(tmp_path, tendon):
    m = motion()
    assert "20000 samples, 20 s at 1000 Hz; even steps, 0 gaps" in tendon("inspect", write(tmp_path / "a.csv", m))[1]
    rng = np.random.default_rng(0)
    late = m | {"t": m["t"] + 1e-4 * rng.uniform(size=len(m["t"]))}
    assert "jitter 4.1e-05 s" in tendon("inspect", write(tmp_path / "b.csv", late))[1]


def test_other_names_are_guessed_and_not_believed(tmp_path, tendon):
    m = motion()
    columns = {"time_ms": m["t"] * 1000, "ref_pos": m["q1"], "act_pos_deg": m["q1"] * DEGREES, "torque": m["tau1"]}
    path = write(tmp_path / "run.csv", columns)
    status, out, _ = tendon("inspect", path, "drive")
    assert status == 1
    line = next(line for line in out.splitlines() if line.startswith("Perhaps: "))
    assert line == 'Perhaps: --map q1="act_pos_deg [deg]" --map tau1="torque" --map t="time_ms [ms]"'
    assert tendon("inspect", path, "drive", *shlex.split(line)[1:])[0] == 0
    write(path, {"t": m["t"], "q1": m["q1"], "Iq": m["tau1"]})
    assert 'Perhaps: --map tau1="Iq [A]"\n' in tendon("inspect", path)[1]


def test_families_are_guessed_whole():
    names = [f"{name}{k}" for name in ("ref_pos", "act_pos_deg", "act_torque_nm") for k in (1, 2)]
    fields = [RecordedField(f"rec.{name}", "rec.time") for name in [*names, "time"]]
    assert map_options(fields, "t") == [
        '--map q="rec.act_pos_deg [deg]"',
        '--map tau="rec.act_torque_nm"',
        '--map t="rec.time"',
    ]


def test_what_is_no_recording_is_one_line(tmp_path, refused):
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n" + b"\x06")
    assert "the MCAP file is cut off" in refused("inspect", tmp_path / "a.mcap", "--json", "-")


def test_gaps_and_what_is_lost_are_told(tmp_path, tendon):
    m = {name: np.delete(x, slice(5000, 5100)) for name, x in motion().items()}
    status, out, _ = tendon("inspect", write(tmp_path / "run.csv", m), "drive")
    assert status == 1
    assert "1 gap" in out
    assert "line 5002: a gap of 0.101 s in t" in out


def two_joints(**more) -> Recording:
    t = np.arange(4000) / 1000
    q = np.array([np.sin(3 * t), 0.7 * np.cos(5 * t + 1)])
    qd = np.array([3 * np.cos(3 * t), -3.5 * np.sin(5 * t + 1)])
    whole = np.zeros(len(t), dtype=np.int64)
    made = {"q": q, "qd": qd, "tau": qd + np.sign(qd)} | more
    types = ("revolute", "revolute")
    return Recording(Path("r"), t, whole, types=types, segments=(slice(0, 4000),), temperature=(None, None), **made)


def test_rates_of_exchanged_joints():
    right = two_joints()
    assert of_rates(right) == without_model(right) == []
    assert right.qd is not None
    found = of_rates(two_joints(qd=right.qd[::-1]))
    assert [(s.joint, s.kind) for s in found] == [(1, "exchanged"), (2, "exchanged")]
    assert found[0].cure == 'expected both under one number: pass --map qd1="qd2"'


@pytest.mark.parametrize("late", [-0.004, 0.0025, 0.03])
def test_a_shift_in_time_is_found(late):
    """A link-side encoder that is read later, or a rate: to a hundredth of a millisecond."""
    r = two_joints()
    t = r.t - late
    link = np.array([1.01 * np.sin(3 * t), 0.7 * np.cos(5 * t + 1) + 0.02])
    rate = np.array([3 * np.cos(3 * t), -3.5 * np.sin(5 * t + 1)])
    found = {s.signal: s.value for s in shift_entries(two_joints(q_link=link, qd=rate))}
    assert found == pytest.approx(dict.fromkeys(("q1_link", "q2_link", "qd1", "qd2"), late), abs=1e-5)


def test_the_cure_names_the_fields_of_the_file(tmp_path, tendon):
    m = motion()
    signals = {"t": m["t"], "q": m["q1"][None], "tau": -m["tau1"][None]}
    path = write_mcap(tmp_path / "run.mcap", [("/joint_states", ("elbow",), signals)])
    _, out, _ = tendon("inspect", path, "drive")
    assert '--map tau1="-/joint_states.effort.elbow"' in out
    assert np.array_equal(read(path, None, {"tau1": "-/joint_states.effort.elbow"}).tau[0], m["tau1"])


WRIST = {
    "right": ({}, []),
    "sign": ({"tau2": "-tau2"}, [("sign", 2)]),
    "torques exchanged": ({"tau2": "tau3", "tau3": "tau2"}, [("exchanged", 2)]),
    "positions exchanged": ({"q2": "q3", "q3": "q2"}, [("exchanged", 2)]),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", WRIST)
def test_a_real_arm_whose_wrist_is_coupled(tmp_path, tendon, name):
    """What the model lacks at the wrist asks for an inertia that no arm has; the other joints are told all the same."""
    folder = Path(__file__).parents[4] / "shared" / "data" / "real" / "tx40"
    if not folder.is_dir():
        pytest.skip("../shared/data/real is not there")
    mapping, expected = WRIST[name]
    assert tendon("import", folder / "tx40.urdf", "--out", tmp_path / "tx40.toml")[0] == 0
    maps = [part for signal, cell in mapping.items() for part in ("--map", f"{signal}={cell}")]
    out = tendon("inspect", folder / "tx40.csv.gz", tmp_path / "tx40.toml", *maps, "--json", "-")[1]
    assert [(s["kind"], s["joint"]) for s in json.loads(out)["suspicions"]] == expected


@pytest.mark.slow
def test_a_real_arm_in_degrees(tmp_path, tendon):
    """All its joints, also those of whose torque so much is friction that no fit of them alone tells it."""
    folder = Path(__file__).parents[4] / "shared" / "data" / "real" / "tx40"
    if not folder.is_dir():
        pytest.skip("../shared/data/real is not there")
    with gzip.open(folder / "tx40.csv.gz", "rt", encoding="utf-8") as lines:
        names = [cell.partition(" ")[0] for cell in lines.readline().split(",")]
        table = np.loadtxt(lines, delimiter=",").T
    signals = {name: x * DEGREES if name.startswith("q") else x for name, x in zip(names, table, strict=True)}
    path = write(tmp_path / "run.csv", signals)
    assert tendon("import", folder / "tx40.urdf", "--out", tmp_path / "tx40.toml")[0] == 0
    found = json.loads(tendon("inspect", path, tmp_path / "tx40.toml", "--json", "-")[1])
    assert [(s["kind"], s["joint"]) for s in found["suspicions"]] == [("degrees", k) for k in range(1, 7)]
    assert found["cures"] == [f'--map q{k}="q{k} [deg]"' for k in range(1, 7)]
