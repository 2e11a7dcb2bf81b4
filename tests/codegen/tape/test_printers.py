"""Spelling: parentheses, powers, literals, names."""

from __future__ import annotations

import struct
from fractions import Fraction

import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from codegen.c.c_code import C_DOUBLE, C_FLOAT, float32, identifier
from codegen.casadi.casadi_code import CASADI
from codegen.tape.printers import Printer, float64
from codegen.tape.tape import Tape

X, Y, P = sp.symbols("x y p", real=True)


def c(expr: sp.Expr, language: object = C_DOUBLE) -> tuple[list[str], str]:
    tape = Tape.from_expressions([expr], (), (X, Y, P))
    lines, (text,) = Printer(language, tape, {X: "x0", Y: "y0", P: "p0"}, frozenset()).print()
    return lines, text


@pytest.mark.parametrize(
    ("expr", "text"),
    [
        (X - (Y - P), "x0 + p0 - y0"),
        (X * (Y + P), "x0 * (y0 + p0)"),
        (X / (Y * P), "x0 / (p0 * y0)"),
        (-(X + Y) * P, "-(p0 * (x0 + y0))"),
        (X / 2, "0.5 * x0"),
        (sp.Max(X, -3), "tendon_max_f64(-3.0, x0)"),
    ],
)
def test_parentheses(expr: sp.Expr, text: str) -> None:
    lines, found = c(expr)
    value = eval(
        found.replace("tendon_max_f64", "max"), {"x0": 3.0, "y0": 5.0, "p0": 7.0, "max": max}
    )  # a string of ours
    assert not lines
    assert value == pytest.approx(float(expr.subs({X: 3, Y: 5, P: 7})))
    assert sorted(found) == sorted(text)


def test_an_unrolled_power_is_parenthesised() -> None:
    """exp(-y*y/p*p) compiles as well, and is another function."""
    lines, text = c(sp.exp(-(Y**2) / P**2))
    assert not lines
    assert text == "tendon_exp_f64(-(y0 * y0 / (p0 * p0)))"


def test_no_power_of_a_whole_number() -> None:
    lines, text = c(X**7 + X**2)
    assert "pow" not in "".join([*lines, text])


def test_general_powers_keep_zero() -> None:
    assert c(sp.Abs(X) ** P)[1] == "tendon_pow_f64(tendon_abs_f64(x0), p0)"


def test_sine_and_cosine_come_together() -> None:
    lines, text = c(sp.sin(X) * Y + sp.cos(X))
    assert lines == ["double sin_1;", "double cos_1;", "tendon_sincos_f64(x0, &sin_1, &cos_1);"]
    assert {"sin_1", "cos_1"} < set(text.replace(" * ", " ").replace(" + ", " ").split())


def test_casadi_knows_its_own_names() -> None:
    assert c(sp.Min(X, Y) + sp.exp(P), CASADI)[1].replace(" ", "") in (
        "ca.fmin(x0,y0)+ca.exp(p0)",
        "ca.exp(p0)+ca.fmin(x0,y0)",
    )


def test_temporaries_do_not_hide_arguments() -> None:
    tape = Tape.from_expressions([(X + Y) ** 2], (), (X, Y))
    lines, _ = Printer(C_DOUBLE, tape, {X: "t1", Y: "y0"}, frozenset({"t1"})).print()
    assert lines == ["const double t1_ = t1 + y0;"]


@given(st.fractions(-1_000_000, 1_000_000))
def test_literals_read_back(value: Fraction) -> None:
    double = value.numerator / value.denominator
    assert float(float64(value)) == double
    single = struct.unpack("<f", struct.pack("<f", double))[0]
    text = float32(value)
    assert text.endswith("f")
    assert "." in text or "e" in text
    assert struct.unpack("<f", struct.pack("<f", float(text[:-1])))[0] == single


def test_float_has_float_literals() -> None:
    assert c(X / 3, C_FLOAT)[1] == "0.33333334f * x0"


@pytest.mark.parametrize("name", ["", "1a", "a b", "a;b", "double", "lambda", "q̇", "count"])
def test_not_identifiers(name: str) -> None:
    assert not identifier(name)
