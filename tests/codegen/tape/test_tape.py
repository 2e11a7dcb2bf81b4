"""The tape: what is counted, shared, folded and removed."""

from __future__ import annotations

from fractions import Fraction

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen.tape.tape import Tape
from symbolic.model import derive
from symbolic.model_file.arm import Arm
from symbolic.primitives import ramp, step

X, Y, Z = sp.symbols("x y z", real=True)
W = sp.Symbol("w", positive=True)
EXACT = {"const": lambda value: value, "max": max, "min": min}
SWITCHES = {"gate": lambda x, a: a if x > 0 else 0.0, "side": lambda x, a, b: a if x > 0 else b if x < 0 else 0.0}


def tape(*expressions: sp.Expr, definitions: tuple = ()) -> Tape:
    return Tape.from_expressions(expressions, definitions, (X, Y, Z))


def arithmetic(*expressions: sp.Expr) -> int:
    return tape(*expressions).count()["arithmetic"]


@pytest.mark.parametrize(
    ("expressions", "count"),
    [
        ((X + Y + Z,), 2),
        ((X - Y,), 1),
        ((Y - X, X - Y), 2),  # a difference and its negation
        ((-X,), 1),
        ((-X - Y,), 2),
        ((Z - X * Y,), 2),
        ((2 * X + 2 * Y,), 2),  # SymPy's spreading of the 2 is undone
        ((X**4,), 2),
        ((X**3 * Y,), 3),
        ((1 / X,), 1),
        ((X / Y,), 1),
        ((X * Y / Z,), 2),
        ((X * Y + Z, X * Y - Z), 3),
        ((3 * X / 2,), 1),
        ((sp.Integer(0),), 0),
    ],
)
def test_count(expressions: tuple[sp.Expr, ...], count: int) -> None:
    assert arithmetic(*expressions) == count


def test_sine_and_cosine_of_an_angle_are_one() -> None:
    count = tape(sp.sin(X + Y), sp.cos(X + Y), sp.cos(-X - Y), sp.sin(Z)).count()
    assert count["sincos"] == 2
    assert count["arithmetic"] == 1


def test_what_the_recursion_names_keeps_its_name(vishard4: Arm) -> None:
    """Forces, moments, rates and directions; only what no output needs or what is an input has none."""
    model = derive(vishard4)
    names = set(Tape.of(model.function("inverse_dynamics")).names.values())
    assert {"F2", "F3", "F4", "G3", "N2", "N3", "N4", "w3", "al4", "b3", "y3", "hc4", "hs4", "lc3", "ls3"} <= names
    assert {"c2", "s2", "c3", "s3", "c34", "s34"} <= names
    assert {"D21", "D22", "c234"} <= set(Tape.of(model.function("inertia")).names.values())
    for function in model.functions:
        found = Tape.of(function).names
        assert len(set(found.values())) == len(found), function.name


def test_a_name_stands_for_a_value_with_its_sign() -> None:
    """b - a is kept as a - b, once: what is called after it would have the other sign."""
    d = sp.Symbol("d", real=True)
    turned = tape(X - Y, d * Z, definitions=((sp.Symbol("e", real=True), X - Y), (d, Y - X)))
    assert [turned.names.get(i) for i, n in enumerate(turned.nodes) if n.op == "sub"] == ["e"]
    assert "d" not in turned.names.values()


def test_constants_are_folded_exactly() -> None:
    a = sp.Symbol("a")
    folded = tape(a / 7, definitions=((a, 3 * X),))
    assert [n.value for n in folded.nodes if n.op == "const"] == [Fraction(3, 7)]
    assert folded.count()["arithmetic"] == 1


def test_decimals_are_what_was_written() -> None:
    """3 times 0.1 is 3/10, without a ghost of binary rounding."""
    a = sp.Symbol("a")
    folded = tape(3 * a, definitions=((a, sp.Float(0.1) * X),))
    assert [n.value for n in folded.nodes if n.op == "const"] == [Fraction(3, 10)]


