"""Recordings: what is read from a file, and the one line where it cannot be."""

from __future__ import annotations

import gzip
import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from runtime.recordings import recording
from runtime.recordings.columns import UNITS, RecordedArm, normal_unit
from runtime.recordings.recording import Recording, RecordingError, read
from tests.runtime.recordings.formats import joint

DATA = Path(__file__).parents[4] / "shared" / "data"
joints = RecordedArm.without_model
DRIVE = RecordedArm((joint(torque_constant=2.0),), space=False)
AXIS = RecordedArm((joint("prismatic"),), space=False)
N = 300


def rows(n: int = N, joints: int = 1) -> list[list[str]]:
    """t, q..., tau... of a sway at 1 kHz."""
    return [
        [f"{k * 1e-3:.3f}"]
        + [f"{math.sin(0.02 * k + i):.6f}" for i in range(joints)]
        + [f"{math.cos(0.02 * k + i):.4f}" for i in range(joints)]
        for k in range(n)
    ]


def text(header: str = "t,q1,tau1", table: list[list[str]] | None = None) -> str:
    return "\n".join([header, *(",".join(row) for row in (rows() if table is None else table))]) + "\n"


@pytest.fixture
def write(tmp_path):
    def written(content: str | bytes, name: str = "run3.csv") -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return written


def said(path: Path, arm=DRIVE, **options) -> str:
    """The line that a person reads, without the folder."""
    with pytest.raises(RecordingError) as caught:
        read(path, arm, **options)
    message = str(caught.value).replace(f"{path.parent}/", "")
    assert message.isprintable()
    return message


# --- what is read ---


def test_si_without_units(write):
    r = read(write(text()), DRIVE)
    assert r.q.shape == r.tau.shape == (1, N)
    assert r.q[0, 10] == pytest.approx(math.sin(0.2), abs=1e-6)
    assert r.dt == pytest.approx(1e-3)
    assert r.segments == (slice(0, N),)
    assert (r.qd, r.force, r.temperature) == (None, None, (None,))


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("deg", math.pi / 180), ("°", math.pi / 180), ("mrad", 1e-3), ("rev", 2 * math.pi), (" rad ", 1.0)],
)
def test_angles(write, unit, factor):
    r = read(write(text(f"t,q1 [{unit}],tau1")), DRIVE)
    assert r.q[0, 10] == pytest.approx(factor * float(rows()[10][1]), rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "factor"), [("N m", 1), ("Nm", 1), ("N·m", 1), ("mNm", 1e-3), ("mN m", 1e-3), ("A", 2.0), ("mA", 2e-3)]
)
def test_torques_and_currents(write, unit, factor):
    r = read(write(text(f"t,q1,tau1 [{unit}]")), DRIVE)
    assert r.tau[0, 10] == pytest.approx(factor * float(rows()[10][2]), rel=1e-12)


WHOLE = {  # one whole of a unit that people know, and what it is in SI
    "time": {1: "s sec seconds", 1e3: "ms", 1e6: "us", 1e9: "ns", 1 / 60: "min"},
    "angle": {
        2 * math.pi: "rad radians",
        2e3 * math.pi: "mrad",
        2e6 * math.pi: "urad",
        1: "rev turn",
        360: "deg degrees Grad °",
        360e3: "mdeg",
        21_600: "arcmin",
        1_296_000: "arcsec",
        2048 + 4096: "tick4096",
        512 + 1024 * 360 / 300: "tick1024",
    },
    "length": {1: "m", 100: "cm", 1e3: "mm", 1e6: "um"},
    "angular rate": {
        2 * math.pi: "rad/s",
        2e3 * math.pi: "mrad/s",
        360: "deg/s Grad/s °/s",
        60: "rpm U/min rev/min 1/min",
        1: "rev/s turn/s rps",
        4096: "tick4096/s",
        1024 * 360 / 300: "tick1024/s",
    },
    "speed": {1: "m/s", 100: "cm/s", 1e3: "mm/s", 1e6: "um/s", 60: "m/min", 60e3: "mm/min"},
    "torque": {1: "N m,Nm", 1e3: "mN m,mNm,N mm,Nmm", 100: "N cm,Ncm", 1e-3: "kN m,kNm", 1e6: "uNm"},
    "force": {1: "N", 1e3: "mN", 1e-3: "kN"},
    "current": {1: "A", 1e3: "mA", 1e6: "uA"},
    "voltage": {1: "V", 1e3: "mV", 1e-3: "kV"},
    "ratio": {1: "1", 100: "%"},
    "temperature": {100: "degC °C C", 373.15: "K", 212: "degF °F"},
}
"""Number of units in a second, a full turn, a metre, a turn a second, a metre a second, a newton metre, a newton, an
ampere, a volt, a whole; for temperatures the reading at which water boils, and for registers of servos a turn beyond
the middle."""
IN_SI = {"angle": 2 * math.pi, "angular rate": 2 * math.pi, "temperature": 100.0}


