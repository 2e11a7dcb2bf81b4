"""Straight-line tapes of binary operations: from expressions, with shared operands, and with balanced sums.

Numbers are exact rationals until a printer rounds them. Values that a recursion names keep their names.
"""

from __future__ import annotations

import functools
import heapq
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import sympy as sp

from codegen.tape.numbering import ARITHMETIC, Lowering, Node, NumberedProgram, Numbering, Ref, lower
from symbolic import primitives
from symbolic.functions import SymbolicFunction

Pair = tuple[float, float]
"""A value and the sum of the absolute values of its terms."""


def _scaled(op: str, a: Pair, b: Pair = (0.0, 0.0), c: Pair = (0.0, 0.0)) -> Pair:
    """One operation on such pairs."""
    (x, mx), (y, my) = a, b
    if op in ("add", "sub"):
        return (x + y if op == "add" else x - y), mx + my
    if op == "mul":
        return x * y, mx * my
    if op == "div":
        return x / y, mx / abs(y) * (my / abs(y))
    if op in ("neg", "abs"):
        return (-x if op == "neg" else abs(x)), mx
    if op in ("sin", "cos"):
        value, slope = (math.sin(x), math.cos(x)) if op == "sin" else (math.cos(x), math.sin(x))
        return value, abs(value) + abs(slope) * mx
    if op in ("max", "min"):
        return (max(x, y) if op == "max" else min(x, y)), max(mx, my)
    if op in ("sgn", "step"):
        value = float((x > 0) - (x < 0)) if op == "sgn" else float(x > 0)
        return value, abs(value)
    if op == "gate":
        return b if x > 0 else (0.0, 0.0)
    if op == "side":
        return b if x > 0 else c if x < 0 else (0.0, 0.0)
    if op == "ramp":
        return max(x, 0.0), mx if x > 0 else 0.0
    return _transcendental(op, x, mx, y=y, my=my)


def _transcendental(op: str, x: float, mx: float, y: float, my: float) -> Pair:
    if op == "sqrt":
        value = math.sqrt(x)
        return value, value * (mx / x) if x > 0 else 0.0
    if op == "exp":
        value = math.exp(min(x, 700.0))
        return value, value * (1 + mx)
    if op == "rise":
        return -math.expm1(-x), 1.0 + math.exp(-x) * (1 + mx)
    if op == "log":
        return math.log(x), abs(math.log(x)) + mx / abs(x)
    if op == "atan2":
        value = math.atan2(x, y)
        return value, abs(value) + (abs(y) * mx + abs(x) * my) / (x * x + y * y)
    if x <= 0:
        return 0.0, 0.0
    value = x**y
    return value, value * (1 + abs(y) * mx / x + abs(math.log(x)) * my)


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
        """The tape of a function: the shorter one with and without a search for common subexpressions."""
        expressions = [e for output in function.outputs for e in output.expressions]
        leaves = {s for argument in function.inputs for s in argument.symbols}
        if function.struct is not None:
            leaves |= set(function.struct.symbols)
        if lowering == "smooth":
            leaves |= set(primitives.WIDTHS)
        return cls.from_expressions(expressions, function.definitions, leaves, lowering=lowering, where=function.name)

    @classmethod
    def from_expressions(
        cls,
        expressions: Sequence[sp.Expr],
        definitions: Sequence[tuple[sp.Symbol, sp.Expr]],
        leaves: Iterable[sp.Symbol],
        lowering: Lowering = "exact",
        where: str = "expression",
    ) -> Tape:
        """The same for expressions. Raises ValueError for a symbol or operation that no target can evaluate."""
        return _shorter(tuple(expressions), tuple(definitions), frozenset(leaves), lowering=lowering, where=where)

    def count(self) -> dict[str, int]:
        """Operations by kind; "arithmetic" is the sum of add, sub, mul, div and neg; "sincos" counts angles."""
        kinds = Counter(node.op for node in self.nodes)
        angles = {node.args[0] for node in self.nodes if node.op in ("sin", "cos")}
        count = {"arithmetic": sum(kinds[op] for op in ARITHMETIC), "sincos": len(angles)}
        others = sorted(set(kinds) - {"const", "leaf", "sin", "cos", *ARITHMETIC})
        return count | {op: kinds[op] for op in ARITHMETIC if kinds[op]} | {op: kinds[op] for op in others if kinds[op]}

    def cost(self) -> int:
        """Number of operations; a sine-cosine pair and other functions count as 20."""
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
        """Outputs for numbers of any kind. operations: "const" (of a Fraction) and everything but arithmetic."""
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
        """Sum of the absolute values of each output's terms, the scale of its rounding errors.

        Quotients and functions include the condition number of their argument, so that the scale of an inverse map
        reflects how accurately it can be computed.
        """
        pairs: list[tuple[float, float]] = []
        for node in self.nodes:
            if node.op == "leaf":
                value = float(values[node.value])
                pairs.append((value, abs(value)))
            elif node.op == "const":
                pairs.append((float(node.value), abs(float(node.value))))
            else:
                # An angle that is an input is exact.
                exact = node.op in ("sin", "cos") and self.nodes[node.args[0]].op == "leaf"
                pairs.append(_scaled(node.op, *(((pairs[a][0], 0.0) if exact else pairs[a]) for a in node.args)))
        return [pairs[i][1] for i in self.outputs]


