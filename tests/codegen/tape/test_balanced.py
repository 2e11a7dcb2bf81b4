"""Sums in another order: as many operations, the same value, a shorter chain."""

from __future__ import annotations

from fractions import Fraction

import pytest
import spatial_arms
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st
from random_arms import MIXED

from codegen.tape.tape import Tape, balanced
from symbolic.model import derive
from symbolic.model_file.arm import Arm

LEAVES = sp.symbols("a:6", real=True)
EXACT = {"const": Fraction}
terms = st.lists(st.tuples(st.sampled_from([1, -1]), st.sampled_from(LEAVES), st.sampled_from(LEAVES)), min_size=1)


def operations(tape: Tape) -> tuple[int, int]:
    """A difference of two terms may be a sum elsewhere."""
    count = tape.count()
    return count["arithmetic"], count["sincos"]


def longest(tape: Tape) -> int:
    """Operations in the longest chain."""
    chains: list[int] = []
    for node in tape.nodes:
        chains.append(max((chains[a] + 1 for a in node.args), default=0))
    return max(chains[i] for i in tape.outputs)


@given(st.lists(terms, min_size=1, max_size=4), st.lists(st.fractions(-9, 9), min_size=6, max_size=6))
def test_the_value_is_exactly_the_same(sums: list[list[tuple[int, sp.Symbol, sp.Symbol]]], at: list[Fraction]) -> None:
    definitions, before = [], LEAVES[0]
    for k, products in enumerate(sums):
        symbol = sp.Symbol(f"s{k}", real=True)
        definitions.append((symbol, before + sum(sign * a * b for sign, a, b in products)))
        before = symbol
    tape = Tape.from_expressions([before, before * LEAVES[1]], definitions, LEAVES)
    other, values = balanced(tape), dict(zip(LEAVES, at, strict=True))
    assert other.evaluate(values, EXACT) == tape.evaluate(values, EXACT)
    assert operations(other) == operations(tape)
    assert longest(other) <= longest(tape)


@pytest.mark.parametrize("arm", [MIXED["rprrp"], spatial_arms.known("panda")], ids=lambda arm: arm.name)
def test_names_stay_and_the_chain_is_shorter(arm: Arm) -> None:
    tape = Tape.of(derive(arm).function("inverse_dynamics"))
    other = balanced(tape)
    assert operations(other) == operations(tape)
    assert sorted(other.names.values()) == sorted(tape.names.values())
    assert longest(other) < 0.9 * longest(tape)