def test_every_unit_is_what_people_take_it_for() -> None:
    """Against definitions written apart from the factors."""
    said = {
        unit: (dimension, number)
        for dimension, numbers in WHOLE.items()
        for number, units in numbers.items()
        for unit in (units.split(",") if "," in units else [units] if units == "N m" else units.split())
    }
    assert said.keys() == set(UNITS)
    for unit, (dimension, number) in said.items():
        kind, factor, zero = UNITS[unit]
        assert (kind, number * factor + zero) == (dimension, pytest.approx(IN_SI.get(dimension, 1.0), rel=1e-12)), unit


@given(
    size=st.decimals("0.001", 9999, places=3).filter(lambda x: x > 0),
    blank=st.sampled_from(("", " ")),
    unit=st.sampled_from(sorted(set(UNITS) - {"K", "degF", "°F", "tick4096", "tick1024", "1", "1/min"})),
)
def test_a_number_before_a_unit_multiplies_it(size, blank, unit) -> None:
    """As manuals of servos state the step of a register: 2.69 mA, 0.229 rpm."""
    kind, factor, zero = UNITS[normal_unit(f"{size}{blank}{unit}")]
    assert (kind, factor, zero) == (UNITS[unit][0], pytest.approx(float(size) * UNITS[unit][1]), 0.0)


@pytest.mark.parametrize(
    "unit", ["0 mA", "2 K", "2 tick4096", "2", "1e3 mA", "-1 mA", "2 3 mA", "2 mAh", "²mA", "2.69"]
)
def test_what_is_no_multiple_of_a_unit(unit) -> None:
    assert normal_unit(unit) not in UNITS


@pytest.mark.parametrize("sign", [1, -1])
def test_a_register_of_positions_has_its_zero_in_the_middle(write, sign) -> None:
    table = [[row[0], str(2048 + k), row[2]] for k, row in enumerate(rows())]
    r = read(write(text("t,raw,tau1", table)), None, {"q1": f"{'-' * (sign < 0)}raw [tick4096]"})
    assert r.q[0] == pytest.approx(sign * 2 * math.pi / 4096 * np.arange(N))


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e-3), ("us", 1e-6), ("µs", 1e-6), ("μs", 1e-6), ("s", 1.0)])
def test_times(write, unit, factor):
    assert read(write(text(f"t [{unit}],q1,tau1")), DRIVE).dt == pytest.approx(1e-3 * factor)


def test_rates_temperatures_and_the_other_signals(write):
    header = "t,q1,tau1,dq1 [rpm],temperature1 [K],fy [mN],q1_desired [deg],q1_link,tau1_link,tau1_rigid,comment"
    table = [[*row, "60", "300", "5", "180", "1", "2", "3", "warm, up"] for row in rows()]
    table = [[*row[:-1], f'"{row[-1]}"'] for row in table]
    r = read(write(text(header, table)), DRIVE)
    assert r.qd is not None
    assert r.qd[0, 0] == pytest.approx(2 * math.pi)
    assert r.temperature[0] is not None
    assert r.temperature[0][0] == pytest.approx(26.85)
    assert r.force is not None
    assert r.force[1, 0] == pytest.approx(5e-3)
    assert np.isnan(r.force[0]).all()
    assert r.q_desired is not None
    assert r.q_desired[0, 0] == pytest.approx(math.pi)
    assert [a[0, 0] for a in (r.q_link, r.tau_link, r.tau_rigid) if a is not None] == [1, 2, 3]


