"""A CasADi function at many places at once: the same bits as CasADi's own, one place after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from codegen.casadi.machine import LANES, OPERATIONS
from runtime.model.loader import Library
from runtime.model.batch import Batch, Instructions, Machine

Binary = Callable[[ca.SX, ca.SX], ca.SX]

EXPRESSIONS: dict[str, Binary] = {
    "sum": lambda x, y: x + y,
    "difference": lambda x, y: x - y,
    "product": lambda x, y: x * y,
    "quotient": lambda x, y: x / y,
    "power": lambda x, y: ca.fabs(x) ** y,
    "constant power": lambda x, y: ca.fabs(x * y) ** 2.7,
    "square": lambda x, y: x**2 + 2 * y,
    "roots and inverse": lambda x, y: ca.sqrt(ca.fabs(x)) + 1 / y,
    "circular": lambda x, y: ca.sin(x) + ca.cos(y) * ca.tan(x),
    "arcs": lambda x, y: -ca.asin(x / 4) * ca.acos(y / 4) + ca.atan(x) - ca.atan2(x, y),
    "hyperbolic": lambda x, y: ca.sinh(x) - ca.cosh(y) + ca.tanh(x),
    "areas": lambda x, y: ca.asinh(x) + ca.acosh(2 + y**2) + ca.atanh(x / 4),
    "exponential": lambda x, y: -ca.exp(x) + ca.log(ca.fabs(y)) + ca.log1p(ca.fabs(x)) + ca.expm1(y),
    "comparisons": lambda x, y: (x < y) + 2 * (x <= y) + 4 * (x == y) + 8 * (x != y),
    "logic": lambda x, y: ca.logic_and(x > 0, y > 0) + 2 * ca.logic_or(x > 0, y > 0) + 4 * ca.logic_not(x > 0),
    "steps": lambda x, y: ca.floor(x) + 10 * ca.ceil(y) + 100 * ca.sign(x),
    "remainder": lambda x, y: ca.fmod(x, y) + ca.copysign(x, y),
    "either": lambda x, y: ca.if_else(x > y, ca.sin(x), ca.cos(y)),
    "least and most": lambda x, y: ca.fmin(x, y) + 3 * ca.fmax(x, y),
    "others": lambda x, y: ca.hypot(-ca.erf(x), -y),
}


def assert_same(library: Library, function: ca.Function, inputs: Sequence[np.ndarray]) -> None:
    """Of inputs (N, size) each."""
    batch = Batch(Machine(library.machine), Instructions.of(function), len(inputs[0]))
    found = batch(*inputs)
    for k in range(len(inputs[0])):
        expected = function.call([ca.DM(values[k]) for values in inputs])
        for own, one in zip(found, expected, strict=True):
            np.testing.assert_array_equal(own[k].T, ca.densify(one).full())


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_every_operation_and_its_slope_is_casadis(library: Library, name: str) -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    value = EXPRESSIONS[name](x, y)
    function = ca.Function("f", [x, y], [value, ca.jacobian(value, ca.vertcat(x, y))])
    rng = np.random.default_rng(0)
    points = [rng.uniform(-3.0, 3.0, (50, 1)), rng.uniform(-3.0, 3.0, (50, 1))]
    points[1][:5] = points[0][:5]
    assert_same(library, function, points)


@given(count=st.integers(1, 3 * LANES + 1), rows=st.integers(1, 4), columns=st.integers(1, 3))
def test_any_number_of_places_and_shapes(library: Library, count: int, rows: int, columns: int) -> None:
    a, b = ca.SX.sym("a", rows), ca.SX.sym("b", columns)
    sparse = ca.SX(rows, columns)
    sparse[0, columns - 1] = ca.dot(a, a) * 0.1
    function = ca.Function("f", [a, b], [a @ b.T, sparse, ca.sumsqr(b) + 2.5])
    rng = np.random.default_rng(count)
    assert_same(library, function, [rng.standard_normal((count, rows)), rng.standard_normal((count, columns))])


def test_without_rows_there_is_nothing(library: Library) -> None:
    x = ca.SX.sym("x", 2)
    without = Instructions.of(ca.Function("f", [x], [ca.SX(0, 1), ca.dot(x, x)]))
    found = Batch(Machine(library.machine), without, 3)(np.zeros((3, 2)))
    assert found[0].size == 0
    assert found[1].shape == (3, 1, 1)


def test_an_operation_that_the_machine_has_not_is_no_number(library: Library) -> None:
    x = ca.SX.sym("x")
    with pytest.raises(NotImplementedError, match="none of"):
        Batch(Machine(library.machine), Instructions.of(ca.Function("f", [x], [ca.erfinv(x)])), 1)


def test_the_expressions_here_are_of_all_operations() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    functions = [ca.Function("f", [x, y], [build(x, y)]) for build in EXPRESSIONS.values()]
    seen = {f.instruction_id(k) for f in functions for k in range(f.n_instructions())}
    assert {name for name in OPERATIONS if getattr(ca, f"OP_{name}") not in seen} <= {"ASSIGN"}
