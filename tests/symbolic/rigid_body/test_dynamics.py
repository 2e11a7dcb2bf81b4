"""The emitted dynamics equal the Lagrangian of the model file's masses, exactly, and have its properties.

Everything in this file that says == compares fractions: there are no tolerances but in the two tests that integrate
or rescale in floating point.
"""

from __future__ import annotations

from fractions import Fraction

import exact
import pytest
import sympy as sp

from codegen.tape.tape import Tape
from symbolic.functions import Turn

CASES = [(n, seed) for n in range(1, 8) for seed in range(4 if n < 6 else 3)]


@pytest.fixture(params=CASES, ids=lambda c: f"n{c[0]}-{c[1]}")
def case(request: pytest.FixtureRequest) -> exact.Case:
    return exact.random_case(*request.param)


def product(matrix: list[list[Fraction]], vector: list[Fraction]) -> list[Fraction]:
    return [sum((a * b for a, b in zip(row, vector, strict=True)), Fraction(0)) for row in matrix]


def test_recursion_on_lumps_is_the_lagrangian_of_the_physical_parameters(case: exact.Case) -> None:
    state = case.point(1)
    q, qd = state["q"], state["qd"]
    D, C, g = (case.true(part, q=q, qd=qd) for part in (case.truth.D, case.truth.C, case.truth.g))
    torque = [a + b + c for a, b, c in zip(product(D, state["qdd"]), product(C, qd), g, strict=True)]
    assert case.call("inverse_dynamics", **state) == torque
    assert product(case.matrix("regressor", **state), list(case.lumps)) == torque
    assert case.call("forward_dynamics", q=q, qd=qd, tau=torque) == state["qdd"]
    # and the closed forms that are emitted, entry by entry
    assert case.matrix("inertia", q=q) == D
    assert case.matrix("coriolis", q=q, qd=qd) == C
    assert case.call("gravity", q=q) == g


def test_inertia_is_symmetric_and_positive_definite(case: exact.Case) -> None:
    D = case.matrix("inertia", q=case.point(2)["q"])
    assert [list(column) for column in zip(*D, strict=True)] == D
    for k in range(case.n):  # exact elimination: all pivots positive
        assert D[k][k] > 0
        for i in range(k + 1, case.n):
            D[i] = [a - D[i][k] / D[k][k] * b for a, b in zip(D[i], D[k], strict=True)]


def test_rate_of_inertia_less_twice_coriolis_is_skew(case: exact.Case) -> None:
    state = case.point(3)
    q = [exact.moving(x, v) for x, v in zip(state["q"], state["qd"], strict=True)]
    rates = [[exact.Dual.of(e).slope for e in row] for row in case.matrix("inertia", q=q)]
    C = case.matrix("coriolis", q=state["q"], qd=state["qd"])
    skew = [[rates[i][j] - 2 * C[i][j] for j in range(case.n)] for i in range(case.n)]
    assert all(skew[i][j] == -skew[j][i] for i in range(case.n) for j in range(case.n))


def test_gravity_is_the_slope_of_the_potential(case: exact.Case) -> None:
    q = case.point(4)["q"]
    slopes = []
    for i in range(case.n):
        turned = [exact.moving(x, Fraction(int(i == j))) for j, x in enumerate(q)]
        slopes.append(exact.Dual.of(case.true(case.truth.V, q=turned)).slope)
    assert case.call("gravity", q=q) == slopes