def test_the_force_and_moment_at_the_tip_of_an_arm_in_space(write, tmp_path):
    table = [[*row, "1", "2", "3000", "4"] for row in rows()]
    r = read(write(text("t,q1,tau1,fz [kN],mx [N m],my [mNm],mz", table)), replace(DRIVE, space=True))
    assert r.force is not None
    assert np.isnan(r.force[:2]).all()
    assert r.force[2:, 0] == pytest.approx([1000, 2, 3, 4])
    r.save(tmp_path / "again.csv")
    assert np.array_equal(read(tmp_path / "again.csv", replace(DRIVE, space=True)).force, r.force, True)


def test_a_planar_arm_is_not_given_what_acts_out_of_its_plane(write):
    table = [[*row, "1"] for row in rows()]
    for header, mapping, name in (("t,q1,tau1,mz", {}, "mz"), ("t,q1,tau1,F", {"fz": "F"}, "fz")):
        assert said(write(text(header, table)), mapping=mapping).startswith(
            f"run3.csv line 1: has a column {name}, but the arm is planar: of the force at its tip, only fx and fy are "
            "read"
        )


def test_a_prismatic_joint_takes_lengths_and_forces(write):
    r = read(write(text("t,q1 [mm],tau1 [kN]")), AXIS)
    assert r.q[0, 10] == pytest.approx(1e-3 * float(rows()[10][1]))
    assert r.tau[0, 10] == pytest.approx(1e3 * float(rows()[10][2]))


def test_fewer_temperatures_than_joints(write):
    r = read(write(text("t,q1,q2,tau1,tau2,temperature2", [[*row, "25"] for row in rows(joints=2)])), None)
    assert r.temperature[0] is None
    assert r.temperature[1] is not None


def test_other_headers_by_map(write):
    header = "Time [ms],Position1 [deg],Iq"
    mapping = {"t": "Time [ms]", "q1": "Position1 [deg]", "tau1": "Iq [A]"}
    r = read(write(text(header)), DRIVE, mapping)
    assert r.q[0, 10] == pytest.approx(math.radians(float(rows()[10][1])))
    assert r.tau[0, 10] == pytest.approx(2 * float(rows()[10][2]))
    assert read(write(text(header)), DRIVE, {**mapping, "q1": "Position1"}).q[0, 10] == r.q[0, 10]
    assert read(write(text("Time [ms],q (deg),Iq")), DRIVE, {**mapping, "q1": "q (deg)"}).q[0, 10] == r.q[0, 10]


def test_a_map_goes_before_the_columns_own_name(write):
    table = [[*row, "7"] if k else [*row, "8"] for k, row in enumerate(rows())]
    assert read(write(text("t,q1,tau1,filtered", table)), DRIVE, {"tau1": "filtered"}).tau[0, 0] == 8


@pytest.mark.parametrize(
    "restyle",
    [
        lambda s: s.replace("\n", "\r\n"),
        lambda s: s.replace("\n", "\r"),
        lambda s: "\ufeff" + s,
        lambda s: s.replace(",", ";"),
        lambda s: s.replace(",", "\t"),
        lambda s: "\n\n" + s.replace("\n0.010", "\n\n0.010") + "\n\n",
        lambda s: "\n".join(",".join(f'"{c}"' for c in line.split(",")) for line in s.split("\n") if line),
        lambda s: s.replace(",", " , "),
        lambda s: s.rstrip("\n"),
        lambda s: gzip.compress(s.encode()),
    ],
)
def test_the_same_numbers_in_any_dress(write, restyle):
    plain, dressed = read(write(text(), "a.csv"), DRIVE), read(write(restyle(text()), "b.csv"), DRIVE)
    assert np.array_equal(plain.q, dressed.q)
    assert np.array_equal(plain.t, dressed.t)