@functools.cache
def _shorter(
    expressions: tuple[sp.Expr, ...],
    definitions: tuple[tuple[sp.Symbol, sp.Expr], ...],
    leaves: frozenset[sp.Symbol],
    lowering: Lowering,
    where: str,
) -> Tape:
    """See Tape.of; cached for several targets.

    For a recursion of sums and products the search is `shorter`. Closed forms and switches share more complex
    expressions, which SymPy's search finds.
    """
    outputs = [lower(e, lowering) for e in expressions]
    named = [(symbol, lower(e, lowering)) for symbol, e in definitions]
    program = Numbering(named, {}, leaves, where).program(outputs)
    plain = Tape(*program)
    if definitions and {node.op for node in plain.nodes} <= _SEARCHED:
        return min((plain, *(Tape(*found) for found in shorter(program))), key=Tape.cost)
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


_SUM, _PRODUCT = ("add", "sub"), ("mul",)
_SEARCHED = frozenset((*ARITHMETIC, "const", "leaf", "sin", "cos"))
"""Operations of the programs that are searched for shared operands."""

Shared = tuple[int, int, int]
"""Two operands and the product of their signs, so that a + b and −a − b are the same pair."""
Operands = dict[int, list[Ref]]
"""The operands of sums, or of products, by node."""


def shorter(program: NumberedProgram) -> list[NumberedProgram]:
    """The program with shared operands computed once, found in two ways.

    Sums and products are flattened into lists of operands: first only those that are read once, then all. The pair that
    occurs in most lists becomes an operand of its own, until no two lists share a pair. For + - * this finds what SymPy
    finds, in a twentieth of the time. Source: Breuer 1969 (Generation of optimal code for expressions via
    factorization).
    """
    reads = Counter(a for node in program.nodes for a in node.args)
    once = {i for i, count in reads.items() if count == 1}
    return [_shared(program, opened) for opened in (once, range(len(program.nodes)))]


def _shared(program: NumberedProgram, opened: Collection[int]) -> NumberedProgram:
    kept = set(program.outputs) | set(program.names)
    sums = _operands(program, _SUM, opened, kept)
    products = _operands(program, _PRODUCT, opened, kept)
    size = len(program.nodes)
    joined = _extracted(sums, size)
    multiplied = _extracted(products, size + len(joined))
    if not joined and not multiplied:
        return program
    return _Rebuilding(program, sums, products, joined=joined, multiplied=multiplied).program()


def _operands(
    program: NumberedProgram, kinds: Sequence[str], opened: Collection[int], kept: Collection[int]
) -> Operands:
    """Operands of the sums or products that remain when the others are flattened into those that read them."""
    found: Operands = {}
    read = set(kept).union(*(node.args for node in program.nodes if node.op not in kinds))
    for i, node in enumerate(program.nodes):
        if node.op not in kinds:
            continue
        found[i] = []
        for a, sign in zip(node.args, (1, -1 if node.op == "sub" else 1), strict=True):
            if a in found and a in opened and a not in kept:
                found[i] += [(sign * s, operand) for s, operand in found[a]]
            else:
                found[i].append((sign, a))
                read.add(a)
    return {i: operands for i, operands in found.items() if i in read}


def _extracted(lists: Operands, first: int) -> dict[int, Shared]:
    """Replaces pairs that several lists share by new operands, numbered from `first` on. Returns the pairs."""
    holders: defaultdict[Shared, set[int]] = defaultdict(set)
    for i, operands in lists.items():
        for pair in _pairs(operands):
            holders[pair].add(i)
    made: dict[int, Shared] = {}
    several = {pair for pair, where in holders.items() if len(where) > 1}
    while several:
        pair = max(several, key=lambda p: (len(holders[p]), -p[1], -p[0]))
        made[first + len(made)] = pair
        for i in sorted(holders[pair]):
            before = _pairs(lists[i])
            lists[i] = _joined(lists[i], pair, first + len(made) - 1)
            after = _pairs(lists[i])
            for other in before - after:
                holders[other].discard(i)
            for other in after - before:
                holders[other].add(i)
            several |= {p for p in after - before if len(holders[p]) > 1}
            several -= {p for p in before - after if len(holders[p]) < 2}
    return made


def _pairs(operands: Sequence[Ref]) -> set[Shared]:
    return {(min(a, b), max(a, b), s * r) for k, (s, a) in enumerate(operands) for r, b in operands[k + 1 :]}


def _joined(operands: Sequence[Ref], pair: Shared, number: int) -> list[Ref]:
    """The list with one operand, `number`, in place of a pair."""
    a, b, signs = pair
    x, y = next(
        (x, y)
        for x, (s, i) in enumerate(operands)
        for y, (r, j) in enumerate(operands)
        if x != y and (i, j, s * r) == (a, b, signs)
    )
    rest: list[Ref] = [operand for k, operand in enumerate(operands) if k not in (x, y)]
    rest.insert(min(x, y), (operands[x][0], number))
    return rest


