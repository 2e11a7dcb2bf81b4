"""Functions in symbols, and the straight-line programs that define them.

A recursion passes every intermediate value through `let` of a `Notes` object. On SymPy symbols this records a
definition, so that the emitted code is the recursion itself and no search for common subexpressions is needed; on
numbers of an exact ring it returns the value. Code generation sees SymbolicFunctions only.
"""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from types import MappingProxyType
from typing import Any, Protocol

import sympy as sp

Definitions = tuple[tuple[sp.Symbol, sp.Expr], ...]


class Notes(Protocol):
    """The operations that a recursion needs besides +, − and *."""

    def let(self, name: str, value: Any) -> Any:
        """Name an intermediate value; returns its replacement, a symbol or the value itself."""

    def sincos(self, angle: Any) -> tuple[Any, Any]:
        """(cos, sin) of an angle; angles can be added and subtracted."""


class Recorder:
    """Records definitions in SymPy. Equal values share a symbol; a leading minus stays outside the definition."""

    def __init__(self, reserved: Iterable[str] = ()) -> None:
        self._definitions: list[tuple[sp.Symbol, sp.Expr]] = []
        self._known: dict[sp.Expr, sp.Symbol] = {}
        self._taken = set(reserved)

    def let(self, name: str, value: Any) -> sp.Expr:
        """A symbol for the value, shared with its negative; an input or a number is returned as it is."""
        expr = sp.sympify(value)
        sign, rest = expr.as_coeff_Mul()
        if expr.is_Atom or (rest.is_Atom and sign == -1):
            return expr
        if sign == -1:
            return -self.let(name, rest)
        if expr not in self._known:
            self._known[expr] = self._symbol(name)
            self._definitions.append((self._known[expr], expr))
        return self._known[expr]

    def symbol(self, name: str, value: Any) -> sp.Symbol:
        """A new symbol for a value, even if one exists."""
        symbol = self._symbol(name)
        self._definitions.append((symbol, sp.sympify(value)))
        return symbol

    def sincos(self, angle: Any) -> tuple[sp.Expr, sp.Expr]:
        """Symbols of an angle's cosine and sine; the numbers 1 and 0 for angle 0."""
        if angle == 0:
            return sp.Integer(1), sp.Integer(0)
        name = str(angle)
        return self.let(f"cos_{name}", sp.cos(angle)), self.let(f"sin_{name}", sp.sin(angle))

    def live(self, outputs: Iterable[sp.Expr]) -> Definitions:
        """The definitions that the outputs need, in order of evaluation."""
        needed = set().union(*(sp.sympify(e).free_symbols for e in outputs))
        kept = []
        for symbol, expr in reversed(self._definitions):
            if symbol in needed:
                kept.append((symbol, expr))
                needed |= expr.free_symbols
        return tuple(reversed(kept))

    def _symbol(self, name: str) -> sp.Symbol:
        unique, number = name, 2
        while unique in self._taken:
            unique, number = f"{name}_{number}", number + 1
        self._taken.add(unique)
        return sp.Symbol(unique, real=True)


@dataclass(frozen=True)
class Suffixed:
    """A recorder with a suffix on all names, for several runs of one recursion."""

    recorder: Recorder
    end: str

    def let(self, name: str, value: Any) -> sp.Expr:
        return self.recorder.let(name + self.end, value)

    def sincos(self, angle: Any) -> tuple[sp.Expr, sp.Expr]:
        return self.recorder.sincos(angle)


@dataclass(frozen=True)
class Turn:
    """An angle as (cos, sin) in any ring, which can be exact where the angle cannot."""

    cos: Any
    sin: Any

    @property
    def pair(self) -> tuple[Any, Any]:
        """(cos, sin)."""
        return self.cos, self.sin

    def __add__(self, other: Turn | int) -> Turn:
        if isinstance(other, int):  # the start of a sum
            return self
        return Turn(self.cos * other.cos - self.sin * other.sin, self.sin * other.cos + self.cos * other.sin)

    __radd__ = __add__

    def __neg__(self) -> Turn:
        return Turn(self.cos, -self.sin)

    def __sub__(self, other: Turn) -> Turn:
        return self + -other

    def __rsub__(self, _zero: int) -> Turn:
        return -self

    def over(self, number: Callable[[Any], Any]) -> Turn:
        """The same in another ring."""
        return Turn(number(self.cos), number(self.sin))


def residue(number: Fraction | int, prime: int) -> int:
    """A fraction modulo a prime."""
    return number.numerator * pow(number.denominator, -1, prime) % prime


def random_turn(rng: random.Random, prime: int) -> Turn:
    """A random angle modulo a prime, from the tangent of its half."""
    t = rng.randrange(prime)
    inverse = pow(1 + t * t, -1, prime)
    return Turn((1 - t * t) * inverse % prime, 2 * t * inverse % prime)


