"""Identification against published parameters, plants with known ones, and physics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from runtime.fit_warnings import warnings
from runtime.identification.compare import compare, structure_shares
from runtime.identification.identify import identify, uncorrected
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.recordings.recording import Recording
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import simulate
from runtime.workspace.source import Source
from tests.kept import kept
from tests.runtime.conftest import recorded

Shared = Callable[[str, Model], Recording]
SPRING = Term("parallel_spring", 4)

PUBLISHED = {"M1": 95.1089, "viscous": 203.5034, "coulomb": 20.3935, "offset": -3.1648}
"""A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, 2019; without skew correction."""


def test_published_parameters_of_emps(emps: Model, shared: Shared) -> None:
    found = kept(identify, emps, [shared("emps/identification.csv.gz", emps)])
    plain = uncorrected(found)
    assert plain is not None
    values = {"M1": plain.lumps[0].value}
    for name, parameter in (("viscous", "coefficient"), ("coulomb", "torque"), ("offset", "torque")):
        values[name] = plain.values[Term(name, 1)][parameter].value
    assert values == pytest.approx(PUBLISHED, rel=0.01)
    # A command is held for a sample before the motion that it causes is read: half a sample and a little.
    low, high = found.inference.skew_interval or (0.0, 0.0)
    assert 0.3 < low < high < 1.0


def test_parameters_of_an_independent_plant(drive: Model) -> None:
    """Table I's joint 4, from equations that are not the library's; the interval holds the truth in most cases."""
    found = kept(identify, drive, [recorded(None, 5)])
    values = found.inference.values
    assert found.inference.lumps[0].value == pytest.approx(0.2365, rel=0.01)
    assert values[Term("coulomb_asymmetric", 1)]["positive"].value == pytest.approx(1.72, abs=0.02)
    assert values[Term("coulomb_asymmetric", 1)]["negative"].value == pytest.approx(1.05, abs=0.02)
    assert values[Term("viscous", 1)]["coefficient"].value == pytest.approx(1.14, abs=0.02)
    assert values[Term("viscous_cubic", 1)]["coefficient"].value == pytest.approx(-0.015, abs=0.002)
    low, high = values[Term("viscous", 1)]["coefficient"].interval or (0.0, 0.0)
    assert 0.0 < high - low < 0.1


def test_inertia_stays_positive_definite(drive: Model) -> None:
    """A torque against all physics (its sign turned) asks for a negative inertia and does not get it."""
    plain = recorded(None, 6)
    turned = Recording(
        plain.path, plain.t, plain.run, plain.q, -plain.tau, plain.types, plain.segments, plain.temperature
    )
    found = kept(identify, drive, [turned])
    assert found.inference.lumps[0].value > 0
    assert found.inference.values[Term("viscous", 1)]["coefficient"].value >= 0


def test_inseparable_parameters_are_named_together(drive: Model) -> None:
    """At one constant speed, viscous, cubic and Coulomb friction are one number."""
    t = np.arange(6000) / 1000
    rng = np.random.default_rng(0)
    q = 0.5 * t + 1e-5 * rng.standard_normal(len(t))
    tau = 2.0 + 0.1 * rng.standard_normal(len(t))
    steady = Recording(
        recorded(None, 6).path,
        t,
        np.zeros(len(t), dtype=np.int64),
        q[None],
        tau[None],
        ("revolute",),
        (slice(0, len(t)),),
        (None,),
    )
    viscous = kept(identify, drive, [steady]).inference.values[Term("viscous", 1)]["coefficient"]
    assert viscous.interval is None
    assert any("coulomb_asymmetric" in name for name in viscous.with_others)


def test_compare_says_where_the_residual_sits(drive: Model) -> None:
    """A hidden spring shows over position, hidden direction-dependent friction over the velocity."""
    spring = kept(compare, drive, [recorded("linear_spring", 3)])
    shares = structure_shares(spring.joints[0])
    assert max(shares, key=lambda k: shares[k]) == "position"
    friction = kept(compare, drive, [recorded("viscous_asymmetric", 3)])
    shares = structure_shares(friction.joints[0])
    assert shares["velocity"] > 0.5
    assert shares["velocity"] > shares["position"]


def test_leaving_the_range_of_the_data_warns(drive: Model) -> None:
    """The cubic term bends the friction down: beyond the data it would drive the joint."""
    (said,) = warnings(kept(compare, drive, [recorded(None, 5)]).fit)
    assert "drives the joint" in said


def test_joints_that_are_held_stay_as_the_file_has_them(model: Model) -> None:
    """One joint of four moves; the others give way by less than a milliradian, where friction has no direction."""
    t = np.arange(20_000) / 1000.0
    swing = -0.8 + 0.7 * np.sin(2 * np.pi * 0.31 * t) * np.cos(2 * np.pi * 0.9 * t)
    held = [2e-4 * np.sin(2 * np.pi * f * t) for f in (1.1, 1.7, 2.3)]
    made, _ = simulate(model, settings=SimulationSettings(seed=3), motion=np.array([*held, swing]))
    found = kept(identify, model, [made])
    fit = found.prediction
    for number, (lump, value) in enumerate(zip(model.lumps, fit.lumps, strict=True)):
        if lump.joint < 4:
            assert value == pytest.approx(lump.value), number
    # What joint 4 sees with the others at rest is the sum of its own.
    seen = sum(v for lump, v in zip(model.lumps, fit.lumps, strict=True) if lump.name in ("J4", "I4"))
    stated = sum(lump.value for lump in model.lumps if lump.name in ("J4", "I4"))
    assert seen == pytest.approx(stated, rel=0.02)
    # Nothing is claimed of what no row tells.
    assert found.inference.lumps[0].interval is None
    assert found.inference.values[Term("viscous", 1)]["coefficient"].interval is None
    assert fit.values[Term("viscous", 1)] == model.joints[0].effects["viscous"]
    assert fit.values[Term("viscous", 4)]["coefficient"] == pytest.approx(1.14, rel=0.05)
    residual = found.residual[3]
    # The noise of the torque is 3 % of it, and all that is left.
    assert np.sqrt(np.mean(residual**2)) < 0.03 * np.sqrt(np.mean(made.tau[3] ** 2))


def test_a_spring_that_the_motion_does_not_reach_stays_as_the_file_has_it(model: Model) -> None:
    """The spring of joint 4 is taut below -1.2 rad, the motion ends at -0.4."""
    made, _ = simulate(model, settings=SimulationSettings(seed=3, seconds=15.0))
    assert made.q[3].min() > -0.5
    found = kept(identify, model, [made])
    values = found.inference.values[SPRING]
    assert {name: e.value for name, e in values.items()} == pytest.approx(model.joints[3].effects["parallel_spring"])
    assert all(e.interval is None for e in values.values())


def test_a_spring_that_is_elsewhere_than_the_file_says_is_found(model: Model) -> None:
    source = Source.shipped("vishard4")
    elsewhere = source.with_text(source.edits.place("parallel_spring", 4, {"offset": 0.05}).text).compiled.model()
    made, _ = simulate(elsewhere, settings=SimulationSettings(seed=3, seconds=15.0))
    values = kept(identify, model, [made]).inference.values[SPRING]
    assert values["offset"].value == pytest.approx(0.05, abs=0.01)
    assert values["stiffness"].value == pytest.approx(5900.0, rel=0.03)
    assert values["radius"].value == 0.06
