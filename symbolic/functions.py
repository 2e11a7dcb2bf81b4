"""Functions in symbols, and the straight-line programs that define them.

A recursion passes every intermediate value through `let` of a `Notes` object. On SymPy symbols this records a
definition, so that the emitted code is the recursion itself and no search for common subexpressions is needed; on
numbers of an exact ring it returns the value. Code generation sees SymbolicFunctions only.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol

import sympy as sp

Definitions = tuple[tuple[sp.Symbol, sp.Expr], ...]


class Notes(Protocol):
    """What a recursion needs besides +, − and *."""

    def let(self, name: str, value: Any) -> Any:
        """Name an intermediate value; returns what stands for it from here on."""

    def sincos(self, angle: Any) -> tuple[Any, Any]:
        """(cos, sin) of an angle; angles can be added and subtracted."""


class Recorder:
    """Records definitions in SymPy. Equal values share a symbol; a leading minus stays outside, where it is free."""

    def __init__(self, reserved: Iterable[str] = ()) -> None:
        self._definitions: list[tuple[sp.Symbol, sp.Expr]] = []
        self._known: dict[sp.Expr, sp.Symbol] = {}
        self._taken = set(reserved)

    def let(self, name: str, value: Any) -> sp.Expr:
        """A symbol that stands for the value from here on; one for both signs of it, none for an input."""
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
        """One of its own for a value, whatever that is."""
        symbol = self._symbol(name)
        self._definitions.append((symbol, sp.sympify(value)))
        return symbol

    def sincos(self, angle: Any) -> tuple[sp.Expr, sp.Expr]:
        """Symbols of cosine and sine of an angle; of 0, the numbers 1 and 0."""
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
    """A recorder's names with an end that tells several runs of one recursion apart."""

    recorder: Recorder
    end: str

    def let(self, name: str, value: Any) -> sp.Expr:
        return self.recorder.let(name + self.end, value)

    def sincos(self, angle: Any) -> tuple[sp.Expr, sp.Expr]:
        return self.recorder.sincos(angle)


@dataclass(frozen=True)
class Turn:
    """An angle as (cos, sin) in any ring: exact where the angle itself would not be."""

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


@dataclass(frozen=True)
class Count:
    """Operations of a straight-line program: + − * / and lone negations; pairs of sin and cos apart."""

    operations: int
    sincos: int

    @property
    def cost(self) -> int:
        """For choosing between programs: an inlined sine and cosine cost about twenty operations."""
        return self.operations + 20 * self.sincos


def count(definitions: Definitions, outputs: Sequence[sp.Expr]) -> Count:
    """Count a program as it will be printed; a power by an integer is a chain of products."""
    expressions = [*(e for _, e in definitions), *map(sp.sympify, outputs)]
    angles = {f.args[0] for e in expressions for f in e.atoms(sp.sin, sp.cos)}
    return Count(sum(_operations(e) for e in expressions), len(angles))


def _operations(expr: sp.Expr) -> int:
    if expr.is_Atom:
        return 0
    if expr.is_Add:
        terms = [a.as_coeff_Mul() for a in expr.args]
        inner = sum(_operations(rest if sign == -1 else a) for a, (sign, rest) in zip(expr.args, terms, strict=True))
        return inner + len(terms) - 1 + all(sign == -1 for sign, _ in terms)
    if expr.is_Mul:
        return sum(_operations(a) for a in expr.args) + len(expr.args) - 1
    if expr.is_Pow and expr.exp.is_Integer:
        power = int(expr.exp)
        return _operations(expr.base) + abs(power) - (power > 0)
    return 1 * (not isinstance(expr, (sp.sin, sp.cos))) + sum(_operations(a) for a in expr.args)


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


def output(name: str, values: Sequence[Any], shape: tuple[int, ...], *, unit: str, meaning: str) -> Output:
    """An output whose values may be numbers or expressions, flattened row by row."""
    return Output(name, tuple(sp.sympify(value) for value in values), shape, unit=unit, meaning=meaning)


@dataclass(frozen=True)
class Struct:
    """Parameters that generated code takes as one C struct, so that identified values need no regeneration.

    `defaults` are the values that follow from the model file, field by field; None where it leaves one open.
    """

    name: str
    symbols: tuple[sp.Symbol, ...]
    units: tuple[str, ...]
    meanings: tuple[str, ...]
    defaults: tuple[float | None, ...]


@dataclass(frozen=True)
class Continuation:
    """How a function goes on from another one of the same inputs, which a target may call in place of its definitions.

    function   the other one's name
    values     (symbol, position): what the definitions call elements of its flat output; the elements at all other
               positions are its own as they are
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
    notation      what the names of the definitions stand for, without their numbers; "c, s": two of one kind
    continues     another function whose output is all that the outputs need of the definitions, or None
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
        """All that it takes, in the order of a generated signature: the parameters as a vector, then the inputs."""
        if self.struct is None:
            return self.inputs
        symbols = self.struct.symbols
        return (
            Argument(self.struct.name, symbols, (len(symbols),), "", ", ".join(s.name for s in symbols)),
            *self.inputs,
        )


@dataclass(frozen=True)
class Coordinates:
    """Symbols q, qd, qdd, tau of an arm with n joints, and their units (mixed arms have both)."""

    types: tuple[str, ...]

    def symbols(self, name: str) -> list[sp.Symbol]:
        """n symbols, one a joint: name1, name2 and so on."""
        return [sp.Symbol(f"{name}{i + 1}", real=True) for i in range(len(self.types))]

    def unit(self, revolute: str, prismatic: str) -> str:
        """One unit if all joints are of one type, else "a or b", joint by joint."""
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
        return Argument(name, tuple(self.symbols(name)), (len(self.types),), unit, meaning)

    @property
    def force(self) -> str:
        """Unit of the joints' torques, in letters: N m, N, or both where joints are mixed."""
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
