"""Parameters for BAM: its friction, evaluated as its authors write it, is that of the model's effects."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from runtime.model.terms import structure
from runtime.simulation.plant import Plant
from runtime.workspace.source import Source
from tests import one_joint
from tests.runtime.conftest import Run

TABLES = """\
[joint.effects.coulomb]
torque = 1.5
[joint.effects.viscous]
coefficient = 0.4
"""
CREEP = "[joint.effects.stribeck]\ntorque = 0.8\nspeed = 0.2\n"
LOAD = "[joint.effects.load_friction]\ncoefficient = 0.1\n"


def friction(bam: dict, qd: np.ndarray, outer: float = 0.0, motor: float = 0.0) -> np.ndarray:
    """BAM's frictionloss + damping |qd|, with its switches by model: m2 and m4 fall with the rate, m3 and m4 grow with
    the torque of the gearbox."""
    falls, grows = bam["model"] in ("m2", "m4"), bam["model"] in ("m3", "m4")
    creeping = np.exp(-(np.abs(qd / bam["dtheta_stribeck"]) ** bam["alpha"])) if falls else 0.0
    loss = bam["friction_base"] + (bam["friction_stribeck"] * creeping if falls else 0.0)
    if grows:
        loss = loss + bam["load_friction_base"] * abs(outer - motor)
    if falls and grows:
        loss = loss + bam["load_friction_stribeck"] * abs(outer - motor) * creeping
    return loss + bam["friction_viscous"] * np.abs(qd)


def exported(run: Run, tables: str, *more: str) -> tuple[dict, dict]:
    text = one_joint.model_text(tables).replace("gear_ratio = 100", "gear_ratio = 100\ntorque_constant = 1.6")
    Path("bench.toml").write_text(text)
    status, out, err = run("export", "bench.toml", "--to", "bam", "--out", "bench.json", "--json", "-", *more)
    assert status == 0, err
    return json.loads(Path("bench.json").read_text()), json.loads(out)


@pytest.mark.parametrize(
    ("tables", "model"), [(TABLES, "m1"), (TABLES + CREEP, "m2"), (TABLES + LOAD, "m3"), (TABLES + CREEP + LOAD, "m4")]
)
def test_the_friction_is_that_of_the_effects(tendon: Run, tables: str, model: str) -> None:
    bam, document = exported(tendon, tables, "--servo", "mx106")
    assert (bam["model"], bam["actuator"], bam["kt"], bam["armature"]) == (model, "mx106", 1.6, 0.1)
    qd, load = np.array([0.01, 0.1, 0.3, 2.0]), 4.0
    own = 1.5 + 0.4 * qd
    if CREEP in tables:
        own = own + 0.8 * np.exp(-((qd / 0.2) ** 2))
    if LOAD in tables:
        own = own + 0.1 * load
    # At a constant rate the motor's torque holds the outer one.
    assert friction(bam, qd, outer=-load, motor=load) == pytest.approx(own)
    assert {entry["effect"]: entry["played"] for entry in document["effects"]} == {
        "coulomb": "exact",
        "viscous": "exact",
        **({"stribeck": "exact"} if CREEP in tables else {}),
        **({"load_friction": "approximated"} if LOAD in tables else {}),
    }
    assert any(item.startswith("R of joint 1: not known") for item in document["unsaid"])


def test_a_servo_moves_there_as_in_the_plant(tendon: Run, cache: Path) -> None:  # noqa: ARG001
    """BAM's own step: friction stops the joint within its budget."""
    bam, _ = exported(tendon, TABLES + CREEP)
    model = Source.read(Path("bench.toml"), None).compiled.model()
    dt, inertia = 1e-4, one_joint.INERTIA
    torque = 5.0 * np.cos(2 * np.pi * 1.5 * dt * (np.arange(3000) + 0.5))
    plant = Plant(model, structure(model), dt)
    plant.reset([0.0])
    q = qd = 0.0
    for tau in torque:
        plant.advance([tau])
        stop = inertia / dt * qd + tau
        most = float(friction(bam, np.array(qd)))
        qdd = (tau - np.sign(stop) * min(abs(stop), most)) / inertia
        qd += qdd * dt
        q += qd * dt
    assert abs(float(plant.q[0])) > 0.1
    assert q == pytest.approx(float(plant.q[0]), rel=5e-3)


def test_inertias_may_be_unknown(tendon: Run) -> None:
    """A servo's parameters need none, but a share of the torque does."""
    text = one_joint.model_text(TABLES + "[joint.effects.offset]\ntorque = 0.2\n")
    Path("open.toml").write_text(text.replace(f"rotor_inertia = {one_joint.ROTOR:.2f}\n", ""))
    status, out, err = tendon("export", "open.toml", "--to", "bam", "--out", "open.json", "--json", "-")
    assert status == 0, err
    assert [effect["share"] for effect in json.loads(out)["effects"] if effect["effect"] == "offset"] == [None]
    assert "armature" not in json.loads(Path("open.json").read_text())


def test_each_joint_has_a_file_and_the_rest_is_listed(tendon: Run) -> None:
    tables = TABLES + "[joint.effects.lugre]\nstiffness = 100.0\ndamping = 1.0\n"
    text = one_joint.model_text(tables) + "\n" + one_joint.joint_text()
    Path("two.toml").write_text(text)
    status, out, _ = tendon("export", "two.toml", "--to", "bam", "--out", "two.json")
    assert status == 0
    assert {path.name for path in Path().glob("two*.json")} == {"two_1.json", "two_2.json"}
    assert json.loads(Path("two_2.json").read_text())["friction_base"] == 0.0
    assert "lugre at joint 1 (" in " ".join(out.split())
    status, out, err = tendon("export", "two.toml", "--to", "urdf", "--out", "two.urdf", "--servo", "mx64")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "--servo mx64: only BAM's parameters name one" in err
