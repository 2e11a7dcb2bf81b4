"""Identification against published parameters, plants with known ones, and physics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from runtime.compare import compare, structure_shares
from runtime.identify import identify
from runtime.loader import Model
from runtime.recording import Recording
from runtime.terms import Term
from tests.runtime.conftest import recorded

Shared = Callable[[str, Model], Recording]

PUBLISHED = {"M1": 95.1089, "viscous": 203.5034, "coulomb": 20.3935, "offset": -3.1648}
"""A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, 2019; without skew correction."""


def test_published_parameters_of_emps(emps: Model, shared: Shared) -> None:
    found = identify(emps, [shared("emps/identification.csv.gz", emps)])
    assert found.uncorrected is not None
    values = {"M1": found.uncorrected.lumps[0].value}
    for name, parameter in (("viscous", "coefficient"), ("coulomb", "torque"), ("offset", "torque")):
        values[name] = found.uncorrected.values[Term(name, 1)][parameter].value
    assert values == pytest.approx(PUBLISHED, rel=0.01)
    # A command is held for a sample before the motion that it causes is read: half a sample and a little.
    low, high = found.inference.skew_interval or (0.0, 0.0)
    assert 0.3 < low < high < 1.0


def test_parameters_of_an_independent_plant(drive: Model) -> None:
    """Table I's joint 4, from equations that are not the library's; the interval holds the truth in most cases."""
    found = identify(drive, [recorded(None, 5)])
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
    found = identify(drive, [turned])
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
    viscous = identify(drive, [steady]).inference.values[Term("viscous", 1)]["coefficient"]
    assert viscous.interval is None
    assert any("coulomb_asymmetric" in name for name in viscous.with_others)


def test_compare_says_where_the_residual_sits(drive: Model) -> None:
    """A hidden spring shows over position, hidden direction-dependent friction over the velocity."""
    spring = compare(drive, [recorded("linear_spring", 3)])
    shares = structure_shares(spring.joints[0])
    assert max(shares, key=lambda k: shares[k]) == "position"
    friction = compare(drive, [recorded("viscous_asymmetric", 3)])
    shares = structure_shares(friction.joints[0])
    assert shares["velocity"] > 0.5
    assert shares["velocity"] > shares["position"]


def test_leaving_the_range_of_the_data_warns(drive: Model) -> None:
    """The cubic term bends the friction down: beyond the data it would drive the joint."""
    document = compare(drive, [recorded(None, 5)]).to_json()
    assert len(document["warnings"]) == 1
    assert "drives the joint" in document["warnings"][0]
