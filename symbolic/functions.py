"""SymbolicFunction: named inputs and outputs in SymPy. It is all that code generation sees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import sympy as sp


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