def test_runs_may_restart_time(write):
    table = [[*row, "1"] for row in rows()] + [[*row, "2"] for row in rows()]
    r = read(write(text("t,q1,tau1,run", table)), DRIVE)
    assert r.segments == (slice(0, N), slice(N, 2 * N))
    assert r.run[0] == 1
    assert r.dt == pytest.approx(1e-3)


def test_jitter_is_allowed(write):
    table = rows()
    for k, row in enumerate(table):
        row[0] = f"{k * 1e-3 + (k % 3) * 3e-4:.5f}"
    assert len(read(write(text(table=table)), DRIVE).segments) == 1


def test_one_joint_may_be_held_while_another_moves(write):
    table = rows(joints=2)
    for row in table:
        row[2] = "0.5"
    assert np.ptp(read(write(text("t,q1,q2,tau1,tau2", table)), None).q[1]) == 0


def test_write_and_read_give_the_same(tmp_path, write):
    header = "run,t,q1,q2,tau1,tau2,temperature2,fx,fy,q1_link"
    table = [["1", *row, "25", "1", "2", "0.1"] for row in rows(joints=2)]
    arm = RecordedArm((joint(), joint("prismatic")), space=False)
    first = read(write(text(header, table)), arm)
    for name in ("out.csv", "out.csv.gz"):
        recording.write(tmp_path / name, first)
        again = read(tmp_path / name, arm)
        assert np.allclose(again.q, first.q, rtol=1e-11, atol=0)  # 12 digits are written
        assert np.allclose(again.tau, first.tau, rtol=1e-11, atol=0)
        assert again.force is not None
        assert again.q_link is not None
        assert np.isnan(again.q_link[1]).all()
        bytes_first = (tmp_path / name).read_bytes()
        recording.write(tmp_path / name, again)
        assert (tmp_path / name).read_bytes() == bytes_first
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.csv", "out.csv.gz", "run3.csv"]


# --- what is refused ---


