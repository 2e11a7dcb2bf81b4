"""Recordings of every format: the same numbers, the same checks with the place in the file; hostile files."""

from __future__ import annotations

import gzip
import io
import sqlite3
import struct
import time
import tracemalloc
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from mcap_ros2.decoder import DecoderFactory

from runtime.arrays import Array
from runtime.recordings import array_files, contents
from runtime.recordings.columns import RecordedArm
from runtime.recordings.recording import RecordingError, read
from tests.runtime.recordings.formats import EPOCH, joint, motion, write_bare_mcap, write_mcap, write_sqlite

KUKA = Path(__file__).parents[4] / "shared" / "data" / "real" / "kuka"

NAMES = ("shoulder", "elbow")
joints = RecordedArm.without_model
ARM = RecordedArm(tuple(joint(torque_constant=2.0, name=name) for name in NAMES), space=True)
TURNED = replace(ARM, joints=ARM.joints[::-1])


def said(path: Path, arm=ARM, **options) -> str:
    """The line that a person reads, without the folder."""
    with pytest.raises(RecordingError) as caught:
        read(path, arm, **options)
    message = str(caught.value).replace(f"{path.parent}/", "")
    assert message.isprintable()
    return message


def write_npz(path: Path, m) -> Path:
    np.savez_compressed(path, **{k: v.T for k, v in m.items()})
    return path


def write_mat(path: Path, m) -> Path:
    scipy.io.savemat(path, {"log": dict(m), "note": "a run"}, do_compression=True)
    return path


def write_hdf5(path: Path, m) -> Path:
    with h5py.File(path, "w") as file:
        for name, values in m.items():
            file.create_dataset(f"arm/{name}", data=values.T, compression="gzip")
        file["arm"].attrs["about"] = "a run"
    return path


