"""A controller proposed for an arm that has none: the file keeps what it says, the loop is stable, the arm runs.

The loop is judged by the eigenvalues of the sampled closed loop, from the equations of motion linearised here.
"""

from __future__ import annotations

import json
import tomllib
from itertools import pairwise
from math import exp, pi
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from runtime.model.loader import Model
from runtime.workspace.source import Source
from tests.runtime.conftest import Refused, Run
from tests.variants import slow

SLIDER = """<robot name="slider"><link name="world"/>
<joint name="turn" type="continuous"><parent link="world"/><child link="a"/><axis xyz="0 0 1"/></joint>
<link name="a"><inertial><origin xyz="0.2 0 0"/><mass value="6"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="lift" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" effort="120" velocity="2"/></joint>
<link name="b"><inertial><origin xyz="0.15 0 0"/><mass value="3"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.04"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0.3 0 0"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.4" effort="200" velocity="0.5"/></joint>
<link name="c"><inertial><origin xyz="0.1 0 0"/><mass value="1.5"/>
<inertia ixx="0.002" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link></robot>
"""
ARMS = ("ur10", "panda", "slider")


def begun(tendon: Run, arm: str) -> Path:
    """The arm's file with a proposed controller."""
    if arm == "slider":
        Path("slider.urdf").write_text(SLIDER)
        assert tendon("import", "slider.urdf", "--out", "bare.toml")[0] == 0
    status, _, err = tendon("init", "--controller", "bare.toml" if arm == "slider" else arm, "--out", "arm.toml")
    assert status == 0, err
    return Path("arm.toml")


def plan(model: Model) -> str:
    """A scenario forth and back within a tenth of each joint's range, on joint angles alone."""
    ranges = [joint.position_limits or (-1.0, 1.0) for joint in model.joints]
    ends = [
        {f"q{k}": round(low + (high - low) * at, 4) for k, (low, high) in enumerate(ranges, 1)} for at in (0.55, 0.62)
    ]
    points = "".join(
        f"[points.{name}]\nrest = true\n" + "".join(f"{q} = {x}\n" for q, x in end.items())
        for name, end in zip("ab", ends, strict=True)
    )
    phases = "".join(f'[[phase]]\nfrom = "{a}"\nto = "{b}"\npart = 0.5\ndegree = 5\n' for a, b in pairwise("aba"))
    return f'name = "move"\nmodel = "arm.toml"\ncycle_time = 6.0\nfriction = false\n{points}{phases}'


# --- the loop ---


def stable(model: Model, q: np.ndarray, factor: float) -> float:
    """Largest magnitude of the sampled closed loop's eigenvalues at rest at q; factor: of all inertias and weights."""
    n, rate = model.n, model.controller["rate"]  # type: ignore[index]
    still = np.zeros(n)
    lumps = factor * model.lump_values
    weight = np.column_stack(
        [
            (model.inverse_dynamics(q + d, still, still, lumps) - model.inverse_dynamics(q - d, still, still, lumps))
            / 2e-5
            for d in 1e-5 * np.eye(n)
        ]
    )
    inverse = np.linalg.inv(model.inertia(q, lumps))
    # x = [q, q̇]; torques are held over a period.
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ weight, np.zeros((n, n))]])
    whole = expm(np.block([[A, np.vstack([np.zeros((n, n)), inverse])], [np.zeros((n, 3 * n))]]) / rate)
    F, G = whole[: 2 * n, : 2 * n], whole[: 2 * n, 2 * n :]
    # The controller keeps the last positions and the filtered rates: v' = a v + (1 − a) rate (q − q_last).
    a = exp(-2.0 * pi * model.controller["velocity_cutoff"] / rate)  # type: ignore[index]
    C = np.hstack([np.eye(n), np.zeros((n, n))])
    gain = (1.0 - a) * rate
    kp, kd = (np.diag([getattr(j.gains, key) for j in model.joints]) for key in ("kp", "kd"))
    rates = np.hstack([gain * C, -gain * np.eye(n), a * np.eye(n)])
    torque = -np.hstack([kp @ C, np.zeros((n, 2 * n))]) - kd @ rates
    closed = np.vstack(
        [np.hstack([F, np.zeros((2 * n, 2 * n))]) + G @ torque, np.hstack([C, np.zeros((n, 2 * n))]), rates]
    )
    return float(np.abs(np.linalg.eigvals(closed)).max())


