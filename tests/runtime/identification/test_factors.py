"""A torque in another unit, before the gear, or without gravity is noticed although inertias are partly unknown, and
nothing is said of a sound one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from runtime.diagnosis.credibility import judged
from runtime.diagnosis.stages import diagnose
from runtime.identification.identify import identify
from tests import torque_mistakes as t
from tests.kept import kept
from tests.variants import slow

PLACES = ["ur10: rotors", "vishard4: rotors"]
FURTHER = ["ur10: masses", "ur10: rotors and inertias", "panda: rotors", "panda: masses"]
FURTHER += ["vishard4: rotors and inertias"]
EVERY = [*PLACES, *map(slow, FURTHER)]
"""Arm, and what the user's file leaves open."""


@pytest.mark.parametrize("place", EVERY)
@pytest.mark.parametrize("mistake", t.MISTAKES)
def test_a_torque_in_another_unit_is_noticed(place: str, mistake: str) -> None:
    """At half of the joints or more, and everywhere the same mistake, as a logger has one unit; where inertias and
    rotors are open, at those that hold much weight, a UR10's second and third."""
    arm, left_open = place.split(": ")
    change, kind, cure = t.MISTAKES[mistake]
    found = kept(t.suspected, t.users_model(arm, left_open), change(t.sound(arm)))
    n = t.true_model(arm).n
    assert len({s.joint for s in found}) == len(found) >= (2 if place == "ur10: rotors and inertias" else n / 2)
    assert {s.kind for s in found} == {kind}
    assert all(cure in str(s) for s in found)


@pytest.mark.parametrize("place", EVERY)
def test_gravity_that_was_taken_out_is_noticed(place: str) -> None:
    arm, left_open = place.split(": ")
    found = kept(t.suspected, t.users_model(arm, left_open), t.without_gravity(arm, t.sound(arm)))
    assert [s.kind for s in found] == ["gravity"]
    assert found[0].maps == ("--map torque=gravity_compensated",)
    assert ("horizontal plane" in str(found[0])) == (arm == "vishard4")


@pytest.mark.parametrize("arm", ["ur10", "vishard4", "drive", slow("panda")])
@pytest.mark.parametrize("left_open", t.OPEN)
def test_nothing_is_said_of_a_sound_torque(arm: str, left_open: str) -> None:
    model = t.users_model(arm, left_open)
    assert kept(t.suspected, model, t.sound(arm)) == ()
    assert kept(t.doubted, model, t.sound(arm)) == ()


def test_a_stated_rotor_is_the_least_that_a_joint_moves() -> None:
    """One joint whose link is unknown: nothing else is stated."""
    text = t.users_text("drive", "masses")
    for key in ("inertia",):
        text = "\n".join(line for line in text.split("\n") if not line.startswith(key))
    model = t.source("drive", text.replace("gravity = [0.0, -9.81]", "gravity = [0.0, 0.0]")).compiled.model()
    r = t.without_gravity("drive", t.sound("drive"))
    assert kept(t.suspected, model, r) == ()
    change, kind, cure = t.MISTAKES["before the gear"]
    (found,) = kept(t.suspected, model, change(r))
    assert found.kind == kind
    assert "the rotor of the model file" in str(found)
    assert cure in str(found)


def test_one_joint_without_gravity_is_mentioned_only() -> None:
    """It may as well move in a horizontal plane. Over small angles, friction hides the weight."""
    model, r = t.users_model("drive", "rotors"), t.sound("drive")
    assert kept(t.suspected, model, t.without_gravity("drive", r)) == ()
    assert kept(t.doubted, model, t.without_gravity("drive", r)) == ()
    time = np.arange(20_000) / 1000
    rates = np.array([[0.13], [0.41], [0.97]]) * 2 * np.pi
    sizes, phases = np.array([[1.2], [0.3], [0.05]]), np.array([[0.0], [1.0], [2.0]])
    q = (sizes * np.sin(rates * time + phases)).sum(axis=0)
    qd = (sizes * rates * np.cos(rates * time + phases)).sum(axis=0)
    qdd = -(sizes * rates**2 * np.sin(rates * time + phases)).sum(axis=0)
    tau = 0.2365 * qdd + 0.5 * np.sign(qd) + 0.5 * qd + 0.03 * np.random.default_rng(1).standard_normal(len(q))
    one = np.zeros(len(q), dtype=np.int64)
    wide = replace(r, t=time, run=one, q=q[None], tau=tau[None], segments=(slice(0, len(q)),))
    assert kept(t.suspected, model, wide) == ()
    assert [s.kind for s in kept(t.doubted, model, wide)] == ["gravity"]
    falls = replace(wide, tau=wide.tau + 9.81 * 0.4 * np.cos(wide.q))
    assert kept(t.doubted, model, falls) == ()


def test_the_verbs_refuse_such_a_recording() -> None:
    model, wrong = t.users_model("ur10", "rotors"), t.MISTAKES["before the gear"][0](t.sound("ur10"))
    assert judged(identify(model, [wrong]), [wrong]).verdict == "refused"
    assert kept(diagnose, model, [wrong]).verdict == "refused"
