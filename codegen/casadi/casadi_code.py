"""CasADi text of symbolic functions: one builder a function, smooth surrogates of named width."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import sympy as sp

from codegen.c.c_code import description, legend
from codegen.casadi.language import CASADI
from codegen.tape.printers import Printer
from codegen.tape.tape import Tape
from symbolic import units as u
from symbolic.functions import Argument, Output, SymbolicFunction
from symbolic.primitives import WIDTHS

WIDTH_UNITS = {"rate": u.RATE, "position": u.POSITION, "force": u.FORCE, "time": u.SECOND}
"""Of the widths of the switches, in the order of primitives.WIDTHS."""
WIDTH = Argument(
    "width",
    WIDTHS,
    (len(WIDTHS),),
    ", ".join(unit.text() for unit in WIDTH_UNITS.values()),
    f"half widths of the switches in {', '.join(WIDTH_UNITS)}",
)


@dataclass(frozen=True)
class Builder:
    """A Python function without arguments that returns a casadi.Function."""

    name: str
    doc: str
    body: str


def builder(function: SymbolicFunction, widths: bool = False, tape: Tape | None = None) -> Builder:
    """`widths`: the last input is WIDTH, the widths of the surrogates."""
    tape = tape or Tape.of(function, "smooth")
    inputs = [*function.arguments, *([WIDTH] if widths else [])]
    leaves: dict[sp.Symbol, str] = {}
    lines = []
    for a in inputs:
        lines.append(_symbol(a.name, a.shape))
        # Elements that are called as an argument are meant by their place.
        named = _has_names(a) and not {s.name for s in a.symbols} & {other.name for other in inputs}
        leaves |= dict(
            zip(a.symbols, [s.name for s in a.symbols] if named else _elements(a.name, a.shape), strict=True)
        )
        if named:
            lines += _unpacked(a)
    names, outputs = [a.name for a in inputs], [o.name for o in function.outputs]
    taken = frozenset(names) | {text for text in leaves.values() if text.isidentifier()} | set(outputs)
    statements, texts = Printer(CASADI, tape, leaves, taken).print()
    lines += statements
    for output in function.outputs:
        count = len(output.expressions)
        lines.append(f"{output.name} = {_output(output, texts[:count])}")
        texts = texts[count:]
    quoted = [", ".join(f'"{name}"' for name in group) for group in (names, outputs)]
    lines.append(f"inputs, outputs = [{', '.join(names)}], [{', '.join(outputs)}]")
    lines.append(f'return ca.Function("{function.name}", inputs, outputs, [{quoted[0]}], [{quoted[1]}])')
    return Builder(function.name, _doc(function, inputs, tape), "\n".join("    " + line for line in lines))


def _has_names(argument: Argument) -> bool:
    """Whether the elements are quantities of different kinds with names of their own, not joints."""
    return argument.name in ("parameters", "p", "x", "width") and bool(argument.symbols)


def _unpacked(argument: Argument) -> list[str]:
    """A statement, maybe of several lines, that names the elements of a vector."""
    names = ", ".join(s.name for s in argument.symbols)
    # Nothing but the names' commas is a place where the line may end.
    text = f"({names}{',' if len(argument.symbols) == 1 else ''})~=~ca.vertsplit({argument.name})"
    return [line.replace("~", " ") for line in textwrap.wrap(text, 112, subsequent_indent="    ")]


def _symbol(name: str, shape: tuple[int, ...]) -> str:
    size = "".join(f", {n}" for n in shape)
    return f'{name} = ca.SX.sym("{name}"{size})'


def _elements(name: str, shape: tuple[int, ...]) -> list[str]:
    """CasADi counts down the columns, a SymbolicFunction along the rows; two indices say which is meant."""
    if not shape:
        return [name]
    if len(shape) == 1:
        return [f"{name}[{i}]" for i in range(shape[0])]
    return [f"{name}[{i}, {j}]" for i in range(shape[0]) for j in range(shape[1])]


def _output(output: Output, texts: list[str]) -> str:
    if not output.shape:
        return f"ca.SX({texts[0]})"
    if len(output.shape) == 1:
        return f"ca.SX(ca.vertcat({', '.join(texts)}))"
    width = output.shape[1]
    rows = [f"ca.horzcat({', '.join(texts[i : i + width])})" for i in range(0, len(texts), width)]
    return f"ca.SX(ca.vertcat({', '.join(rows)}))"


def _doc(function: SymbolicFunction, inputs: list[Argument], tape: Tape) -> str:
    """A docstring, wrapped, that no text can end early."""
    names = legend(function, tape)
    lines = [*description(function, inputs, tape), *([f"Names: {names}"] if names else [])]
    wrapped = [
        part
        for line in lines
        for part in textwrap.wrap(line.replace("\\", "/").replace('"', "'"), 112, subsequent_indent="  ")
    ]
    return '"""' + "\n    ".join(wrapped) + '\n    """'