class Exact:
    """Any ring with +, − and *; angles are Turns."""

    def let(self, name: str, value: Any) -> Any:  # noqa: ARG002
        return value

    def sincos(self, angle: Any) -> tuple[Any, Any]:
        return (angle.cos, angle.sin) if isinstance(angle, Turn) else (1, 0)


class Residues(Exact):
    """Integers modulo a prime, reduced at every `let`; angles are Turns."""

    def __init__(self, prime: int) -> None:
        self.prime = prime

    def let(self, name: str, value: Any) -> Any:  # noqa: ARG002
        if isinstance(value, Turn):
            return Turn(value.cos % self.prime, value.sin % self.prime)
        return value % self.prime


@dataclass(frozen=True, slots=True)
class CountedValue:
    """± a node of an OperationCounter."""

    counter: OperationCounter
    sign: int
    node: int

    def __neg__(self) -> CountedValue:
        return CountedValue(self.counter, -self.sign, self.node)

    def __add__(self, other: Any) -> Any:
        counter = self.counter
        if not isinstance(other, CountedValue):
            return self if other == 0 else counter.make("shift", other * self.sign, self.node, self.sign)
        if self.node == other.node:
            return 0 if self.sign != other.sign else self * 2
        if self.sign == other.sign:
            return counter.make("add", min(self.node, other.node), max(self.node, other.node), self.sign)
        above, below = (self.node, other.node) if self.sign > 0 else (other.node, self.node)
        if ("sub", below, above) in counter.known:
            return counter.make("sub", below, above, -1)
        return counter.make("sub", above, below, 1)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, CountedValue):
            return self.counter.make(
                "mul", min(self.node, other.node), max(self.node, other.node), self.sign * other.sign
            )
        if other == 0:
            return 0
        if abs(other) == 1:
            return self if other > 0 else -self
        return self.counter.make("scale", abs(other), self.node, self.sign if other > 0 else -self.sign)

    __rmul__ = __mul__


class OperationCounter:
    """Notes whose values only count operations, which is much faster than SymPy.

    Equal operations count once, signs belong to values and numbers fold, as in generated code.
    """

    def __init__(self) -> None:
        self.known: dict[tuple[str, Any, Any], int] = {}

    def leaf(self, name: str) -> CountedValue:
        """An input."""
        return self.make("leaf", name, None, 1)

    def make(self, operation: str, a: Any, b: Any, sign: int) -> CountedValue:
        """The value of an operation on a and b; a repeated operation costs nothing."""
        key = (operation, a, b)
        node = self.known.get(key)
        if node is None:
            node = self.known[key] = len(self.known)
        return CountedValue(self, sign, node)

    def let(self, name: str, value: Any) -> Any:  # noqa: ARG002
        """The value itself."""
        return value

    def sincos(self, angle: Any) -> tuple[Any, Any]:
        """Cosine and sine; 1 and 0 of a constant angle 0."""
        if not isinstance(angle, CountedValue):
            return 1, 0
        return self.make("cos", angle.node, None, 1), self.make("sin", angle.node, None, angle.sign)

    def cost(self, outputs: Iterable[Any]) -> int:
        """The operations that the outputs need; an inlined sine and cosine cost about twenty."""
        nodes = list(self.known)
        todo = [o.node for o in outputs if isinstance(o, CountedValue)]
        live: set[int] = set()
        while todo:
            i = todo.pop()
            if i not in live:
                live.add(i)
                operation, a, b = nodes[i]
                if operation != "leaf":
                    todo += {"sin": (a,), "cos": (a,), "shift": (b,), "scale": (b,)}.get(operation, (a, b))
        kinds = [nodes[i] for i in live]
        angles = {a for operation, a, _ in kinds if operation in ("sin", "cos")}
        return sum(operation not in ("leaf", "sin", "cos") for operation, _, _ in kinds) + 20 * len(angles)


@dataclass(frozen=True)
class Argument:
    """An input: `symbols` flattened row by row; `shape` () for a scalar, (n,) or (n, m)."""

    name: str
    symbols: tuple[sp.Symbol, ...]
    shape: tuple[int, ...]
    unit: str
    meaning: str


@dataclass(frozen=True)
class Output:
    """An output: `expressions` flattened row by row, in the symbols of inputs, struct and definitions."""

    name: str
    expressions: tuple[sp.Expr, ...]
    shape: tuple[int, ...]
    unit: str
    meaning: str


