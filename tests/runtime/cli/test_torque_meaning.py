"""What a recorded torque is: declared or found out, and nothing written where it looks wrong."""

from __future__ import annotations

import contextlib
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from runtime.recordings.columns import RecordedArm
from runtime.recordings.recording import read, write
from symbolic.model_file.arm import TORQUES
from tests import torque_mistakes as t
from tests.runtime.conftest import Run


def test_a_torque_without_gravity_and_unit_may_be_a_current(tendon: Run, here: Path, arm: Path) -> None:
    """Read as N m, amperes lack most of the weight; the option needs the motor's constant."""

    def cure() -> str:
        status, out, _ = tendon("inspect", "bare.csv", arm, "--json", "-")
        assert status == 1
        (found,) = json.loads(out)["suspicions"]
        return str(found["cure"])

    header, _, rows = (here / "bare.csv").read_text(encoding="utf-8").partition("\n")
    (here / "bare.csv").write_text(header.replace(" [N m]", "") + "\n" + rows, encoding="utf-8")
    assert "current" not in cure()
    text = arm.read_text(encoding="utf-8")
    arm.write_text(
        re.sub(r"^(gear_ratio.*)$", r"\1\ntorque_constant = 5.0", text, flags=re.MULTILINE), encoding="utf-8"
    )
    assert re.search(r'; if it is a current, pass --map tau(\d)="tau\1 \[A\]"', cure())


def test_nothing_is_written_from_a_torque_that_looks_wrong(tendon: Run, here: Path) -> None:
    """The torque before the gear, and a link that the model file leaves open: the fit itself is perfect."""
    text = t.users_text("drive", "masses").replace("gravity = [0.0, -9.81]", "gravity = [0.0, 0.0]")
    text = "".join(line for line in text.splitlines(keepends=True) if not line.startswith("inertia"))
    model = here / "open.toml"
    model.write_text(text, encoding="utf-8")
    r = t.without_gravity("drive", t.sound("drive"))
    write(here / "run.csv", replace(r, tau=r.tau / 100))
    for verb, *options in (["improve", "--out", "better.toml"], ["improve", "--write"], ["identify", "--write"]):
        status, out, _ = tendon(verb, model, "run.csv", *options)
        assert status == 2
        assert "the gear ratio of 100" in out
        assert "Nothing written" in out
        assert model.read_text(encoding="utf-8") == text
        assert not (here / "better.toml").exists()


@pytest.fixture
def arm(here: Path) -> Path:
    """A user's model file of an arm in the plane, whose rotors are open, and recordings of it."""
    (here / "arm.toml").write_text(t.users_text("vishard4", "rotors"), encoding="utf-8")
    write(here / "bare.csv", t.without_gravity("vishard4", t.sound("vishard4")))
    return here / "arm.toml"


def test_it_is_declared_by_an_option_the_recording_or_the_model_file(tendon: Run, here: Path, arm: Path) -> None:
    """In this order; inspect says which."""

    def inspected(*options: str) -> dict[str, Any]:
        status, out, _ = tendon("inspect", "bare.csv", arm, *options, "--json", "-")
        found = json.loads(out)
        assert status == (found["suspicions"] != [])
        return found

    found = inspected()
    assert found["torque"] == {"kind": "motor", "by": None}
    assert [s["kind"] for s in found["suspicions"]] == ["gravity"]
    assert found["cures"] == ["--map torque=gravity_compensated"]
    cured = inspected(*found["cures"][0].split())
    assert cured["torque"] == {"kind": "gravity_compensated", "by": "--map"}
    assert cured["suspicions"] == []
    text = arm.read_text(encoding="utf-8")
    arm.write_text(f'torque = "gravity_compensated"\n{text}', encoding="utf-8")
    assert inspected()["torque"] == {"kind": "gravity_compensated", "by": "the model file"}
    assert inspected()["suspicions"] == []
    bare = (here / "bare.csv").read_text(encoding="utf-8")
    (here / "bare.csv").write_text(f'# torque = "motor"\n{bare}', encoding="utf-8")
    assert inspected()["torque"] == {"kind": "motor", "by": "the file"}
    assert inspected("--map", "torque=command")["torque"] == {"kind": "command", "by": "--map"}
    assert "Torques: of the motors, times the gear ratios, by the file" in tendon("inspect", "bare.csv", arm)[1]


def test_an_unknown_word_is_an_error(tendon: Run, arm: Path) -> None:
    status, _, err = tendon("identify", arm, "bare.csv", "--map", "torque=links")
    assert status == 2
    assert 'bare.csv: torque is "links" (--map); expected motor or link or command' in err
    assert 'did you mean "link"?' in err
    text = arm.read_text(encoding="utf-8")
    arm.write_text(f'torque = "gravity"\n{text}', encoding="utf-8")
    status, _, err = tendon("identify", arm, "bare.csv")
    assert status == 2
    assert 'torque is the text "gravity"; expected "motor" or "link" or "command" or "gravity_compensated"' in err


