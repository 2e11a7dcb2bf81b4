"""Torques that are declared to be at the link, without gravity or commanded: the equations are theirs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from runtime.identification.compare import has_proper_inertia
from runtime.identification.fit import Fit
from runtime.identification.identify import identify, prepared
from runtime.model.loader import Model
from runtime.recordings.recording import Recording, RecordingError
from tests import torque_mistakes as t
from tests.kept import kept

ARMS = ["ur10", "vishard4"]


def missed(fit: Fit) -> float:
    """The largest part of a joint's torque that the fit misses."""
    motion, found = fit.motion, []
    for i, residual in enumerate(fit.residual):
        use = motion.moving(i)
        found.append(np.linalg.norm(residual[use]) / np.linalg.norm(motion.recorded(i, fit.skew)[use]))
    return float(max(found))


def at_the_link(arm: str) -> Recording:
    """What a sensor behind the gear reads of a stiff joint: neither the rotor's inertia nor friction, but some noise.

    The links' torques are those of the same arm with next to no rotors, by the inverse dynamics.
    """
    r = t.sound(arm)
    text = t.true_text(arm)
    light = "\n".join("rotor_inertia = 1e-9" if x.startswith("rotor_inertia") else x for x in text.split("\n"))
    model = t.source(arm, light).compiled.model()
    seconds = r.t[1] - r.t[0]
    qd = np.gradient(r.q, seconds, axis=1)
    smooth = np.hanning(41) / np.hanning(41).sum()
    qd = np.array([np.convolve(row, smooth, mode="same") for row in qd])
    qdd = np.array([np.convolve(row, smooth, mode="same") for row in np.gradient(qd, seconds, axis=1)])
    tau = model.inverse_dynamics(r.q, qd, qdd)
    noise = 0.01 * np.std(tau, axis=1, keepdims=True) * np.random.default_rng(1).standard_normal(tau.shape)
    inner = slice(100, -100)
    made = replace(r, t=r.t[inner], run=r.run[inner], q=r.q[:, inner], tau=(tau + noise)[:, inner])
    return replace(made, segments=(slice(0, len(made.t)),))


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("left_open", ["rotors", "masses"])
def test_a_torque_without_gravity_is_fitted_without_it(arm: str, left_open: str) -> None:
    """The arm's inertial parameters are those of the whole torque, as far as its motion alone tells them."""
    model, r = t.users_model(arm, left_open), t.without_gravity(arm, t.sound(arm))
    declared = identify(model, [replace(r, torque="gravity_compensated")])
    assert missed(declared) < 0.35 * missed(identify(model, [r]))
    assert kept(t.suspected, model, replace(r, torque="gravity_compensated")) == ()
    whole = identify(model, [t.sound(arm)])
    for lump, mine, other in zip(model.lumps, declared.inference.lumps, whole.inference.lumps, strict=True):
        if mine.interval is not None and mine.interval[1] - mine.interval[0] < 0.1 * abs(mine.value):
            assert mine.value == pytest.approx(other.value, rel=0.1), lump.name


def test_gravity_in_a_torque_that_is_declared_to_lack_it() -> None:
    model, r = t.users_model("ur10", "rotors"), t.sound("ur10")
    (found,) = kept(t.suspected, model, replace(r, torque="gravity_compensated"))
    assert (found.kind, found.maps) == ("gravity", ("--map torque=motor",))


@pytest.mark.parametrize("arm", ARMS)
def test_a_torque_at_the_link_has_no_rotors(arm: str) -> None:
    """With rotors in the file, its parameters fit; without, the rotors are not made up."""
    r = at_the_link(arm)
    whole, open_rotors = t.true_model(arm), t.users_model(arm, "rotors")
    stated = np.diagonal(whole.inertia(np.zeros((whole.n, 1)))[:, :, 0])
    rotors = np.array([joint.rotor_inertia for joint in whole.joints])
    for model in (whole, open_rotors):
        fit = identify(model, [replace(r, torque="link")])
        assert missed(fit) < 0.1
        assert has_proper_inertia(fit)
        found = np.diagonal(model.inertia(np.zeros((model.n, 1)), fit.coefficients[: len(model.lumps)])[:, :, 0])
        expected = stated if model is whole else stated - rotors
        if model is whole:
            # Rotors that are parameters of their own are not told.
            expected = np.where(np.abs(found - stated) < np.abs(found - stated + rotors), stated, stated - rotors)
        assert found == pytest.approx(expected, abs=0.15 * stated.max())


@pytest.mark.parametrize("arm", ARMS)
def test_a_torque_at_the_link_that_nobody_declared_is_mentioned(arm: str) -> None:
    """Friction and rotors are missing at once; a sound torque has both."""
    model, r = t.true_model(arm), at_the_link(arm)
    assert kept(t.suspected, model, r) == ()
    (found,) = kept(t.doubted, model, r)
    assert (found.kind, found.maps) == ("link", ("--map torque=link",))
    assert kept(t.doubted, model, replace(r, torque="link")) == ()
    assert kept(t.doubted, model, t.sound(arm)) == ()


def test_recordings_of_both_sides_are_not_fitted_together() -> None:
    model = t.users_model("vishard4", "rotors")
    r = t.sound("vishard4")
    with pytest.raises(RecordingError, match="measured at the link"):
        identify(model, [r, replace(at_the_link("vishard4"), torque="link")])


def test_a_command_is_held_between_uneven_samples() -> None:
    model: Model = t.users_model("drive", "rotors")
    r = t.sound("drive")
    rng = np.random.default_rng(3)
    kept_samples = np.cumsum(rng.choice([10, 12], size=2000))
    kept_samples = kept_samples[kept_samples < len(r.t)]
    uneven = replace(
        r, t=r.t[kept_samples], run=r.run[kept_samples], q=r.q[:, kept_samples], tau=r.tau[:, kept_samples]
    )
    uneven = replace(uneven, segments=(slice(0, len(kept_samples)),), temperature=(None,), qd=None)
    assert prepared(model, [replace(uneven, torque="command")]).band.held