def cell(line: int, column: int, value: str) -> str:
    """A recording with one cell changed; line 1 is the header."""
    table = rows()
    table[line - 2][column] = value
    return text(table=table)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (cell(200, 1, "nan"), "run3.csv line 200: q1 is NaN; drop the row or pass --allow-gaps"),
        (cell(200, 1, ""), "run3.csv line 200: q1 is NaN; drop the row or pass --allow-gaps"),
        (cell(200, 2, "N/A"), "run3.csv line 200: tau1 is NaN; drop the row or pass --allow-gaps"),
        (cell(200, 2, "inf"), "run3.csv line 200: tau1 is infinite; repair or drop the row"),
        (
            cell(200, 2, "1e200"),
            "run3.csv line 200: tau1 is 1e+200, more than any sensor reads (at most 1e+12 in SI); repair or",
        ),
        (cell(200, 2, "x1"), 'run3.csv line 200: tau1 is "x1"; expected a number'),
        (cell(200, 2, "1_0"), 'run3.csv line 200: tau1 is "1_0"; expected a number'),
        (cell(200, 2, "1,5"), "run3.csv line 200: has 4 cells; expected 3 as in the header"),
        (cell(200, 0, "0.1"), "run3.csv line 200: time runs backwards, 0.1 s after 0.197 s; number the runs"),
        (cell(200, 0, "0.197"), "run3.csv line 200: time stands still, 0.197 s after 0.197 s;"),
        ("\n".join(text().split("\n")[:100] + text().split("\n")[110:]), "run3.csv line 101: a gap of 0.011 s in t"),
        (text() + "0.3,0.1", "run3.csv line 302: has 2 cells; expected 3 as in the header"),
        (text(table=rows(199)), "run3.csv: only 199 samples; expected at least 200"),
        (text(table=[]), "run3.csv: has a header but no samples"),
        ("", "run3.csv: is empty; expected a header such as t [s],q1 [rad],tau1 [N m]"),
        ("\n\n", "run3.csv: is empty; expected a header"),
        (
            text("t,q1,tau_1"),
            'run3.csv line 1: no column tau1 (the model has 1 joint); the file has "t", "q1", "tau_1"',
        ),
        (text("time,q1,tau1"), "run3.csv line 1: no column t; the file has"),
        (text("t,q2,tau1"), "run3.csv line 1: has a column q2, but the model has 1 joint; drop the column or use"),
        (text("t,q0,tau1"), "run3.csv line 1: has a column q0, but the model has 1 joint"),
        (text("t,q1 [N m],tau1"), "run3.csv line 1: q1 is in [N m]; expected an angle such as rad or deg (joint 1 is"),
        (text("t,q1 [mm],tau1"), "run3.csv line 1: q1 is in [mm]; expected an angle such as rad or deg (joint 1 is"),
        (text("t,q1,tau1 [N]"), "run3.csv line 1: tau1 is in [N]; expected a torque such as N m or mN m (joint 1"),
        (text("t [deg],q1,tau1"), "run3.csv line 1: t is in [deg]; expected a time such as s or ms"),
        (text("t,q1 [radd],tau1"), 'run3.csv line 1: q1 has the unknown unit "radd"; did you mean "rad"?'),
        (text("t,q1 [counts],tau1"), "state how much one is, such as [tick4096] of a servo"),
        (text("t,q1,q1"), 'run3.csv line 1: two columns are q1: "q1" and "q1"; drop one'),
        (text("t,q1,q1 [deg]"), 'run3.csv line 1: two columns are q1: "q1" and "q1 [deg]"; drop one'),
        (text("t q1 tau1"), "expected names separated by commas"),
        (text("t,q1,tau1,run", [[*row, "0.5"] for row in rows()]), "run3.csv line 2: run is 0.5; expected a whole"),
        (text("t,q1,tau1,run [s]", [[*row, "0"] for row in rows()]), "line 1: run has the unit [s]; expected whole"),
        (text(table=[[r[0], "1", r[2]] for r in rows()]), "run3.csv: q1 is constant; nothing moves, so nothing can"),
        (text(table=[[r[0], r[1], "2"] for r in rows()]), "run3.csv: tau1 is constant (2) while q1 moves; is it the"),
        (gzip.compress(text().encode())[:-200], "run3.csv: the gzip file is cut off; copy it again"),
        (gzip.compress(text().encode())[:50] + b"xxxxxxxx" * 9, "run3.csv: the gzip file is damaged"),
        (text("t,q1,tau1 [\xb0]").encode("latin-1"), "run3.csv line 1: byte 0xb0 is not UTF-8; save the file"),
        (b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "run3.csv line 1: byte 0x89 is not UTF-8"),
    ],
)
def test_mistakes(write, content, expected):
    assert expected in said(write(content))


def test_the_wrong_joint_count(write):
    two = write(text("t,q1,q2,tau1,tau2", rows(joints=2)))
    assert "has a column q2, but the model has 1 joint;" in said(two, joints(1))
    assert "no column q3 (the model has 3 joints)" in said(two, joints(3))
    assert said(two, joints(3)).endswith(", and all are used; use the model of this arm")


def test_what_is_read_already_is_not_offered(write):
    """And the columns of a file without a header are typed out for the arm's joints."""
    two = [[*row, "0"] for row in rows(joints=2)]
    assert said(write(text("t,q1,q_2,tau1,tau2,c", two)), joints(2)).endswith('name it with --map q2="q_2"')
    assert said(write(text("t,q1,pos2 [rad],tau1,tau2,c", two)), joints(2)).endswith(
        'name it with --map q2="Header [unit]"'
    )
    bare = write("\n".join(",".join(row) for row in rows(joints=2)))
    assert said(bare, joints(2)).endswith(
        "no header but 5 numbers; name its 5 columns with --columns t,q1,q2,tau1,tau2"
    )