def test_what_is_at_the_link_is_not_written_into_a_file_of_the_motors(tendon: Run, here: Path, arm: Path) -> None:
    text = arm.read_text(encoding="utf-8")
    for verb, *options in (["identify", "--write"], ["improve", "--out", "better.toml"]):
        status, _, err = tendon(verb, arm, "bare.csv", "--map", "torque=link", *options)
        assert status == 2
        assert 'state torque = "link" in a copy of ' in err
        assert arm.read_text(encoding="utf-8") == text
        assert not (here / "better.toml").exists()


def test_a_written_recording_says_what_its_torques_are(here: Path) -> None:
    r = t.sound("drive")
    drive = RecordedArm(t.true_model("drive").joints, space=False, torque="command")
    for torque in TORQUES:
        write(here / "run.csv", replace(r, torque=torque))
        assert read(here / "run.csv", drive).torque == torque
    write(here / "run.csv", r)
    assert read(here / "run.csv", drive).torque == "command"
    assert read(here / "run.csv", replace(drive, torque=None)).torque is None


def test_other_formats_say_it_too(here: Path) -> None:
    """An array or variable of one text, an attribute, metadata."""
    r = t.sound("drive")
    arm = RecordedArm(t.true_model("drive").joints, space=False)
    columns = {"t": r.t, "q1": r.q[0], "tau1": r.tau[0]}
    np.savez(here / "run.npz", **columns, torque=np.array("link"))
    scipy.io.savemat(here / "run.mat", {**{k: x[:, None] for k, x in columns.items()}, "torque": "link"})
    paths = [here / "run.npz", here / "run.mat"]
    with contextlib.suppress(ImportError):
        import h5py

        with h5py.File(here / "run.h5", "w") as file:
            file.attrs["torque"] = "link"
            for name, values in columns.items():
                file[name] = values
        paths.append(here / "run.h5")
    with contextlib.suppress(ImportError):
        import pyarrow
        from pyarrow import parquet

        table = pyarrow.table(columns).replace_schema_metadata({"torque": "link"})
        parquet.write_table(table, here / "run.parquet")
        paths.append(here / "run.parquet")
    for path in paths:
        found = read(path, arm)
        assert (found.torque, found.torque_by) == ("link", "the file"), path.name


@pytest.mark.parametrize(
    ("names", "line"),
    [
        (["panda_joint1", "panda_joint2"], 'torque = "link"'),
        (["fr3_joint1", "fr3_joint2"], 'torque = "link"'),
        (["shoulder_pan_joint", "shoulder_lift_joint"], "# torque ="),
        (["joint_1", "joint_2"], ""),
    ],
)
def test_import_states_what_the_driver_is_known_to_publish(
    tendon: Run, here: Path, names: list[str], line: str
) -> None:
    body = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = "".join(f'<link name="l{k}">{body}</link>' for k in range(3))
    ends = [f'<parent link="l{k}"/><child link="l{k + 1}"/><axis xyz="0 1 0"/></joint>' for k in range(2)]
    joints = "".join(f'<joint name="{name}" type="continuous">{end}' for name, end in zip(names, ends, strict=True))
    (here / "arm.urdf").write_text(f'<robot name="arm">{links}{joints}</robot>', encoding="utf-8")
    status, _, err = tendon("import", "arm.urdf", "--out", "made.toml")
    assert status == 0, err
    found = [
        x
        for x in (here / "made.toml").read_text(encoding="utf-8").splitlines()
        if x.lstrip("# ").startswith("torque =")
    ]
    assert [x.startswith(line) for x in found] == ([True] if line else [])


def test_a_log_of_libfranka_is_at_the_link(here: Path) -> None:
    r = t.sound("drive")
    header = "time,q[0],dq[0],tau_J[0]\n"
    rows = zip(1000 * r.t, r.q[0], np.gradient(r.q[0], r.t), r.tau[0], strict=True)
    (here / "log.csv").write_text(header + "".join(f"{a:.4f},{b:.9g},{c:.9g},{d:.9g}\n" for a, b, c, d in rows))
    found = read(here / "log.csv", RecordedArm(t.true_model("drive").joints, space=False, torque="motor"))
    assert (found.torque, found.torque_by) == ("link", "libfranka's log")


@pytest.mark.parametrize("torque", ["link", "gravity_compensated"])
def test_what_is_simulated_is_the_torque_that_the_model_file_says(tendon: Run, arm: Path, torque: str) -> None:
    """So that no verb refuses it as one of the other side of the gear."""
    arm.write_text(f'torque = "{torque}"\n{arm.read_text(encoding="utf-8")}', encoding="utf-8")
    assert tendon("simulate", arm, "--seconds", "12", "--out", "own.csv")[0] == 0
    found = json.loads(tendon("inspect", "own.csv", arm, "--json", "-")[1])
    assert (found["torque"], found["suspicions"]) == ({"kind": torque, "by": "the file"}, [])
    assert tendon("identify", arm, "own.csv", "--write")[0] != 2
