"""The link behind a gap, against an integration of its equation by others, and its limits."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from runtime.arrays import Array
from tests.effect_values import simulate, trace

INERTIA, GAP = 0.2, 1e-3


def values(resonance: float, ratio: float, gap: float = GAP) -> dict[str, float]:
    """Parameters from the resonance in contact (Hz) and its damping ratio."""
    stiffness = INERTIA * (2 * math.pi * resonance) ** 2
    return {"gap": gap, "stiffness": stiffness, "damping": 2 * ratio * math.sqrt(stiffness * INERTIA)}


def under(load: list[float]) -> list[dict[str, float]]:
    beside = {"link_inertia": INERTIA, "coupling": INERTIA, "coupling_rate": 0.0, "coupling_slope": 0.0}
    return [{"load": x, **beside} for x in load]


def reference(p: dict[str, float], load: Callable[[float], float], t: Array) -> Array:
    """(2, N) deflection and rate, by an integrator that is stopped short at every sample of 20 us."""

    def contact(x: float, rate: float) -> float:
        deep = abs(x) - p["gap"] / 2
        side = math.copysign(1, x)
        return side * max(0.0, p["stiffness"] * deep + p["damping"] * side * rate) if deep > 0 else 0.0

    start = load(0) / p["stiffness"] + math.copysign(p["gap"] / 2, load(0))
    solved = solve_ivp(
        lambda at, x: [x[1], (load(at) - contact(*x)) / INERTIA],
        (0, t[-1] + 1e-9),
        [start, 0.0],
        t_eval=t,
        max_step=2e-5,
        rtol=1e-6,
        atol=1e-10,
    )
    return np.asarray(solved.y)


@pytest.mark.parametrize(
    ("resonance", "ratio", "dt"),
    [(15, 0.05, 1e-3), (60, 0.2, 1e-3), (60, 0.05, 1e-3), (150, 0.2, 1e-3), (150, 0.2, 2e-4)],
)
def test_gap_is_crossed_as_an_integration_says(resonance: float, ratio: float, dt: float) -> None:
    def load(t: float) -> float:
        return 4 * math.cos(2 * math.pi * 1.5 * t)

    t = np.arange(0, 0.5, dt)
    p = values(resonance, ratio)
    found = trace("backlash", p, dt, under([load(x) for x in t]))
    expected = reference(p, load, t)
    deflection = np.array([x["deflection"] for x in found])
    assert np.ptp(expected[0]) > GAP
    # A flank that is left within a step holds the link back for the rest of it: of second order in the step. Few
    # bounces stay below a quarter of this.
    assert np.abs(deflection - expected[0]).max() < (2 * math.pi * resonance * dt) ** 2 * GAP
    # What the motor feels is the whole change of the link's momentum, impacts included.
    momentum = -np.cumsum([x["torque"] for x in found]) * dt
    rate = np.array([x["rate"] for x in found])
    assert np.abs(momentum - INERTIA * rate).max() < 0.6 * INERTIA * np.abs(np.diff(rate)).max()


def test_free_flight_lacks_the_load_for_the_time_of_the_gap() -> None:
    load, dt = 4.0, 1e-3
    gap = 9e-3
    p = values(2000.0, 0.5, gap)
    torque = simulate("backlash", p, dt, under([-load] * 10 + [load] * 60))
    flight = math.sqrt(2 * gap * INERTIA / load)  # 30 ms
    start = 12  # the load's jump, continued in a straight line, is over
    assert torque[start + 1 : 9 + round(flight / dt)] == pytest.approx([-load] * (round(flight / dt) - 4))
    assert sum(torque[12 + round(flight / dt) :]) > 0
    assert torque[-1] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("load", [-7.0, 0.0, 7.0])
def test_rest_on_a_flank_or_between_them_adds_nothing(load: float) -> None:
    assert max(map(abs, simulate("backlash", values(60, 0.1), 1e-3, under([load] * 30)))) < 1e-9


@pytest.mark.parametrize("frequency", [3.0, 9.0, 20.0])
def test_without_a_gap_the_link_moves_as_behind_a_spring(frequency: float) -> None:
    samples = under([3 * math.sin(2 * math.pi * frequency * k * 1e-3) for k in range(400)])
    p = values(16, 0.0, gap=0.0)
    spring = trace("elasticity", {k: p[k] for k in ("stiffness", "damping")}, 1e-3, samples)
    closed = trace("backlash", p, 1e-3, samples)
    largest = max(abs(x["deflection"]) for x in spring)
    assert [x["deflection"] for x in closed] == pytest.approx([x["deflection"] for x in spring], abs=1e-9 * largest)
    # The torque is read from the rates: second order, (omega dt)^2 of it at the faster of load and resonance.
    high = max(abs(x["torque"]) for x in spring)
    error = max(abs(a["torque"] - b["torque"]) for a, b in zip(closed[5:], spring[5:], strict=True))
    assert error < 2 * (2 * math.pi * max(frequency, 16) * 1e-3) ** 2 * high


def test_smaller_gaps_tend_to_a_spring() -> None:
    samples = under([3 * math.sin(2 * math.pi * 5 * k * 1e-3) for k in range(400)])
    p = values(16, 0.02)
    spring = trace("elasticity", {k: p[k] for k in ("stiffness", "damping")}, 1e-3, samples)
    errors = []
    for gap in (1e-3, 1e-4, 1e-5):
        found = trace("backlash", p | {"gap": gap}, 1e-3, samples)
        errors.append(max(abs(a["deflection"] - b["deflection"]) for a, b in zip(found, spring, strict=True)))
    assert errors[0] > 4 * errors[1]
    # What stays with the last is that a flank does not pull: the damping ratio of 0.02, of a swing of 2 mrad.
    assert errors[2] < 1e-4


@settings(max_examples=40, deadline=None)
@given(
    resonance=st.floats(5, 1e6),
    ratio=st.floats(0, 2),
    gap=st.floats(0, 0.02),
    dt=st.floats(1e-4, 1e-2),
    load=st.floats(0.1, 9),
)
def test_released_link_only_loses_energy(resonance: float, ratio: float, gap: float, dt: float, load: float) -> None:
    """No load after the first samples: kinetic and elastic energy fall at any stiffness and step."""
    p = values(resonance, ratio, gap)
    found = trace("backlash", p, dt, under([load] * 3 + [0.0] * 60))[5:]
    stored = [max(abs(x["deflection"]) - gap / 2, 0.0) for x in found]
    energy = [
        INERTIA * x["rate"] ** 2 / 2 + p["stiffness"] * deep**2 / 2 for x, deep in zip(found, stored, strict=True)
    ]
    for before, after in itertools.pairwise(energy):
        # A flank's place is known to its rounding, which weighs by the stiffness.
        assert after <= before * (1 + 1e-6) + p["stiffness"] * (1e-14 * (gap + 1e-3)) ** 2 + 1e-12


@settings(max_examples=40, deadline=None)
@given(
    loads=st.lists(st.floats(-10, 10), min_size=5, max_size=40),
    resonance=st.floats(5, 1e6),
    ratio=st.floats(0, 2),
    gap=st.floats(0, 0.05),
    dt=st.floats(1e-4, 1e-1),
)
def test_any_load_stiffness_and_step_stay_bounded(
    loads: list[float], resonance: float, ratio: float, gap: float, dt: float
) -> None:
    found = trace("backlash", values(resonance, ratio, gap), dt, under(loads))
    assert all(math.isfinite(x["torque"]) for x in found)
    # Even without any contact the momentum is at most the impulse of the loads, three times it as continued.
    assert max(INERTIA * abs(x["rate"]) for x in found) <= 3 * 10 * dt * len(loads) + 1e-9