@pytest.mark.parametrize("arm", ARMS)
def test_the_loop_is_stable_at_all_poses_and_for_half_and_one_and_a_half_times_the_inertia(
    tendon: Run, arm: str
) -> None:
    model = Source.read(begun(tendon, arm), None).compiled.model()
    ranges = np.array([joint.position_limits or (-3.0, 3.0) for joint in model.joints])
    rng = np.random.default_rng(4)
    for _ in range(40):
        q = rng.uniform(*ranges.T)
        for factor in (0.5, 1.0, 1.5):
            assert stable(model, q, factor) < 1.0
    # The judge tells an unstable loop: forty times the gains.
    assert stable(model, q, 1.0 / 40.0) > 1.0


@pytest.mark.parametrize("arm", ["ur10", slow("panda"), "slider"])
def test_an_arm_runs_with_what_was_proposed(tendon: Run, arm: str) -> None:
    """Friction is not compensated before it is identified: each joint stays behind by its friction over kp."""
    source = Source.read(begun(tendon, arm), None)
    model = source.compiled.model()
    Path("move.toml").write_text(plan(model))
    assert tendon("optimize", "move.toml", "--out", "plan.json", "--json", "planned.json")[0] == 0
    speeds = [joint["peak_speed"] for joint in json.loads(Path("planned.json").read_text())["joints"]]
    once = ("--on", "simulation", "--trials", "1", "--cycles", "1", "--json", "done.json")
    status, _, err = tendon("execute", "arm.toml", "plan.json", *once)
    assert status == 0, err
    done = json.loads(Path("done.json").read_text())
    assert done["status"] == "done"
    assert done["mean"]["saturated"] == 0.0
    for joint, speed, behind in zip(model.joints, speeds, done["mean"]["tracking_max"], strict=True):
        assert joint.gains is not None
        dry, viscous = joint.effects["coulomb_asymmetric"], joint.effects["viscous"]
        rubs = max(dry.values()) + viscous["coefficient"] * speed
        assert behind < 1.2 * rubs / joint.gains.kp + 1e-3
        assert behind < 0.05


# --- the file ---


def test_what_stands_in_the_file_stays_and_what_is_proposed_says_so(tendon: Run) -> None:
    Path("bare.urdf").write_text(SLIDER)
    tendon("import", "bare.urdf", "--out", "mine.toml")
    text = Path("mine.toml").read_text()
    text = text.replace('name = "lift"', '# my own joint\nname = "lift"\nrotor_inertia = 0.4   # measured', 1)
    text += "\n[controller]\nrate = 500.0\nvelocity_cutoff = 60.0\nfriction_scale = 0.5\nfriction_slope = 20.0\n"
    Path("mine.toml").write_text(text)
    status, out, _ = tendon("init", "--controller", "mine.toml")
    assert status == 0
    assert "Nothing is written" in out
    assert Path("mine.toml").read_text() == text

    status, out, _ = tendon("init", "--controller", "mine.toml", "--write", "--json", "said.json")
    assert (status, "Written to mine.toml" in out) == (0, True)
    after, before = tomllib.loads(Path("mine.toml").read_text()), tomllib.loads(text)
    assert after["controller"] == before["controller"]
    assert after["joint"][1]["rotor_inertia"] == 0.4
    assert "# my own joint" in Path("mine.toml").read_text()
    said = json.loads(Path("said.json").read_text())
    for entry in said["proposed"]:
        home = after if entry["joint"] is None else after["joint"][entry["joint"] - 1]
        *tables, key = entry["key"].split(".")
        for table in tables:
            home = home[table]
        assert home[key] == entry["value"]
    # What was not in the file is exactly what is said to be proposed, each with its comment.
    comments = [line for line in Path("mine.toml").read_text().splitlines() if "proposed:" in line]
    assert len(comments) == len(said["proposed"])
    assert {entry["joint"] for entry in said["proposed"] if entry["key"] == "rotor_inertia"} == {1, 3}
    assert {entry["joint"] for entry in said["proposed"] if entry["key"] == "limits.torque"} == {1}

    written = Path("mine.toml").read_text()
    status, out, _ = tendon("init", "--controller", "mine.toml", "--write")
    assert (status, "nothing to propose" in out) == (0, True)
    assert Path("mine.toml").read_text() == written
    # Only gains are proposed anew, and only where that is asked for.
    Path("mine.toml").write_text(written.replace("kp = ", "kp = 1.0 # "))
    assert "nothing to propose" in tendon("init", "--controller", "mine.toml")[1]
    assert tendon("init", "--controller", "mine.toml", "--new-gains", "--write")[0] == 0
    again = tomllib.loads(Path("mine.toml").read_text())
    assert [j["controller"] for j in again["joint"]] == [j["controller"] for j in after["joint"]]


