"""Value numbering: expressions as nodes of a straight-line program that computes every value once.

Commutative operands have one order and differences one direction. Signs are kept with references until an operation
needs them, numbers are exact rationals, and operations that no output needs are removed.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any, Literal, NamedTuple

import sympy as sp

from symbolic import primitives

Lowering = Literal["exact", "smooth"]

_X, _WIDTH = sp.Dummy("x", real=True), sp.Dummy("width", positive=True)


class Larger(sp.Function):
    """The larger of two."""

    is_extended_real = True


class Smaller(sp.Function):
    """The smaller of two."""

    is_extended_real = True


def lower(expr: Any, lowering: Lowering) -> sp.Expr:
    """`expr` for a tape: unchanged, or from primitives.smooth with Larger and Smaller for Max and Min."""
    e = sp.sympify(expr)
    return _smooth(e, {}) if lowering == "smooth" else e


@functools.cache
def _surrogates() -> dict[Any, sp.Expr]:
    plain = {kind: primitives.smooth(kind(_X, _WIDTH)) for kind in _PRIMITIVES}
    return {kind: e.replace(sp.Max, Larger).replace(sp.Min, Smaller) for kind, e in plain.items()}


def _smooth(e: sp.Expr, done: dict[sp.Expr, sp.Expr]) -> sp.Expr:
    """Equal parts are lowered once."""
    if e not in done:
        if not e.has(*_PRIMITIVES):
            done[e] = e
        else:
            args = [_smooth(a, done) for a in e.args]
            surrogate = _surrogates().get(type(e))
            done[e] = e.func(*args) if surrogate is None else surrogate.xreplace({_X: args[0], _WIDTH: args[1]})
    return done[e]


ARITHMETIC = ("add", "sub", "mul", "div", "neg")
_PRIMITIVES = {primitives.sgn: "sgn", primitives.step: "step", primitives.ramp: "ramp"}
_UNARY = {sp.log: "log"}
# Functions without an operation in the targets, in terms of others.
_REWRITE: dict[Any, Callable[..., sp.Expr]] = {
    sp.tan: lambda x: sp.sin(x) / sp.cos(x),
    sp.tanh: lambda x: 1 - 2 / (sp.exp(2 * x) + 1),
    sp.sinh: lambda x: (sp.exp(x) - sp.exp(-x)) / 2,
    sp.cosh: lambda x: (sp.exp(x) + sp.exp(-x)) / 2,
    sp.atan: lambda x: sp.atan2(x, sp.Integer(1), evaluate=False),
    sp.asin: lambda x: sp.atan2(x, sp.sqrt(1 - x**2), evaluate=False),
    sp.acos: lambda x: sp.atan2(sp.sqrt(1 - x**2), x, evaluate=False),
}


class Node(NamedTuple):
    """One operation; `args` are positions of earlier nodes. value: Fraction of a "const", Symbol of a "leaf"."""

    op: str
    args: tuple[int, ...] = ()
    value: Any = None


class NumberedProgram(NamedTuple):
    """nodes in order of evaluation; outputs: positions in `nodes`; names: position -> name, none twice."""

    nodes: tuple[Node, ...]
    outputs: tuple[int, ...]
    names: Mapping[int, str]


Ref = tuple[int, int]
"""(sign, node): a value and its sign, so that negations are folded where possible."""


class Numbering:
    """Numbers values, equal ones once. lazy: definitions that are used when their symbol occurs."""

    def __init__(
        self,
        definitions: Sequence[tuple[sp.Symbol, sp.Expr]],
        lazy: Mapping[sp.Symbol, sp.Expr],
        leaves: frozenset[sp.Symbol],
        where: str,
    ) -> None:
        self.definitions, self.lazy, self.leaves, self.where = definitions, lazy, leaves, where
        self.nodes: list[Node] = []
        self.index: dict[Node, int] = {}
        self.memo: dict[sp.Expr, Ref] = {}
        # Exponentials of nonpositive values: their node -> the node of the negated exponent.
        self.falling: dict[int, int] = {}
        self.names: dict[int, str] = {}

    def program(self, outputs: Sequence[sp.Expr]) -> NumberedProgram:
        """The program of definitions and outputs."""
        for symbol, expr in self.definitions:
            sign, i = self.memo[symbol] = self.value(expr)
            if sign > 0 and self.nodes[i].op not in ("leaf", "const"):
                self.names.setdefault(i, symbol.name)
        return self.ending([self.value(e) for e in outputs])

    def ending(self, outputs: Sequence[Ref]) -> NumberedProgram:
        """The operations that these outputs need."""
        plain = [self.plain(self._turned(ref, outputs)) for ref in outputs]
        return _live(self.nodes, plain, self.names | directions(self.nodes))

    def node(self, op: str, *args: int, value: Any = None) -> int:
        """Number of an operation; the same operation has the same number."""
        node = Node(op, args, value)
        if node not in self.index:
            self.index[node] = len(self.nodes)
            self.nodes.append(node)
        return self.index[node]

    def const(self, value: Fraction) -> Ref:
        """A constant by sign and magnitude."""
        return (-1 if value < 0 else 1), self.node("const", value=abs(value))

    def number(self, ref: Ref) -> Fraction | None:
        """The value of a constant; None for other values."""
        node = self.nodes[ref[1]]
        return ref[0] * node.value if node.op == "const" else None

    def plain(self, ref: Ref) -> int:
        """The node of the value including its sign."""
        sign, i = ref
        if sign > 0:
            return i
        node = self.nodes[i]
        return self.node("const", value=-node.value) if node.op == "const" else self.node("neg", i)

    def _turned(self, ref: Ref, outputs: Sequence[Ref]) -> Ref:
        """−(a − b) as b − a, unless a − b is used elsewhere."""
        sign, i = ref
        node = self.nodes[i]
        if sign > 0 or node.op != "sub":
            return ref
        read = sum(i in n.args for n in self.nodes) + sum(i == j and s > 0 for s, j in outputs)
        return ref if read else (1, self.node("sub", node.args[1], node.args[0]))

    def value(self, expr: sp.Expr) -> Ref:
        """Sign and number of an expression."""
        found = self.memo.get(expr)
        if found is None:
            found = self.memo[expr] = self._convert(expr)
        return found

    def _convert(self, e: sp.Expr) -> Ref:
        if e.is_Symbol:
            return self._symbol(e)
        if e.is_Rational:
            return self.const(Fraction(int(e.p), int(e.q)))
        if e.is_Float:
            return self.const(Fraction(repr(float(e))))
        if e.is_number and e.is_real:
            return self.const(Fraction(str(sp.N(e, 40))))
        if e.is_Add:
            return self._sum(e)
        if e.is_Mul:
            return self._product(e)
        if e.is_Pow:
            return self._power(e.base, e.exp)
        return self._call(e)

    def _symbol(self, symbol: sp.Symbol) -> Ref:
        if symbol in self.lazy:
            return self.value(self.lazy[symbol])
        if symbol not in self.leaves:
            raise ValueError(f"{self.where}: {symbol} is neither an input, a parameter nor defined before its use")
        return 1, self.node("leaf", value=symbol)

    def _sum(self, e: sp.Expr) -> Ref:
        """A sum; a factor that SymPy has distributed over all terms is taken out again."""
        split = [term.as_coeff_Mul() for term in e.args]
        scales = {abs(c) for c, _ in split}
        common = scales.pop() if len(scales) == 1 else sp.S.One
        if common == 1 or not common.is_Rational or any(t.is_number for _, t in split):
            return self.folded(self.add, self._joined([self.value(term) for term in e.args]))
        inner = [(s if c > 0 else -s, i) for c, (s, i) in ((c, self.value(t)) for c, t in split)]
        return self.mul(self.value(common), self.folded(self.add, self._joined(inner)))

    def _joined(self, terms: Sequence[Ref]) -> list[Ref]:
        """The terms of a sum, with those that depend on the sign of one value joined under a single comparison."""
        sides: dict[int, dict[bool, Ref]] = {}
        rest: list[Ref] = []
        for sign, i in terms:
            node = self.nodes[i]
            if node.op != "gate":
                rest.append((sign, i))
                continue
            x, value = node.args
            below = self.nodes[x].op == "neg"
            found = sides.setdefault(self.nodes[x].args[0] if below else x, {})
            found[below] = self.add(found[below], (sign, value)) if below in found else (sign, value)
        return rest + [self._sides(x, found) for x, found in sides.items()]

    def _sides(self, x: int, found: Mapping[bool, Ref]) -> Ref:
        """One value for x > 0 and another for x < 0; a gate if there is only one."""
        if len(found) == 2:
            return 1, self.node("side", x, self.plain(found[False]), self.plain(found[True]))
        below, value = next(iter(found.items()))
        return self._gated(self.plain((-1 if below else 1, x)), value)

    def _product(self, e: sp.Expr) -> Ref:
        """Numerator over denominator; the constant factor comes last, so that products without it are shared."""
        number, above, below = Fraction(1), [], []
        for factor in e.args:
            if factor.is_Pow and factor.exp.is_Rational and factor.exp < 0:
                below.append(self._power(factor.base, -factor.exp))
                continue
            ref = self.value(factor)
            value = self.number(ref)
            if value is None:
                above.append(ref)
            else:
                number *= value
        scale = self.const(number)
        result = self.mul(scale, self.folded(self.mul, above)) if above else scale
        return self.div(result, self.folded(self.mul, below)) if below else result

    def _power(self, base: sp.Expr, exponent: sp.Expr) -> Ref:
        if exponent.is_Integer:
            n = int(exponent)
            if n < 0:
                return self.div(self.const(Fraction(1)), self._integer_power(self.value(base), -n))
            return self._integer_power(self.value(base), n)
        if exponent.is_Rational and exponent.q == 2:
            if exponent < 0:
                return self.div(self.const(Fraction(1)), self._power(base, -exponent))
            root = 1, self.node("sqrt", self.plain(self.value(base)))
            return self.mul(root, self._integer_power(self.value(base), int(exponent.p) // 2))
        if base == sp.E:
            return self._exponential(exponent)
        return 1, self.node("pow", self.plain(self.value(base)), self.plain(self.value(exponent)))

    def _exponential(self, exponent: sp.Expr) -> Ref:
        argument = self.value(exponent)
        i = self.node("exp", self.plain(argument))
        if exponent.is_nonpositive:
            self.falling[i] = self.plain((-argument[0], argument[1]))
        return 1, i

    def _integer_power(self, base: Ref, n: int) -> Ref:
        if n == 0:
            return self.const(Fraction(1))
        if n == 1:
            return base
        half = self._integer_power(base, n // 2)
        square = self.mul(half, half)
        return self.mul(square, base) if n % 2 else square

    def _call(self, e: sp.Expr) -> Ref:
        kind = e.func
        if kind in (sp.sin, primitives.sgn, sp.sign):
            sign, i = self.value(e.args[0])
            return sign, self.node("sin" if kind is sp.sin else "sgn", i)
        if kind in (sp.cos, sp.Abs):
            return 1, self.node("cos" if kind is sp.cos else "abs", self.value(e.args[0])[1])
        if kind is sp.exp:
            return self._exponential(e.args[0])
        if kind in _PRIMITIVES or kind in _UNARY:
            return 1, self.node((_PRIMITIVES | _UNARY)[kind], self.plain(self.value(e.args[0])))
        if kind is sp.atan2:
            return 1, self.node("atan2", *(self.plain(self.value(a)) for a in e.args))
        if kind in (sp.Max, sp.Min, Larger, Smaller):
            op = "max" if kind in (sp.Max, Larger) else "min"
            ids = sorted(self.plain(self.value(a)) for a in e.args)
            result = ids[0]
            for i in ids[1:]:
                result = self.node(op, result, i)
            return 1, result
        if kind in _REWRITE:
            return self.value(_REWRITE[kind](*e.args))
        raise ValueError(
            f"{self.where}: no target can evaluate {kind.__name__}; use sgn, step, ramp, sin, cos, exp, log, powers, "
            "Abs, Min, Max or atan2"
        )

    def folded(self, operation: Callable[[Ref, Ref], Ref], refs: Sequence[Ref]) -> Ref:
        """The operation applied from left to right."""
        result = refs[0]
        for ref in refs[1:]:
            result = operation(result, ref)
        return result

    def add(self, a: Ref, b: Ref) -> Ref:
        """a + b with folded constants; x − x is 0, and b + a is the same node."""
        x, y = self.number(a), self.number(b)
        if x is not None and y is not None:
            return self.const(x + y)
        if x == 0:
            return b
        if y == 0:
            return a
        (s, i), (r, j) = a, b
        if i == j and s != r:
            return self.const(Fraction(0))
        if x == 1 and r < 0 and j in self.falling:
            return 1, self.node("rise", self.falling[j])
        if s == r:
            return s, self.node("add", min(i, j), max(i, j))
        positive, negative = (i, j) if s > 0 else (j, i)
        if Node("sub", (negative, positive)) in self.index:
            return -1, self.node("sub", negative, positive)
        return 1, self.node("sub", positive, negative)

    def mul(self, a: Ref, b: Ref) -> Ref:
        """a b with folded constants; b a is the same node."""
        x, y = self.number(a), self.number(b)
        if x is not None and y is not None:
            return self.const(x * y)
        if x is None and y is not None:
            a, b, x = b, a, y
        if x == 0:
            return self.const(Fraction(0))
        (s, i), (r, j) = a, b
        if x is not None and abs(x) == 1:
            return s * r, j
        for switch, other in ((i, b), (j, a)):
            if self.nodes[switch].op in ("step", "ramp"):
                return self._switched(s * r, self.nodes[switch], other[1])
        inner = self.nodes[j]
        if x is not None and inner.op == "mul" and self.nodes[inner.args[0]].op == "const":
            return self.mul(self.const(x * self.nodes[inner.args[0]].value), (r, inner.args[1]))
        if x is None:
            i, j = min(i, j), max(i, j)
        return s * r, self.node("mul", i, j)

    def _switched(self, sign: int, switch: Node, factor: int) -> Ref:
        (x,) = switch.args
        argument = (-1, self.nodes[x].args[0]) if self.nodes[x].op == "neg" else (1, x)
        value = (1, factor) if switch.op == "step" else self.mul(argument, (1, factor))
        return self._gated(x, (sign * value[0], value[1]))

    def _gated(self, x: int, value: Ref) -> Ref:
        return value if self.number(value) == 0 else (value[0], self.node("gate", x, value[1]))

    def div(self, a: Ref, b: Ref) -> Ref:
        """a / b; for a constant b the product with its inverse. Raises ValueError if b is 0."""
        y = self.number(b)
        if y is not None:
            if y == 0:
                raise ValueError(f"{self.where}: division by zero")
            return self.mul(a, self.const(1 / y))
        if self.number(a) == 0:
            return a
        (s, i), (r, j) = a, b
        return (s * r, self.node("div", i, j)) if i != j else self.const(Fraction(s * r))


_JOINT = re.compile(r"q(\d+)")


def directions(nodes: Sequence[Node]) -> dict[int, str]:
    """The usual names for cosines and sines of sums of joint angles, such as c23 for cos(q2 + q3)."""
    names = {}
    for i, node in enumerate(nodes):
        if node.op in ("sin", "cos"):
            joints = _joints(nodes, node.args[0])
            if joints:
                between = "_" if max(joints) > 9 else ""
                names[i] = node.op[0] + between.join(map(str, sorted(joints)))
    return names


def _joints(nodes: Sequence[Node], i: int) -> list[int]:
    """The joints whose angles are summed at a node; empty for other values."""
    node = nodes[i]
    if node.op == "leaf":
        found = _JOINT.fullmatch(node.value.name)
        return [int(found[1])] if found else []
    parts = [_joints(nodes, a) for a in node.args] if node.op == "add" else []
    return [j for part in parts for j in part] if all(parts) else []


def _live(nodes: Sequence[Node], outputs: Sequence[int], names: Mapping[int, str]) -> NumberedProgram:
    """The operations that the outputs need, renumbered."""
    needed = set(outputs)
    for i in range(len(nodes) - 1, -1, -1):
        if i in needed:
            needed.update(nodes[i].args)
    place: dict[int, int] = {}
    kept: list[Node] = []
    for i, node in enumerate(nodes):
        if i in needed:
            place[i] = len(kept)
            kept.append(node._replace(args=tuple(place[a] for a in node.args)))
    return NumberedProgram(
        tuple(kept), tuple(place[i] for i in outputs), {place[i]: n for i, n in names.items() if i in place}
    )