def test_dead_definitions_are_removed() -> None:
    a, b = sp.symbols("a b")
    kept = tape(a, definitions=((a, X + Y), (b, sp.sin(X))))
    assert kept.count() == {"arithmetic": 1, "sincos": 0, "add": 1}


def test_an_unknown_symbol_is_named() -> None:
    with pytest.raises(ValueError, match="expression: w is neither an input"):
        tape(sp.Symbol("w") + X)


def test_an_unknown_operation_is_named() -> None:
    with pytest.raises(ValueError, match="no target can evaluate besselj"):
        tape(sp.besselj(X, Y))


def test_what_one_sign_switches_is_compared_once() -> None:
    """A spring with pretension; friction of two sides."""
    spring = tape(Y * step(X, W) + Z * ramp(X, W))
    assert spring.count() == {"arithmetic": 2, "sincos": 0, "add": 1, "mul": 1, "gate": 1}
    friction = tape(Y * step(X, W) - Z * step(-X, W))
    assert friction.count() == {"arithmetic": 1, "sincos": 0, "neg": 1, "side": 1}
    for x, pulls, rubs in ((0.5, 3.5, 2.0), (-0.5, 0.0, -3.0), (0.0, 0.0, 0.0)):
        values = {X: x, Y: 2.0, Z: 3.0}
        assert spring.evaluate(values, SWITCHES) == [pulls]
        assert friction.evaluate(values, SWITCHES) == [rubs]


def test_an_exponential_that_rises_to_one() -> None:
    """1 - exp(-|x|) is one operation; of an argument of any sign it is not."""
    assert tape(1 - sp.exp(-sp.Abs(X))).count() == {"arithmetic": 0, "sincos": 0, "abs": 1, "rise": 1}
    assert "rise" not in tape(1 - sp.exp(-X)).count()


numbers = st.fractions(-5, 5, max_denominator=12)


@st.composite
def polynomials(draw: st.DrawFn) -> sp.Expr:
    leaf = st.one_of(st.sampled_from([X, Y, Z]), numbers.map(lambda f: sp.Rational(f.numerator, f.denominator)))
    pairs = lambda inner: st.tuples(st.sampled_from("+-*^"), inner, inner)  # noqa: E731

    def build(tree: object) -> sp.Expr:
        if not isinstance(tree, tuple):
            return sp.sympify(tree)
        op, left, right = tree[0], build(tree[1]), build(tree[2])
        return {"+": left + right, "-": left - right, "*": left * right, "^": left**3 - right}[op]

    return build(draw(st.recursive(leaf, pairs, max_leaves=8)))


@given(st.lists(polynomials(), min_size=1, max_size=3), numbers, numbers, numbers)
@settings(max_examples=80, deadline=None)
def test_evaluates_exactly(expressions: list[sp.Expr], x: Fraction, y: Fraction, z: Fraction) -> None:
    """Over the rationals, a tape and SymPy agree to the last digit."""
    values = {X: x, Y: y, Z: z}
    found = tape(*expressions).evaluate(values, EXACT)
    exact = {s: sp.Rational(v.numerator, v.denominator) for s, v in values.items()}
    for expr, value in zip(expressions, found, strict=True):
        wanted = expr.subs(exact)
        assert sp.Rational(value.numerator, value.denominator) == wanted


def test_magnitude_is_the_sum_of_terms() -> None:
    assert tape(X - Y).magnitude({X: 3.0, Y: 3.0}) == [6.0]
    assert tape(X * Y - 2 * Z).magnitude({X: 3.0, Y: -2.0, Z: 1.0}) == [8.0]
    # 1/(x - y) close to its pole: the scale grows with the condition number, twice.
    assert tape(1 / (X - Y)).magnitude({X: 1.0, Y: 0.5}) == [2.0 * 3.0]