class _Rebuilding:
    """Renumbers the program from its lists of operands."""

    def __init__(
        self,
        program: NumberedProgram,
        sums: Operands,
        products: Operands,
        joined: dict[int, Shared],
        multiplied: dict[int, Shared],
    ) -> None:
        self.old, self.sums, self.products = program, sums, products
        self.joined, self.multiplied = joined, multiplied
        self.new = Numbering([], {}, frozenset(), "a program")
        self.refs: dict[int, Ref] = {}

    def program(self) -> NumberedProgram:
        for i, node in enumerate(self.old.nodes):
            if node.op in (*_SUM, *_PRODUCT) and i not in self.sums and i not in self.products:
                continue
            self.refs[i] = sign, place = self._value(i)
            if i in self.old.names and sign > 0 and self.new.nodes[place].op not in ("leaf", "const"):
                self.new.names.setdefault(place, self.old.names[i])
        return self.new.ending([self.refs[i] for i in self.old.outputs])

    def _value(self, i: int) -> Ref:
        node, new = self.old.nodes[i], self.new
        if i in self.sums:
            return new.folded(new.add, [self._signed(ref) for ref in self.sums[i]])
        if i in self.products:
            return new.folded(new.mul, [self._signed(ref) for ref in self.products[i]])
        if node.op == "leaf":
            return 1, new.node("leaf", value=node.value)
        if node.op == "const":
            return new.const(node.value)
        sign, place = self.refs[node.args[0]]
        if node.op == "neg":
            return -sign, place
        if node.op == "div":
            return new.div((sign, place), self.refs[node.args[1]])
        return (sign if node.op == "sin" else 1), new.node(node.op, place)

    def _signed(self, ref: Ref) -> Ref:
        """An operand; a shared pair is computed where it is first read."""
        sign, i = ref
        if i not in self.refs:
            a, b, signs = self.joined.get(i) or self.multiplied[i]
            operation = self.new.add if i in self.joined else self.new.mul
            self.refs[i] = operation(self._signed((1, a)), self._signed((signs, b)))
        own, place = self.refs[i]
        return sign * own, place


_WAIT = {"leaf": 0, "const": 0, "sin": 12, "cos": 12, "div": 4}
"""Latency of an operation in units of an addition; 1 if not listed."""

Term = tuple[int, int, int]
"""(time at which it is known, position among the new nodes, sign)."""


def balanced(tape: Tape) -> Tape:
    """The tape with sums in the order in which their terms become available; named values keep their terms."""
    return _Balancing(tape).tape()


class _Balancing:
    """The new nodes, and the time at which each is known."""

    def __init__(self, tape: Tape) -> None:
        self.old = tape
        self.nodes: list[Node] = []
        self.known: list[int] = []
        self.place: dict[int, int] = {}
        uses, read_by_sums = tape.uses(), {a for node in tape.nodes if node.op in _SUM for a in node.args}
        self.inner = [
            node.op in _SUM and uses[i] == 1 and i in read_by_sums and i not in tape.names
            for i, node in enumerate(tape.nodes)
        ]

    def tape(self) -> Tape:
        for i, node in enumerate(self.old.nodes):
            if self.inner[i]:
                continue
            if node.op in _SUM:
                self.place[i] = self._summed(self._terms(i, 1))
            else:
                self.place[i] = self._node(Node(node.op, tuple(map(self.place.__getitem__, node.args)), node.value))
        names = {self.place[i]: name for i, name in self.old.names.items()}
        return Tape(tuple(self.nodes), tuple(self.place[i] for i in self.old.outputs), names)

    def _node(self, node: Node) -> int:
        self.nodes.append(node)
        self.known.append(max(map(self.known.__getitem__, node.args), default=0) + _WAIT.get(node.op, 1))
        return len(self.nodes) - 1

    def _terms(self, i: int, sign: int) -> list[Term]:
        """The terms of a sum, including those of the sums inside it."""
        a, b = self.old.nodes[i].args
        other = sign if self.old.nodes[i].op == "add" else -sign
        found = []
        for arg, its in ((a, sign), (b, other)):
            if self.inner[arg]:
                found += self._terms(arg, its)
            else:
                place = self.place[arg]
                found.append((self.known[place], place, its))
        return found

    def _summed(self, terms: list[Term]) -> int:
        """Adds the two earliest terms until one is left."""
        heapq.heapify(terms)
        while len(terms) > 1:
            (_, a, first), (_, b, second) = heapq.heappop(terms), heapq.heappop(terms)
            if first == second:
                place, sign = self._node(Node("add", (a, b))), first
            else:
                place, sign = self._node(Node("sub", (a, b) if first > 0 else (b, a))), 1
            heapq.heappush(terms, (self.known[place], place, sign))
        ((_, place, sign),) = terms
        assert sign > 0, "a sum that the tape has without a negation has a term without one"
        return place
