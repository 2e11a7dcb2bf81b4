"""Straight-line programs: the same recursion run on SymPy symbols or on numbers of an exact ring.

A recursion takes a `Notes` object and passes every intermediate value through `let`. On SymPy that
records a definition, so that the emitted code is the recursion itself and no search for common
subexpressions is needed; on numbers it merely hands the value back.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
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