def output(name: str, values: Sequence[Any], *, unit: str, meaning: str) -> Output:
    """An output of numbers or expressions (n,), or (n, m) as n rows."""
    nested = isinstance(values[0], Sequence)
    shape = (len(values), len(values[0])) if nested else (len(values),)
    flat = itertools.chain.from_iterable(values) if nested else values
    return Output(name, tuple(map(sp.sympify, flat)), shape, unit=unit, meaning=meaning)


@dataclass(frozen=True)
class Struct:
    """Parameters that generated code takes as one C struct, so that new values need no regeneration.

    defaults   values from the model file; None where unknown
    """

    name: str
    symbols: tuple[sp.Symbol, ...]
    units: tuple[str, ...]
    meanings: tuple[str, ...]
    defaults: tuple[float | None, ...]


@dataclass(frozen=True)
class Continuation:
    """A function that continues another one with the same inputs, which a target may call instead of recomputing it.

    function   the other function's name
    values     (symbol, position): symbols of the definitions for elements of the other's flat output; the elements at
               all other positions are identical in both outputs
    """

    function: str
    values: tuple[tuple[sp.Symbol, int], ...]


@dataclass(frozen=True)
class SymbolicFunction:
    """A function in symbols.

    name          C identifier, without the arm's prefix
    inputs        in the order of the generated signature
    outputs       in the order of the generated signature
    definitions   (symbol, expression) in order of evaluation; expressions use inputs, struct and earlier symbols
    struct        the parameters, or None
    doc           one sentence: what it returns
    source        equation number of the paper or the literature
    notation      meanings of the definitions' names, without numbers; "c, s": two of one kind
    continues     another function whose output replaces the definitions, or None
    """

    name: str
    inputs: tuple[Argument, ...]
    outputs: tuple[Output, ...]
    doc: str
    source: str
    definitions: tuple[tuple[sp.Symbol, sp.Expr], ...] = field(default=())
    struct: Struct | None = None
    notation: Mapping[str, str] = field(default_factory=dict)
    continues: Continuation | None = None

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """All arguments in the order of a generated signature: the parameters as a vector, then the inputs."""
        if self.struct is None:
            return self.inputs
        symbols = self.struct.symbols
        return (
            Argument(self.struct.name, symbols, (len(symbols),), unit="", meaning=", ".join(s.name for s in symbols)),
            *self.inputs,
        )


@dataclass(frozen=True)
class Coordinates:
    """Symbols and units of q, qd, qdd and tau of an arm with n joints; mixed arms have two units."""

    types: tuple[str, ...]

    def symbols(self, name: str) -> list[sp.Symbol]:
        """n symbols, one for each joint: name1, name2 and so on."""
        return [sp.Symbol(f"{name}{i + 1}", real=True) for i in range(len(self.types))]

    def unit(self, revolute: str, prismatic: str) -> str:
        """One unit if all joints have one type, otherwise "a or b"."""
        kinds = dict.fromkeys(revolute if t == "revolute" else prismatic for t in self.types)
        return " or ".join(kinds)

    def argument(self, name: str) -> Argument:
        """The input q, qd, qdd or tau."""
        unit, meaning = {
            "q": (self.unit("rad", "m"), "joint positions"),
            "qd": (self.unit("rad/s", "m/s"), "joint rates"),
            "qdd": (self.unit("rad/s^2", "m/s^2"), "joint accelerations"),
            "tau": (self.unit("N m", "N"), "joint torques"),
        }[name]
        return Argument(name, tuple(self.symbols(name)), (len(self.types),), unit=unit, meaning=meaning)

    @property
    def force(self) -> str:
        """Unit of the joint torques: N m, N, or both of mixed arms."""
        return self.unit("N m", "N")


@dataclass(frozen=True)
class Author:
    """Writes SymbolicFunctions over the same inputs and the same struct."""

    coordinates: Coordinates
    struct: Struct

    def recorder(self) -> Recorder:
        """A recorder whose definitions cannot clash with inputs or parameters."""
        inputs = (s.name for name in ("q", "qd", "qdd", "tau") for s in self.coordinates.symbols(name))
        return Recorder([*inputs, *(s.name for s in self.struct.symbols)])

    def function(
        self,
        name: str,
        inputs: Sequence[str | Argument],
        output: Output,
        recorder: Recorder,
        *,
        doc: str,
        source: str,
        notation: Mapping[str, str] = MappingProxyType({}),
        continues: Continuation | None = None,
    ) -> SymbolicFunction:
        """A function of one output. inputs: "q", "qd", "qdd" or "tau", or arguments of its own."""
        return SymbolicFunction(
            name,
            tuple(i if isinstance(i, Argument) else self.coordinates.argument(i) for i in inputs),
            outputs=(output,),
            doc=doc,
            source=source,
            definitions=recorder.live(output.expressions),
            struct=self.struct,
            notation=notation,
            continues=continues,
        )
