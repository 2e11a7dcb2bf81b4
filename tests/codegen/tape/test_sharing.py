"""The search for what sums and products share: the same values, never more operations."""

from __future__ import annotations

import operator
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen.tape.numbering import NumberedProgram, Numbering
from codegen.tape.tape import Tape, shorter

X = sp.symbols("x0:5", real=True)
Y = sp.symbols("y0:4", real=True)
EXACT: dict[str, Callable[..., Any]] = {"const": Fraction, "div": lambda a, b: Fraction(a) / b, "neg": operator.neg}
AT = dict(zip(X, map(Fraction, (3, -7, 11, 19, -23)), strict=True))

terms = st.lists(st.tuples(st.sampled_from([-2, -1, 1, 3]), st.lists(st.sampled_from(X), min_size=1, max_size=4)))
sums = st.lists(terms.filter(bool), min_size=1, max_size=5)


def program(expressions: list[sp.Expr], definitions: tuple[tuple[sp.Symbol, sp.Expr], ...] = ()) -> NumberedProgram:
    return Numbering(definitions, {}, frozenset(X), "test").program(expressions)


def operations(found: NumberedProgram) -> int:
    return Tape(*found).count()["arithmetic"]


@settings(deadline=None, max_examples=150)
@given(sums, sums)
def test_the_values_stay_and_no_operation_is_added(named: list[Any], given: list[Any]) -> None:
    """Sums of products of few symbols, some of them named, which have much in common."""
    laws = [sum((c * sp.Mul(*f) for c, f in terms), sp.Integer(0)) for terms in named[:4]]
    definitions = tuple(zip(Y, laws, strict=False))
    outputs = [sum((c * sp.Mul(*f) for c, f in terms), sp.Add(*Y[: len(laws)])) for terms in given]
    plain = program(outputs, definitions)
    assert Tape.from_expressions(outputs, definitions, X).cost() <= Tape(*plain).cost()
    for found in shorter(plain):
        assert Tape(*found).evaluate(AT, EXACT) == Tape(*plain).evaluate(AT, EXACT)
        assert set(found.names.values()) <= {y.name for y in Y}


def test_what_stands_between_others_is_found() -> None:
    """a + c in a + b + c and a + c + d up to the sign, b d in products of three."""
    a, b, c, d, e = X
    assert operations(program([a + b + c, d * e - a - c])) == 5
    assert min(map(operations, shorter(program([a + b + c, d * e - a - c])))) == 4
    assert min(map(operations, shorter(program([a * b * d, b * c * d, b * d * e])))) == 4


def test_a_square_is_a_pair() -> None:
    a, b, c, *_ = X
    assert min(map(operations, shorter(program([a**2 * b, a**2 * c])))) == 3
