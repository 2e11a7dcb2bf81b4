"""SymbolicFunction: named inputs and outputs in SymPy. It is all that code generation sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import sympy as sp

from symbolic.straightline import Recorder


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