def test_a_current_needs_the_torque_constant(write):
    message = said(write(text("t,q1 [mm],tau1 [A]")), AXIS)
    assert message == "run3.csv line 1: tau1 is a current [A], but joint 1 of the model has no torque_constant; add it"


def test_a_prismatic_joint_refuses_angles(write):
    assert "q1 is in [rad]; expected a length such as m or mm (joint 1 is prismatic)" in said(
        write(text("t,q1 [rad],tau1")), AXIS
    )


def test_rigid_torques_come_for_all_joints_or_none(write):
    path = write(text("t,q1,q2,tau1,tau2,tau1_rigid", [[*row, "1"] for row in rows(joints=2)]))
    assert "has no column tau2_rigid; record the rigid-body torque of every joint, or of none" in said(path, joints(2))


@pytest.mark.parametrize(
    ("mapping", "expected"),
    [
        ({"q1": "Pos"}, '--map q1: no column "Pos"; the file has "t", "q1", "tau1"'),
        ({"q1": "tua1"}, '--map q1: no column "tua1"; did you mean "tau1"?'),
        ({"q9": "q1"}, "--map q9: no such signal; known are t, q1, tau1"),
        ({"q1": "tau1", "tau1": "tau1"}, '--map tau1: column "tau1" is mapped to two signals'),
    ],
)
def test_maps_that_do_not_fit(write, mapping, expected):
    assert expected in said(write(text()), mapping=mapping)


def test_files_that_are_none(tmp_path):
    expected = "expected a recording in CSV, plain or gzip, or MCAP, a ROS 2 bag, MATLAB, HDF5, Parquet or NumPy"
    assert said(tmp_path / "absent.csv") == f"absent.csv: no such file; {expected}"
    assert "is a directory" in said(tmp_path)
    assert "a\\x00b: cannot be read" in said(Path("a\0b"))


def test_a_name_with_line_ends_stays_one_line(tmp_path):
    assert "bad\\nname.csv: no such file" in said(tmp_path / "bad\nname.csv")


# --- gaps ---


def test_gaps_split_when_allowed(write):
    lines = text(table=rows(600)).split("\n")
    path = write("\n".join(lines[:301] + lines[330:]))
    assert "a gap of 0.03 s" in said(path)
    r = read(path, DRIVE, allow_gaps=True)
    assert r.segments == (slice(0, 300), slice(300, 571))


def test_time_running_backwards_splits_when_allowed(write):
    path = write(text(table=rows() + rows()))
    assert "line 302: time runs backwards" in said(path)
    assert read(path, DRIVE, allow_gaps=True).segments == (slice(0, N), slice(N, 2 * N))


def test_nan_rows_are_dropped_when_allowed(write):
    table = rows(400)
    table[100][1] = table[101][2] = ""
    for k in range(200, 300):
        table[k][1] = "nan"
    r = read(write(text(table=table)), DRIVE, allow_gaps=True)
    assert r.q.shape == (1, 298)
    assert not np.isnan(r.q).any()
    assert len(r.segments) == 2


def test_temperatures_logged_slowly_are_filled_when_allowed(write):
    table = [[*row, "20" if k % 100 == 0 else ""] for k, row in enumerate(rows())]
    path = write(text("t,q1,tau1,temperature1", table))
    assert "line 3: temperature1 is NaN" in said(path)
    r = read(path, DRIVE, allow_gaps=True)
    assert r.q.shape == (1, N)
    assert r.temperature[0] is not None
    assert np.all(r.temperature[0] == 20)


def test_too_little_is_left(write):
    table = [[row[0], row[1] if k % 2 else "nan", row[2]] for k, row in enumerate(rows(300))]
    assert (
        said(write(text(table=table)), allow_gaps=True) == "run3.csv: only 150 samples are left; expected at least 200"
    )
    scattered = [[f"{k // 20 + k * 1e-3:.3f}", *row[1:]] for k, row in enumerate(rows(300))]
    assert "no piece between gaps has 50 samples" in said(write(text(table=scattered)), allow_gaps=True)


