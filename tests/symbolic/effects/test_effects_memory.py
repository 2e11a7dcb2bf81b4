"""Effects with a memory: bounds, limits, and the differential equations that they stand for."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from itertools import accumulate, pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from symbolic.effects import LIBRARY
from symbolic.effects.declaration import state
from tests.effect_values import simulate


def moving(rates: Sequence[float], level: float, dt: float = 1e-3) -> list[dict[str, float]]:
    """Samples of a motion at these rates under dry friction of this level."""
    way = accumulate((0.5 * dt * (a + b) for a, b in pairwise(rates)), initial=0.0)
    return [{"q": q, "qd": r, "level": level} for q, r in zip(way, rates, strict=True)]


@settings(max_examples=40, deadline=None)
@given(rates=st.lists(st.floats(-3, 3), min_size=1, max_size=40), stiffness=st.floats(1, 1e6), level=st.floats(0, 5))
def test_bristle_stays_between_the_coulomb_levels(rates: list[float], stiffness: float, level: float) -> None:
    samples = moving(rates, level)
    for value, rate in zip(
        simulate("lugre", {"stiffness": stiffness, "damping": 0.0}, 1e-3, samples), rates, strict=True
    ):
        sign = (rate > 0) - (rate < 0)
        assert abs(value + level * sign) <= level * (1 + 1e-12)


def test_stiff_bristle_is_coulomb_friction() -> None:
    samples = moving((1.0, 0.5, 0.2, -0.3, -1.0, -0.1, 0.4, 0.4), 1.5)
    torques = simulate("lugre", {"stiffness": 1e9, "damping": 0.0}, 1e-3, samples)
    # A step after each reversal the bristle has turned over, and the sum is Coulomb friction.
    slid = [k for k in range(1, len(samples)) if samples[k - 1]["qd"] * samples[k]["qd"] > 0]
    assert [torques[k] for k in slid] == pytest.approx([0.0] * len(slid), abs=1e-12)


def test_bristle_is_a_spring_before_it_slides() -> None:
    stiffness, level, rate, dt = 200.0, 1.5, 1e-4, 1e-3
    torques = simulate("lugre", {"stiffness": stiffness, "damping": 0.0}, dt, moving([rate] * 11, level, dt))
    travelled = 10 * rate * dt
    # Exponential approach: exactly level (1 - exp(-k x/level)), a spring k x at first.
    expected = level * (1 - math.exp(-stiffness * travelled / level))
    assert torques[10] + level == pytest.approx(expected, rel=1e-9)
    assert expected == pytest.approx(stiffness * travelled, rel=1e-3)


def test_bristle_bends_over_the_way_at_any_sampling() -> None:
    """Along one way without a turn, samples ten times as far apart find the same torque."""

    def along(dt: float) -> list[float]:
        return simulate(
            "lugre",
            {"stiffness": 400.0, "damping": 0.0},
            dt,
            moving([2 * k * dt for k in range(round(0.08 / dt))], 1.5, dt),
        )

    assert along(1e-2) == pytest.approx(along(1e-3)[::10], rel=1e-9)


JOINT = {"link_inertia": 0.2, "coupling": 0.2, "coupling_rate": 0.0, "coupling_slope": 0.0}
"""Of a joint whose link asks for the same torque at any rate and place."""


def vibration(stiffness: float, damping: float, frequency: float, seconds: float) -> list[float]:
    """Torque of the elasticity of a 0.2 kg m² link under a load of 3 N m at a frequency, at 1 kHz."""
    dt = 1e-3
    omega = 2 * math.pi * frequency
    samples = [{"load": 3 * math.sin(omega * k * dt), **JOINT} for k in range(round(seconds / dt))]
    return simulate("elasticity", {"stiffness": stiffness, "damping": damping}, dt, samples)


@pytest.mark.parametrize("frequency", [3.0, 9.0, 20.0])
def test_elasticity_vanishes_when_stiff(frequency: float) -> None:
    # 3 N m, on a joint 2000 times faster than a sample; the start, where the load sets in, leaves the most.
    assert max(map(abs, vibration(1e12, 1.0, frequency, 0.3))) < 1e-5


@pytest.mark.parametrize("frequency", [5.0, 12.0, 15.9, 25.0])
def test_elasticity_has_the_frequency_response_of_its_equation(frequency: float) -> None:
    stiffness, damping, inertia = 2000.0, 4.0, 0.2  # resonance 15.9 Hz, damping ratio 0.1
    torques = vibration(stiffness, damping, frequency, 2.0)[1000:]
    omega = 2 * math.pi * frequency
    expected = 3 * inertia * omega**2 / (stiffness + 1j * omega * damping - inertia * omega**2)
    found = 2 * sum(x * cmath.exp(-1j * omega * (1000 + k) * 1e-3) for k, x in enumerate(torques)) / len(torques) * 1j
    # The input is continued in a straight line over a step: an error of (omega dt)^2 = 2.5 % at 25 Hz.
    assert abs(found - expected) < 0.03 * abs(expected)


def test_elasticity_starts_in_equilibrium() -> None:
    """A constant load, gravity for one, has deflected the spring before the recording begins."""
    samples = [{"load": 7.0, **JOINT}] * 20
    torques = simulate("elasticity", {"stiffness": 2000.0, "damping": 0.5}, 1e-3, samples)
    assert max(map(abs, torques)) < 1e-9
    assert {s.symbol for s in LIBRARY["elasticity"].states} == {
        state(n) for n in ("deflection", "rate", "acceleration", "load")
    }
