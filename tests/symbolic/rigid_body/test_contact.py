"""The coordinates of the contact phase: exact identities, and the inverse map in floating point."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import exact
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from codegen.tape.tape import Tape
from symbolic.functions import Turn
from symbolic.rigid_body.kinematics import has_contact_phase

CASE = exact.case(exact.chain_of("RRRR"))
L1, L2 = Fraction("0.23"), Fraction("0.17")
RIGHT_ANGLE = Turn(Fraction(0), Fraction(1))


def matrix_product(a: list[list[Any]], b: list[Any]) -> list[Any]:
    return [sum((x * y for x, y in zip(row, b, strict=True)), Fraction(0)) for row in a]


def determinant(rows: list[list[Fraction]]) -> sp.Rational:
    return sp.Matrix([[sp.Rational(x.numerator, x.denominator) for x in row] for row in rows]).det()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("upright", [False, True])
def test_determinant_is_l1_l2_sin_q2(seed: int, upright: bool) -> None:
    q = CASE.point(seed)["q"]
    if upright:
        q[0] = RIGHT_ANGLE
    expected = L1 * L2 * q[1].sin
    assert determinant(CASE.matrix("contact_jacobian", q=q)) == sp.Rational(expected.numerator, expected.denominator)


@pytest.mark.parametrize("seed", range(5))
def test_jacobian_and_bias_are_derivatives_of_the_map(seed: int) -> None:
    """Second route: dual numbers through φ's lengths and through J_w; link 3's angle is a plain sum."""
    state = CASE.point(seed)
    q, qd = state["q"], state["qd"]
    J = CASE.matrix("contact_jacobian", q=q)
    turning = [exact.moving(x, v) for x, v in zip(q, qd, strict=True)]
    known: dict[sp.Expr, Any] = {}
    f = CASE.model.function("contact_coordinates")
    values = CASE.values(q=turning)
    for symbol, expr in f.definitions:
        values[symbol] = exact.evaluate(expr, values, known)
    w = [exact.evaluate(e, values, known) for e in f.outputs[0].expressions[:2]]
    wd = matrix_product(J, qd)
    assert wd[:2] == [x.slope for x in w]
    assert wd[2:] == [qd[0] + qd[1] + qd[2], qd[3]]
    rates = [[exact.Dual.of(e).slope for e in row] for row in CASE.matrix("contact_jacobian", q=turning)]
    assert CASE.call("contact_bias", q=q, qd=qd) == matrix_product(rates, qd)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("upright", [False, True])
def test_acceleration_solves_the_second_derivative(seed: int, upright: bool) -> None:
    state = CASE.point(seed)
    q, qd, qdd = state["q"], state["qd"], state["qdd"]
    if upright:
        q[0] = RIGHT_ANGLE
    bias = CASE.call("contact_bias", q=q, qd=qd)
    wdd = [a + b for a, b in zip(matrix_product(CASE.matrix("contact_jacobian", q=q), qdd), bias, strict=True)]
    assert CASE.call("contact_acceleration", q=q, qd=qd, wdd=wdd) == qdd


def test_acceleration_is_a_structured_solve() -> None:
    """A structured solve takes about 48 operations; elimination of the 4 × 4 system several times that."""
    f = CASE.model.function("contact_acceleration")
    assert Tape.of(f).count()["arithmetic"] <= 49


_WIDE = st.floats(-math.pi, math.pi)
_BENT = st.floats(0.05, math.pi - 0.05)


@given(q1=_WIDE, q2=_BENT, q3=_WIDE, q4=_WIDE, elbow=st.sampled_from([1.0, -1.0]))
def test_inverse_map_inverts(q1: float, q2: float, q3: float, q4: float, elbow: float) -> None:
    """Tolerance: rounding of w, 1e-16, times the map's condition, at most about 1/(l sin² q_2) = 2000 at the edges."""
    q = [q1, elbow * q2, q3, q4]
    w = FLOATS["contact_coordinates"](q)
    back = FLOATS["contact_inverse"](w, [elbow])
    assert all(
        math.isclose(math.remainder(a - b, 2 * math.pi), 0.0, abs_tol=1e-11) for a, b in zip(back, q, strict=True)
    )
    assert FLOATS["contact_coordinates"](back) == pytest.approx(w, abs=1e-12)


def test_only_arms_with_four_turning_joints_have_it() -> None:
    assert has_contact_phase(CASE.layout.metric)
    for types in ("RRR", "RRPR", "RRRRR"):
        assert "contact_inverse" not in [f.name for f in exact.derive(exact.chain_of(types)).functions]


FLOATS = {name: exact.in_floats(CASE.model, name) for name in ("contact_coordinates", "contact_inverse")}