def test_a_value_that_is_measured_is_not_called_proposed_any_more(tendon: Run) -> None:
    edits = Source.read(begun(tendon, "slider"), None).edits
    name = next(iter(edits.arm.joints[0].effects))
    key = next(iter(edits.arm.joints[0].effects[name]))
    after = edits.set_values({(name, 1): {key: 1.25}}, rotors={1: 0.75})
    lines = after.text.splitlines()
    assert f"{key} = 1.25 # N m" in lines
    assert "rotor_inertia = 0.75 # kg m^2" in lines


def test_a_slow_drive_and_an_elastic_joint_get_slower_loops(tendon: Run) -> None:
    begun(tendon, "slider")
    text = Path("bare.toml").read_text()

    def bandwidth(more: str) -> tuple[float, str]:
        Path("more.toml").write_text(text + more)
        assert tendon("init", "--controller", "more.toml", "--json", "said.json")[0] == 0
        said = json.loads(Path("said.json").read_text())
        return said["bandwidth"], said["limit"]

    free, _ = bandwidth("")
    slow, why = bandwidth("[effects.command_delay]\ntime = 0.01\n")
    assert slow < 0.5 * free
    assert "delay of the drive" in why
    text = text.replace("[tip]", "[joint.effects.elasticity]\nstiffness = 150.0\ndamping = 1.0\n\n[tip]")
    soft, why = bandwidth("")
    assert soft < free
    assert "elasticity@3" in why


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--write"], "--write needs --controller MODEL"),
        (["--controller", "ur10", "--write"], "comes with Tendon and is not changed"),
        (["--controller", "bare.toml", "--write", "--out", "new.toml"], "leave one of them out"),
        (["--controller", "bare.toml", "--out", "there.toml"], "already exists"),
        (["--controller", "bare.toml", "--joints", "r"], "leave out the options of a new arm"),
        (["--controller", "weightless.toml"], "needs numbers that the model file leaves out"),
        (["--controller", "missing.toml"], "no such file"),
    ],
)
def test_mistakes_are_one_line_and_write_nothing(
    tendon: Run, refused: Refused, arguments: list[str], message: str
) -> None:
    Path("slider.urdf").write_text(SLIDER)
    tendon("import", "slider.urdf", "--out", "bare.toml")
    Path("weightless.toml").write_text(Path("bare.toml").read_text().replace("mass = 3.0", "# mass ="))
    Path("there.toml").write_text("as it was")
    before = {p.name: p.read_bytes() for p in Path().iterdir()}
    assert message in refused("init", *arguments)
    assert {p.name: p.read_bytes() for p in Path().iterdir()} == before
