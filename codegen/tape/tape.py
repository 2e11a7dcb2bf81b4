"""Expressions to one straight-line tape of binary operations.

Equal values are numbered once (commutative operands in one order, a difference in one direction), signs
travel with the reference until something needs them, numbers stay exact rationals until a printer rounds
them, and what no output needs is removed. What a recursion has named keeps its name.
"""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import sympy as sp

from codegen.tape import magnitude, sharing
from codegen.tape.lowering import Lowering, lower
from codegen.tape.numbering import ARITHMETIC, Node, Numbering
from symbolic import primitives
from symbolic.functions import SymbolicFunction


@dataclass(frozen=True)
class Tape:
    """nodes in order of evaluation; outputs: positions in `nodes`, flat, in the order of the function's outputs.

    names   position -> what the equations call that value; no name stands twice
    """

    nodes: tuple[Node, ...]
    outputs: tuple[int, ...]
    names: Mapping[int, str] = field(default_factory=dict)

    @classmethod
    def of(cls, function: SymbolicFunction, lowering: Lowering = "exact") -> Tape:
        """The shorter of the definitions as given and the definitions after a common-subexpression search."""
        expressions = [e for output in function.outputs for e in output.expressions]
        leaves = {s for argument in function.inputs for s in argument.symbols}
        if function.struct is not None:
            leaves |= set(function.struct.symbols)
        if lowering == "smooth":
            leaves |= set(primitives.WIDTHS)
        return cls.from_expressions(expressions, function.definitions, leaves, lowering, function.name)

    @classmethod
    def from_expressions(
        cls,
        expressions: Sequence[sp.Expr],
        definitions: Sequence[tuple[sp.Symbol, sp.Expr]],
        leaves: Iterable[sp.Symbol],
        lowering: Lowering = "exact",
        where: str = "expression",
    ) -> Tape:
        """ValueError names the function and the symbol or operation that no target can evaluate."""
        return _shorter(tuple(expressions), tuple(definitions), frozenset(leaves), lowering, where)

    def count(self) -> dict[str, int]:
        """Operations by kind; "arithmetic" is the sum of add, sub, mul, div and neg; "sincos" counts angles."""
        kinds = Counter(node.op for node in self.nodes)
        angles = {node.args[0] for node in self.nodes if node.op in ("sin", "cos")}
        count = {"arithmetic": sum(kinds[op] for op in ARITHMETIC), "sincos": len(angles)}
        others = sorted(set(kinds) - {"const", "leaf", "sin", "cos", *ARITHMETIC})
        return count | {op: kinds[op] for op in ARITHMETIC if kinds[op]} | {op: kinds[op] for op in others if kinds[op]}

    def cost(self) -> int:
        """Operations, a sine-cosine pair at its rough price of 20."""
        count = self.count()
        rest = sum(n for op, n in count.items() if op not in (*ARITHMETIC, "arithmetic", "sincos"))
        return count["arithmetic"] + 20 * (count["sincos"] + rest)

    def uses(self) -> list[int]:
        """How often each node is read, by other nodes and by outputs."""
        uses = [0] * len(self.nodes)
        for node in self.nodes:
            for arg in node.args:
                uses[arg] += 1
        for output in self.outputs:
            uses[output] += 1
        return uses

    def evaluate(self, values: Mapping[sp.Symbol, Any], operations: Mapping[str, Callable[..., Any]]) -> list[Any]:
        """Outputs for numbers of any kind; `operations` supplies "const" (of a Fraction) and what is not arithmetic."""
        table = _ARITHMETIC | dict(operations)
        results: list[Any] = []
        for op, args, value in self.nodes:
            if len(args) == 2:
                results.append(table[op](results[args[0]], results[args[1]]))
            elif op == "leaf":
                results.append(values[value])
            elif op == "const":
                results.append(table["const"](value))
            else:
                results.append(table[op](*[results[a] for a in args]))
        return [results[i] for i in self.outputs]

    def magnitude(self, values: Mapping[sp.Symbol, float]) -> list[float]:
        """Sum of the absolute values of the terms of each output, the scale of its rounding errors.

        Sums add, products multiply; a quotient and an inner function carry the condition number of
        their argument, so that inverse maps are judged by how well they can be computed at all.
        """
        pairs: list[tuple[float, float]] = []
        for node in self.nodes:
            if node.op == "leaf":
                value = float(values[node.value])
                pairs.append((value, abs(value)))
            elif node.op == "const":
                pairs.append((float(node.value), abs(float(node.value))))
            else:
                # An angle that is an input as given has no error of its own to amplify.
                exact = node.op in ("sin", "cos") and self.nodes[node.args[0]].op == "leaf"
                pairs.append(
                    magnitude.scale(node.op, *(((pairs[a][0], 0.0) if exact else pairs[a]) for a in node.args))
                )
        return [pairs[i][1] for i in self.outputs]


@functools.cache
def _shorter(
    expressions: tuple[sp.Expr, ...],
    definitions: tuple[tuple[sp.Symbol, sp.Expr], ...],
    leaves: frozenset[sp.Symbol],
    lowering: Lowering,
    where: str,
) -> Tape:
    """See Tape.of. What several targets print in one run is searched once.

    A recursion names its values, which are sums and products of a few others. What is written as a whole, and with
    switches, has more in common than these: SymPy's search sees it.
    """
    outputs = [lower(e, lowering) for e in expressions]
    named = [(symbol, lower(e, lowering)) for symbol, e in definitions]
    program = Numbering(named, {}, leaves, where).program(outputs)
    plain = Tape(*program)
    if definitions and {node.op for node in plain.nodes} <= sharing.OPERATIONS:
        return min((plain, *(Tape(*found) for found in sharing.shorter(program))), key=Tape.cost)
    replacements, reduced = sp.cse(
        [e for _, e in named] + outputs, symbols=sp.numbered_symbols("cse_", cls=sp.Dummy), order="none"
    )
    if not replacements:
        return plain
    shared = [(symbol, e) for (symbol, _), e in zip(named, reduced, strict=False)]
    searched = Tape(*Numbering(shared, dict(replacements), leaves, where).program(reduced[len(named) :]))
    return searched if searched.cost() < plain.cost() else plain


_ARITHMETIC: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
}