@pytest.mark.parametrize("gravity", [(0.0, 0.0), (1.5, -9.0)])
def test_two_link_arm_as_in_the_textbook(gravity: tuple[float, float]) -> None:
    """A second route, written by hand in relative angles: Spong & Vidyasagar 1989, planar elbow manipulator."""
    arm = exact.chain_of("RR", gravity)
    case = exact.case(arm)
    state = case.point(5)
    (t1, t2), (v1, v2), (a1, a2) = state["q"], state["qd"], state["qdd"]
    l1, m1, m2 = Fraction("0.23"), Fraction("2.5"), Fraction("2.5")
    r1, r2, i1, i2, rotor = Fraction("0.11"), Fraction("0.11"), Fraction("0.012"), Fraction("0.012"), Fraction("0.3")
    gx, gy = (Fraction(str(x)) for x in gravity)
    d11 = m1 * r1**2 + m2 * (l1**2 + r2**2 + 2 * l1 * r2 * t2.cos) + i1 + i2
    d12 = m2 * (r2**2 + l1 * r2 * t2.cos) + i2
    d22 = m2 * r2**2 + i2
    h = -m2 * l1 * r2 * t2.sin
    t12 = t1 + t2
    g2 = m2 * r2 * (gx * t12.sin - gy * t12.cos)
    g1 = (m1 * r1 + m2 * l1) * (gx * t1.sin - gy * t1.cos) + g2
    assert case.call("inverse_dynamics", **state) == [
        (d11 + rotor) * a1 + d12 * a2 + h * v2 * v1 + h * (v1 + v2) * v2 + g1,
        d12 * a1 + (d22 + rotor) * a2 - h * v1 * v1 + g2,
    ]


def test_slider_on_a_turning_arm_by_hand() -> None:
    """Polar coordinates: radial r̈ − r ω², across r α + 2 ṙ ω; link 2's own frame slides along link 1's axis."""
    case = exact.case(exact.chain_of("RP"))
    state = case.point(6)
    (_, slide), (w, v), (al, a) = state["q"], state["qd"], state["qdd"]
    m, c, inertia, rotor = Fraction("2.5"), Fraction("0.11"), Fraction("0.012"), Fraction("0.3")
    r = Fraction("0.23") + slide + c
    turning = (m * c**2 + 2 * inertia + rotor) * al + m * r * (r * al + 2 * v * w)
    assert case.call("inverse_dynamics", **state) == [turning, m * (a - r * w**2) + rotor * a]


@pytest.mark.parametrize("types", ["R", "P", "RR", "RP", "PR", "PP", "RRR", "RPR", "PRP"])
def test_lumps_are_independent(types: str) -> None:
    """Base parameters: over a few states the regressor has full column rank."""
    case = exact.case(exact.chain_of(types, (2.0, -9.0), 0.02))
    rows = [row for seed in range(8) for row in case.matrix("regressor", **case.point(seed))]
    assert sp.Matrix([[sp.Rational(x.numerator, x.denominator) for x in row] for row in rows]).rank() == len(case.lumps)


@pytest.mark.parametrize(
    ("gravity", "operations", "pairs"),
    [((0.0, 0.0), 73, 3), ((0.0, -9.81), 83, 4), ((9.81, 0.0), 83, 4), ((3.0, -8.0), 83, 4)],
)
def test_four_joint_recursion_is_short(gravity: tuple[float, float], operations: int, pairs: int) -> None:
    """Rotor inertias at all four joints included; the limits asked for are 73 + 3 and 85 + 4."""
    f = exact.derive(exact.chain_of("RRRR", gravity)).function("inverse_dynamics")
    counted = Tape.of(f).count()
    assert counted["arithmetic"] <= operations
    assert counted["sincos"] <= pairs


@pytest.mark.parametrize(("types", "operations"), [("R", 1), ("P", 1), ("RR", 19), ("RRR", 47), ("RRRRR", 99)])
def test_other_recursions_are_short(types: str, operations: int) -> None:
    f = exact.derive(exact.chain_of(types)).function("inverse_dynamics")
    assert Tape.of(f).count()["arithmetic"] <= operations


def test_straight_angles_are_no_exception() -> None:
    """All joints at 0 and at 90° and 180°, where sines and cosines vanish."""
    case = exact.case(exact.chain_of("RRRR", (0.0, -9.81)))
    for turn in (Turn(Fraction(1), Fraction(0)), Turn(Fraction(0), Fraction(1)), Turn(Fraction(-1), Fraction(0))):
        state = case.point(7) | {"q": [turn] * 4}
        D, g = case.true(case.truth.D, q=state["q"]), case.true(case.truth.g, q=state["q"])
        state["qd"] = [Fraction(0)] * 4
        assert case.call("inverse_dynamics", **state) == [
            a + b for a, b in zip(product(D, state["qdd"]), g, strict=True)
        ]
