"""Hysteresis in displacement: no rate, no sampling, memory of turning points, loss in every loop."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.effect_values import simulate

TORQUE, WIDTH = 1.3, 0.2
TURNS = st.lists(st.floats(-0.5, 0.5), min_size=2, max_size=8)


def along(path: list[float], dt: float = 1e-3) -> list[float]:
    return simulate("spring_hysteresis", {"torque": TORQUE, "width": WIDTH}, dt, [{"q": q} for q in path])


def legs(turns: list[float], points: list[int]) -> list[float]:
    """The path through the turning points, each leg in so many even steps."""
    path = turns[:1]
    for (start, end), n in zip(itertools.pairwise(turns), points, strict=True):
        path += [start + (end - start) * k / n for k in range(1, n)] + [end]
    return path


@settings(max_examples=40, deadline=None)
@given(turns=TURNS, data=st.data())
def test_loop_depends_neither_on_rate_nor_on_sampling(turns: list[float], data: st.DataObject) -> None:
    """The same turning points at another speed, in other steps and at another dt."""
    points = data.draw(st.lists(st.integers(1, 9), min_size=len(turns) - 1, max_size=len(turns) - 1))
    coarse = along(turns)
    fine = along(legs(turns, points), dt=7e-4)
    at = [0, *itertools.accumulate(points)]
    # Sums of up to 70 steps of order 1 in four elements.
    assert [fine[k] for k in at] == pytest.approx(coarse, abs=1e-13 * 70)


@settings(max_examples=40, deadline=None)
@given(turns=TURNS)
def test_torque_is_bounded_and_turns_over_on_twice_the_width(turns: list[float]) -> None:
    assert max(map(abs, along(turns))) <= TORQUE * (1 + 1e-12)
    assert along([*turns, turns[-1] + 2 * WIDTH])[-1] == pytest.approx(TORQUE)
    assert along([*turns, turns[-1] - 2 * WIDTH])[-1] == pytest.approx(-TORQUE)


@settings(max_examples=40, deadline=None)
@given(turns=TURNS)
def test_no_closed_loop_gives_energy(turns: list[float]) -> None:
    """Work over the second of two equal cycles, where the start is forgotten."""
    cycle = legs([*turns, turns[0]], [40] * len(turns))
    q, torque = np.array(cycle + cycle[1:]), np.array(along(cycle + cycle[1:]))
    second = slice(len(cycle) - 1, None)
    work = float(np.sum((torque[second][1:] + torque[second][:-1]) / 2 * np.diff(q[second])))
    # The trapezoid errs at the four kinks of each leg, by an eighth of torque, step squared and slope over torque.
    step = max(abs(b - a) for a, b in itertools.pairwise(cycle))
    assert work >= -(4 * len(turns) * step**2 / 8) * TORQUE / WIDTH


def test_saturated_loop_loses_what_its_elements_lose() -> None:
    amplitude = 1.5 * WIDTH
    cycle = legs([amplitude, -amplitude, amplitude], [42, 42])  # steps of a fourteenth of the width: kinks are hit
    torque = np.array(along([0.0, *cycle, *cycle[1:]]))[-len(cycle) :]
    work = float(np.sum((torque[1:] + torque[:-1]) / 2 * np.diff(cycle)))
    limits = [WIDTH * j / 7 for j in (1, 3, 5, 7)]
    assert work == pytest.approx(sum(4 * TORQUE / sum(limits) * w * (amplitude - w) for w in limits))


@settings(max_examples=40, deadline=None)
@given(inner=st.floats(0, 1), far=st.floats(0.05, 0.5))
def test_inner_loop_closes_where_it_began(inner: float, far: float) -> None:
    """Return-point memory, which one element with an exponential approach lacks."""
    path = [0.0, far, far * (1 - inner), far]
    torque = along(path)
    assert torque[3] == pytest.approx(torque[1], abs=1e-12)


def test_virgin_curve_is_a_parabola_and_narrow_hysteresis_is_dry_friction() -> None:
    part = np.linspace(0, 1, 29)
    torque = np.array(along(list(WIDTH * part)))
    x = part * 7 / 8
    assert np.abs(torque / TORQUE - (2 * x - x**2)).max() < 1 / 64 + 1e-12
    samples = [{"q": q} for q in (0.0, 0.1, 0.2, 0.1, -0.3, -0.2)]
    narrow = simulate("spring_hysteresis", {"torque": TORQUE, "width": 1e-6}, 1e-3, samples)
    assert narrow == pytest.approx([0.0, TORQUE, TORQUE, -TORQUE, -TORQUE, TORQUE])