# --- anything at all ---

NUMBERS = ["0", "1", "-1.5", "1e308", "-1e308", "1e400", "1e-320", "1e-400", "nan", "-inf", "1_0", "0x10", "9" * 400]
CELLS = st.sampled_from([*NUMBERS, "", " ", "x", "é", "'", '"', "1,2", "1,5", "٣", "\x00"])
UNITS_READ = ["t,q1,tau1", "t [ms],q1 [deg],tau1 [mA]", "t,q1,tau1 [Nmm]", "t [ms],q1 [deg],tau1 [A]"]
HEADERS = st.sampled_from([*UNITS_READ, "t;q1;tau1", "t q1 tau1", "# t,q1,tau1", "", "1,2,3"]) | st.text(max_size=9)
STARTS = [b"", b"\x93NUMPY", b"PK\x03\x04", b"\x89MCAP0\r\n", b"MATLAB 5.0", b"SQLite format 3\0", b"\x1f\x8b"]
"""Of files that are read."""


@settings(max_examples=150, deadline=20_000, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(STARTS), st.binary(max_size=400), st.sampled_from([DRIVE, None]))
@example(b"\x1f\x8b", b"", DRIVE)
@example(b"t,q1,tau1\n", b'"' * 500_000, DRIVE)
@example(b"", b"\xff\xfet\x00,\x00q\x00", DRIVE)
def test_any_bytes_are_refused_in_one_line(write, start, rest, arm):
    said(write(start + rest), arm)


@pytest.mark.parametrize("examples", [40, pytest.param(300, marks=pytest.mark.slow)])
def test_any_change_is_a_recording_or_one_line(write, examples):
    @settings(max_examples=examples, deadline=20_000, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(st.data())
    def changed(data):
        check_changed(write, data)

    changed()


def check_changed(write, data):
    table = rows(220)
    if data.draw(st.booleans()):
        table[data.draw(st.integers(0, len(table) - 1))] = data.draw(st.lists(CELLS, min_size=3, max_size=5))
    for _ in range(data.draw(st.integers(1, 4))):
        line = data.draw(st.integers(0, len(table) - 1))
        table[line][data.draw(st.integers(0, 2))] = data.draw(CELLS | st.floats().map(str) | st.text(max_size=3))
    path = write(text(data.draw(HEADERS), table).replace("\n", data.draw(st.sampled_from("\n\r"))))
    message = ""
    try:
        r = read(path, data.draw(st.sampled_from([DRIVE, None])), allow_gaps=data.draw(st.booleans()))
    except RecordingError as error:
        message = str(error)
    else:
        assert isinstance(r, Recording)
        assert np.isfinite(r.q).all()
        assert np.isfinite(r.tau).all()
        assert np.isfinite(r.t).all()
        assert all(np.all(np.diff(r.t[s]) > 0) for s in r.segments)
    assert "\n" not in message
    assert message == "" or message.startswith(str(path))


# --- real recordings ---


@pytest.mark.parametrize("name", "abcdef")
def test_recordings_with_a_hidden_effect(name):
    path = DATA / "hidden" / f"recording_{name}.csv.gz"
    if not path.is_file():
        pytest.skip("../shared/data/hidden is not there")
    n = 2 if name == "f" else 1
    start = time.process_time()
    r = read(path, joints(n))
    seconds = time.process_time() - start
    assert r.q.shape[0] == n
    assert r.dt == pytest.approx(1e-3)
    assert r.temperature[0] is not None
    assert len(r.segments) == 1
    assert seconds < 0.3  # of processor time; takes 0.05 s


@pytest.mark.parametrize("name", ["identification", "validation"])
def test_emps(name):
    path = DATA / "emps" / f"{name}.csv.gz"
    if not path.is_file():
        pytest.skip("../shared/data/emps is not there")
    r = read(path, AXIS)
    assert r.q.shape == (1, 24841)
    assert r.q_desired is not None
    assert "expected an angle" in said(path, DRIVE)