def write_mat73(path: Path, m) -> Path:
    """As MATLAB has it: HDF5 behind 512 bytes, dimensions turned round, text as numbers."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in m.items():
            file.create_dataset(f"log/{name}", data=np.atleast_2d(values)).attrs["MATLAB_class"] = b"double"
        file.create_dataset("title", data=np.arange(500, dtype=np.uint16)[None]).attrs["MATLAB_class"] = b"char"
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\x02IM")
    return path


def write_parquet(path: Path, m) -> Path:
    columns = {"t": m["t"]} | {f"{s}{i + 1}": m[s][i] for s in ("q", "qd", "tau") for i in range(len(m["q"]))}
    pq.write_table(pa.table({**columns, "mode": ["auto"] * len(m["t"])}), path)
    return path


def write_listed(path: Path, m) -> Path:
    """Parquet with the joints of a row in a list."""
    lists = {s: pa.FixedSizeListArray.from_arrays(pa.array(m[s].T.ravel()), len(m[s])) for s in ("q", "qd", "tau")}
    pq.write_table(pa.table({"t": m["t"], **lists}), path)
    return path


def write_text(path: Path, m) -> Path:
    table = np.column_stack([m["t"], m["q"].T, m["qd"].T, m["tau"].T])
    np.savetxt(path, table, fmt="%.17g", header="t [s] q1 q2 qd1 qd2 tau1 [N m] tau2 [N m]")
    return path


def write_decimal_commas(path: Path, m) -> Path:
    np.savetxt(path, np.column_stack([m["t"], m["q"].T, m["qd"].T, m["tau"].T]), fmt="%.17g", delimiter=";")
    path.write_text("t;q1;q2;qd1;qd2;tau1;tau2\n" + path.read_text().replace(".", ","))
    return path


WRITERS = {
    "run.npz": write_npz,
    "run.mat": write_mat,
    "run73.mat": write_mat73,
    "run.h5": write_hdf5,
    "run.parquet": write_parquet,
    "listed.parquet": write_listed,
    "run.txt": write_text,
    "comma.csv": write_decimal_commas,
    "run.mcap": lambda path, m: write_mcap(path, [("/joint_states", NAMES, m)]),
    "lz4.mcap": lambda path, m: write_mcap(path, [("/joint_states", NAMES, m)], CompressionType.LZ4),
    "plain.mcap": lambda path, m: write_mcap(path, [("/joint_states", NAMES, m)], CompressionType.NONE),
    "small.mcap": lambda path, m: write_mcap(path, [("/joint_states", NAMES, m)], chunk_size=3000),
    "run.db3": lambda path, m: write_sqlite(path, "/joint_states", NAMES, m),
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_numbers(tmp_path, name):
    m = motion()
    path = WRITERS[name](tmp_path / name, m)
    path = path.rename(tmp_path / "without_an_ending")
    assert len(read(path, None).q) == 2
    r = read(path, ARM)
    assert np.abs(r.t - m["t"]).max() < 1e-9
    for signal in ("q", "qd", "tau"):
        assert np.array_equal(getattr(r, signal), m[signal]), signal
    assert r.segments == (slice(0, 600),)


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("run.npz", "tau row 301"),
        ("run.mat", "log.tau column 301"),
        ("run73.mat", "log.tau column 301"),
        ("run.h5", "arm/tau row 301"),
        ("run.parquet", "tau2 sample 301"),
        ("run.txt", "line 302"),
        ("comma.csv", "line 302"),
        ("run.mcap", "/joint_states message 301"),
        ("run.db3", "/joint_states message 301"),
    ],
)
def test_the_checks_of_csv_with_the_place_in_the_file(tmp_path, name, place):
    broken = motion()
    broken["tau"][1, 300] = np.nan
    path = WRITERS[name](tmp_path / name, broken)
    assert said(path) == f"{name} {place}: tau2 is NaN; drop the row or pass --allow-gaps"
    assert read(path, ARM, allow_gaps=True).q.shape == (2, 599)
    infinite = motion()
    infinite["q"][0, 300] = np.inf
    q = place.replace("tau2", "q1").replace("tau", "q")
    assert said(WRITERS[name](tmp_path / f"b{name}", infinite)).startswith(f"b{name} {q}: q1 is infinite; repair or")
    gap = motion()
    gap["t"][300:] += 1
    t = place.replace("tau2", "t").replace("tau", "t")
    t = t.replace("row", "sample") if "line" not in t and "message" not in t else t
    t = t.replace("column", "sample") if name == "run.mat" else t
    assert said(WRITERS[name](tmp_path / f"c{name}", gap)).startswith(f"c{name} {t}: a gap of 1.001 s in t, over 3")


# --- MCAP and bags ---


def test_the_official_reader_reads_the_same(tmp_path):
    """Joints that change their order and that lack, stamps of nanoseconds: message by message."""
    m = motion(2002, 3)
    path = write_mcap(tmp_path / "a.mcap", [("/joint_states", ("a", "joint_b", "c"), m)], chunk_size=50_000)
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        official = [message for *_, message in reader.iter_decoded_messages()]
    r = read(path, joints(3))
    assert len(official) == 2002
    stamps = np.array([x.header.stamp.sec * 10**9 + x.header.stamp.nanosec for x in official])
    assert np.array_equal(np.round(r.t * 1e9).astype(np.int64), stamps - EPOCH)
    for signal, name in (("q", "position"), ("qd", "velocity"), ("tau", "effort")):
        assert np.array_equal(getattr(r, signal), np.array([getattr(x, name) for x in official]).T)


@pytest.mark.parametrize("options", [{"use_chunking": False}, {"index_types": IndexType.NONE}])
def test_logs_without_chunks_or_indices(tmp_path, options):
    path = write_bare_mcap(tmp_path / "a.mcap", NAMES, motion(), **options)
    assert np.array_equal(read(path, ARM).q, motion()["q"])


def test_joints_by_name(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", [("/joint_states", ("gripper", *NAMES), motion(joints=3))])
    q = motion(joints=3)["q"]
    assert np.array_equal(read(path, ARM).q, q[1:])
    assert np.array_equal(read(path, TURNED).q, q[:0:-1])
    assert read(path, ARM).notes == ()
    assert "joints in the order of the file: 1 gripper, 2 shoulder, 3 elbow" in read(path, joints(3)).notes
    assert 'has 3 joints, "gripper", "shoulder", "elbow", and the model 2 with other names' in said(path, joints(2))
    mapping = {"q1": "position.gripper", "qd1": "velocity.gripper", "tau1": "-effort.gripper"}
    one = read(path, joints(1), mapping)
    assert np.array_equal(one.tau[0], -motion(joints=3)["tau"][0])


def test_two_nodes_on_one_topic(tmp_path):
    """An arm and its gripper, in turn: each with its own instants."""
    m, other = motion(), motion(joints=1, start=0.0005)
    path = write_mcap(tmp_path / "a.mcap", [("/joint_states", ("finger",), other), ("/joint_states", NAMES, m)])
    r = read(path, ARM)
    assert np.array_equal(r.q, m["q"])
    assert r.t[1] - r.t[0] == pytest.approx(1e-3)
    finger = replace(ARM, joints=(joint(name="finger"),))
    assert np.array_equal(read(path, finger).q, other["q"])


def test_topics_sampled_apart(tmp_path):
    """Positions at 1 kHz, torques at 700 Hz and some of both without the other."""
    m, slow = motion(3000), motion(2000, rate=700.0, start=0.1003)
    smooth = {"t": slow["t"], "tau": 0.3 * slow["qd"]}
    topics = [("/joint_states", NAMES, {k: m[k] for k in ("t", "q", "qd")}), ("/efforts", NAMES, smooth)]
    path = write_mcap(tmp_path / "a.mcap", topics)
    r = read(path, ARM)
    assert r.t[0] == pytest.approx(0.101)
    assert r.q[0] == pytest.approx(np.sin(20 * r.t), abs=1e-6)
    assert np.abs(r.tau[1] - 6 * np.cos(20 * r.t + 1)).max() < 1e-4
    (note,) = r.notes
    brought = "tau1, tau2 of /efforts (700 Hz) resampled at the times of the positions of /joint_states (1000 Hz)"
    assert note.startswith(f"{brought}; ")
    assert not r.clocks[0].corrected
    smooth["t"] = np.where(smooth["t"] > 1, smooth["t"] + 0.5, smooth["t"])
    hole = write_mcap(tmp_path / "b.mcap", topics)
    assert "b.mcap /efforts message 631: a gap of 0.5014 s in /efforts, over 3 times the median step" in said(hole)
    assert len(read(hole, ARM, allow_gaps=True).segments) == 2


def answered(seed: int, joints: int) -> dict[str, Array]:
    """24 s at 1 kHz of motion without a period, and torques: inertia that is coupled, dry and viscous friction."""
    rng = np.random.default_rng(seed)
    t = np.arange(24_000) / 1000
    q, qd, qdd = np.zeros((3, joints, len(t)))
    for f in (0.17, 0.43, 1.1, 2.6):
        a, w, phase = 0.5 / (1 + f) ** 1.5, 2 * np.pi * f, rng.uniform(0, 2 * np.pi, (joints, 1))
        q += a * np.sin(w * t + phase)
        qd += a * w * np.cos(w * t + phase)
        qdd -= a * w**2 * np.sin(w * t + phase)
    inertia = 0.2 * np.eye(joints) + 0.05
    tau = inertia @ qdd + 0.5 * np.sign(qd) + 0.4 * qd + 0.8 * np.sin(q) + 0.03 * rng.standard_normal(q.shape)
    return {"t": t, "q": q + 1e-5 * rng.standard_normal(q.shape), "tau": tau}


@pytest.mark.parametrize("late", [0.0, 0.0234, -0.12])
def test_torques_that_another_clock_stamps(tmp_path, late):
    """Torques at 500 Hz on a clock that is late or early: the offset is found to 0.3 ms, corrected, and reported."""
    m = answered(3, 2)
    efforts = {"t": m["t"][::2] + late + 0.2, "tau": m["tau"][:, ::2]}
    topics = [("/joint_states", NAMES, {"t": m["t"] + 0.2, "q": m["q"]}), ("/efforts", NAMES, efforts)]
    r = read(write_mcap(tmp_path / "a.mcap", topics), ARM)
    (clock,) = r.clocks
    assert clock.shift.value == pytest.approx(late, abs=3e-4)
    assert clock.corrected == (late != 0)
    if late:
        assert f"corrected: their stamps are {abs(late):.3g}"[:-1] in r.notes[0]
        assert ("later than the motion" if late > 0 else "earlier than the motion") in r.notes[0]
    first = int(np.argmax(m["q"][0] == r.q[0, 0]))
    beside = m["tau"][:, first : first + len(r.t)]
    assert np.sqrt(np.mean((r.tau - beside) ** 2)) < 0.07


def test_a_motion_that_does_not_tell_the_clocks_apart(tmp_path):
    """Torques that have nothing to do with it, and a joint that is held."""
    m, rng = answered(4, 2), np.random.default_rng(0)
    noise = {"t": m["t"][::2] + 0.03, "tau": rng.standard_normal((2, 12_000))}
    topics = [("/joint_states", NAMES, {"t": m["t"], "q": m["q"]}), ("/efforts", NAMES, noise)]
    r = read(write_mcap(tmp_path / "a.mcap", topics), ARM)
    assert not r.clocks[0].corrected
    assert r.notes[0].endswith("the offset between their clocks cannot be determined from this motion")


def test_two_topics_with_everything_ask_which(tmp_path):
    m = motion()
    path = write_mcap(tmp_path / "a.mcap", [("/left/joint_states", NAMES, m), ("/right/joint_states", NAMES, m)])
    message = said(path)
    assert '"/left/joint_states", "/right/joint_states" all have q; choose one with --map q="/left' in message
    left = {s: f"/left/joint_states.{n}" for s, n in (("q", "position"), ("qd", "velocity"), ("tau", "effort"))}
    assert np.array_equal(read(path, ARM, {**left, "t": "/left/joint_states.stamp"}).q, m["q"])


def test_a_log_without_joint_states_says_what_it_has(tmp_path):
    from mcap_ros2.writer import Writer

    with open(tmp_path / "a.mcap", "wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("std_msgs/msg/String", "string data")
        writer.write_message("/chatter", schema, {"data": "hello"})
        writer.finish()
    expected = (
        "a.mcap: has no messages of sensor_msgs/msg/JointState in CDR; its topics are /chatter (std_msgs/msg/String)"
    )
    assert said(tmp_path / "a.mcap") == expected


def test_joint_states_in_another_encoding_are_named(tmp_path):
    from mcap.writer import Writer

    with open(tmp_path / "a.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/JointState", "ros1msg", b"float64[] position")
        channel = writer.register_channel("/joint_states", "ros1", schema)
        writer.add_message(channel, 0, b"", 0)
        writer.finish()
    assert said(tmp_path / "a.mcap").endswith("its topics are /joint_states (sensor_msgs/JointState in ros1)")


def test_joints_that_change_in_each_message(tmp_path):
    streams = [("/joint_states", (f"j{k}",), motion(2, 1, start=k)) for k in range(100)]
    assert "/joint_states: has messages with more than 64 different lists of joints" in said(
        write_mcap(tmp_path / "a.mcap", streams), 1
    )


def test_a_bag_whose_tables_are_none(tmp_path):
    bag = sqlite3.connect(tmp_path / "a.db3")
    bag.execute("CREATE VIEW topics AS SELECT 1 AS id, '/a' AS name, 'sensor_msgs/msg/JointState' AS type, 'cdr' AS s")
    bag.close()
    assert "is a SQLite file without the tables topics and messages" in said(tmp_path / "a.db3")


def test_a_bag_is_a_folder(tmp_path):
    write_sqlite(tmp_path / "run_0.db3", "/joint_states", NAMES, motion())
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    assert read(tmp_path, ARM).q.shape == (2, 600)


# --- names ---


def test_a_whole_family_by_one_map(tmp_path):
    m = motion()
    np.savez(tmp_path / "a.npz", zeit=m["t"] * 1000, winkel=np.degrees(m["q"].T), strom=m["tau"].T * 1000)
    assert "a.npz: no column t; the file has" in said(tmp_path / "a.npz")
    r = read(tmp_path / "a.npz", ARM, {"t": "zeit [ms]", "q": "winkel [deg]", "tau": "-strom [mA]"})
    assert np.allclose(r.q, m["q"])
    assert np.allclose(r.tau, -2 * m["tau"])
    assert r.cells["tau2"] == "-strom2 [mA]"
    few = said(tmp_path / "a.npz", joints(3), mapping={"q": "winkel [deg]"})
    assert few.startswith("a.npz: --map q: 2 columns are called winkel with a number; expected one for each of 3")


def test_without_a_header(tmp_path):
    m, path = motion(), tmp_path / "a.csv"
    for delimiter, comma in ((",", False), (" ", False), (";", True), (" ", True)):
        table = np.column_stack([m["t"], m["q"].T, m["tau"].T])
        np.savetxt(path, table, delimiter=delimiter, fmt="%.17g")
        if comma:
            path.write_text(path.read_text().replace(".", ","))
        given = "a.csv: its first line is no header but 5 numbers"
        expected = f"{given}; name its 5 columns with --columns t,q1,q2,tau1,tau2"
        assert said(path) == expected
        names = {name: f"#{k}" for k, name in enumerate(("t", "q1", "q2", "tau1", "tau2"), 1)}
        r = read(path, ARM, names)
        assert np.array_equal(r.tau, m["tau"]), (delimiter, comma)
        assert r.q.shape == (2, 600)


def test_logs_of_universal_robots(tmp_path):
    m = motion()
    families = ("target_q", "actual_q", "actual_qd", "actual_current")
    header = " ".join(["timestamp", *(f"{name}_{i}" for name in families for i in range(2))])
    table = np.column_stack([m["t"], m["q"].T, m["q"].T, m["qd"].T, m["tau"].T])
    np.savetxt(tmp_path / "robot_data.csv", table, fmt="%.17g", header=header, comments="")
    r = read(tmp_path / "robot_data.csv", ARM)
    assert np.array_equal(r.q, m["q"])
    assert np.array_equal(r.q_desired, m["q"])
    assert np.array_equal(r.tau, 2 * m["tau"])
    assert "Universal Robots' RTDE recorder" in r.notes[0]
    bare = replace(ARM, joints=tuple(joint(name=name) for name in NAMES))
    assert "tau1 is a current [A], but joint 1 of the model has no torque_constant; add it" in said(
        tmp_path / "robot_data.csv", bare
    )


@pytest.mark.parametrize("prefix", ["", "state."])
def test_logs_of_libfranka(tmp_path, prefix):
    m = motion(joints=7)

    def cells(name: str) -> str:
        return ",".join(f"{prefix}{name}[{i}]" for i in range(7))

    names = [cells(name) for name in ("q", "q_d", "dq", "tau_J")]
    header = ",".join(["duration, success rate", *names, "sent commands", cells("q_d")])
    one = np.ones((len(m["t"]), 1))
    parts = [m["t"][:, None] * 1000, one, m["q"].T, m["q"].T, m["qd"].T, m["tau"].T, one, m["q"].T]
    np.savetxt(tmp_path / "log.csv", np.hstack(parts), fmt="%.17g", delimiter=",", header=header, comments="")
    r = read(tmp_path / "log.csv", None)
    assert np.array_equal(r.q, m["q"])
    assert np.array_equal(r.tau, m["tau"])
    assert r.dt == pytest.approx(1e-3)
    assert "measured behind the gears" in r.notes[0]


def test_structs_as_a_maker_of_robots_has_them():
    """The original of a real recording against what was made of it by hand."""
    if not (KUKA / "recording_A.mat").is_file():
        pytest.skip("../shared/data/real is not there")
    mapping = {"t": "rec.time_cont", "q1": "act_pos_mot_deg1 [deg]", "q1_link": "act_pos_se_deg1 [deg]"}
    mapping["tau1"] = "act_torque_abs_nm1"
    r, by_hand = read(KUKA / "recording_A.mat", None, mapping), read(KUKA / "a1_A.csv.gz", None)
    assert np.allclose(r.t, by_hand.t, atol=1e-6)
    assert np.allclose(r.q, by_hand.q, atol=1e-8)
    assert np.allclose(256.857 * r.tau, by_hand.tau, rtol=1e-5)  # the gear ratio
    assert r.q_link is not None
    assert np.allclose(r.q_link, by_hand.q_link, atol=1e-8)


def test_variables_with_times_of_their_own(tmp_path):
    m, slow = motion(3000), motion(2000, rate=700.0)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["arm/t"], file["arm/q"] = m["t"], m["q"].T
        file["drive/t"], file["drive/tau"] = slow["t"], 0.3 * slow["qd"].T
    r = read(tmp_path / "a.h5", ARM, {"t": "arm/t"})
    assert np.abs(r.tau[1] - 6 * np.cos(20 * r.t + 1)).max() < 1e-4
    said = "tau1, tau2 of drive/t (700 Hz) resampled at the times of the positions of arm/t (1000 Hz)"
    assert r.notes[0].startswith(said)


def test_a_package_that_lacks_is_asked_for_by_name(tmp_path, monkeypatch):
    monkeypatch.setattr(contents, "find_spec", lambda _: None)
    for name, package, extra in (
        ("run.h5", "h5py", "hdf5"),
        ("run.parquet", "pyarrow", "parquet"),
        ("run.mcap", "zstandard", "mcap"),
        ("lz4.mcap", "lz4", "mcap"),
    ):
        message = said(WRITERS[name](tmp_path / name, motion()))
        assert f"needs {package}, the extra `{extra}` (pip install -e '.[{extra}]'); run: " in message
    assert read(WRITERS["plain.mcap"](tmp_path / "plain.mcap", motion()), ARM).q.shape == (2, 600)


# --- hostile files ---


def outcome(path: Path, arm) -> str:
    """What reading a file comes to: the recording, or the line that refuses it."""
    try:
        return repr(read(path, arm))
    except RecordingError as error:
        return str(error)


@pytest.mark.parametrize("name", [n for n in WRITERS if n not in ("run.txt", "comma.csv")])
def test_a_file_that_is_cut_off_is_one_line(tmp_path, name):
    whole = WRITERS[name](tmp_path / name, motion(300)).read_bytes()
    for part in (0.1, 0.5, 0.9, 0.99):
        (tmp_path / name).write_bytes(whole[: int(part * len(whole))])
        message = outcome(tmp_path / name, ARM)
        assert message.startswith(str(tmp_path / name))


@pytest.mark.parametrize("name", ["run.npz", "run.mat", "run.h5", "run.parquet", "run.db3", "plain.mcap", "lz4.mcap"])
def test_any_damage_is_a_recording_or_one_line(tmp_path, name):
    whole = WRITERS[name](tmp_path / name, motion(220, 1)).read_bytes()

    @settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(
        st.lists(st.tuples(st.integers(8, len(whole) - 1), st.binary(min_size=1, max_size=8)), min_size=1, max_size=3)
    )
    def damaged(changes):
        data = bytearray(whole)
        for place, put in changes:
            data[place : place + len(put)] = put
        (tmp_path / name).write_bytes(bytes(data))
        assert "\n" not in outcome(tmp_path / name, None)

    damaged()


def test_counts_that_lie(tmp_path):
    """A billion samples stated and none there: refused before the memory is asked for."""
    header = b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000,), }".ljust(
        117
    )
    (tmp_path / "a.npy").write_bytes(header + b"\n")
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("t.npy", header + b"\n")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name in ("t", "q1", "q2", "tau1", "tau2"):
            file.create_dataset(name, shape=(10**9,), chunks=(10**6,), dtype="f8")
    tracemalloc.start()
    assert "a.npy: column states (1000000000,) numbers, more than the file holds" in said(tmp_path / "a.npy")
    assert "a.npz: t states (1000000000,) numbers, more than the file holds" in said(tmp_path / "a.npz")
    assert "a.h5: t has (1000000000,) numbers; expected at most 2 GB" in said(tmp_path / "a.h5")
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


@pytest.mark.parametrize("limit", [10**8, pytest.param(2 * 10**9, marks=pytest.mark.slow)])
def test_a_small_matlab_file_that_unpacks_to_much(tmp_path, monkeypatch, limit):
    """It is refused while it is unpacked, not after."""
    monkeypatch.setattr(array_files, "MAX_BYTES", limit)
    packer = zlib.compressobj(9)
    part = packer.compress(bytes(1 << 24)) + packer.flush(zlib.Z_FULL_FLUSH)
    # After a full flush the same bytes unpack to the same again.
    again = packer.compress(bytes(1 << 24)) + packer.flush(zlib.Z_FULL_FLUSH)
    bomb = part + again * (limit >> 24)
    mat = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(bomb)) + bomb
    (tmp_path / "a.mat").write_bytes(mat)
    tracemalloc.start()
    expected = f"a.mat: the MATLAB file decompresses to more than {limit // 10**9} GB; save only what is needed"
    assert expected in said(tmp_path / "a.mat")
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


def test_bombs(tmp_path):
    """Small files that unpack to more than a memory holds."""
    zeros = zlib.compress(bytes(1 << 20), 9)
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(bytes(1 << 26)))
    assert "a.csv.gz: the gzip file contains no text" in said(tmp_path / "a.csv.gz")
    chunk = (
        struct.pack("<QQQI", 0, 0, 1 << 40, 0) + struct.pack("<I", 3) + b"lz4" + struct.pack("<Q", len(zeros)) + zeros
    )
    record = struct.pack("<BQ", 6, len(chunk)) + chunk
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n" + record)
    assert "a.mcap: the MCAP file has a chunk that states 1099511627776 bytes" in said(tmp_path / "a.mcap")
    (tmp_path / "b.mcap").write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, 1 << 62))
    assert "b.mcap: the MCAP file is cut off: a record at byte 8 has 4611686018427387904 bytes" in said(
        tmp_path / "b.mcap"
    )


@pytest.mark.parametrize(
    ("head", "expected"),
    [
        (b"#ROSBAG V2.0\n", "is a ROS 1 bag; convert it with: pip install rosbags"),
        (b"\x28\xb5\x2f\xfd", "is compressed with zstd; decompress it with: zstd -d FILE"),
        (b"BZh9", "is compressed with bzip2"),
    ],
)
def test_what_is_recognised_and_refused(tmp_path, head, expected):
    (tmp_path / "a").write_bytes(head + bytes(100))
    assert expected in said(tmp_path / "a")


def test_a_workbook_and_an_archive(tmp_path):
    for inside, expected in (
        ("xl/workbook.xml", "is an Excel workbook; save the sheet as CSV"),
        ("a", "a ZIP archive"),
    ):
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w") as archive:
            archive.writestr(inside, "x")
        (tmp_path / "a").write_bytes(buffer.getvalue())
        assert expected in said(tmp_path / "a")


def test_messages_cost_little(tmp_path):
    """Twenty thousand of six joints, where the official reader takes more than a second."""
    names = [f"joint_{k}" for k in range(6)]
    path = write_mcap(tmp_path / "a.mcap", [("/joint_states", names, motion(20_000, 6))], CompressionType.LZ4)
    costs = []
    for _ in range(3):
        began = time.process_time()
        read(path, joints(6))
        costs.append(time.process_time() - began)
    assert min(costs) < 0.3
